"""What no pad has touched, where a further slice has room, and the profile that slices give.

Between slices the squared radius q follows the cubic that has its values and slopes at both: exact
for every ellipsoid. A curve of higher or lower degree differs from it; how far such differences
predict the true error was measured on shapes of known form (`error_bound.py`). All figures of a
profile are fractions of the object's height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.protocol import (
    MAX_ROUNDING,
    Observation,
    ObservedSlice,
    SliceOutcome,
    first_and_last,
)

# Bound of slopes, radii per height, and curvatures times height: larger ones would overflow in
# powers. Radii per height are at least its inverse.
MAX_FIGURE = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class BandSettings:
    """When a height is untouched, and how bands are looked up."""

    rows_per_spacing: int = 8  # examined heights per smallest distance of two slices
    max_open: float = 0.1  # fraction of the azimuths that may be untouched at a touched height
    n_heights: int = 65  # of a span, at which the expected band is computed


class Span(NamedTuple):
    """A stretch of the side."""

    low: float  # [m]
    high: float  # [m]

    @property
    def length(self) -> float:
        """High less low [m]."""
        return self.high - self.low

    @property
    def middle(self) -> float:
        """Half-way [m]."""
        return 0.5 * (self.low + self.high)


def untouched_spans(
    observation: Observation, settings: BandSettings = BandSettings()
) -> list[Span]:
    """Stretches between the first and the last height that no slice has touched, from below."""
    bottom, top = first_and_last(observation)
    n_rows = settings.rows_per_spacing * (top - bottom) / observation.spacing
    count = max(int(np.ceil(n_rows)), 1)
    edges = np.linspace(bottom, top, count + 1)
    rows = 0.5 * (edges[:-1] + edges[1:])[:, None]
    usable = observation.usable_slices
    if not usable:
        return [Span(bottom, top)]
    touched = np.zeros((count, len(usable[0].radii)), dtype=bool)
    for contour in usable:
        touched |= (rows >= contour.contact_low) & (rows <= contour.contact_high)
    untouched = np.mean(~touched, axis=1) > settings.max_open
    turns = np.flatnonzero(np.diff(np.concatenate([[False], untouched, [False]]).astype(np.int8)))
    return [Span(*pair) for pair in edges[turns].reshape(-1, 2).tolist()]


def untraceable_height(observation: Observation) -> float:
    """Total height of the untouched spans in which a slice failed [m]."""
    failed = [made.height for made in observation.slices if made.outcome == SliceOutcome.FAILED]
    spans = untouched_spans(observation)
    return sum(span.length for span in spans if any(span.low <= at <= span.high for at in failed))


def even_heights(
    observation: Observation, span: Span, settings: BandSettings = BandSettings()
) -> list[float]:
    """Heights of the fewest slices that touch an untouched span, from below [m].

    Where only contours count, touched bands are not used, and the result is the span's middle.
    """
    if not observation.all_taxels or not observation.usable_slices:
        return [span.middle]
    heights = np.linspace(span.low, span.high, settings.n_heights)
    bands = _expected_bands(observation, heights, settings)
    # Lengths are divided by the local sum of band and feature: a slice and a gap take 1 of them.
    units = 0.5 * (bands[1:] + bands[:-1]) + observation.feature
    step = span.length / (settings.n_heights - 1) / units
    along = np.concatenate([[0.0], np.cumsum(step)])
    band = float(np.mean(bands / (bands + observation.feature)))
    count = max(int(np.ceil(along[-1] - (1.0 - band) - MAX_ROUNDING)), 1)
    gap = (along[-1] - count * band) / (count + 1)
    places = np.interp(gap + 0.5 * band + np.arange(count) * (band + gap), along, heights)
    return [float(height) for height in places]


def _expected_bands(observation: Observation, heights: Floats, settings: BandSettings) -> Floats:
    """Height (n,) of the band that a slice at each height (n,) is expected to touch [m].

    Along the surface a pad touches as much as its neighbours' did: less height if it leans.
    """
    usable = sorted(observation.usable_slices, key=lambda contour: contour.height)
    touched = [
        np.quantile(contour.contact_high - contour.contact_low, settings.max_open)
        for contour in usable
    ]
    stretches = [float(np.sqrt(1.0 + (contour.slopes**2).mean())) for contour in usable]
    known_heights = [contour.height for contour in usable]
    along = np.interp(heights, known_heights, np.multiply(touched, stretches))
    profile = profile_of(observation)
    if len(profile.heights) < 2:
        return along
    shares = np.clip((heights - observation.low) / observation.extent, *profile.heights[[0, -1]])
    radii = np.sqrt(np.maximum(hermite(profile, shares), 0.0))
    slopes = np.gradient(radii, (heights - observation.low) / observation.extent, axis=0)
    return np.asarray(along / np.sqrt(1.0 + (slopes**2).mean(axis=1)))


def longest_untouched(spans: Sequence[Span], low: float, high: float) -> float:
    """Longest untouched stretch between two heights [m]."""
    return max([min(span.high, high) - max(span.low, low) for span in spans] + [0.0])


def longest_first(spans: Sequence[Span], unit: float) -> list[Span]:
    """Spans by length, the longest first; of equal ones, to a millionth of `unit`, the lowest."""
    return sorted(spans, key=lambda span: -round(span.length / unit, 6))


def free_height(observation: Observation, wanted: float, span: Span) -> float | None:
    """The height in a span nearest to the wanted one that is far enough from all tried ones [m].

    Heights at which other fingers are at work count as tried. None if there is no room.
    """
    tried = [(made.height, observation.spacing) for made in observation.slices]
    spacing = max(observation.finger_spacing, observation.spacing)
    tried += [(height, spacing) for height in observation.busy_heights]
    nearest = [wanted, span.low, span.high]
    nearest += [height + side * gap for height, gap in tried for side in (1.0, -1.0)]
    free = (
        height
        for height in nearest
        if span.low <= height <= span.high
        and all(abs(height - other) >= gap * (1.0 - MAX_ROUNDING) for other, gap in tried)
    )
    return min(free, key=lambda height: (abs(height - wanted), -height), default=None)


class Profile(NamedTuple):
    """The usable slices by height; lengths as fractions of the object's height."""

    heights: Floats  # (m,) from the bottom up
    squares: Floats  # (m, k) squared radii
    rises: Floats  # (m, k) their first derivative
    bends: Floats  # (m, k) their second derivative
    radii: Floats  # (m, k)
    slopes: Floats  # (m, k)
    deviations: Floats  # (m,) of the radii


