"""The default planner: refines where the predicted error is largest, then what is untouched.

A coarse cover first, of an odd number, so that the middle is among it. Then, while the error that
the slices predict is too large, the height that brings it down with the fewest slices; when it is
small enough, the middle of what no pad has touched. A predicted error says nothing about what lies
between two pads, which is why both are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np

from palpate.core.explore.planners.coverage import (
    NEAR,
    ORDER,
    ErrorPrediction,
    Estimate,
    Span,
    estimate_error,
    even_heights,
    free_height,
    longest_first,
    longest_untouched,
    parts_needed,
    prediction_of,
    untouched_spans,
)
from palpate.core.explore.planners.protocol import (
    ALL_REACHED,
    END_DEVIATIONS,
    Choice,
    Height,
    Observation,
    Stop,
    Wait,
    exhausted_budget,
    first_and_last,
)
from palpate.core.explore.planners.touches import CHOICES, next_touch
from palpate.core.plugins import Range, check_ranges

# Reasons of slices that no error has asked for.
COVERING, UNTOUCHED = "the coarse cover", "nothing has touched what lies there"
ROOM = 2.0  # Slices that only average noise lie at least so many features apart
COVER_REACH = 0.12  # Of the height: a slice so near to a wanted one of the cover stands for it
PULLED = 0.35  # A cut moves by up to this share of a part, towards the end that bends more
AMPLE = 1.3  # Cuts are planned for an error by so much below the tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """The default planner."""

    cover: Annotated[int, Range(3, 99, "1")] = 3  # Slices before any error is predicted; odd
    # Error that an untouched stretch may hide, over the height, by the square of its share.
    hidden_error: Annotated[float, Range(0.0, 1.0, "1")] = 0.04
    # An interval cut into m parts is expected to err by m to this power less.
    order: Annotated[float, Range(1.0, 6.0, "1")] = ORDER
    # Cost of moving by the whole height, over that of a slice.
    travel: Annotated[float, Range(0.0, 1.0, "1")] = 0.02

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.cover % 2 == 0:
            raise ValueError(f"cover must be odd, so that the middle is in it, got {self.cover}")

    def next(self, observation: Observation) -> Choice:
        """The next slice, or that the demand is met, or that nothing more can be done."""
        over = exhausted_budget(observation)
        if over is not None:
            return Stop(over)
        covering = self.settled(observation)
        if covering is not None:
            return covering
        surface = observation.surface
        if surface is not None and observation.general:
            return next_touch(observation, surface, CHOICES.min_gain)
        prediction = prediction_of(observation)
        if prediction is not None:
            found = self._refining(observation, prediction)
            if found is not None:
                return found
        if observation.busy_heights:
            return Wait("other fingers are at work where there is something left to do")
        estimate = estimate_error(observation)
        if surface is not None and not estimate.reached:
            bound = math.inf if estimate.rms_bound_95 is None else estimate.rms_bound_95
            return next_touch(observation, surface, CHOICES.min_gain, bound)
        return Stop(_reason(observation, estimate))

    def settled(self, observation: Observation) -> Height | None:
        """The next slice of the coarse cover, in which no model has a say; None after the last."""
        failed = len(observation.slices) - len(observation.usable_slices)
        if observation.surface is None or failed < 2:
            height = self._covering(observation)
            return None if height is None else Height(height, COVERING)
        return None

    def _refining(self, observation: Observation, prediction: ErrorPrediction) -> Height | None:
        """The next slice for the error's sake, for what is untouched, or to average noise."""
        spans = untouched_spans(observation)
        tolerance = observation.tolerance / observation.extent
        if prediction.wants_refinement(tolerance):
            height = best_refinement(observation, prediction, spans, self)
            if height is not None:
                height = _along_with(observation, spans, height)
                return Height(height, "the predicted error is largest there")
        height = _untouched_height(observation, spans)
        if height is not None:
            return Height(height, UNTOUCHED)
        usable = len(observation.usable_slices)
        room = max(int(observation.extent / (ROOM * observation.spacing)), usable)
        if observation.all_taxels and prediction.wants_averaging(tolerance, usable, room):
            height = _widest_free(observation)
            if height is not None:
                return Height(height, "noise is averaged there")
        return None

    def _covering(self, observation: Observation) -> float | None:
        """The first height of the cover, from the middle, for which no slice stands yet.

        A part in which one could not be traced, as in a ridge, waits for the others.
        """
        low, high = first_and_last(observation)
        heights = np.linspace(low, high, self.cover).tolist()
        reach = min(COVER_REACH * observation.extent, 0.4 * (high - low) / (self.cover - 1))
        parts = [Span(max(low, one - reach), min(high, one + reach)) for one in heights]
        there = [one.height for one in observation.usable_slices]
        there += observation.busy_heights
        failed = [one.height for one in observation.slices if not one.usable]
        middle = self.cover // 2
        left = [i for i, part in enumerate(parts) if not _count(there, part)]
        for i in sorted(left, key=lambda i: (_count(failed, parts[i]), abs(i - middle), -i)):
            height = free_height(observation, heights[i], parts[i])
            if height is not None:
                return height
        return None


def _count(heights: Sequence[float], part: Span) -> int:
    return sum(part.low <= one <= part.high for one in heights)


