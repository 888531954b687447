"""A solid of any genus from touched points with normals.

`rebuild_general` returns a `GeneralSolid`: topology from a coarse solution, then an implicit spline
over a narrow band of cells, whose control values lie on a grid. `GeneralSettings` holds all that is
tuned. It rests on core geometry and the points of `palpate.core.rebuild.contours`.
"""

from palpate.core.rebuild.general.edges import (
    Edges as Edges,
    find_edges as find_edges,
    sharpened as sharpened,
)
from palpate.core.rebuild.general.errors import touch_distances as touch_distances
from palpate.core.rebuild.general.orientation import (
    Orientation as Orientation,
    oriented as oriented,
)
from palpate.core.rebuild.general.rebuilding import (
    fitting_cell as fitting_cell,
    is_flat as is_flat,
    rebuild_general as rebuild_general,
    tears as tears,
)
from palpate.core.rebuild.general.settings import (
    DEFAULT_GENERAL as DEFAULT_GENERAL,
    GeneralSettings as GeneralSettings,
)
from palpate.core.rebuild.general.solid import (
    GeneralSolid as GeneralSolid,
    protrusions as protrusions,
    touch_squares as touch_squares,
)
from palpate.core.rebuild.general.walls import (
    wall_cell as wall_cell,
    wall_thickness as wall_thickness,
)
