"""Which family an end of known height belongs to: the one that would have told the last contour.

The last contour is left out, and each family predicts its radius from the others.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import Profile, conic, flat, superellipse, trend_of

FEWEST = 12
"""With fewer contours they lie too far apart for a test by the last one."""
SLACK = 0.004
"""Of the largest radius: families that predict within this are equally good; the plainest is
taken."""
NOISES = 2.0
"""The same in standard deviations of a mean radius."""
STANDS = 0.5
"""Squared radius, as a share of the last contour's, that is carried on to a flat end."""

Kind = Literal["flat", "conic", "superellipse"]
FAMILIES: dict[Kind, Callable[[Floats, Floats, float], Profile]] = {
    "flat": flat,
    "conic": conic,
    "superellipse": superellipse,
}
"""The plainest first."""


class Choice(NamedTuple):
    """A family and its profile."""

    kind: Kind
    profile: Profile
    misses: dict[Kind, float]
    """By how much each family missed the last contour's radius; none with few contours."""


def choose_profile(depths: Floats, radii: Floats, end: float, scatter: float) -> Choice:
    """Profile of an end whose height is known.

    Parameters
    ----------
    depths : (n,) array
        Outward coordinates of the contours, ascending.
    radii : (n,) array
        Mean radii there, positive.
    end : float
        Outward coordinate of the end, beyond the last contour.
    scatter : float
        Standard deviation of a mean radius.
    """
    if len(depths) < FEWEST:
        carried = trend_of(depths, radii)
        stands = carried.at(end - float(depths[-1])) > STANDS * carried.square
        kind: Kind = "flat" if stands else "conic"
        misses: dict[Kind, float] = {}
    else:
        misses = _misses(depths, radii, end)
        enough = min(misses.values()) + max(NOISES * scatter, SLACK * float(radii.max()))
        kind = next(name for name, miss in misses.items() if miss <= enough)
    return Choice(kind, FAMILIES[kind](depths, radii, end), misses)


def _misses(depths: Floats, radii: Floats, end: float) -> dict[Kind, float]:
    known, seen = depths[:-1], radii[:-1]
    way = np.array([(depths[-1] - known[-1]) / (end - known[-1])])
    return {
        name: abs(float(seen[-1] * family(known, seen, end).shares(way)[0] - radii[-1]))
        for name, family in FAMILIES.items()
    }