def best_refinement(
    observation: Observation, prediction: ErrorPrediction, spans: Sequence[Span], rule: Predicted
) -> float | None:
    """The height at which one slice more is worth most, m; None where there is no room."""
    heights = (observation.low + observation.extent * prediction.heights).tolist()
    pairs = list(pairwise(heights))
    hidden = np.array([longest_untouched(spans, *pair) for pair in pairs]) / observation.extent
    # Squared errors of the intervals by their shares of the area, with what may be hidden.
    squares = prediction.errors**2 + (rule.hidden_error * hidden**2) ** 2
    variances = prediction.shares * squares
    parts = parts_needed(variances, observation.tolerance / observation.extent / AMPLE, rule.order)
    last = observation.slices[-1].height
    bottom, top = first_and_last(observation)
    offers = []
    for i, (low, high) in enumerate(pairs):
        if any(low < busy < high for busy in observation.busy_heights):
            continue  # another finger cuts it at this moment
        share = _place(int(parts[i]), float(prediction.indicators.bend_side[i]))
        inside = Span(max(low, bottom), min(high, top))  # a slice may lie beyond an end that moved
        wanted = min(max(low + (high - low) * share, inside.low), inside.high)
        height = free_height(observation, wanted, inside)
        if height is not None:
            away = abs(height - last) / observation.extent
            offers.append((float(variances[i]) / (1.0 + rule.travel * away), away, height))
    if not offers:
        return None
    most = max(value for value, _, _ in offers)
    alike = [offer for offer in offers if offer[0] >= most * (1.0 - NEAR)]
    return min(alike, key=lambda offer: (round(offer[1] / NEAR), -offer[2]))[2]


def _place(parts: int, bend_side: float) -> float:
    """Where to cut an interval that needs so many parts: at their border nearest to its middle."""
    count = max(parts, 2)
    border = count // 2 if bend_side < 0.5 - NEAR else count - count // 2
    return (border + PULLED * (2.0 * bend_side - 1.0)) / count


def _along_with(observation: Observation, spans: Sequence[Span], wanted: float) -> float:
    """A wanted height, moved so that its slice is one of those that cover an untouched span."""
    if observation.all_taxels:
        for span in spans:
            if span.low <= wanted <= span.high and span.length > observation.feature:
                return _into(observation, span, wanted) or wanted
    return wanted


def _untouched_height(observation: Observation, spans: Sequence[Span]) -> float | None:
    """Where to touch what was not touched: into the longest span, m.

    Beside other fingers, where most slices are left that only one finger at a time can trace.
    """
    feature = observation.feature
    wanted = [span for span in longest_first(spans, feature) if span.length > feature]
    if not observation.busy_heights:
        found = (_into(observation, span) for span in wanted)
        return next((height for height in found if height is not None), None)
    places = [(place, span) for span in wanted for place in even_heights(observation, span)]
    crowds = {
        place: sum(abs(place - other) < observation.finger_spacing for other, _ in places)
        for place, _ in places
    }
    order = sorted(places, key=lambda one: -crowds[one[0]])
    tried = (free_height(observation, *one) for one in order)
    return next((height for height in tried if height is not None), None)


def _into(observation: Observation, span: Span, wanted: float | None = None) -> float | None:
    """Where to begin in an untouched span: in its middle, or nearest to a wanted height, m."""
    places = even_heights(observation, span)
    at = places[len(places) // 2]
    if wanted is not None:
        at = min(places, key=lambda place: abs(place - wanted))
    return free_height(observation, at, span)


def _widest_free(observation: Observation) -> float | None:
    """Middle of the widest stretch between slices that has room for one more, m."""
    bottom, top = first_and_last(observation)
    between = (*(one.height for one in observation.slices), *observation.busy_heights)
    heights = sorted({bottom, top, *(one for one in between if bottom < one < top)})
    spans = [Span(*pair) for pair in pairwise(heights)]
    ordered = longest_first(spans, observation.feature)
    found = (free_height(observation, span.middle, span) for span in ordered)
    return next((height for height in found if height is not None), None)


def _reason(observation: Observation, estimate: Estimate) -> str:
    """Why it is over, where no slice is left that would help."""
    if estimate.prediction is None or estimate.rms_bound_95 is None:
        return "fewer than two slices could be traced"
    loose = END_DEVIATIONS * max(observation.low_deviation, observation.high_deviation)
    if estimate.reached:
        return ALL_REACHED
    if estimate.rms_bound_95 <= observation.tolerance:
        if loose > observation.feature:
            return "no further touch tells where the object ends"
        return "what is left untouched cannot be reached"
    noise = estimate.prediction.noise
    if observation.ends_deviation > observation.tolerance:
        return (
            "the ends are uncertain beyond the tolerance, and no further slice tells more of them"
        )
    if noise.touched * observation.extent > observation.tolerance:
        return "the noise of the slices is beyond the tolerance, and no further slice takes it away"
    if not estimate.prediction.wants_refinement(observation.tolerance / observation.extent):
        return (
            "the surface does not follow what was touched to within the tolerance, and further "
            "slices would hardly help"
        )
    return "the slices lie as close as they may, and the error is not within tolerance"
