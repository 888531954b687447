"""What an exploration is busy with: the top, the slices, the top once more, the cap."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.core.arrays import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Top:
    """Looking for the object from above."""

    places: tuple[Floats, ...]
    """Where to look next."""


@dataclass(frozen=True, slots=True, eq=False)
class Slices:
    """Tracing slices."""

    heights: tuple[float, ...]
    """Heights still to be traced, the one under way first, m."""
    retried: bool = False
    """True if the one under way is a second try."""
    top_is_sure: bool = False
    """True once the top has been felt over the middle of a contour."""


@dataclass(frozen=True, slots=True, eq=False)
class Summit:
    """Feeling the top again: the first touch from above was far from the object's middle."""

    heights: tuple[float, ...]
    """Heights still to be traced if the top is as high as was thought, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Cap:
    """Touching the top once the contours are there."""

    places: tuple[Floats, ...]
    """Where to touch next, the one under way first."""
