"""Between the world, in which everything is felt, and the frame in which it is sliced."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.frames import IDENTITY, rotation_matrix, split_pose
from palpate.core.rebuild.felt.felt_points import FeltPoints


def slicing_pose(frame: ArrayLike | None) -> Floats | None:
    """A checked pose (7,) of a slicing frame in the world; None if it is the world's own.

    Raises
    ------
    ValueError
        If it is no pose: seven finite numbers, the last four a quaternion of length 1.
    """
    if frame is None:
        return None
    pose = finite_array("frame", frame, IDENTITY.shape).copy()
    rotation_matrix(pose[3:])
    if np.array_equal(pose, IDENTITY):
        return None
    pose.setflags(write=False)
    return pose


def into_frame(frame: Floats | None, points: Floats) -> Floats:
    """Points (n, 3) of the world as they are seen from a frame."""
    if frame is None:
        return points
    position, axes = split_pose(frame)
    seen: Floats = (points - position) @ axes
    return seen


def turned_into_frame(frame: Floats | None, directions: Floats) -> Floats:
    """Directions (n, 3) of the world as they are seen from a frame."""
    if frame is None:
        return directions
    seen: Floats = directions @ rotation_matrix(frame[3:])
    return seen


def felt_into_frame(frame: Floats | None, felt: FeltPoints) -> FeltPoints:
    """Felt points of the world as they are seen from a frame."""
    normals = felt.normals
    return felt._replace(
        points=into_frame(frame, felt.points),
        normals=None if normals is None else turned_into_frame(frame, normals),
    )
