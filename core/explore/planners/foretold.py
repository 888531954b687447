"""The error of the side between the slices, as they themselves foretell it.

Two signs are enough. A curve that knows the curvatures, too, differs from the cubic by about as
much as the cubic differs from the truth; and where slopes and curvatures of both ends do not add
up to the rise of the positions, something lies between. Their weights were fitted to logarithms
of true errors, interval by interval, and the factor of the bound to whole runs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.intervals import Profile, Signs, signs_of
from palpate.core.explore.planners.known import Known

HIGHER, CLASH = 0.61, 2.2
"""Trust in the two signs."""
SAFETY = 1.1
"""Bound of 95 % over the foretold error of the whole."""
NOISE = 0.87
"""Of a slice's deviation that is left in the surface between two, with its own margin."""
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
    """That which comes of the slices' own deviations: no further slice takes it away."""

    @property
    def bound(self) -> float:
        """Of the error of the whole, in 95 of 100 runs."""
        return math.hypot(self.curve, self.noise)

    def wants_cut(self, tolerance: float) -> bool:
        """Whether further slices would bring the error down, and have to."""
        if self.noise < tolerance:
            return self.bound > tolerance
        return self.curve > SETTLED * self.noise


def foretell(known: Known, profile: Profile) -> Foretold:
    """The errors that at least two slices foretell."""
    signs = signs_of(profile)
    errors = np.hypot(HIGHER * signs.higher, CLASH * signs.clash)
    wide = profile.radii.mean(axis=1)
    long = np.sqrt(1.0 + (profile.slopes**2).mean(axis=1))
    areas = signs.width * (wide[:-1] * long[:-1] + wide[1:] * long[1:])
    shares = areas / areas.sum()
    resolution = known.resolution / known.extent
    curve = SAFETY * math.sqrt(float((shares * errors**2).sum()))
    noise = NOISE * math.sqrt(float((shares * signs.noise**2).sum()))
    return Foretold(signs, errors, shares, curve, math.hypot(noise, resolution))
