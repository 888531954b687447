"""The default planner: refines where the predicted error is largest, then what is untouched.

A coarse cover comes first, of an odd number of slices, so that the middle is among them. Then,
while the predicted error is too large, comes the height that lowers it with the fewest slices; when
it is small enough, the middle of what no pad has touched. Both criteria are needed: a predicted
error says nothing about what lies between two pads.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated

import numpy as np

from palpate.core.explore.planners.coverage import (
    Span,
    even_heights,
    free_height,
    longest_first,
    longest_untouched,
    untouched_spans,
)
from palpate.core.explore.planners.error_bound import (
    MAX_TIE,
    ErrorPrediction,
    ErrorSettings,
    Estimate,
    estimate_error,
    parts_needed,
    prediction_of,
)
from palpate.core.explore.planners.protocol import (
    ALL_REACHED,
    Choice,
    Height,
    Observation,
    Stop,
    Wait,
    exhausted_budget,
    first_and_last,
)
from palpate.core.explore.planners.surface import ObservedSurface
from palpate.core.explore.planners.touches import TouchPlannerSettings, next_touch
from palpate.core.plugins import Range, check_ranges

# Reasons of slices that do not follow from a predicted error.
COVERING, UNTOUCHED = "the coarse cover", "nothing has touched what lies there"


@dataclass(frozen=True, slots=True, kw_only=True)
class CuttingSettings:
    """Where slices are placed between others."""

    min_room: float = 2.0  # [`Observation.spacing`] between slices that only average noise
    cover_reach: float = 0.12  # [height] around a height of the cover, where a slice replaces it
    pull: float = 0.35  # [parts] by which a cut moves, at most, towards the end that bends more
    target: float = 1.3  # cuts are planned for an error of the tolerance divided by this


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedSettings:
    """Where slices are placed, and which single touches are made once slices are of no more use."""

    cutting: CuttingSettings = CuttingSettings()
    touches: TouchPlannerSettings = field(default=TouchPlannerSettings())


@dataclass(frozen=True, slots=True, kw_only=True)
class Predicted:
    """The default planner."""

    cover: Annotated[int, Range(3, 99, "1")] = 3  # slices before any error is predicted; odd
    # Error over the height that an untouched stretch may hide, per its squared share of it.
    hidden_error: Annotated[float, Range(0.0, 1.0, "1")] = 0.04
    # The error of an interval falls by m to this power when it is cut into m parts.
    order: Annotated[float, Range(1.0, 6.0, "1")] = ErrorSettings().order
    # Cost of moving by the whole height, over that of a slice.
    travel: Annotated[float, Range(0.0, 1.0, "1")] = 0.02
    settings: PredictedSettings = PredictedSettings()

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.cover % 2 == 0:
            raise ValueError(f"cover must be odd, so that the middle is in it, got {self.cover}")

    def next(self, observation: Observation) -> Choice:
        """The next slice, or that the demand is met, or that nothing more can be done."""
        spent = exhausted_budget(observation)
        if spent is not None:
            return Stop(spent)
        covering = self.settled(observation)
        if covering is not None:
            return covering
        surface = observation.surface
        if surface is not None and observation.general:
            return self._touching(observation, surface)
        prediction = prediction_of(observation)
        if prediction is not None:
            refining = self._refining(observation, prediction)
            if refining is not None:
                return refining
        if observation.busy_heights:
            return Wait("other fingers are at work where there is something left to do")
        estimate = estimate_error(observation)
        if surface is not None and not estimate.reached:
            bound = math.inf if estimate.rms_bound_95 is None else estimate.rms_bound_95
            return self._touching(observation, surface, bound)
        return Stop(_reason(observation, estimate))

    def _touching(
        self, observation: Observation, surface: ObservedSurface, bound: float | None = None
    ) -> Choice:
        """The next single touch; `bound`: error of the solid [m], None: the surface's."""
        settings = self.settings.touches
        return next_touch(observation, surface, settings.choice.min_gain, bound, settings)

    def settled(self, observation: Observation) -> Height | None:
        """The next slice of the coarse cover, which depends on no model; None after the last."""
        failed = len(observation.slices) - len(observation.usable_slices)
        if observation.surface is None or failed < 2:
            height = self._covering(observation)
            return None if height is None else Height(height, COVERING)
        return None

    def _refining(self, observation: Observation, prediction: ErrorPrediction) -> Height | None:
        """The next slice to lower the error, to touch an untouched span, or to average noise."""
        spans = untouched_spans(observation)
        tolerance = observation.tolerance / observation.extent
        if prediction.wants_refinement(tolerance):
            height = best_refinement(observation, prediction, spans, self)
            if height is not None:
                height = _moved_into_span(observation, spans, height)
                return Height(height, "the predicted error is largest there")
        height = _untouched_height(observation, spans)
        if height is not None:
            return Height(height, UNTOUCHED)
        usable = len(observation.usable_slices)
        room = int(observation.extent / (self.settings.cutting.min_room * observation.spacing))
        if observation.all_taxels and prediction.wants_averaging(
            tolerance, usable, max(room, usable)
        ):
            height = _widest_free(observation)
            if height is not None:
                return Height(height, "noise is averaged there")
        return None

    def _covering(self, observation: Observation) -> float | None:
        """The height of the cover nearest to the middle that has no slice yet [m].

        A part in which a slice failed, as in a ridge, comes after the others.
        """
        low, high = first_and_last(observation)
        heights = np.linspace(low, high, self.cover).tolist()
        # Parts do not overlap.
        reach = self.settings.cutting.cover_reach * observation.extent
        reach = min(reach, 0.4 * (high - low) / (self.cover - 1))
        parts = [Span(max(low, height - reach), min(high, height + reach)) for height in heights]
        made = [contour.height for contour in observation.usable_slices]
        made += observation.busy_heights
        failed = [attempt.height for attempt in observation.slices if not attempt.usable]
        middle = self.cover // 2
        left = [i for i, part in enumerate(parts) if not _count(made, part)]
        for i in sorted(left, key=lambda i: (_count(failed, parts[i]), abs(i - middle), -i)):
            height = free_height(observation, heights[i], parts[i])
            if height is not None:
                return height
        return None


