"""Rotation vectors: axis times angle, for poses that are adjusted by least squares."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats

SERIES_BELOW = 0.1
"""Angle, rad, below which the Jacobian's last coefficient comes from its series."""


def rotations_of_vectors(vectors: Floats) -> Floats:
    """Rotation matrices (b, 3, 3) of rotation vectors (b, 3), in rad.

    Notes
    -----
    Rodrigues's formula by sinc, so that no turn at all is nothing special.
    """
    cross = _cross(vectors)
    angle = np.sqrt(np.einsum("bi,bi->b", vectors, vectors))[:, None, None]
    half = np.sinc(angle / (2.0 * np.pi))
    result: Floats = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross
    return result


def right_jacobians(vectors: Floats) -> Floats:
    """How small changes of rotation vectors turn the body, (b, 3, 3).

    With R the rotation of v and J this matrix, that of v + dv is R times that of J dv, to first
    order.
    """
    cross = _cross(vectors)
    square = np.einsum("bi,bi->b", vectors, vectors)[:, None, None]
    angle = np.sqrt(square)
    half = np.sinc(angle / (2.0 * np.pi))
    small = angle < SERIES_BELOW
    safe = np.where(small, 1.0, square)
    series = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0))
    lag = np.where(small, series, (1.0 - np.sinc(angle / np.pi)) / safe)
    result: Floats = np.eye(3) - 0.5 * half**2 * cross + lag * cross @ cross
    return result


def vector_of_rotation(matrix: Floats) -> Floats:
    """Rotation vector (3,), of angle 0 to pi, of a rotation matrix (3, 3).

    Notes
    -----
    By way of the quaternion: an angle near 0 or near pi keeps all its digits. Of the two vectors
    of a half turn it is the one that `quaternion` happens to give.
    """
    from palpate.core.frames import quaternion

    turn = quaternion(matrix)
    if turn[3] < 0.0:
        turn = -turn
    sine = math.sqrt(float(turn[:3] @ turn[:3]))
    half = math.atan2(sine, float(turn[3]))
    result: Floats = turn[:3] * (2.0 * half / sine if sine > 0.0 else 2.0)
    return result


def _cross(vectors: Floats) -> Floats:
    """Matrices (b, 3, 3) of the vector products with vectors (b, 3)."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.moveaxis(np.array(rows), 2, 0)
