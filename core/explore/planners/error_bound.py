"""How large the error of a side between slices is, and what the next halving of it will cost.

Two indicators show how wrong a curve between two slices is. The quintic that has the curvatures as
well differs from the cubic by about as much as the cubic differs from the truth; and where slopes
and curvatures of both ends do not add up to the rise of the positions, something lies between.
Their weights were fitted to logarithms of true errors, interval by interval, and the factor of the
bound to whole runs. A predicted error says nothing about what lies between two pads: that is stated
separately, as a height that nothing has touched.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.planners.coverage import (
    Profile,
    Span,
    longest_untouched,
    profile_of,
    untouched_spans,
)
from palpate.core.explore.planners.protocol import Observation
from palpate.core.explore.planners.surface import OpenArea
from palpate.core.explore.planners.verdict import Findings, Verdict, judge

MAX_TIE = 1e-6  # [value] by which two values may differ and be equal


@dataclass(frozen=True, slots=True, kw_only=True)
class IndicatorSettings:
    """Which curvatures count in the indicators of an interval."""

    max_bend: float = 8.0  # largest second derivative of the radius, times interval: clips edges
    min_bend: float = 0.02  # added to rms second derivatives of the squared radius, which may be 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSettings:
    """How errors are predicted, and when further slices are worth their time.

    The factors of stated deviations are from explorations of drawn objects and of the shipped
    scenes, half of them with noise.
    """

    quintic_weight: float = 0.61  # of `ErrorIndicators.quintic_gap` in an interval's error
    mismatch_weight: float = 2.2  # of `ErrorIndicators.rise_mismatch` in an interval's error
    # The 95 % bound is the predicted error times safety (1 + few_intervals / n^3), for n intervals:
    # two show little of how an object errs, or of how it deviates.
    safety: float = 1.1
    few_intervals: float = 6.0
    noise_share: float = 0.87  # bound of noise between slices, over their standard deviation
    order: float = 3.0  # exponent by which the error of an interval falls with its number of parts
    # Exponent by which it falls with the untouched share of the interval. A smooth side has a
    # higher one, a side with a sharp edge in the interval a lower one.
    untouched_order: float = 2.0
    deviation_factor: float = 1.25  # ratio of the 95 % bound to the deviation that the solid states
    ends_factor: float = 1.5  # further factor for the ends, whose untouched edges vary most
    edge_error: float = 1.0e-4  # [height] of edges, which no stated deviation contains
    # Where the tolerance is out of reach, slices end if they can lower less of the error than this.
    min_noise_gain: float = 0.5  # [noise of the slices]
    min_tolerance_gain: float = 0.2  # [tolerance]
    max_cuts: int = 64  # slices that are planned ahead


class ErrorIndicators(NamedTuple):
    """Indicators of m - 1 intervals [height], normal to the side, rms over the azimuths."""

    width: Floats  # (m - 1,) its height
    quintic_gap: Floats  # (m - 1,) quintic with curvatures less cubic, in the interval's middle
    rise_mismatch: Floats  # (m - 1,) rise of the radius less that of the slopes and curvatures
    noise: Floats  # (m - 1,) standard deviation of the two slices
    # (m - 1,) 0 to 1: where it bends more, lower or upper end; from roots of second derivatives.
    bend_side: Floats


def error_indicators(
    profile: Profile, settings: IndicatorSettings = IndicatorSettings()
) -> ErrorIndicators:
    """What each interval shows of its error."""
    h = np.diff(profile.heights)[:, None]
    q0, q1 = profile.squares[:-1], profile.squares[1:]
    d0, d1 = profile.rises[:-1], profile.rises[1:]
    limit = settings.max_bend * 2.0 * profile.radii
    c0 = np.clip(profile.bends[:-1], -limit[:-1] / h, limit[:-1] / h)
    c1 = np.clip(profile.bends[1:], -limit[1:] / h, limit[1:] / h)
    stretch = np.sqrt(1.0 + (0.5 * (profile.slopes[:-1] + profile.slopes[1:])) ** 2)
    normal = 1.0 / (np.sqrt(2.0 * (q0 + q1)) * stretch)
    # Values of the curves in the middle of the interval.
    quintic_gap = h * (d0 - d1) / 32.0 + h**2 * (c0 + c1) / 64.0
    rise_mismatch = (q1 - q0 - 0.5 * h * (d0 + d1) + h**2 * (c1 - c0) / 12.0) / 16.0
    bend_side = np.sqrt(_rms(profile.bends) + settings.min_bend)
    return ErrorIndicators(
        width=h[:, 0],
        quintic_gap=_rms(quintic_gap * normal),
        rise_mismatch=_rms(rise_mismatch * normal),
        noise=np.sqrt(0.5 * (profile.deviations[:-1] ** 2 + profile.deviations[1:] ** 2)),
        bend_side=bend_side[1:] / (bend_side[1:] + bend_side[:-1]),
    )


def _rms(values: Floats) -> Floats:
    """Root mean square of each row."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))


