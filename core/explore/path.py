"""What of a contour has been traced, and the stretches of it that could not be felt."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.explore.felt import Felt

Why = Literal["bridged", "missed"]
"""The pad touched beside the stretch, or over it, but not in it; or it touched nothing there."""
LEAST_POINTS = 10
"""Fewer points have no winding."""


class Gap(NamedTuple):
    """A stretch between two points of a contour that could not be felt."""

    start: Floats
    """Its last point before, (3,), m."""
    end: Floats
    """The first one after, (3,), m."""
    why: Why
    """What the pad felt there."""

    @property
    def extent(self) -> float:
        """Distance between its ends, m."""
        return float(np.linalg.norm(self.end - self.start))


class Path(NamedTuple):
    """What has been traced so far, in the slicing frame."""

    points: Floats
    """(n, 3), m."""
    normals: Floats
    """(n, 3)."""
    across: Floats
    """(n,), 1/m."""
    low: Floats
    """Lowest height felt below each point, (n,), m."""
    high: Floats
    """Highest height felt above it, (n,), m."""

    def joined(self, other: Path) -> Path:
        """Append another path."""
        return Path(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def part(self, chosen: Bools | Ints | slice) -> Path:
        """Take some of its points."""
        return Path(*(field[chosen] for field in self))

    def felt_again(self, felt: Felt, near: float) -> Path:
        """Stretch the bands to what another touch has felt within `near` of the points, m."""
        if not len(felt.points):
            return self
        apart = np.linalg.norm(self.points[:, None, :2] - felt.points[None, :, :2], axis=2)
        met, nearest = apart.min(axis=1) < near, apart.argmin(axis=1)
        low = np.where(met, np.minimum(self.low, felt.low[nearest]), self.low)
        high = np.where(met, np.maximum(self.high, felt.high[nearest]), self.high)
        return self._replace(low=low, high=high)


def path_of(felt: Felt) -> Path:
    """The arc of a touch."""
    return Path(felt.points, felt.normals, felt.across, felt.low, felt.high)


def winding(points: Floats) -> float:
    """Angle swept about the middle of points (n, 3), rad; 0 for fewer than ten."""
    if len(points) <= LEAST_POINTS:
        return 0.0
    away = points[:, :2] - points[:, :2].mean(axis=0)
    angle = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return float(angle[-1] - angle[0])


def heading_across(chord: Floats) -> float:
    """Azimuth of the outward normal of a contour that runs along a chord (2,), rad."""
    return math.atan2(-chord[0], chord[1])
