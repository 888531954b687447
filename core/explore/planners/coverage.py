"""What no pad has touched, how large the error is, and what the next halving of it will cost.

The squared radius q is carried between slices by the cubic that has its values and slopes at both:
exact for every ellipsoid. A curve of one degree more, or one that knows less, differs from it; how
far such differences predict the true error was measured on shapes of known form. All figures of a
profile are shares of the object's height.

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
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.planners.protocol import (
    END_DEVIATIONS,
    SAME,
    Observation,
    ObservedSlice,
    SliceOutcome,
    first_and_last,
)
from palpate.core.explore.planners.surface import OpenArea
from palpate.core.explore.planners.verdict import Findings, Verdict, judge

# Heights, per least distance of two slices, at which it is asked whether anything was touched.
ROWS = 8
FINE = 65  # Heights of a span at which a band is looked up
ROUNDING = 1e-9  # Of a slice: more than this, and it takes another one
OPEN = 0.1  # A height counts as untouched where more than this share of its azimuths is
MOST_BEND = 8.0  # Of the radius' second derivative times the interval: curvatures beyond are edges
# Radius over the height, slope, and curvature times the height: beyond, the power that is taken of
# them would be no number. Of a radius, the inverse is the least.
MOST = 1e6
LEAST_BEND = 0.02  # Second derivative of the squared radius below which nothing bends
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


class Span(NamedTuple):
    """A stretch of the side."""

    low: float  # m
    high: float  # m

    @property
    def length(self) -> float:
        """High less low, m."""
        return self.high - self.low

    @property
    def middle(self) -> float:
        """Half-way, m."""
        return 0.5 * (self.low + self.high)


def untouched_spans(observation: Observation) -> list[Span]:
    """Stretches between the first and the last height that no slice has touched, from below."""
    bottom, top = first_and_last(observation)
    count = max(int(np.ceil(ROWS * (top - bottom) / observation.spacing)), 1)
    edges = np.linspace(bottom, top, count + 1)
    rows = 0.5 * (edges[:-1] + edges[1:])[:, None]
    usable = observation.usable_slices
    if not usable:
        return [Span(bottom, top)]
    touched = np.zeros((count, len(usable[0].radii)), dtype=bool)
    for one in usable:
        touched |= (rows >= one.contact_low) & (rows <= one.contact_high)
    untouched = np.mean(~touched, axis=1) > OPEN
    turns = np.flatnonzero(np.diff(np.concatenate([[False], untouched, [False]]).astype(np.int8)))
    return [Span(*pair) for pair in edges[turns].reshape(-1, 2).tolist()]


def untraceable_height(observation: Observation) -> float:
    """Height of the untouched spans in which a slice was tried that no finger could trace, m."""
    failed = [one.height for one in observation.slices if one.outcome == SliceOutcome.FAILED]
    spans = untouched_spans(observation)
    return sum(span.length for span in spans if any(span.low <= at <= span.high for at in failed))


def even_heights(observation: Observation, span: Span) -> list[float]:
    """Heights at which as few slices as can be touch an untouched span, m, from below.

    Where only contours count, what is touched beside them tells nothing: it takes the middle.
    """
    if not observation.all_taxels or not observation.usable_slices:
        return [span.middle]
    heights = np.linspace(span.low, span.high, FINE)
    bands = _expected_bands(observation, heights)
    # In units of a band and a feature, a stretch as long as both is 1 everywhere.
    step = span.length / (FINE - 1) / (0.5 * (bands[1:] + bands[:-1]) + observation.feature)
    along = np.concatenate([[0.0], np.cumsum(step)])
    band = float(np.mean(bands / (bands + observation.feature)))
    count = max(int(np.ceil(along[-1] - (1.0 - band) - ROUNDING)), 1)
    gap = (along[-1] - count * band) / (count + 1)
    found = np.interp(gap + 0.5 * band + np.arange(count) * (band + gap), along, heights)
    return [float(height) for height in found]


def _expected_bands(observation: Observation, heights: Floats) -> Floats:
    """Height (n,) of the band that a slice at each height (n,) is expected to touch, m.

    Along the surface a pad touches as much as its neighbours' did: less height if it leans.
    """
    usable = sorted(observation.usable_slices, key=lambda one: one.height)
    touched = [np.quantile(one.contact_high - one.contact_low, OPEN) for one in usable]
    long = [float(np.sqrt(1.0 + (one.slopes**2).mean())) for one in usable]
    along = np.interp(heights, [one.height for one in usable], np.multiply(touched, long))
    profile = profile_of(observation)
    if len(profile.heights) < 2:
        return along
    shares = np.clip((heights - observation.low) / observation.extent, *profile.heights[[0, -1]])
    wide = np.sqrt(np.maximum(hermite(profile, shares), 0.0))
    slopes = np.gradient(wide, (heights - observation.low) / observation.extent, axis=0)
    return np.asarray(along / np.sqrt(1.0 + (slopes**2).mean(axis=1)))


def longest_untouched(spans: Sequence[Span], low: float, high: float) -> float:
    """Longest untouched stretch between two heights, m."""
    return max([min(span.high, high) - max(span.low, low) for span in spans] + [0.0])


def longest_first(spans: Sequence[Span], unit: float) -> list[Span]:
    """Longest first; of spans as long as each other, to a millionth of `unit`, the lowest first."""
    return sorted(spans, key=lambda span: -round(span.length / unit, 6))


def free_height(observation: Observation, wanted: float, within: Span) -> float | None:
    """The height nearest to the wanted one that is far enough from all that were tried.

    Heights at which other fingers are at work count as tried. In m; None if there is no room.
    """
    tried = [(one.height, observation.spacing) for one in observation.slices]
    spacing = max(observation.finger_spacing, observation.spacing)
    tried += [(height, spacing) for height in observation.busy_heights]
    nearest = [wanted, within.low, within.high]
    nearest += [height + side * gap for height, gap in tried for side in (1.0, -1.0)]
    free = (
        height
        for height in nearest
        if within.low <= height <= within.high
        and all(abs(height - other) >= gap * (1.0 - 1e-9) for other, gap in tried)
    )
    return min(free, key=lambda height: (abs(height - wanted), -height), default=None)


class Profile(NamedTuple):
    """The usable slices by height; lengths as shares of the object's height."""

    heights: Floats  # (m,), from the bottom up
    squares: Floats  # Squared radii; (m, k)
    rises: Floats  # Their first derivative; (m, k)
    bends: Floats  # Their second derivative; (m, k)
    radii: Floats  # (m, k)
    slopes: Floats  # (m, k)
    deviations: Floats  # Of the radii; (m,)


