"""How large the error is by now, and what the next halving of it will cost: whoever plans.

Two indicators tell how far a curve between two slices is wrong. A curve that knows the curvatures,
too, differs from the cubic by about as much as the cubic differs from the truth; and where slopes
and curvatures of both ends do not add up to the rise of the positions, something lies between.
Their weights were fitted to logarithms of true errors, interval by interval, and the factor of the
bound to whole runs. A predicted error says nothing about what lies between two pads: that is told
beside it, as a height that nothing has touched.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.planners.coverage import (
    ErrorIndicators,
    Profile,
    Span,
    error_indicators,
    longest_untouched,
    profile_of,
    untouched_spans,
)
from palpate.core.explore.planners.protocol import END_DEVIATIONS, Observation
from palpate.core.explore.planners.surface import OpenArea
from palpate.core.explore.planners.touches import is_known, is_open

HIGHER, CLASH = 0.61, 2.2  # Trust in the two signs
# Bound of 95 % over the predicted error of the whole; with few intervals by so much more, over the
# cube of their number, as two tell little of how an object errs, nor of how it deviates.
SAFETY, FEW = 1.1, 6.0
NOISE = 0.87  # Of a slice's deviation that is left in the surface between two, with its own margin
# An interval errs by its untouched share to this power less: smooth ones by a higher one, but sharp
# edges that lie in it by their whole length.
UNTOUCHED_ORDER = 2.0
ORDER = 3.0  # An interval cut into m parts errs by m to this power less
# Bound of 95 % over the deviation that a solid of all taxels states itself, and by how much more of
# the part that its ends make, whose untouched edges vary most; and what edges leave that no
# deviation states, over the extent. From explorations of drawn objects and of the shipped scenes,
# half of them with noise.
DEVIATION, ENDS, LEFT = 1.25, 1.5, 1.0e-4
# Where the tolerance is out of reach, slices stop when what they would bring down is less than this
# of their noise, and of the tolerance.
SETTLED, HARDLY = 0.5, 0.2
NEAR = 1e-6  # Values that differ by less of themselves are alike
MOST_CUTS = 64  # Slices that are planned ahead


class Cost(NamedTuple):
    """What something takes."""

    touches: float
    seconds: float  # Robot time, s


@dataclass(frozen=True, eq=False)
class Estimate:
    """What can be said of the solid that is rebuilt from the slices so far."""

    observation: Observation  # Of which
    # Its root mean square error is below this in 95 of 100 runs, m; None where there is no solid.
    rms_bound_95: float | None
    # Largest height that nothing has touched, or in which an end may lie, m.
    largest_untouched: float
    tolerance_met: bool  # Whether all that is as small as is asked for
    prediction: ErrorPrediction | None  # Of what the bound is made; None likewise
    open_area: OpenArea | None = None  # What lies far from every touch; None where nobody looked

    @cached_property
    def halving(self) -> Cost | None:
        """What bringing the error to its half is expected to take; None where no slice does."""
        if self.prediction is None:
            return None
        return halving_cost(self.observation, self.prediction)


def estimate_error(observation: Observation) -> Estimate:
    """The bound, what is untouched, and what the next halving takes."""
    surface = observation.surface
    if surface is not None and observation.general:
        known, hole = is_known(observation, surface), surface.open_area
        return Estimate(observation, surface.rms_bound_95, hole.width, known, None, hole)
    prediction, spans = prediction_of(observation), untouched_spans(observation)
    loose = END_DEVIATIONS * max(observation.low_deviation, observation.high_deviation)
    untouched = max([span.length for span in spans] + [loose])
    if prediction is None:
        bound = None
        if len(profile_of(observation).heights) and observation.deviation is not None:
            bound = DEVIATION * observation.deviation
        return Estimate(observation, bound, untouched, False, None)
    bound = prediction.rms_bound_95 * observation.extent
    opened = None
    if surface is not None:
        bound, opened = math.hypot(bound, surface.hidden), surface.open_area
    met = bound <= observation.tolerance and untouched <= observation.feature
    if met and surface is not None:
        met = not is_open(observation, surface)
    return Estimate(observation, bound, untouched, met, prediction, opened)


def prediction_of(observation: Observation) -> ErrorPrediction | None:
    """What slices say about the side between them; None of fewer than two."""
    profile = profile_of(observation)
    if len(profile.heights) < 2:
        return None
    return predict_error(observation, profile, untouched_spans(observation))


def halving_cost(observation: Observation, prediction: ErrorPrediction) -> Cost | None:
    """Of as many slices as those so far, on average, as are predicted to halve the error."""
    usable = [one for one in observation.slices if one.usable]
    count = prediction.slices_to(0.5 * prediction.rms_bound_95, len(usable))
    if count is None:
        return None
    touches = float(np.mean([one.touches for one in usable]))
    return Cost(count * touches, count * float(np.mean([one.seconds for one in usable])))


class ErrorPrediction(NamedTuple):
    """What at least two slices say about the side between them; shares of the object's height."""

    heights: Floats  # Of the slices, (m,)
    indicators: ErrorIndicators  # Of each interval between two
    errors: Floats  # Bound of each interval's root mean square error, noise apart; (m - 1,)
    shares: Floats  # Of the side's area; (m - 1,)
    curve: float  # Bound of the error of the whole that comes of too few slices, in 95 of 100 runs
    noise: Noise  # Bound of that which comes of noise, and that of the ends
    untouched: Floats  # Share of each interval's height that nothing has touched, (m - 1,)

    @property
    def rms_bound_95(self) -> float:
        """Of the error of the whole, in 95 of 100 runs."""
        return math.hypot(self.curve, self.noise.all)

    def wants_refinement(self, tolerance: float) -> bool:
        """Whether further slices would bring down what too few slices leave, and have to.

        They do while the tolerance is within their reach; and else while they bring the error down
        by much, for ends are known the better the more is known of the sides that lead to them.
        """
        if self.rms_bound_95 <= tolerance:
            return False
        untouched = math.sqrt(float((self.shares * self.untouched**2).sum()))
        falling = math.hypot(self.curve, untouched * self.noise.between)
        if self.rms_bound_95**2 - falling**2 <= tolerance**2:
            return True
        return falling > max(SETTLED * self.noise.slices, HARDLY * tolerance)

    def wants_averaging(self, tolerance: float, slices: int, room: int) -> bool:
        """Whether noise is too large, but so many slices would average it away, and there is room.

        Of a solid rebuilt from all that was touched, noise falls with the root of their number.
        """
        noise = self.noise
        fading = (noise.touched**2 - noise.lasting**2) / DEVIATION**2  # its margin is no noise
        left = fading * slices / room + noise.lasting**2
        return noise.touched > tolerance and left <= tolerance**2

    def slices_to(self, target: float, slices: int) -> int | None:
        """Slices beyond those so far that bring the bound to a target; None if none do."""
        variances = self.shares * self.errors**2
        noise, total = self.noise, max(float(variances.sum()), np.finfo(float).tiny)
        for more, (_, left) in enumerate(cut_further(variances, ORDER, self.untouched)):
            between = noise.between**2 * left / total
            curve = left * (_margin(len(variances) + more) / _margin(len(variances))) ** 2
            fading = (noise.touched**2 - noise.lasting**2) * slices / (slices + more)
            if curve + between + fading + noise.lasting**2 <= target**2:
                return more
        return None


