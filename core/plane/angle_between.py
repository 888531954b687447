"""The angle between two directions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats


def angle_between(first: Floats, second: Floats) -> Floats:
    """Angle (...) from 0 to pi between directions (..., 2) or (..., 3), rad.

    By the arc tangent of cross and scalar product: an arc cosine knows nothing of angles
    below 1e-8. A direction of length 0 is taken to lie along any other.

    Raises
    ------
    ValueError
        If a direction is not finite (..., 2) or (..., 3).
    """
    first, second = _scaled("first", first, (2, 3)), _scaled("second", second, (2, 3))
    along = np.einsum("...d,...d->...", first, second)
    if first.shape[-1] == 2:
        across = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    else:
        across = np.linalg.norm(np.cross(first, second), axis=-1)
    angle: Floats = np.arctan2(across, along)
    return angle


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle (...) above -pi and up to pi from one plane direction (..., 2) to another, rad.

    Positive counter-clockwise; made as `angle_between` makes its.

    Raises
    ------
    ValueError
        If a direction is not finite (..., 2).
    """
    first, second = _scaled("first", first, (2,)), _scaled("second", second, (2,))
    along = np.einsum("...d,...d->...", first, second)
    across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    turn: Floats = np.arctan2(across + 0.0, along)  # of -0 it would be -pi
    return turn


def _scaled(name: str, direction: ArrayLike, sizes: tuple[int, ...]) -> Floats:
    """The direction with a largest coordinate of 1, so that no product leaves the range."""
    direction = np.asarray(direction, np.float64)
    if not direction.ndim or direction.shape[-1] not in sizes:
        wanted = " or ".join(f"(..., {size})" for size in sizes)
        raise ValueError(f"{name} must have shape {wanted}, got {direction.shape}")
    if not np.isfinite(direction).all():
        raise ValueError(f"{name} must be finite")
    largest = np.abs(direction).max(axis=-1, keepdims=True)
    scaled: Floats = direction / np.where(largest > 0.0, largest, 1.0)
    return scaled
