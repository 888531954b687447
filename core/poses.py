"""Poses, rotation matrices, quaternions, rotation vectors, and the principal axes of points.

In messages and files a pose is seven numbers: position x, y, z [m], then a unit quaternion x, y, z,
w. Computations convert them once to a `Pose`. Rotation matrices have the axes of the moved frame as
columns. A rotation vector is axis times angle, for poses that are adjusted by least squares. Not
scipy's `Rotation`, which has other last digits, takes 0.3 s to import, and five times as long for
one rotation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from palpate.core.arrays import Floats

IDENTITY_POSE: Floats = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # as in messages
FACING_DOWN: Floats = np.diag([1.0, -1.0, -1.0])  # rotation of a pad that faces straight down
IDENTITY_POSE.setflags(write=False)
FACING_DOWN.setflags(write=False)
UNIT_TOLERANCE = 1e-6  # of a quaternion's length; closer ones are normalised, others are errors


class Pose(NamedTuple):
    """Position and rotation of a frame: the rigid motion from it to the outer frame."""

    position: Floats  # of its origin, (3,) [m]
    axes: Floats  # of the frame as columns, (3, 3), a rotation

    @classmethod
    def from_array(cls, array: Floats) -> Self:
        """Pose from seven numbers, as in messages.

        Raises ValueError if the quaternion is not of unit length within 1e-6.
        """
        return cls(array[:3], rotation_matrix(array[3:]))

    @property
    def array(self) -> Floats:
        """The pose as seven numbers, (7,), as in messages."""
        return np.concatenate([self.position, quaternion_from_matrix(self.axes)])

    def __matmul__(self, inner: Pose) -> Pose:
        """The pose `inner` of this frame, in the outer frame."""
        return Pose(self.position + self.axes @ inner.position, self.axes @ inner.axes)

    def inverse(self) -> Pose:
        """The pose of the outer frame in this one."""
        return Pose(-self.axes.T @ self.position, self.axes.T)

    def to_outer(self, points: Floats) -> Floats:
        """Points (n, 3) of this frame in the outer frame."""
        return points @ self.axes.T + self.position

    def to_local(self, points: Floats) -> Floats:
        """Points (n, 3) of the outer frame in this one."""
        return (points - self.position) @ self.axes

    def advanced(self, distance: float) -> Pose:
        """The pose moved along its own z axis [m]."""
        return Pose(self.position + distance * self.axes[:, 2], self.axes)

    def turned(self, shift: Sequence[float], turn: Sequence[float]) -> Pose:
        """The pose shifted [m], and turned by a rotation vector [rad], both in its own frame."""
        rotation = rotations_from_vectors(np.array([turn]))[0]
        return Pose(self.position + self.axes @ np.asarray(shift), self.axes @ rotation)


def rotation_matrix(quaternion: Floats) -> Floats:
    """Rotation matrix (3, 3) of a quaternion x, y, z, w.

    Raises ValueError if the quaternion is not of unit length within 1e-6.
    """
    x, y, z, w = quaternion.tolist()
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        raise ValueError(f"a rotation must be a quaternion of length 1, got length {length:g}")
    x, y, z, w = x / length, y / length, z / length, w / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_matrix(matrix: Floats) -> Floats:
    """Quaternion x, y, z, w of a rotation matrix (3, 3), by its largest component.

    Shepperd, *Quaternion from rotation matrix*, 1978: never divides by a small number.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    squares = [1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i]
    columns = [
        [squares[0], b + d, c + g, h - f],
        [b + d, squares[1], f + h, c - g],
        [c + g, f + h, squares[2], d - b],
        [h - f, c - g, d - b, squares[3]],
    ]
    best = np.array(columns[int(np.argmax(squares))])
    return best / math.sqrt(float(best @ best))


def pad_rotation(heading: float, tilt: float) -> Floats:
    """Rotation of a pad that faces a surface.

    `heading`: azimuth of the outward normal [rad]. `tilt`: elevation of the outward normal [rad].
    Returns (3, 3), pad axes as columns: x along the contour, counter-clockwise; z into the object;
    y completes them and points downwards where `tilt` is 0.
    """
    along = np.array([-math.sin(heading), math.cos(heading), 0.0])
    level = math.cos(tilt)
    x, y, z = -level * math.cos(heading), -level * math.sin(heading), -math.sin(tilt)
    into = np.array([x, y, z])
    across = np.array([-z * along[1], z * along[0], x * along[1] - y * along[0]])
    return np.column_stack([along, across, into])


def rotation_angle(first: Floats, second: Floats) -> float:
    """Angle [rad] between two rotation matrices; by atan2, which is exact for small angles."""
    relative = first.T @ second
    axis = np.array(
        [
            relative[2, 1] - relative[1, 2],
            relative[0, 2] - relative[2, 0],
            relative[1, 0] - relative[0, 1],
        ]
    )
    return math.atan2(math.sqrt(float(axis @ axis)), float(np.trace(relative)) - 1.0)


def rotations_from_vectors(vectors: Floats) -> Floats:
    """Rotation matrices (b, 3, 3) of rotation vectors (b, 3) [rad]: Rodrigues's formula by sinc."""
    cross = cross_matrices(vectors)
    angle = np.sqrt(np.einsum("bi,bi->b", vectors, vectors))[:, None, None]
    half = np.sinc(angle / (2.0 * np.pi))
    result: Floats = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * cross @ cross
    return result


def right_jacobians(vectors: Floats, max_series_angle: float = 0.1) -> Floats:
    """Right Jacobians (b, 3, 3) of rotation vectors (b, 3) [rad].

    With R the rotation of v and J this matrix, the rotation of v + dv is, to first order, R times
    that of J dv. `max_series_angle`: below it the last coefficient is from its series [rad].
    """
    cross = cross_matrices(vectors)
    square = np.einsum("bi,bi->b", vectors, vectors)[:, None, None]
    angle = np.sqrt(square)
    half = np.sinc(angle / (2.0 * np.pi))
    small = angle < max_series_angle
    safe = np.where(small, 1.0, square)
    series = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0))
    lag = np.where(small, series, (1.0 - np.sinc(angle / np.pi)) / safe)
    result: Floats = np.eye(3) - 0.5 * half**2 * cross + lag * cross @ cross
    return result


def cross_matrices(vectors: Floats) -> Floats:
    """Matrices (b, 3, 3) of the vector products with vectors (b, 3)."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.moveaxis(np.array([[none, -z, y], [z, none, -x], [-y, x, none]]), 2, 0)


def axes_along(direction: Floats) -> Floats:
    """Orthonormal right-handed axes (3, 3) as columns, the last along a unit `direction` (3,)."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(direction)))] = 1.0
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(direction, first), direction])


def principal_axes(centred: Floats) -> Floats:
    """Principal axes (3, 3) of points about the origin, the longest last; a rotation."""
    axes = np.linalg.eigh(centred.T @ centred)[1]
    return axes if np.linalg.det(axes) > 0.0 else axes * [-1.0, 1.0, 1.0]
