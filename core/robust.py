"""Robust statistics: the standard deviation of normal noise from the median size of its errors.

Half of the errors may be gross before the median follows them (Hampel, *The influence curve and
its role in robust estimation*, 1974). The constant stands here both ways, each rounded as
textbooks have it: multiplying by the one differs from dividing by the other in the fifth digit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

MAD_TO_SIGMA = 1.4826  # Standard deviation of normal noise, of its median absolute deviation
PROBABLE_ERROR = 0.6745  # Median absolute deviation of normal noise, of its standard deviation


def scaled_mad(errors: ArrayLike) -> float:
    """Standard deviation of errors about 0, as 1.4826 times their median size."""
    return MAD_TO_SIGMA * float(np.median(np.abs(errors)))


def probable_error_sigma(errors: ArrayLike) -> float:
    """Standard deviation of errors about 0, as their median size over 0.6745."""
    return float(np.median(np.abs(errors))) / PROBABLE_ERROR