def profile_of(observation: Observation) -> Profile:
    """The usable slices of an observation."""
    slices = sorted(observation.usable_slices, key=lambda contour: contour.height)
    return stack_slices(slices, observation.low, observation.extent)


def stack_slices(slices: Sequence[ObservedSlice], low: float, extent: float) -> Profile:
    """Usable slices, sorted by height, as arrays; of two at one height the later.

    `low`: of the object's end [m]. `extent`: the object's height [m].
    """
    slices = [
        contour
        for contour, above in zip_longest(slices, slices[1:])
        if above is None or above.height - contour.height > MAX_ROUNDING * extent
    ]
    heights = np.array([(contour.height - low) / extent for contour in slices])
    radii = np.array([contour.radii for contour in slices]) / extent
    radii = np.clip(radii, 1.0 / MAX_FIGURE, MAX_FIGURE)
    slopes = np.clip(np.array([contour.slopes for contour in slices]), -MAX_FIGURE, MAX_FIGURE)
    limit = MAX_FIGURE / extent
    curvatures = np.clip([contour.curvatures for contour in slices], -limit, limit) * extent
    second = -curvatures * (1.0 + slopes**2) ** 1.5
    return Profile(
        heights=heights,
        squares=radii**2,
        rises=2.0 * radii * slopes,
        bends=2.0 * slopes**2 + 2.0 * radii * second,
        radii=radii,
        slopes=slopes,
        deviations=np.array([contour.deviation for contour in slices]) / extent,
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
