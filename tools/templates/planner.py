"""Template of a planner: untouched parts first, then parts that bow. Adapt it.

Name it in a scene, and start palpate in the folder of this file:

    explore:
      planner: template:Template
      settings: {most_bow: 4.0}

Inputs and outputs of a planner: `palpate.planning.Observation` and `palpate.planning.Choice`. A
planner has no memory: it decides from `observation` alone, so that a recorded run can be planned
again. All lengths have the same, unknown unit: compare them with lengths of the observation, and
never with a number of your own.
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
    """Chooses slices in untouched spans, then where the side bows between two slices."""

    # Bow between two slices over the tolerance; above 1, since slopes are measured as well.
    most_bow: Annotated[float, Range(0.1, 100.0, "1")] = 4.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def next(self, observation: Observation) -> Choice:
        """The next slice, or a reason to stop or wait; called when a slice is finished."""
        # Slices lie between the first and the last height; ends are touched in another way.
        low, high = first_and_last(observation)
        spans = untouched_spans(observation)
        exhausted = exhausted_budget(observation)
        if exhausted is not None:
            return Stop(exhausted)
        # No height is tried twice, also after a failure, and none near another finger.
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
    """Middle of the longest span with room for another slice."""
    for span in longest_first(spans, observation.feature):
        height = free_height(observation, span.middle, span)
        if height is not None:
            return height
    return None


def _bows(observation: Observation) -> list[tuple[Span, float]]:
    """Spans between slices, and the bow of the side from the straight line there."""
    # Slices that failed, or that lie beyond an end that has moved, are left out.
    inside = [
        traced
        for traced in observation.slices
        if traced.usable and observation.low < traced.height < observation.high
    ]
    bows = []
    for below, above in pairwise(sorted(inside, key=lambda traced: traced.height)):
        span = Span(below.height, above.height)
        # The bow of a flat arc is its turning angle times its chord, over 8.
        turns = np.arctan(above.slopes) - np.arctan(below.slopes)
        chords = np.hypot(span.length, above.radii - below.radii)
        bows.append((span, float(np.abs(turns * chords).mean()) / 8.0))
    return bows
