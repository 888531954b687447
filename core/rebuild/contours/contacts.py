"""Contact points with their normals, and the frame in which an object is sliced.

A contour's point with a normal is three contact points: itself, and one a little above
and below in its plane, for a normal tells where the surface goes from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.poses import IDENTITY_POSE, Pose, rotation_matrix
from palpate.reprs import readable

STEP = 0.02  # Of the mean distance of contours: how far above and below the further points lie
ALONE = 1e-3  # The same of the width, where there is but one contour
LEVEL = 0.05  # Level part of a normal, of 1, below which it tells nothing of the side


@readable
class ContactPoints(NamedTuple):
    """Touched taxels, world frame."""

    points: Floats  # (n, 3), m
    normals: Floats | None  # Outward unit normals, (n, 3); None where nobody measured them
    touch: Ints  # Of each point, (n,), from 0 on: those of one touch share the error of its pose

    @classmethod
    def of_touch(cls, points: Floats, normals: Floats) -> ContactPoints:
        """What a single touch met."""
        return cls(points, normals, np.zeros(len(points), np.int32))


def taxel_pitch(contacts: ContactPoints) -> float:
    """Median distance of the nearest two taxels in the touch that has most of them, m; 0 if one."""
    most = int(np.bincount(contacts.touch).argmax())
    points = contacts.points[contacts.touch == most]
    if len(points) < 2:
        return 0.0
    distances, _ = scipy.spatial.cKDTree(points).query(points, k=2)
    return float(np.median(np.asarray(distances)[:, 1]))


def stack_points(parts: list[ContactPoints]) -> ContactPoints:
    """All points of several touches or stacks, no two of which share a touch."""
    if not parts:
        return ContactPoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int32))
    counts = [int(part.touch.max(initial=-1)) + 1 for part in parts]
    firsts = np.cumsum([0, *counts[:-1]])
    touch = [part.touch + first for part, first in zip(parts, firsts, strict=True)]
    normals = [part.normals for part in parts if part.normals is not None]
    return ContactPoints(
        np.concatenate([part.points for part in parts]),
        np.concatenate(normals) if len(normals) == len(parts) else None,
        np.concatenate(touch).astype(np.int32),
    )


def checked_contacts(contacts: object) -> ContactPoints:
    """The same, normals of length 1 and touches counted from 0 on.

    Raises ValueError if it is nothing of the kind, shapes do not fit, a number is not finite, a
    normal has no length, or a touch is negative or no whole number.
    """
    if not isinstance(contacts, ContactPoints):
        kind = type(contacts).__name__
        raise ValueError(f"patches must be ContactPoints(points, normals, touch), got {kind}")
    points = finite_array("patches.points", contacts.points, (None, 3))
    touch = finite_array("patches.touch", contacts.touch, (len(points),))
    if len(touch) and not (touch.min() >= 0.0 and (touch == np.round(touch)).all()):
        raise ValueError(
            f"patches.touch must be whole numbers from 0 on, got {touch.min():g} to {touch.max():g}"
        )
    numbers = np.unique(touch, return_inverse=True)[1].astype(np.int32)
    if contacts.normals is None:
        return ContactPoints(points, None, numbers)
    normals = finite_array("patches.normals", contacts.normals, points.shape)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    if not (length > 0.0).all():
        raise ValueError(f"patches.normals must have a length, got {int((length == 0).sum())} of 0")
    return ContactPoints(points, normals / length, numbers)


def normals_as_points(
    contours: Sequence[ArrayLike],
    normals: Sequence[ArrayLike],
    heights: ArrayLike | None = None,
    frame: Floats | None = None,
) -> ContactPoints:
    """Contact points of contours with normals; every point is a touch by itself.

    Contours are (n, 3) arrays, or (n, 2) with `heights` (m,); normals (n, 3) point outward and have
    any length. Rows that are not finite, or whose normal has no length, are left out. Both are
    given in the world, the contact points lie in the `frame` (7,), if there is one. Raises
    ValueError if there are not as many normals as contours, or as points of a contour.
    """
    if (count := len(normals)) != len(contours):
        raise ValueError(f"normals must be as many as the {len(contours)} contours, got {count}")
    given_levels = None if heights is None else finite_array("heights", heights, (len(contours),))
    parts = []
    for which, (given, given_normals) in enumerate(zip(contours, normals, strict=True)):
        points, beside = np.asarray(given, float), np.asarray(given_normals, float)
        if given_levels is not None:
            points = np.column_stack([points, np.full(len(points), given_levels[which])])
        if beside.shape != points.shape:
            raise ValueError(
                f"normals of contour {which} must have shape {points.shape}, got {beside.shape}"
            )
        length = np.linalg.norm(beside, axis=1)
        good = np.isfinite(points).all(axis=1) & np.isfinite(length) & (length > 0.0)
        unit = turned_into_frame(frame, beside[good] / length[good, None])
        parts.append((into_frame(frame, points[good]), unit))
    used = [points for points, _ in parts if len(points)]
    levels = np.array([points[:, 2].mean() for points in used])
    step = 0.0
    if len(used) and np.ptp(levels) > 0.0:
        step = STEP * float(np.ptp(levels)) / (len(levels) - 1)
    elif len(used):
        step = ALONE * float(np.ptp(used[0][:, :2], axis=0).max())
    return stack_points([_stretches(points, unit, step) for points, unit in parts])


def _stretches(points: Floats, normals: Floats, step: float) -> ContactPoints:
    level = np.hypot(normals[:, 0], normals[:, 1])
    steep = level > LEVEL
    points, normals, level = points[steep], normals[steep], level[steep]
    uphill = np.column_stack([-normals[:, :2] * normals[:, 2:] / level[:, None], level])
    three = points[:, None] + step * np.array([-1.0, 0.0, 1.0])[:, None] * uphill[:, None]
    touch = np.repeat(np.arange(len(points), dtype=np.int32), 3)
    return ContactPoints(three.reshape(-1, 3), np.repeat(normals, 3, axis=0), touch)


def slicing_pose(frame: ArrayLike | None) -> Floats | None:
    """A checked pose (7,); None if it is the world's own. Raises ValueError if it is none."""
    if frame is None:
        return None
    pose = finite_array("frame", frame, IDENTITY_POSE.shape).copy()
    rotation_matrix(pose[3:])
    if np.array_equal(pose, IDENTITY_POSE):
        return None
    pose.setflags(write=False)
    return pose


def into_frame(frame: Floats | None, points: Floats) -> Floats:
    """Points (n, 3) of the world as they are seen from a frame."""
    if frame is None:
        return points
    position, axes = Pose.from_array(frame)
    return (points - position) @ axes


def contacts_into_frame(frame: Floats | None, contacts: ContactPoints) -> ContactPoints:
    """Contact points of the world as they are seen from a frame."""
    normals = contacts.normals
    return contacts._replace(
        points=into_frame(frame, contacts.points),
        normals=None if normals is None else turned_into_frame(frame, normals),
    )


def turned_into_frame(frame: Floats | None, directions: Floats) -> Floats:
    """Directions (n, 3) of the world as they are seen from a frame."""
    return directions if frame is None else directions @ rotation_matrix(frame[3:])
