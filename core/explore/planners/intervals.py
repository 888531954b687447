"""Between two slices: what the surface may do there, from positions, slopes and curvatures.

The squared radius q is carried between slices by the cubic that has its values and slopes at
both: exact for every ellipsoid. A curve of one degree more, or one that knows less, differs from
it; how far such differences foretell the true error was measured on shapes of known form.
All figures are shares of the object's height.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.choice import SAME
from palpate.core.explore.planners.known import Known, Slice

MOST_BEND = 8.0
"""Of the radius' second derivative times the interval: curvatures beyond are edges."""
MOST = 1e6
"""Radius over the height, slope, and curvature times the height: beyond, the power that is taken of
them would be no number. Of a radius, the inverse is the least."""
LEAST_BEND = 0.02
"""Second derivative of the squared radius below which nothing bends."""


class Profile(NamedTuple):
    """The usable slices by height; lengths as shares of the object's height."""

    heights: Floats
    """(m,), from the bottom up."""
    squares: Floats
    """Squared radii; (m, k)."""
    rises: Floats
    """Their first derivative; (m, k)."""
    bends: Floats
    """Their second derivative; (m, k)."""
    radii: Floats
    """(m, k)."""
    slopes: Floats
    """(m, k)."""
    deviations: Floats
    """Of the radii; (m,)."""


def profile_of(known: Known) -> Profile:
    """The usable slices of what is known."""
    slices = sorted((one for one in known.slices if one.usable), key=lambda one: one.height)
    return stack_slices(slices, known.low, known.extent)


def stack_slices(slices: Sequence[Slice], low: float, extent: float) -> Profile:
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


class Signs(NamedTuple):
    """Of each interval, root mean square over the azimuths, as normal distances; (m - 1,)."""

    width: Floats
    """Its height."""
    higher: Floats
    """In its middle: the quintic with curvatures, too, against the cubic."""
    lower: Floats
    """The cubic against the straight line between the positions."""
    clash: Floats
    """How far slopes and curvatures of both ends miss the rise of the positions."""
    noise: Floats
    """Standard deviation of the two slices."""
    pull: Floats
    """From 0 to 1: towards which end it bends more, by the root of the second derivatives."""


def signs_of(profile: Profile) -> Signs:
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
    higher = h * (d0 - d1) / 32.0 + h**2 * (c0 + c1) / 64.0
    lower = h * (d0 - d1) / 8.0
    clash = (q1 - q0 - 0.5 * h * (d0 + d1) + h**2 * (c1 - c0) / 12.0) / 16.0
    pull = np.sqrt(_rms(profile.bends) + LEAST_BEND)
    return Signs(
        width=h[:, 0],
        higher=_rms(higher * normal),
        lower=_rms(lower * normal),
        clash=_rms(clash * normal),
        noise=np.sqrt(0.5 * (profile.deviations[:-1] ** 2 + profile.deviations[1:] ** 2)),
        pull=pull[1:] / (pull[1:] + pull[:-1]),
    )


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=1)))
