"""Where a rounded end closes that nobody touched.

Contours that narrow faster and faster towards an end, as those of a rounded box do, follow a
superellipse whose height is one more unknown. Those of a cylinder say nothing of it.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import EXPONENTS, SHOULDER_CONTOURS, shoulder

FEWEST = 12
"""Contours: with fewer they lie too far apart to show how an edge is rounded."""
NARROWED = 0.75
"""Squared radius of the last contour, as a share of the fourth's: an end is near only if the
contours have begun to narrow."""
WAYS = np.geomspace(0.02, 1.0, 48)
"""Heights of the end over the last contour that are tried, in spacings of the last two."""
MISS = 0.004
"""Of the largest radius: what the contours may be missed by."""
NOISES = 2.0
"""The same in standard deviations of a mean radius."""


def free_shoulder(depths: Floats, radii: Floats, scatter: float) -> float | None:
    """How far beyond the last contour the solid closes; None where nobody can know.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the contours, ascending.
    radii : (n,) array
        Mean radii there, positive.
    scatter : float
        Standard deviation of a mean radius.

    Notes
    -----
    For each height and pair of exponents the width follows by projection, for all at once.
    """
    if len(depths) < FEWEST or not radii[-1] ** 2 < NARROWED * radii[-4] ** 2:
        return None
    begin = float(depths[-(len(depths) // 2 + 1)])
    ways = (depths[-1] - depths[-2]) * WAYS
    near, seen = depths[-SHOULDER_CONTOURS:], radii[-SHOULDER_CONTOURS:]
    zeta = (near - begin) / (depths[-1] + ways[:, None] - begin)
    misses = np.array([_miss(each, seen) for each in zeta])
    best = int(misses.argmin())
    allowed = MISS * float(radii.max()) + NOISES * scatter
    return float(ways[best]) if misses[best] < allowed else None


def _miss(zeta: Floats, seen: Floats) -> float:
    """By how much the best superellipse misses radii (n,), root mean square."""
    shares = shoulder(zeta, EXPONENTS[:, None, None], EXPONENTS[:, None])
    wide = shares @ seen / np.einsum("pqn,pqn->pq", shares, shares)
    square = np.sum((wide[:, :, None] * shares - seen) ** 2, axis=-1)
    return float(np.sqrt(square.min() / len(seen)))
