"""Array types, the checks that public functions start with, and the spread of errors.

The median resists up to half of gross errors (Hampel, *The influence curve and its role in robust
estimation*, 1974). The constant of normal noise is defined both ways, as textbooks round it:
multiplying by one differs from dividing by the other in the fifth digit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]
MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute deviation of normal noise
PROBABLE_ERROR = 0.6745  # median absolute deviation over standard deviation of normal noise


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Floats:
    """A finite float array with a shape, in which None is any length.

    Raises ValueError if `value` has other entries than finite real numbers, or another shape.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of unequal length
        raise ValueError(f"{name} must be an array of numbers, got rows of many lengths") from error
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be an array of real numbers, got {array.dtype}")
    sides = zip(shape, array.shape, strict=True)
    fits = array.ndim == len(shape) and all(want in (None, have) for want, have in sides)
    if not fits:
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")
    array = array.astype(np.float64, copy=False)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


def positive(name: str, value: float, unit: str) -> float:
    """A positive, finite number; else ValueError."""
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} must be positive and finite, got {value} {unit}")
    return float(value)


def in_metres(name: str, length: float, most: float) -> float:
    """A length that is plausible in metres; ValueError if it exceeds `most` [m]."""
    if length > most:
        raise ValueError(
            f"{name} is {length:g} m, and at most {most:g} m is meant here: lengths are in metres; "
            "multiply millimetres by 0.001"
        )
    return length


def check_extent(name: str, points: Floats, most: float) -> None:
    """Raise ValueError if points (n, 3) span more than `most` [m]: not plausible in metres."""
    span = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if span > most:
        raise ValueError(
            f"{name} span {span:.4g} m, and at most {most:g} m is meant here: coordinates are in "
            "metres; multiply millimetres by 0.001"
        )


def not_negative(name: str, value: float, unit: str) -> float:
    """A finite number that is 0 or more; else ValueError."""
    if not 0.0 <= value < math.inf:
        raise ValueError(f"{name} must be 0 or more and finite, got {value} {unit}")
    return float(value)


def scaled_mad(errors: ArrayLike) -> float:
    """Standard deviation of errors about 0: 1.4826 times their median absolute value."""
    return MAD_TO_SIGMA * float(np.median(np.abs(errors)))


def probable_error_sigma(errors: ArrayLike) -> float:
    """Standard deviation of errors about 0: their median absolute value over 0.6745."""
    return float(np.median(np.abs(errors))) / PROBABLE_ERROR
