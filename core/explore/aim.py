"""How the pad is held while it follows a contour, and where it is sent."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import pad_rotation, pose_of

PRESS = 1.5e-3
"""Depth of a plain touch, m: half of the pad. Shallower ones feel less at once: at 1 mm a contour
takes a fifth more touches, and a band is lower by as much."""
DEEP_PRESS = 2.35e-3
"""Depth where a plain one does not reach into a hollow, m."""
MOST_TILT = 1.45
"""The pad is tilted no farther than this, rad: at a pole a contour has no heading."""


class Stance(NamedTuple):
    """How the pad is held; carried from touch to touch."""

    tilt: float = 0.0
    """Elevation of the outward normal that the pad expects, rad."""
    shift: float = 0.0
    """The contour lies this far from the pad's middle along its y axis, m."""
    depth: float = PRESS
    """Depth of press, m."""
    frozen: bool = False
    """True once a search has found a stance that works: it is then kept for the contour."""
    failed_searches: int = 0
    """Searches in a row that found none."""
    contact: float = math.inf
    """Half the length of the arc that a searched stance felt first, m."""


UPRIGHT = Stance()
"""How the pad is held before anything is known."""


class Aim(NamedTuple):
    """One touch, in the slicing frame."""

    place: Floats
    """Where the contour is expected, (2,), m."""
    heading: float
    """Azimuth of the expected outward normal, rad."""
    standoff: float
    """Distance before the place from which the pad starts, m."""
    reach: float
    """How far past the place it may go, m."""
    stance: Stance
    """How it is held."""

    def start(self, height: float) -> Floats:
        """Pose (7,) from which the pad moves, for a slice at this height."""
        axes = pad_rotation(self.heading, self.stance.tilt)
        target = np.array([self.place[0], self.place[1], height])
        target = target + self.stance.shift * axes[:, 1]
        return pose_of(target - self.standoff * axes[:, 2], axes)

    @property
    def travel(self) -> float:
        """Longest way of the guarded move, m."""
        return self.standoff + self.reach
