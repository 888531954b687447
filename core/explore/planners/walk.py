"""The thesis' way over an object: from half height to one end, then to the other (3.2.2).

Each step follows from the curvature of the slice that was traced last, and from its change. All
lengths are over the object's height, curvatures times it: as printed, in 1/length, the same rule
gave 15, 5 and 3 contours for one vase in three units.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.explore.planners.choice import (
    SAME,
    Choice,
    Height,
    Stop,
    Wait,
    blocked,
    first_and_last,
    spent,
    tried,
)
from palpate.core.explore.planners.known import Known, Outcome, Slice

MOST_FAILURES = 3
"""In a row; then the search in this direction ends."""
SHORTER = (1.0, 0.75, 0.6, 0.4)
"""A step that would lead to where a slice has failed is taken so much shorter."""


class Ends(NamedTuple):
    """When the search in one direction is over, short of the object's end."""

    threshold: float
    """A step upwards below this share of the height ends it; 0: never."""
    perimeter: float
    """So does a contour shorter than this share of the height: a pole is near."""


class Steps(Protocol):
    """How far to go; shares of the height."""

    def first(self, bend: float) -> float:
        """From half height; `bend` is the mean curvature there, times the height."""
        ...

    def later(self, bend: float, change: float, count: int) -> float:
        """From the `count`-th slice beyond half height; `change` against the one before it."""
        ...


def walk(known: Known, steps: Steps, ends: Ends) -> Choice:
    """The next slice of a search in one direction and then in the other."""
    over = spent(known)
    if over is not None:
        return Stop(over, None)
    if not known.slices:
        middle = 0.5 * (known.low + known.high)
        return (
            Wait("the first slice is under way") if known.taken else Height(middle, "half height")
        )
    start = known.slices[0]
    if not start.usable:
        return Stop(f"the slice at half height, {start.height:g} m, could not be traced", False)
    up = 1.0 if mean_rise(start) >= 0.0 else -1.0
    for direction in (up, -up):
        if any((height - start.height) * direction > 0.0 for height in known.taken):
            continue
        height = _onwards(known, steps, ends, direction)
        if height is not None and not blocked(known, height):
            return Height(height, "upwards" if direction > 0.0 else "downwards")
        if height is not None:
            return Wait("another finger is too near")
    if known.taken:
        return Wait("a step follows from the slice before it, which is under way")
    return Stop("the search has ended in both directions", None)


def _onwards(known: Known, steps: Steps, ends: Ends, direction: float) -> float | None:
    """The next height in this direction, m; None where the search in it is over."""
    start = known.slices[0]
    way = [one for one in known.slices[1:] if (one.height - start.height) * direction > 0.0]
    if any(one.outcome is Outcome.LOST for one in way):
        return None
    usable = [start, *(one for one in way if one.usable)]
    last = usable[-1]
    failures = next((i for i, one in enumerate(reversed(way)) if one.usable), len(way))
    bottom, top = first_and_last(known)
    # The ends may have been moved since; where a slice lies beyond them, the way begins at them.
    here, end = min(max(last.height, bottom), top), top if direction > 0.0 else bottom
    if failures >= MOST_FAILURES or (end - here) * direction <= SAME * known.extent:
        return None
    if 2.0 * math.pi * float(last.radii.mean()) < ends.perimeter * known.extent:
        return None
    bend = mean_bend(last, known.extent)
    if len(usable) == 1:
        step = steps.first(bend)
    else:
        change = abs(bend - mean_bend(usable[-2], known.extent))
        step = steps.later(bend, change, len(usable) - 1)
        if direction > 0.0 and step < ends.threshold:
            return None
    step = min(step * known.extent * 0.5**failures, (end - here) * direction)
    for shorter in SHORTER:
        height = here + direction * step * shorter
        if not tried(known, height):
            return height
    return None


def mean_bend(one: Slice, extent: float) -> float:
    """Mean curvature along the height, without its sign, times the object's height.

    A hollow calls for steps as small as a bulge does; with its sign the step of a hollow would
    exceed the largest.
    """
    return float(np.abs(one.curvatures).mean()) * extent


def mean_rise(one: Slice) -> float:
    """Mean upward component of the outward unit normals (the thesis' phi)."""
    radii, turn = one.radii, 2.0 * math.pi / len(one.radii)
    around = (np.roll(radii, -1) - np.roll(radii, 1)) / (2.0 * turn) / radii
    return float(np.mean(-one.slopes / np.sqrt(1.0 + one.slopes**2 + around**2)))
