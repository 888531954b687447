"""What no pad has felt, and where there is room for one slice more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners.choice import first_and_last
from palpate.core.explore.planners.intervals import hermite, profile_of
from palpate.core.explore.planners.known import Known, Outcome

ROWS = 8
"""Heights per feature at which it is asked whether anything was felt."""
FINE = 65
"""Heights of a run at which a band is looked up."""
ROUNDING = 1e-9
"""Of a slice: more than this, and it takes another one."""
OPEN = 0.1
"""A height counts as unfelt where more than this share of its azimuths is."""


class Run(NamedTuple):
    """A stretch of the side."""

    low: float
    """m."""
    high: float
    """m."""

    @property
    def length(self) -> float:
        """High less low, m."""
        return self.high - self.low

    @property
    def middle(self) -> float:
        """Half-way, m."""
        return 0.5 * (self.low + self.high)


def unfelt_runs(known: Known) -> list[Run]:
    """Stretches between the first and the last height that no slice has felt, from below."""
    bottom, top = first_and_last(known)
    count = max(int(np.ceil(ROWS * (top - bottom) / known.feature)), 1)
    edges = np.linspace(bottom, top, count + 1)
    rows = 0.5 * (edges[:-1] + edges[1:])[:, None]
    usable = [one for one in known.slices if one.usable]
    if not usable:
        return [Run(bottom, top)]
    felt = np.zeros((count, len(usable[0].radii)), dtype=bool)
    for one in usable:
        felt |= (rows >= one.felt_low) & (rows <= one.felt_high)
    unfelt = np.mean(~felt, axis=1) > OPEN
    turns = np.flatnonzero(np.diff(np.concatenate([[False], unfelt, [False]]).astype(np.int8)))
    return [Run(*pair) for pair in edges[turns].reshape(-1, 2).tolist()]


def uncovered(known: Known) -> float:
    """Height of the unfelt stretches in which a slice was tried that no finger could trace, m."""
    failed = [one.height for one in known.slices if one.outcome == Outcome.FAILED]
    runs = unfelt_runs(known)
    return sum(run.length for run in runs if any(run.low <= at <= run.high for at in failed))


def even_places(known: Known, run: Run) -> list[float]:
    """Heights at which as few slices as can be feel an unfelt run, m, from below.

    Where only contours count, what is felt beside them tells nothing: the middle is as good as any
    place.
    """
    if not known.taxels or not any(one.usable for one in known.slices):
        return [run.middle]
    heights = np.linspace(run.low, run.high, FINE)
    bands = _expected_bands(known, heights)
    # In units of a band and a feature, a stretch as long as both is 1 everywhere.
    step = run.length / (FINE - 1) / (0.5 * (bands[1:] + bands[:-1]) + known.feature)
    along = np.concatenate([[0.0], np.cumsum(step)])
    band = float(np.mean(bands / (bands + known.feature)))
    count = max(int(np.ceil(along[-1] - (1.0 - band) - ROUNDING)), 1)
    gap = (along[-1] - count * band) / (count + 1)
    found = np.interp(gap + 0.5 * band + np.arange(count) * (band + gap), along, heights)
    return [float(height) for height in found]


def _expected_bands(known: Known, heights: Floats) -> Floats:
    """Height (n,) of the band that a slice at each height (n,) is expected to feel, m.

    Along the surface a pad feels as much as its neighbours' pads did; where the surface leans, that
    is less of the height.
    """
    usable = sorted((one for one in known.slices if one.usable), key=lambda one: one.height)
    felt = [np.quantile(one.felt_high - one.felt_low, OPEN) for one in usable]
    long = [_steepness(one.slopes) for one in usable]
    along = np.interp(heights, [one.height for one in usable], np.multiply(felt, long))
    profile = profile_of(known)
    if len(profile.heights) < 2:
        return along
    shares = np.clip((heights - known.low) / known.extent, *profile.heights[[0, -1]])
    wide = np.sqrt(np.maximum(hermite(profile, shares), 0.0))
    slopes = np.gradient(wide, (heights - known.low) / known.extent, axis=0)
    return np.asarray(along / np.sqrt(1.0 + (slopes**2).mean(axis=1)))


def _steepness(slopes: Floats) -> float:
    return float(np.sqrt(1.0 + (slopes**2).mean()))


def longest_unfelt(runs: Sequence[Run], low: float, high: float) -> float:
    """Longest unfelt stretch between two heights, m."""
    return max([min(run.high, high) - max(run.low, low) for run in runs] + [0.0])


def longest_first(runs: Sequence[Run], unit: float) -> list[Run]:
    """Longest first; of runs as long as each other, to a millionth of `unit`, the lowest first."""
    return sorted(runs, key=lambda run: -round(run.length / unit, 6))


def free_height(known: Known, wanted: float, within: Run) -> float | None:
    """The height nearest to the wanted one that is a feature away from all that were tried.

    Parameters
    ----------
    known : Known
        What is known; heights at which other fingers are at work count as tried.
    wanted : float
        m.
    within : Run
        Where it must lie.

    Returns
    -------
    float or None
        m; None if there is no room.
    """
    room = known.feature * (1.0 - 1e-9)
    tried = [(one.height, room) for one in known.slices]
    tried += [(height, max(known.apart, room)) for height in known.taken]
    reach = int(np.ceil(within.length / (0.25 * known.feature)))
    steps = sorted(range(-reach, reach + 1), key=lambda step: (abs(step), -step))
    for step in steps:
        height = wanted + 0.25 * known.feature * step
        inside = within.low <= height <= within.high
        if inside and all(abs(height - other) >= gap for other, gap in tried):
            return height
    return None
