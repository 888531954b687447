"""Recovery of a superquadric from points.

Size, exponents, pose, taper and bend, with covariance and reasons for doubt. Starts, trimming and
thresholds of warnings may be tuned; distances and derivatives are closed forms. It rests on
`palpate.core.shapes` and the batched least squares of core; it knows no contours.
"""

from palpate.core.rebuild.recovery.distances import (
    Warps as Warps,
    distances_alone as distances_alone,
    normal_distances as normal_distances,
)
from palpate.core.rebuild.recovery.fitting import (
    recover as recover,
)
from palpate.core.rebuild.recovery.report import (
    Recovery as Recovery,
)
