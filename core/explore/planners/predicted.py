"""The planner that foretells the error: it cuts where that is largest, and leaves nothing unfelt.

A coarse cover first, of an odd number, so that the middle is among it. Then, while the error
that the slices foretell is too large, the height that brings it down with the fewest slices; when
it is small enough, the middle of what no pad has felt. An error foretold says nothing about what
lies between two pads, which is why both are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np

from palpate.core.explore.planners.choice import (
    END_DEVIATIONS,
    Choice,
    Height,
    Stop,
    Wait,
    first_and_last,
    spent,
)
from palpate.core.explore.planners.cover import (
    Run,
    even_places,
    free_height,
    longest_first,
    unfelt_runs,
)
from palpate.core.explore.planners.cuts import Costs, best_cut
from palpate.core.explore.planners.foretold import Foretold, foretell
from palpate.core.explore.planners.intervals import profile_of
from palpate.core.explore.planners.known import Known
from palpate.core.ranges import Range, check_ranges

COVERING, FEELING = "the coarse cover", "nothing has felt what lies there"
"""Reasons of slices that no error has asked for."""
ROOM = 2.0
"""Slices that only average noise lie at least so many features apart."""
COVER_REACH = 0.12
"""A slice so near to where one of the cover was wanted stands for it; of the height."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """The default planner."""

    cover: Annotated[int, Range(3, 99, "1")] = 3
    """Slices before any error is foretold; odd."""
    suspicion: Annotated[float, Range(0.0, 1.0, "1")] = 0.04
    """Error that an unfelt stretch may hide, over the height, by the square of its share."""
    order: Annotated[float, Range(1.0, 6.0, "1")] = 3.0
    """An interval cut into m parts is expected to err by m to this power less."""
    travel: Annotated[float, Range(0.0, 1.0, "1")] = 0.02
    """Cost of moving by the whole height, over that of a slice."""

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.cover % 2 == 0:
            raise ValueError(f"cover must be odd, so that the middle is in it, got {self.cover}")

    def next(self, known: Known) -> Choice:
        """The next slice, or that the demand is met, or that nothing more can be done."""
        profile, runs = profile_of(known), unfelt_runs(known)
        foretold = foretell(known, profile, runs) if len(profile.heights) > 1 else None
        bound = None if foretold is None else foretold.bound * known.extent
        unfelt = max((run.length for run in runs), default=0.0)
        over = spent(known)
        if over is not None:
            return Stop(over, False, bound, unfelt)
        height = self._covering(known)
        if height is not None:
            return Height(height, COVERING)
        if foretold is not None and foretold.wants_cut(known.tolerance / known.extent):
            costs = Costs(self.suspicion, self.order, self.travel)
            height = best_cut(known, profile.heights, foretold, runs, costs)
            if height is not None:
                height = _along_with(known, runs, height)
                return Height(height, "the foretold error is largest there")
        height = _unfelt_height(known, runs) if foretold else None
        if height is not None:
            return Height(height, FEELING)
        if foretold is not None and known.taxels and _may_average(known, foretold):
            height = _widest_free(known)
            if height is not None:
                return Height(height, "noise is averaged there")
        if known.taken:
            return Wait("other fingers are at work where there is something left to do")
        return _end(known, foretold, unfelt)

    def _covering(self, known: Known) -> float | None:
        """The first height of the cover, from the middle, for which no slice stands yet."""
        low, high = first_and_last(known)
        heights = np.linspace(low, high, self.cover)
        reach = min(COVER_REACH * known.extent, 0.4 * (high - low) / (self.cover - 1))
        there = [*(one.height for one in known.slices if one.usable), *known.taken]
        middle = self.cover // 2
        for i in sorted(range(self.cover), key=lambda i: (abs(i - middle), -i)):
            wanted = float(heights[i])
            part = Run(max(low, wanted - reach), min(high, wanted + reach))
            if any(part.low <= one <= part.high for one in there):
                continue
            height = free_height(known, wanted, part)
            if height is not None:
                return height
        return None


def _unfelt_height(known: Known, runs: Sequence[Run]) -> float | None:
    """Where to feel what was not felt: into the longest run, m.

    Beside other fingers, where the most slices are left so close together that only one finger
    at a time can trace them: else they are left over for a single one.
    """
    wanted = [run for run in longest_first(runs, known.feature) if run.length > known.feature]
    if not known.taken:
        found = (_into(known, run) for run in wanted)
        return next((height for height in found if height is not None), None)
    places = [place for run in wanted for place in even_places(known, run)]
    crowds = [sum(abs(place - other) < known.apart for other in places) for place in places]
    order = sorted(range(len(places)), key=lambda i: -crowds[i])
    runs_of = [run for run in wanted for _ in even_places(known, run)]
    tried = (free_height(known, places[i], runs_of[i]) for i in order)
    return next((height for height in tried if height is not None), None)


def _into(known: Known, run: Run, wanted: float | None = None) -> float | None:
    """Where to begin to feel an unfelt run: in its middle, or nearest to a wanted height, m."""
    places = even_places(known, run)
    at = places[len(places) // 2]
    if wanted is not None:
        at = min(places, key=lambda place: abs(place - wanted))
    return free_height(known, at, run)


def _along_with(known: Known, runs: Sequence[Run], wanted: float) -> float:
    """A wanted height, moved so that its slice is one of those that feel an unfelt run evenly."""
    if known.taxels:
        for run in runs:
            if run.low <= wanted <= run.high and run.length > known.feature:
                return _into(known, run, wanted) or wanted
    return wanted


def _may_average(known: Known, foretold: Foretold) -> bool:
    usable = sum(one.usable for one in known.slices)
    room = int(known.extent / (ROOM * known.feature))
    return foretold.wants_average(known.tolerance / known.extent, usable, max(room, usable))


def _widest_free(known: Known) -> float | None:
    """Middle of the widest stretch between slices that has room for one more, m."""
    bottom, top = first_and_last(known)
    between = (*(one.height for one in known.slices), *known.taken)
    heights = sorted({bottom, top, *(one for one in between if bottom < one < top)})
    runs = [Run(*pair) for pair in pairwise(heights)]
    found = (free_height(known, run.middle, run) for run in longest_first(runs, known.feature))
    return next((height for height in found if height is not None), None)


def _end(known: Known, foretold: Foretold | None, unfelt: float) -> Stop:
    if foretold is None:
        return Stop("fewer than two slices could be traced", False, None, unfelt)
    bound, noise = foretold.bound * known.extent, foretold.noise * known.extent
    loose = END_DEVIATIONS * max(known.low_deviation, known.high_deviation)
    small, felt = bound <= known.tolerance, max(unfelt, loose) <= known.feature
    if small and felt:
        said = "the error is within tolerance, and nothing larger than a feature is unfelt"
    elif small and loose > known.feature:
        said = "the error of the side is within tolerance, but where the object ends is uncertain"
    elif small:
        said = "the error is within tolerance, but what is left unfelt cannot be reached"
    elif noise > known.tolerance:
        said = "the noise of the slices is beyond the tolerance, and no further slice takes it away"
    else:
        said = "the slices lie as close as they may, and the error is not within tolerance"
    return Stop(said, small and felt, bound, max(unfelt, loose))


PLANNER = Predicted
