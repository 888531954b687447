"""Filters for tactile images: adaptive Wiener against noise, median against impulses."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Bools, Floats

WINDOW = 3
"""Taxels along a side of the neighbourhood."""
OTHERS = [i for i in range(WINDOW * WINDOW) if i != WINDOW * WINDOW // 2]
"""The neighbourhood without its middle."""
IMPULSE_SPREADS = 6.0
"""An impulse stands off by more than this many standard deviations of the frame."""
MAD_TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation, for normal noise."""


def adaptive_wiener(image: Floats, noise_variance: float) -> Floats:
    """Pull each taxel towards its neighbourhood's mean, by as much as noise explains.

    Parameters
    ----------
    image : (rows, cols) array
        m.
    noise_variance : float
        Variance of one taxel's noise, m^2. With 0 the image comes back as it is.

    Notes
    -----
    Fung, 1999, (3.4) to (3.9); variances stand where (3.6) prints deviations, borders are
    reflected, and a neighbourhood without any variance keeps its mean instead of 0/0.
    """
    if noise_variance <= 0.0:
        return image
    around = _neighbourhoods(image)
    mean = around.mean(axis=-1)
    variance = ((around - mean[..., None]) ** 2).mean(axis=-1)
    signal = np.maximum(variance - noise_variance, 0.0)
    share = signal / np.maximum(variance, noise_variance)
    result: Floats = mean + share * (image - mean)
    return result


def median_filter(image: Floats, step: float) -> tuple[Floats, Bools]:
    """Replace impulses by the median of their neighbourhood.

    A taxel is an impulse if it stands above all of its neighbours, or below all of them, by
    more than `step` and by more than 6 standard deviations of the frame (robustly estimated).
    All others stay as they are: a median taken everywhere makes plateaus, and no curvature
    survives those; and the steepest slope has a higher neighbour on one side and a lower one
    on the other.

    Parameters
    ----------
    image : (rows, cols) array
        m.
    step : float
        The largest difference that a surface can show between a taxel and all around it, m.

    Returns
    -------
    filtered : (rows, cols) array
        m.
    impulses : (rows, cols) array of bool
        What was replaced.
    """
    around = _neighbourhoods(image)
    beside = around[..., OTHERS] - image[..., None]
    alone = np.maximum(beside.min(axis=-1), -beside.max(axis=-1))
    impulses = alone > step
    if not impulses.any():  # most frames: the medians are worth as much as the rest of a touch
        return image, impulses
    median = np.median(around, axis=-1)
    spread = MAD_TO_SIGMA * float(np.median(np.abs(image - median)))
    impulses &= alone > IMPULSE_SPREADS * spread
    return np.where(impulses, median, image), impulses


def _neighbourhoods(image: Floats) -> Floats:
    """The taxels around each taxel, (rows, cols, 9); reflected at the borders."""
    half = WINDOW // 2
    padded = np.pad(image, half, mode="reflect")
    windows = sliding_window_view(padded, (WINDOW, WINDOW))
    return windows.reshape(*image.shape, WINDOW * WINDOW)
