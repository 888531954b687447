"""Where there is no way on, the contour is met again from outside, farther round."""

from __future__ import annotations

import math

from palpate.core.arrays import Floats
from palpate.core.explore.begin import Start, approach
from palpate.core.explore.cut import Cut
from palpate.core.explore.march import Stride, filled
from palpate.core.explore.path import Path, path_of
from palpate.core.explore.routine import Routine

LEAP = math.radians(30.0)
"""Between the directions that are tried, at most."""
ROUNDING = 1e-9
"""Of a leap: a direction that is farther by less is not one more."""


def leap(cut: Cut, path: Path, centre: Floats, radius: float) -> Routine[Stride | None]:
    """The contour met again beyond a stretch that cannot be followed, or None.

    Approaches come from ever farther round, the last from where the contour began; then the
    stretch between is probed like any gap.

    Parameters
    ----------
    cut : Cut
        The slice and the pad.
    path : Path
        What has been traced.
    centre : (2,) array
        Where the object's axis is expected, m.
    radius : float
        Distance from which the pad approaches, m.
    """
    first, last = path.points[0, :2] - centre, path.points[-1, :2] - centre
    from_ = math.atan2(last[1], last[0])
    left = (math.atan2(first[1], first[0]) - from_) % (2.0 * math.pi)
    leaps = max(math.ceil(left / LEAP - ROUNDING), 1)
    for number in range(1, leaps + 1):
        azimuth = from_ + left * number / leaps
        found = yield from approach(cut, centre, radius, azimuth)
        if isinstance(found, Start):
            stride = Stride(path_of(found.felt), found.heading, found.stance)
            return (yield from filled(cut, path, stride))
    return None
