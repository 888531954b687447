"""Template of a planner: first what was not touched, then what bows. Make it yours.

Name it in a scene, and start palpate in the folder of this file:

    explore:
      planner: template:Template
      settings: {most_bow: 4.0}

What a planner is told, and what it may answer: `palpate.planning.Observation` and
`palpate.planning.Choice`. It remembers nothing: all that it goes by is in `observation`, so
that a recorded run can be planned again. Every length is in one unit, but it is not said which:
compare lengths with lengths that are given, and put no number of your own beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from palpate.core.plugins import Range, check_ranges
from palpate.planning import (
    Choice,
    Height,
    Observation,
    Span,
    Stop,
    Wait,
    exhausted_budget,
    first_and_last,
    free_height,
    longest_first,
    untouched_spans,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """Goes where nothing was touched, and then to where the side bows between two slices."""

    # Bow between two slices over the tolerance: above 1, for the slopes tell most of it.
    most_bow: Annotated[float, Range(0.1, 100.0, "1")] = 4.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def next(self, observation: Observation) -> Choice:
        """The next slice, or that there is none: called whenever a slice has come back."""
        # Between the first and the last height: the ends themselves are touched in another way.
        low, high = first_and_last(observation)
        spans = untouched_spans(observation)
        over = exhausted_budget(observation)
        if over is not None:
            return Stop(over)
        # Never where a slice was tried, whatever came of it, and never near another finger.
        for wanted in (0.5 * (low + high), high, low):
            height = free_height(observation, wanted, Span(wanted, wanted))
            if height is not None:
                return Height(height, "the middle, the top and the bottom come first")
        height = _middle(observation, [span for span in spans if span.length > observation.feature])
        if height is not None:
            return Height(height, "nothing was touched there")
        bowed = [
            span for span, bow in _bows(observation) if bow > self.most_bow * observation.tolerance
        ]
        height = _middle(observation, bowed)
        if height is not None:
            return Height(height, "the side bows there")
        if observation.busy_heights:
            return Wait("other fingers are at work on what is left")
        if any(span.length > observation.feature for span in spans):
            return Stop("what is left cannot be reached")
        return Stop("all was touched" + (", but it bows where there is no room" if bowed else ""))


def _middle(observation: Observation, spans: Sequence[Span]) -> float | None:
    """The middle of the longest stretch that has room for one slice more."""
    for span in longest_first(spans, observation.feature):
        height = free_height(observation, span.middle, span)
        if height is not None:
            return height
    return None


def _bows(observation: Observation) -> list[tuple[Span, float]]:
    """Stretches between slices, and how far the side bows out from the straight line there."""
    # A slice that could not be traced tells nothing; nor does one beyond an end that has moved.
    inside = [
        one
        for one in observation.slices
        if one.usable and observation.low < one.height < observation.high
    ]
    found = []
    for below, above in pairwise(sorted(inside, key=lambda one: one.height)):
        span = Span(below.height, above.height)
        # An arc that turns by an angle rises over its chord by an eighth of both.
        turns = np.arctan(above.slopes) - np.arctan(below.slopes)
        chords = np.hypot(span.length, above.radii - below.radii)
        found.append((span, float(np.abs(turns * chords).mean()) / 8.0))
    return found