def profile_of(observation: Observation) -> Profile:
    """The usable slices of what is known."""
    slices = sorted(observation.usable_slices, key=lambda one: one.height)
    return stack_slices(slices, observation.low, observation.extent)


def stack_slices(slices: Sequence[ObservedSlice], low: float, extent: float) -> Profile:
    """Usable slices, sorted by height, as arrays; of two at one height the later."""
    slices = [
        one
        for one, above in zip_longest(slices, slices[1:])
        if above is None or above.height - one.height > SAME * extent
    ]
    heights = np.array([(one.height - low) / extent for one in slices])
    radii = np.clip(np.array([one.radii for one in slices]) / extent, 1.0 / MOST, MOST)
    slopes = np.clip(np.array([one.slopes for one in slices]), -MOST, MOST)
    limit = MOST / extent
    curvatures = np.clip([one.curvatures for one in slices], -limit, limit) * extent
    second = -curvatures * (1.0 + slopes**2) ** 1.5
    return Profile(
        heights=heights,
        squares=radii**2,
        rises=2.0 * radii * slopes,
        bends=2.0 * slopes**2 + 2.0 * radii * second,
        radii=radii,
        slopes=slopes,
        deviations=np.array([one.deviation for one in slices]) / extent,
    )


def hermite(profile: Profile, heights: Floats) -> Floats:
    """Squared radii (n, k) at heights (n,) between the first and the last slice."""
    last = len(profile.heights) - 2
    i = np.clip(np.searchsorted(profile.heights, heights, side="right") - 1, 0, last)
    width = (profile.heights[i + 1] - profile.heights[i])[:, None]
    t = (heights - profile.heights[i])[:, None] / width
    q, dq = profile.squares, profile.rises
    level = (1 + 2 * t) * (1 - t) ** 2 * q[i] + t**2 * (3 - 2 * t) * q[i + 1]
    return np.asarray(level + t * (1 - t) * width * ((1 - t) * dq[i] - t * dq[i + 1]))