class Cost(NamedTuple):
    """What something takes."""

    touches: float
    seconds: float  # [s] robot time


@dataclass(frozen=True, eq=False)
class Estimate:
    """What can be said of the solid that is rebuilt from what was touched so far."""

    observation: Observation
    findings: Findings
    prediction: ErrorPrediction | None  # terms of the bound; None where there is none
    open_area: OpenArea | None = None  # far from every touch; None where that was not determined

    @property
    def verdict(self) -> Verdict:
        """What is known, compared with what is asked."""
        return judge(self.findings, self.observation.limits)

    @property
    def reached(self) -> bool:
        """Whether every limit is kept."""
        return bool(self.verdict.reached)

    @property
    def rms_bound_95(self) -> float | None:
        """The root mean square error is below this in 95 of 100 runs [m]; None without a solid."""
        return self.findings.error_bound

    @property
    def largest_untouched(self) -> float:
        """The largest gap that nothing has touched [m]: of the side, or of a general solid."""
        gap = self.findings.untouched_gap
        if gap is not None:
            return gap
        return 0.0 if self.open_area is None else self.open_area.width

    @cached_property
    def halving(self) -> Cost | None:
        """Expected cost of bringing the error to its half; None where no slice does."""
        if self.prediction is None:
            return None
        return halving_cost(self.observation, self.prediction)


def estimate_error(observation: Observation, settings: ErrorSettings = ErrorSettings()) -> Estimate:
    """The error bound, what is untouched, and what the next halving costs."""
    surface = observation.surface
    if surface is not None and observation.general:
        return Estimate(observation, surface.findings, None, surface.open_area)
    prediction = prediction_of(observation, settings) if observation.bounded else None
    gaps = [span.length for span in untouched_spans(observation)]
    findings = Findings(untouched_gap=max([*gaps, observation.end_uncertainty]))
    # A single slice shows only how far its own band is off.
    if prediction is None:
        return Estimate(observation, findings, None)
    bound = prediction.rms_bound_95 * observation.extent
    if surface is None:
        return Estimate(observation, replace(findings, error_bound=bound), prediction)
    findings = replace(
        findings,
        error_bound=math.hypot(bound, surface.hidden),
        unknown_share=surface.open_area.share,
        unentered_hole=surface.unentered_hole,
    )
    return Estimate(observation, findings, prediction, surface.open_area)


def prediction_of(
    observation: Observation, settings: ErrorSettings = ErrorSettings()
) -> ErrorPrediction | None:
    """What slices show of the side between them; None of fewer than two."""
    profile = profile_of(observation)
    if len(profile.heights) < 2:
        return None
    return predict_error(observation, profile, untouched_spans(observation), settings)


