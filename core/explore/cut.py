"""The slice under way and the pad that follows it: what every length of the tracer goes by."""

from __future__ import annotations

from typing import NamedTuple

from palpate.core.touch.pad import Pad

JOINED = 2.0 / 15.0
"""Points farther apart than this have a gap between them; in widths of the pad."""
LEAST_JOINED = 1.6
"""But points of neighbouring taxels never have; in pitches."""


class Cut(NamedTuple):
    """A slice, and the pad that follows it."""

    pad: Pad
    """The array."""
    height: float
    """Height of the slice in the slicing frame, m."""

    @property
    def width(self) -> float:
        """Width of the array, its smaller side, m."""
        return self.pad.pitch * (min(self.pad.rows, self.pad.cols) - 1)

    @property
    def joined(self) -> float:
        """Points that lie no farther apart than this follow each other, m."""
        return max(JOINED * self.width, LEAST_JOINED * self.pad.pitch)
