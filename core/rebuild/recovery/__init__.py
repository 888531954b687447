"""Recovery of a superquadric from points.

Size, exponents, pose, taper and bend, with covariance and reasons for doubt. Starts, trimming
and the thresholds of each warning may be tuned; distances and their derivatives are closed
forms. It rests on `palpate.core.shapes` and on the batched least squares of core; nothing here
knows of contours.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.rebuild.recovery.distances import Warps as Warps
    from palpate.core.rebuild.recovery.distances import distances_alone as distances_alone
    from palpate.core.rebuild.recovery.distances import normal_distances as normal_distances
    from palpate.core.rebuild.recovery.fitting import recover as recover
    from palpate.core.rebuild.recovery.report import Recovery as Recovery
else:
    __getattr__, __dir__ = lazy(__name__)
