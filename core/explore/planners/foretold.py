"""The error of the side between the slices, as they themselves foretell it.

Two signs are enough. A curve that knows the curvatures, too, differs from the cubic by about as
much as the cubic differs from the truth; and where slopes and curvatures of both ends do not add
up to the rise of the positions, something lies between. Their weights were fitted to logarithms
of true errors, interval by interval, and the factor of the bound to whole runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.cover import Run, longest_unfelt
from palpate.core.explore.planners.intervals import Profile, Signs, signs_of
from palpate.core.explore.planners.known import Known

HIGHER, CLASH = 0.61, 2.2
"""Trust in the two signs."""
SAFETY = 1.1
"""Bound of 95 % over the foretold error of the whole."""
NOISE = 0.87
"""Of a slice's deviation that is left in the surface between two, with its own margin."""
UNFELT_ORDER = 3.0
"""An interval of which all but a share was felt errs by that share to this power less."""
DEVIATION, LEFT = 0.72, 2.0e-4
"""Bound of 95 % over the deviation that a solid of all that was felt states itself, and what edges
leave that no deviation states, over the extent: from 200 explorations of drawn objects, half of
them with noise."""
SETTLED = 0.5
"""Where noise alone is beyond the tolerance, slices stop when they add less than this of it."""


class Foretold(NamedTuple):
    """What at least two slices say about the side between them; shares of the object's height."""

    signs: Signs
    """Of each interval."""
    errors: Floats
    """Root mean square error of each interval, noise apart; (m - 1,)."""
    shares: Floats
    """Of the side's area; (m - 1,)."""
    curve: float
    """Bound of the error of the whole that comes of too few slices, in 95 of 100 runs."""
    noise: float
    """That which comes of the slices' own deviations, or that the solid states itself."""

    @property
    def bound(self) -> float:
        """Of the error of the whole, in 95 of 100 runs."""
        return math.hypot(self.curve, self.noise)

    def wants_cut(self, tolerance: float) -> bool:
        """Whether further slices would bring down what too few slices leave, and have to."""
        if self.noise < tolerance:
            return self.bound > tolerance
        return self.curve > SETTLED * self.noise

    def wants_average(self, tolerance: float, slices: int, room: int) -> bool:
        """Whether noise is too large, but so many slices would average it away, and there is room.

        Of a solid rebuilt from all that was felt, noise falls with the root of their number.
        """
        return self.noise > tolerance and self.noise * math.sqrt(slices / room) <= tolerance


def foretell(known: Known, profile: Profile, runs: Sequence[Run]) -> Foretold:
    """The errors that at least two slices foretell, and unfelt runs between them."""
    signs = signs_of(profile)
    errors = np.hypot(HIGHER * signs.higher, CLASH * signs.clash)
    if known.taxels:
        heights = (known.low + known.extent * profile.heights).tolist()
        unfelt = np.array([longest_unfelt(runs, *pair) for pair in pairwise(heights)])
        errors *= (unfelt / (known.extent * signs.width)) ** UNFELT_ORDER
    wide = profile.radii.mean(axis=1)
    long = np.sqrt(1.0 + (profile.slopes**2).mean(axis=1))
    areas = signs.width * (wide[:-1] * long[:-1] + wide[1:] * long[1:])
    shares = areas / areas.sum()
    curve = SAFETY * math.sqrt(float((shares * errors**2).sum()))
    return Foretold(signs, errors, shares, curve, _noise(known, signs, shares))


def _noise(known: Known, signs: Signs, shares: Floats) -> float:
    """Bound of what is left of the noise, over the extent."""
    resolution = known.resolution / known.extent
    if known.taxels and known.deviation is not None:
        return math.hypot(DEVIATION * known.deviation / known.extent, resolution, LEFT)
    return math.hypot(NOISE * math.sqrt(float((shares * signs.noise**2).sum())), resolution)
