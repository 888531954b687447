"""Template of a planner: first what was not felt, then what bows. Make it yours.

Name it in a scene, and start palpate in the folder of this file:

    explore:
      planner: template:Template
      settings: {most_bow: 4.0}

What a planner is told, and what it may answer: `palpate.core.explore.planners.known` and
`palpate.core.explore.planners.choice`. It remembers nothing: all that it goes by is in `known`, so
that a recorded run can be planned again. Every length is in one unit, but it is not said which:
compare lengths with lengths that are given, and put no number of your own beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np

from palpate.core.explore.planners.choice import (
    Choice,
    Height,
    Stop,
    Wait,
    first_and_last,
    spent,
)
from palpate.core.explore.planners.cover import Run, free_height, longest_first, unfelt_runs
from palpate.core.explore.planners.known import Known
from palpate.core.ranges import Range, check_ranges


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """Goes where nothing was felt, and then to where the side bows between two slices."""

    most_bow: Annotated[float, Range(0.1, 100.0, "1")] = 4.0
    """Bow between two slices over the tolerance: above 1, for the slopes tell most of it."""

    def __post_init__(self) -> None:
        check_ranges(self)

    def next(self, known: Known) -> Choice:
        """The next slice, or that there is none: called whenever a slice has come back."""
        # Between the first and the last height: the ends themselves are touched in another way.
        low, high = first_and_last(known)
        runs = unfelt_runs(known)
        unfelt = max((run.length for run in runs), default=0.0)
        over = spent(known)
        if over is not None:
            return Stop(over, within=False, unfelt=unfelt)
        # Never where a slice was tried, whatever came of it, and never near another finger.
        for wanted in (0.5 * (low + high), high, low):
            height = free_height(known, wanted, Run(wanted, wanted))
            if height is not None:
                return Height(height, "the middle, the top and the bottom come first")
        height = _middle(known, [run for run in runs if run.length > known.feature])
        if height is not None:
            return Height(height, "nothing was felt there")
        bowed = [run for run, bow in _bows(known) if bow > self.most_bow * known.tolerance]
        height = _middle(known, bowed)
        if height is not None:
            return Height(height, "the side bows there")
        if known.taken:
            return Wait("other fingers are at work on what is left")
        if unfelt > known.feature:
            return Stop("what is left unfelt cannot be reached", within=False, unfelt=unfelt)
        said = "all was felt" + (", but it bows where there is no room" if bowed else "")
        return Stop(said, within=not bowed, unfelt=unfelt)


def _middle(known: Known, runs: Sequence[Run]) -> float | None:
    """The middle of the longest stretch that has room for one slice more."""
    for run in longest_first(runs, known.feature):
        height = free_height(known, run.middle, run)
        if height is not None:
            return height
    return None


def _bows(known: Known) -> list[tuple[Run, float]]:
    """Stretches between slices, and how far the side bows out from the straight line there."""
    # A slice that could not be traced tells nothing; nor does one beyond an end that has moved.
    inside = [one for one in known.slices if one.usable and known.low < one.height < known.high]
    found = []
    for below, above in pairwise(sorted(inside, key=lambda one: one.height)):
        run = Run(below.height, above.height)
        # An arc that turns by an angle rises over its chord by an eighth of both.
        turns = np.arctan(above.slopes) - np.arctan(below.slopes)
        chords = np.hypot(run.length, above.radii - below.radii)
        found.append((run, float(np.abs(turns * chords).mean()) / 8.0))
    return found
