"""From contacts to a closed solid.

`reconstruct` takes contours, normals and contact points and answers a `LatticeSolid`, exact at
every place: from evidence to the side, its ends, the surface. `Solid` is what it has in common with
all other solids. What may be tuned are the thresholds on top of each chapter (shares of a size,
standard deviations, counts); each method may be replaced alone. It rests on the rooms below
(contours, side, ends, surface, lattice, recovery); `palpate.core.thesis` adds a method.
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
    other_method as other_method,
    reconstruct as reconstruct,
)
from palpate.core.rebuild.recovery import (
    recover as recover,
)
from palpate.core.rebuild.solid import (
    LatticeSolid as LatticeSolid,
    Method as Method,
)
