"""From contacts to a closed solid.

`reconstruct` makes a `LatticeSolid` of contours, normals and contact points, in closed form at
every place: from evidence to the side, its ends, and the surface. `Solid` is the interface of all
solids. Thresholds are fields of settings classes beside each algorithm (fractions of a size,
standard deviations, counts); each method may be replaced alone. The package is built on those
below (contours, side, ends, surface, lattice, recovery); `palpate.core.thesis` adds a method.
"""

from palpate.core.rebuild.coarse import (
    fit_coarse as fit_coarse,
)
from palpate.core.rebuild.evidence import (
    Evidence as Evidence,
)
from palpate.core.rebuild.general import (
    GeneralSolid as GeneralSolid,
    rebuild_general as rebuild_general,
)
from palpate.core.rebuild.protocol import (
    HasTriangles as HasTriangles,
    MeshSolid as MeshSolid,
    Solid as Solid,
    SolidCheck as SolidCheck,
    SolidMeasures as SolidMeasures,
)
from palpate.core.rebuild.reconstruction import (
    plugin_method as plugin_method,
    reconstruct as reconstruct,
)
from palpate.core.rebuild.recovery import (
    recover as recover,
)
from palpate.core.rebuild.solid import (
    LatticeSolid as LatticeSolid,
    Method as Method,
)
