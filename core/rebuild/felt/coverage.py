"""What of the side was felt: from where to where, and where nothing was."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

SECTORS = 24
"""Parts of a turn, each of which is looked at by itself."""
TINY = 0.02
"""Of the height that was felt: a stretch without a point that is lower is none."""


class Coverage(NamedTuple):
    """Of the side, m."""

    low: float
    """Height from which on it was felt all around."""
    high: float
    """Height up to which it was."""
    gap: float
    """The highest stretch between them in which nothing was felt on some azimuth."""
    lows: Floats
    """Lowest height that was felt in each sector, (24,)."""
    highs: Floats
    """Highest one, (24,)."""
    gaps: Floats
    """Heights of all stretches in which nothing was felt, in any sector, (n,); tiny ones are left
    out."""


def coverage_of(heights: Floats, turns: Floats) -> Coverage | None:
    """Coverage of points at heights (n,) and turns (n,); None if a sector has no point."""
    sector = (np.mod(turns, 1.0) * SECTORS).astype(np.int32) % SECTORS
    if len(np.unique(sector)) < SECTORS:
        return None
    lows, highs = np.full(SECTORS, np.inf), np.full(SECTORS, -np.inf)
    np.minimum.at(lows, sector, heights)
    np.maximum.at(highs, sector, heights)
    order = np.lexsort((heights, sector))
    step = np.diff(heights[order])
    same = np.diff(sector[order]) == 0
    step = step[same]
    gaps = step[step > TINY * float(np.ptp(heights))]
    gap = float(step.max(initial=0.0))
    return Coverage(float(lows.max()), float(highs.min()), gap, lows, highs, gaps)
