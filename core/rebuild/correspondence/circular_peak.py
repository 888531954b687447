"""Where a periodic function is largest, between its samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats


def circular_peak(values: Floats, top: NDArray[np.intp] | None = None) -> Floats:
    """Places (m,) in turns, of the peaks of functions given at even steps around, (m, n).

    By the parabola through the sample `top`, by default the largest, and its neighbours.
    """
    count = values.shape[1]
    top = values.argmax(axis=1) if top is None else top
    rows = np.arange(len(values))
    before, here, after = (values[rows, (top + step) % count] for step in (-1, 0, 1))
    bend = 2.0 * here - before - after
    step = np.divide(0.5 * (after - before), bend, out=np.zeros_like(here), where=bend > 0.0)
    peak: Floats = (top + np.clip(step, -0.5, 0.5)) / count
    return peak
