"""Filters for tactile images: adaptive Wiener against noise, median against impulses."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Floats

WINDOW = 3
"""Taxels along a side of the neighbourhood."""
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
    reflected, and a neighbourhood without any variance keeps its mean instead of 0/0. The
    variance is taken about the mean, so that a large offset costs no digits.
    """
    if noise_variance <= 0.0:
        return image
    around = neighbourhoods(image)
    mean = around.mean(axis=-1)
    variance = ((around - mean[..., None]) ** 2).mean(axis=-1)
    signal = np.maximum(variance - noise_variance, 0.0)
    share = signal / np.maximum(variance, noise_variance)
    result: Floats = mean + share * (image - mean)
    return result


def median_filter(image: Floats) -> Floats:
    """The median of each taxel and the eight around it, borders reflected.

    Fung, 1999, section 3.4.2. It takes out what stands alone and keeps steps; but it cuts
    tops and makes plateaus, of which no curvature can be taken.
    """
    result: Floats = np.median(neighbourhoods(image), axis=-1)
    return result


def wiener_then_median(image: Floats, noise_variance: float) -> Floats:
    """Both filters in the order that Fung, 1999, prefers (figure 3.5).

    Impulses reach the Wiener filter, which takes them for signal and smears them.
    """
    return median_filter(adaptive_wiener(image, noise_variance))


def median_then_wiener(image: Floats, noise_variance: float) -> Floats:
    """Both filters in the order of figure 3.6: impulses are gone before noise is looked at."""
    return adaptive_wiener(median_filter(image), noise_variance)


def neighbourhoods(image: Floats) -> Floats:
    """The taxels around each taxel, (rows, cols, 9); reflected at the borders."""
    windows = sliding_window_view(_reflected(image), (WINDOW, WINDOW))
    return windows.reshape(*image.shape, WINDOW * WINDOW)


def _reflected(image: Floats) -> Floats:
    """The image with one taxel more on each side, mirrored about the border taxels."""
    rows, cols = image.shape
    padded = np.empty((rows + 2, cols + 2))
    padded[1:-1, 1:-1] = image
    padded[0, 1:-1], padded[-1, 1:-1] = image[1], image[-2]
    padded[:, 0], padded[:, -1] = padded[:, 2], padded[:, -3]
    return padded