def _count(heights: Sequence[float], part: Span) -> int:
    """How many heights lie in a part."""
    return sum(part.low <= height <= part.high for height in heights)


def best_refinement(
    observation: Observation,
    prediction: ErrorPrediction,
    spans: Sequence[Span],
    rule: Predicted,
) -> float | None:
    """The height at which one more slice is worth most [m]; None where there is no room."""
    settings = rule.settings.cutting
    heights = (observation.low + observation.extent * prediction.heights).tolist()
    pairs = list(pairwise(heights))
    hidden = np.array([longest_untouched(spans, *pair) for pair in pairs]) / observation.extent
    # Squared errors of the intervals, with those that untouched stretches may hide, per area.
    squares = prediction.errors**2 + (rule.hidden_error * hidden**2) ** 2
    variances = prediction.shares * squares
    target = observation.tolerance / observation.extent / settings.target
    parts = parts_needed(variances, target, rule.order)
    last = observation.slices[-1].height
    bottom, top = first_and_last(observation)
    offers = []
    for i, (low, high) in enumerate(pairs):
        if any(low < busy < high for busy in observation.busy_heights):
            continue  # another finger cuts it at this moment
        share = _cut_place(int(parts[i]), float(prediction.indicators.bend_side[i]), settings.pull)
        inside = Span(max(low, bottom), min(high, top))  # a slice may lie beyond an end that moved
        wanted = min(max(low + (high - low) * share, inside.low), inside.high)
        height = free_height(observation, wanted, inside)
        if height is not None:
            travel = abs(height - last) / observation.extent
            offers.append((float(variances[i]) / (1.0 + rule.travel * travel), travel, height))
    if not offers:
        return None
    best = max(worth for worth, _, _ in offers)
    tied = [offer for offer in offers if offer[0] >= best * (1.0 - MAX_TIE)]
    return min(tied, key=lambda offer: (round(offer[1] / MAX_TIE), -offer[2]))[2]


