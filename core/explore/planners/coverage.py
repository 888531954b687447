"""What no pad has touched, room for one slice more, and the surface between two slices.

The squared radius q is carried between slices by the cubic that has its values and slopes at both:
exact for every ellipsoid. A curve of one degree more, or one that knows less, differs from it; how
far such differences predict the true error was measured on shapes of known form. All figures of a
profile are shares of the object's height.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.protocol import (
    SAME,
    Observation,
    ObservedSlice,
    SliceOutcome,
    first_and_last,
)

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
    usable = [one for one in observation.slices if one.usable]
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

    Where only contours count, what is touched beside them tells nothing: the middle is as good as
    any place.
    """
    if not observation.all_taxels or not any(one.usable for one in observation.slices):
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

    Along the surface a pad touches as much as its neighbours' pads did; where the surface leans,
    that is less of the height.
    """
    usable = sorted((one for one in observation.slices if one.usable), key=lambda one: one.height)
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
    room = observation.spacing * (1.0 - 1e-9)
    tried = [(one.height, room) for one in observation.slices]
    spacing = max(observation.finger_spacing, room)
    tried += [(height, spacing) for height in observation.busy_heights]
    reach = int(np.ceil(within.length / (0.25 * observation.spacing)))
    for step in sorted(range(-reach, reach + 1), key=lambda step: (abs(step), -step)):
        height = wanted + 0.25 * observation.spacing * step
        inside = within.low <= height <= within.high
        if inside and all(abs(height - other) >= gap for other, gap in tried):
            return height
    return None


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
    slices = sorted((one for one in observation.slices if one.usable), key=lambda one: one.height)
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
    chord_gap: Floats  # The cubic against the straight line between the positions
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
    chord_gap = h * (d0 - d1) / 8.0
    rise_mismatch = (q1 - q0 - 0.5 * h * (d0 + d1) + h**2 * (c1 - c0) / 12.0) / 16.0
    bend_side = np.sqrt(_rms(profile.bends) + LEAST_BEND)
    return ErrorIndicators(
        width=h[:, 0],
        quintic_gap=_rms(quintic_gap * normal),
        chord_gap=_rms(chord_gap * normal),
        rise_mismatch=_rms(rise_mismatch * normal),
        noise=np.sqrt(0.5 * (profile.deviations[:-1] ** 2 + profile.deviations[1:] ** 2)),
        bend_side=bend_side[1:] / (bend_side[1:] + bend_side[:-1]),
    )


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))