def halving_cost(observation: Observation, prediction: ErrorPrediction) -> Cost | None:
    """Cost of the slices that are predicted to halve the error, each as costly as those so far."""
    usable = observation.usable_slices
    count = prediction.slices_to(0.5 * prediction.rms_bound_95, len(usable))
    if count is None:
        return None
    touches = float(np.mean([contour.touches for contour in usable]))
    return Cost(count * touches, count * float(np.mean([contour.seconds for contour in usable])))


class ErrorPrediction(NamedTuple):
    """What m slices show of the side between them; fractions of the object's height."""

    heights: Floats  # (m,) of the slices
    indicators: ErrorIndicators
    errors: Floats  # (m - 1,) bound of each interval's root mean square error, noise apart
    shares: Floats  # (m - 1,) of the side's area
    curve: float  # 95 % bound of the error of the whole that comes of too few slices
    noise: Noise  # 95 % bound of the error that comes of noise, and of the ends
    untouched: Floats  # (m - 1,) share of each interval's height that nothing has touched
    settings: ErrorSettings = ErrorSettings()

    @property
    def rms_bound_95(self) -> float:
        """Bound of the error of the whole, in 95 of 100 runs."""
        return math.hypot(self.curve, self.noise.all)

    def wants_refinement(self, tolerance: float) -> bool:
        """Whether the error is too large, and further slices would lower it.

        They are made while they can reach the tolerance. If they cannot, they are made while they
        lower the error by much: a better side also gives better ends.
        """
        if self.rms_bound_95 <= tolerance:
            return False
        untouched = math.sqrt(float((self.shares * self.untouched**2).sum()))
        falling = math.hypot(self.curve, untouched * self.noise.between)
        if self.rms_bound_95**2 - falling**2 <= tolerance**2:
            return True
        min_noise_gain = self.settings.min_noise_gain * self.noise.slices
        return falling > max(min_noise_gain, self.settings.min_tolerance_gain * tolerance)

    def wants_averaging(self, tolerance: float, slices: int, max_slices: int) -> bool:
        """Whether noise is too large, but `max_slices` in place of `slices` would average it away.

        Of a solid rebuilt from all that was touched, noise falls with the root of their number.
        """
        noise = self.noise
        # The factor of the deviations is a margin, not noise.
        fading = (noise.touched**2 - noise.lasting**2) / self.settings.deviation_factor**2
        left = fading * slices / max_slices + noise.lasting**2
        return noise.touched > tolerance and left <= tolerance**2

    def slices_to(self, target: float, slices: int) -> int | None:
        """Slices beyond those so far that bring the bound to a target; None if none do."""
        settings, variances = self.settings, self.shares * self.errors**2
        noise, total = self.noise, max(float(variances.sum()), np.finfo(float).tiny)
        margin = _margin(len(variances), settings.safety, settings)
        cuts = cut_further(variances, settings.order, self.untouched, settings)
        for more, (_, left) in enumerate(cuts):
            between = noise.between**2 * left / total
            curve = left * (_margin(len(variances) + more, settings.safety, settings) / margin) ** 2
            fading = (noise.touched**2 - noise.lasting**2) * slices / (slices + more)
            if curve + between + fading + noise.lasting**2 <= target**2:
                return more
        return None


class Noise(NamedTuple):
    """95 % bounds of errors from noise [height]."""

    all: float  # of the whole surface
    touched: float  # of what was touched, and the ends
    lasting: float  # part of `touched` that no further slice lowers
    slices: float  # of the surface touched in slices

    @property
    def between(self) -> float:
        """Bound of what lies between the touched bands."""
        return math.sqrt(max(self.all**2 - self.touched**2, 0.0))


