"""Where a round end closes that nobody touched.

The squared radius of a quadric is a quadratic of the height, so the last contours of a ball, an
ellipsoid or a paraboloid say where it becomes zero. Those of a cylinder say nothing.
"""

from __future__ import annotations

import math

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import Trend, trend_of

FEWEST = 4
"""Contours: three for the quadratic, one to test it."""
MISS = 0.03
"""Of the squared radius: most that the fourth contour may be missed by."""
NOISES = 4.0
"""The same in standard deviations of its mean radius, as a share of it."""
FARTHEST = 2.0
"""Spacings of the last contours: most that the pole may lie beyond them."""
NARROWED = 0.75
"""Squared radius of the last contour, as a share of the fourth's: a pole is near only if the
contours have begun to narrow."""
NEARLY_REAL = 0.15
"""Imaginary over real part of a root that noise has lifted off the axis."""


def free_pole(depths: Floats, radii: Floats, scatter: float) -> float | None:
    """How far beyond the last contour the solid closes; None where nobody can know.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the contours, ascending.
    radii : (n,) array
        Mean radii there, positive.
    scatter : float
        Standard deviation of a mean radius.
    """
    if len(depths) < FEWEST:
        return None
    trend = trend_of(depths, radii)
    fourth = float(radii[-FEWEST]) ** 2
    miss = abs(trend.at(float(depths[-FEWEST] - depths[-1])) - fourth) / fourth
    told = miss < MISS + NOISES * scatter / float(radii[-FEWEST])
    narrows = trend.slope < 0.0 and trend.square < NARROWED * fourth
    pole = _first_root(trend)
    near = pole < FARTHEST * float(depths[-1] - depths[-2])
    return pole if told and narrows and near else None


def _first_root(trend: Trend) -> float:
    """The nearest positive root, or the real part of one that is nearly real; else infinity."""
    half, square = -0.5 * trend.slope, trend.square
    inside = half * half - trend.bend * square
    if inside >= 0.0:
        # Of both forms the one without cancellation; both roots are positive or one is.
        larger = half + math.copysign(math.sqrt(inside), half)
        roots = [square / larger if larger else math.inf]
        roots.append(larger / trend.bend if trend.bend else math.inf)
        return min((root for root in roots if root > 0.0), default=math.inf)
    real = half / trend.bend
    imaginary = math.sqrt(-inside) / abs(trend.bend)
    return real if real > 0.0 and imaginary < NEARLY_REAL * real else math.inf
