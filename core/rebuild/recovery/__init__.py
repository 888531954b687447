"""Recovery of a superquadric from points.

It has size, exponents, pose, taper and bend, with covariance and warnings. Starts, trimming and
thresholds of warnings are fields of settings classes; distances and derivatives are closed forms.
The package uses `palpate.core.shapes` and the batched least squares of core.
"""

from palpate.core.rebuild.recovery.distances import (
    Warps as Warps,
    distances_alone as distances_alone,
    normal_distances as normal_distances,
)
from palpate.core.rebuild.recovery.fitting import (
    RecoverySettings as RecoverySettings,
    recover as recover,
)
from palpate.core.rebuild.recovery.report import (
    Recovery as Recovery,
)