def predict_error(
    observation: Observation,
    profile: Profile,
    spans: Sequence[Span],
    settings: ErrorSettings = ErrorSettings(),
) -> ErrorPrediction:
    """The errors that at least two slices predict, with untouched spans between them."""
    indicators = error_indicators(profile)
    errors = np.hypot(
        settings.quintic_weight * indicators.quintic_gap,
        settings.mismatch_weight * indicators.rise_mismatch,
    )
    untouched = np.ones(len(errors))
    if observation.all_taxels:
        heights = (observation.low + observation.extent * profile.heights).tolist()
        longest = np.array([longest_untouched(spans, *pair) for pair in pairwise(heights)])
        untouched = longest / (observation.extent * indicators.width)
    errors *= untouched**settings.untouched_order
    radii = profile.radii.mean(axis=1)
    stretch = np.sqrt(1.0 + (profile.slopes**2).mean(axis=1))
    areas = indicators.width * (radii[:-1] * stretch[:-1] + radii[1:] * stretch[1:])
    shares = areas / areas.sum()
    errors *= _margin(len(errors), settings.safety, settings)
    curve = math.sqrt(float((shares * errors**2).sum()))
    noise = _noise(observation, indicators, shares, settings)
    return ErrorPrediction(
        profile.heights, indicators, errors, shares, curve, noise, untouched, settings
    )


def _margin(n_intervals: int, factor: float, settings: ErrorSettings) -> float:
    """A factor of a bound, larger where few intervals were seen."""
    return factor * (1.0 + settings.few_intervals / n_intervals**3)


def _noise(
    observation: Observation, indicators: ErrorIndicators, shares: Floats, settings: ErrorSettings
) -> Noise:
    """Error from noise: of the slices, or from the deviations that a solid of all taxels states."""
    extent = observation.extent
    margin = _margin(len(shares), settings.deviation_factor, settings)
    resolution = observation.resolution / extent
    if not observation.all_taxels or observation.deviation is None:
        noise = settings.noise_share * math.sqrt(float((shares * indicators.noise**2).sum()))
        return Noise(*[math.hypot(noise, resolution)] * 4)
    deviations = [contour.deviation for contour in observation.usable_slices]
    band = math.sqrt(float(np.mean(np.square(deviations))))
    # The part of the deviation beyond pose and sensor errors is misfit, not noise.
    band = min(band, math.hypot(observation.pose_deviation, observation.resolution))
    ends = settings.ends_factor * observation.ends_deviation
    side = math.sqrt(max(observation.deviation**2 - observation.ends_deviation**2, 0.0))
    lasting = math.hypot(margin * ends / extent, resolution, settings.edge_error)
    whole = math.hypot(margin * side / extent, lasting)
    slices = margin * band / extent
    return Noise(whole, min(math.hypot(slices, lasting), whole), lasting, slices)


def parts_needed(
    variances: Floats, target: float, order: float, settings: ErrorSettings = ErrorSettings()
) -> Ints:
    """Into how many parts each interval must be cut, with the fewest cuts in all."""
    cuts = list(cut_further(variances, order, np.ones(len(variances)), settings))
    return next((parts for parts, left in cuts if left <= target**2), cuts[-1][0])


def cut_further(
    variances: Floats,
    order: float,
    untouched: Floats,
    settings: ErrorSettings = ErrorSettings(),
) -> Iterator[tuple[Ints, float]]:
    """Parts (n,) of each interval and the variance then left, with no cut, one, two, ...

    Each cut goes where it lowers the variance most. `variances` (n,): of the intervals. `order`:
    the exponent by which errors fall with the number of parts. `untouched` (n,): fraction of each
    interval that a slice's band leaves untouched, which the bands of more slices make smaller.
    """

    def left(parts: Floats) -> Floats:
        remaining = np.maximum(1.0 - parts * (1.0 - untouched), 0.0)
        shrunk = remaining / np.maximum(untouched, MAX_TIE)
        return np.asarray(
            variances * parts ** (-2.0 * order) * shrunk ** (2.0 * settings.untouched_order)
        )

    parts = np.ones(len(variances))
    for _ in range(settings.max_cuts + 1):
        now = left(parts)
        yield parts.astype(np.int32), float(now.sum())
        gain = now - left(parts + 1.0)
        parts[int(np.argmax(gain >= gain.max() * (1.0 - MAX_TIE)))] += 1.0