class Noise(NamedTuple):
    """Bounds of what comes of noise, over the object's height."""

    all: float  # Of the whole surface
    touched: float  # Of it, what was touched, and the ends
    lasting: float  # Of that, what no further slice takes away
    slices: float  # What was touched in slices

    @property
    def between(self) -> float:
        """What is left to what lies between the touched bands."""
        return math.sqrt(max(self.all**2 - self.touched**2, 0.0))


def predict_error(
    observation: Observation, profile: Profile, spans: Sequence[Span]
) -> ErrorPrediction:
    """The errors that at least two slices predict, and untouched spans between them."""
    indicators = error_indicators(profile)
    errors = np.hypot(HIGHER * indicators.quintic_gap, CLASH * indicators.rise_mismatch)
    untouched = np.ones(len(errors))
    if observation.all_taxels:
        heights = (observation.low + observation.extent * profile.heights).tolist()
        longest = np.array([longest_untouched(spans, *pair) for pair in pairwise(heights)])
        untouched = longest / (observation.extent * indicators.width)
    errors *= untouched**UNTOUCHED_ORDER
    wide = profile.radii.mean(axis=1)
    long = np.sqrt(1.0 + (profile.slopes**2).mean(axis=1))
    areas = indicators.width * (wide[:-1] * long[:-1] + wide[1:] * long[1:])
    shares = areas / areas.sum()
    errors *= _margin(len(errors))
    curve = math.sqrt(float((shares * errors**2).sum()))
    noise = _noise(observation, indicators, shares)
    return ErrorPrediction(profile.heights, indicators, errors, shares, curve, noise, untouched)


def _margin(intervals: int, safety: float = SAFETY) -> float:
    return safety * (1.0 + FEW / intervals**3)


def _noise(observation: Observation, indicators: ErrorIndicators, shares: Floats) -> Noise:
    extent, margin = observation.extent, _margin(len(shares), DEVIATION)
    resolution = observation.resolution / extent
    if not observation.all_taxels or observation.deviation is None:
        noise = NOISE * math.sqrt(float((shares * indicators.noise**2).sum()))
        return Noise(*[math.hypot(noise, resolution)] * 4)
    deviations = [one.deviation for one in observation.slices if one.usable]
    band = math.sqrt(float(np.mean(np.square(deviations))))
    # What the surface misses of its taxels by more than their places err is no noise.
    band = min(band, math.hypot(observation.pose_deviation, observation.resolution))
    ends = ENDS * observation.ends_deviation
    side = math.sqrt(max(observation.deviation**2 - observation.ends_deviation**2, 0.0))
    lasting = math.hypot(margin * ends / extent, resolution, LEFT)
    every = math.hypot(margin * side / extent, lasting)
    slices = margin * band / extent
    return Noise(every, min(math.hypot(slices, lasting), every), lasting, slices)


def parts_needed(variances: Floats, target: float, order: float) -> Ints:
    """Into how many parts each interval must be cut, with the fewest cuts in all."""
    cuts = list(cut_further(variances, order))
    return next((parts for parts, left in cuts if left <= target**2), cuts[-1][0])


def cut_further(
    variances: Floats, order: float, untouched: Floats | None = None
) -> Iterator[tuple[Ints, float]]:
    """Parts of each interval and the variance then left, with no cut, one, two, ...

    Each cut goes where it takes most. `untouched` (n,): what share of each interval a slice's band
    leaves untouched, which the bands of more slices make smaller; all of it if left out.
    """
    share = np.ones(len(variances)) if untouched is None else untouched

    def left(parts: Floats) -> Floats:
        shrunk = np.maximum(1.0 - parts * (1.0 - share), 0.0) / np.maximum(share, NEAR)
        return np.asarray(variances * parts ** (-2.0 * order) * shrunk ** (2.0 * UNTOUCHED_ORDER))

    parts = np.ones(len(variances))
    for _ in range(MOST_CUTS + 1):
        now = left(parts)
        yield parts.astype(np.int32), float(now.sum())
        gain = now - left(parts + 1.0)
        parts[int(np.argmax(gain >= gain.max() * (1.0 - NEAR)))] += 1.0