def _cut_place(parts: int, bend_side: float, pull: float) -> float:
    """Where to cut an interval that needs some parts: at their border nearest to its middle."""
    count = max(parts, 2)
    border = count // 2 if bend_side < 0.5 - MAX_TIE else count - count // 2
    return (border + pull * (2.0 * bend_side - 1.0)) / count


def _moved_into_span(observation: Observation, spans: Sequence[Span], wanted: float) -> float:
    """A wanted height, moved so that its slice is one of those that cover an untouched span."""
    if observation.all_taxels:
        for span in spans:
            if span.low <= wanted <= span.high and span.length > observation.feature:
                return _height_in(observation, span, wanted) or wanted
    return wanted


def _untouched_height(observation: Observation, spans: Sequence[Span]) -> float | None:
    """Height of a slice in the longest untouched span [m].

    If other fingers are at work, in the densest group of planned slices: one finger fills it alone.
    """
    feature = observation.feature
    wanted = [span for span in longest_first(spans, feature) if span.length > feature]
    if not observation.busy_heights:
        heights = (_height_in(observation, span) for span in wanted)
        return next((height for height in heights if height is not None), None)
    places = [(place, span) for span in wanted for place in even_heights(observation, span)]
    crowds = {
        place: sum(abs(place - other) < observation.finger_spacing for other, _ in places)
        for place, _ in places
    }
    order = sorted(places, key=lambda place: -crowds[place[0]])
    heights = (free_height(observation, *place) for place in order)
    return next((height for height in heights if height is not None), None)


def _height_in(observation: Observation, span: Span, wanted: float | None = None) -> float | None:
    """Where to begin in an untouched span: in its middle, or nearest to a wanted height [m]."""
    places = even_heights(observation, span)
    at = places[len(places) // 2]
    if wanted is not None:
        at = min(places, key=lambda place: abs(place - wanted))
    return free_height(observation, at, span)


def _widest_free(observation: Observation) -> float | None:
    """Middle of the widest stretch between slices that has room for one more [m]."""
    bottom, top = first_and_last(observation)
    made = (*(attempt.height for attempt in observation.slices), *observation.busy_heights)
    heights = sorted({bottom, top, *(height for height in made if bottom < height < top)})
    spans = [Span(*pair) for pair in pairwise(heights)]
    ordered = longest_first(spans, observation.feature)
    free = (free_height(observation, span.middle, span) for span in ordered)
    return next((height for height in free if height is not None), None)


def _reason(observation: Observation, estimate: Estimate) -> str:
    """Why exploration ends, where no slice is left that would help."""
    if estimate.prediction is None or estimate.rms_bound_95 is None:
        return "fewer than two slices could be traced"
    if estimate.reached:
        return ALL_REACHED
    if estimate.rms_bound_95 <= observation.tolerance:
        if observation.end_uncertainty > observation.feature:
            return "no further touch shows where the object ends"
        return "what is left untouched cannot be reached"
    noise = estimate.prediction.noise
    if observation.ends_deviation > observation.tolerance:
        return (
            "the ends are uncertain beyond the tolerance, and no further slice shows more of them"
        )
    if noise.touched * observation.extent > observation.tolerance:
        return "the noise of the slices is beyond the tolerance, and no further slice takes it away"
    if not estimate.prediction.wants_refinement(observation.tolerance / observation.extent):
        return (
            "the surface does not follow what was touched to within the tolerance, and further "
            "slices would hardly help"
        )
    return "the slices lie as close as they may, and the error is not within tolerance"