class ErrorIndicators(NamedTuple):
    """Of each interval, root mean square over the azimuths, as normal distances; (m - 1,)."""

    width: Floats  # Its height
    quintic_gap: Floats  # In its middle: the quintic with curvatures, too, against the cubic
    rise_mismatch: Floats  # How far slopes and curvatures of both ends miss the positions' rise
    noise: Floats  # Standard deviation of the two slices
    bend_side: Floats  # From 0 to 1: to which end it bends more, by the root of second derivatives


def error_indicators(profile: Profile) -> ErrorIndicators:
    """What each interval shows."""
    h = np.diff(profile.heights)[:, None]
    q0, q1 = profile.squares[:-1], profile.squares[1:]
    d0, d1 = profile.rises[:-1], profile.rises[1:]
    limit = MOST_BEND * 2.0 * profile.radii
    c0 = np.clip(profile.bends[:-1], -limit[:-1] / h, limit[:-1] / h)
    c1 = np.clip(profile.bends[1:], -limit[1:] / h, limit[1:] / h)
    steep = np.sqrt(1.0 + (0.5 * (profile.slopes[:-1] + profile.slopes[1:])) ** 2)
    normal = 1.0 / (np.sqrt(2.0 * (q0 + q1)) * steep)
    # Values of the curves in the middle of the interval.
    quintic_gap = h * (d0 - d1) / 32.0 + h**2 * (c0 + c1) / 64.0
    rise_mismatch = (q1 - q0 - 0.5 * h * (d0 + d1) + h**2 * (c1 - c0) / 12.0) / 16.0
    bend_side = np.sqrt(_rms(profile.bends) + LEAST_BEND)
    return ErrorIndicators(
        width=h[:, 0],
        quintic_gap=_rms(quintic_gap * normal),
        rise_mismatch=_rms(rise_mismatch * normal),
        noise=np.sqrt(0.5 * (profile.deviations[:-1] ** 2 + profile.deviations[1:] ** 2)),
        bend_side=bend_side[1:] / (bend_side[1:] + bend_side[:-1]),
    )


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))


class Cost(NamedTuple):
    """What something takes."""

    touches: float
    seconds: float  # Robot time, s


@dataclass(frozen=True, eq=False)
class Estimate:
    """What can be said of the solid that is rebuilt from what was touched so far."""

    observation: Observation  # Of which
    findings: Findings  # What is known of the solid, and can be judged
    prediction: ErrorPrediction | None  # Of what the bound is made; None where there is none
    open_area: OpenArea | None = None  # What lies far from every touch; None where nobody looked

    @property
    def verdict(self) -> Verdict:
        """What is known, held against what is asked."""
        return judge(self.findings, self.observation.limits)

    @property
    def reached(self) -> bool:
        """Whether every limit is kept."""
        return bool(self.verdict.reached)

    @property
    def rms_bound_95(self) -> float | None:
        """The root mean square error is below this in 95 of 100 runs, m; None without a solid."""
        return self.findings.error_bound

    @property
    def largest_untouched(self) -> float:
        """The largest gap that nothing has touched, m: of the side, or of a general solid."""
        gap = self.findings.untouched_gap
        if gap is not None:
            return gap
        return 0.0 if self.open_area is None else self.open_area.width

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
        return Estimate(observation, surface.findings, None, surface.open_area)
    prediction = prediction_of(observation) if observation.bounded else None
    spans = untouched_spans(observation)
    loose = END_DEVIATIONS * max(observation.low_deviation, observation.high_deviation)
    found = Findings(untouched_gap=max([span.length for span in spans] + [loose]))
    # One slice tells how far its own band is off, and of nothing else.
    if prediction is None:
        return Estimate(observation, found, None)
    found = replace(found, error_bound=prediction.rms_bound_95 * observation.extent)
    if surface is None:
        return Estimate(observation, found, prediction)
    found = replace(
        found,
        error_bound=math.hypot(found.error_bound or 0.0, surface.hidden),
        unknown_share=surface.open_area.share,
        unentered_hole=surface.unentered_hole,
    )
    return Estimate(observation, found, prediction, surface.open_area)


def prediction_of(observation: Observation) -> ErrorPrediction | None:
    """What slices say about the side between them; None of fewer than two."""
    profile = profile_of(observation)
    if len(profile.heights) < 2:
        return None
    return predict_error(observation, profile, untouched_spans(observation))


def halving_cost(observation: Observation, prediction: ErrorPrediction) -> Cost | None:
    """Of as many slices as those so far, on average, as are predicted to halve the error."""
    usable = observation.usable_slices
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
    deviations = [one.deviation for one in observation.usable_slices]
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
