"""Contact points with their normals, and the frame in which an object is sliced.

A point of a contour with a normal is represented by three contact points: the point itself, and
two on its tangent plane, a little above and below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.poses import IDENTITY_POSE, Pose, rotation_matrix
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalPointSettings:
    """How far from a point with a normal its two additional contact points lie."""

    spacing_fraction: float = 0.02  # of the mean spacing of the contours
    width_fraction: float = 1e-3  # of the first contour's width, where all have one height
    min_horizontal_normal: float = 0.05  # of a unit normal; points of steeper ones are left out


@readable
class ContactPoints(NamedTuple):
    """Touched taxels, world frame."""

    points: Floats  # (n, 3) [m]
    normals: Floats | None  # outward unit normals, (n, 3); None if not measured
    touch: Ints  # number of each point's touch, (n,), from 0; its points share its pose error

    @classmethod
    def of_touch(cls, points: Floats, normals: Floats) -> ContactPoints:
        """Contact points of a single touch."""
        return cls(points, normals, np.zeros(len(points), np.int32))


def taxel_pitch(contacts: ContactPoints) -> float:
    """Median distance [m] from a taxel to the nearest one, in the touch with most taxels.

    It is 0 if that touch has a single taxel.
    """
    largest_touch = int(np.bincount(contacts.touch).argmax())
    points = contacts.points[contacts.touch == largest_touch]
    if len(points) < 2:
        return 0.0
    distances, _ = scipy.spatial.cKDTree(points).query(points, k=2)
    return float(np.median(np.asarray(distances)[:, 1]))


def stack_points(parts: list[ContactPoints]) -> ContactPoints:
    """All points of several sets of contacts, whose touches are numbered consecutively."""
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
    """Validated contacts with unit normals and touches numbered from 0 without gaps.

    Raises ValueError if `contacts` is of another type, shapes do not match, a number is not finite,
    a normal has length 0, or a touch number is negative or not whole.
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
    settings: NormalPointSettings = NormalPointSettings(),
) -> ContactPoints:
    """Contact points of contours with normals; each point of a contour is a touch by itself.

    Contours are (n, 3) arrays, or (n, 2) with `heights` (m,); normals (n, 3) point outward and have
    any length. Rows that are not finite, or whose normal has length 0, are left out. Contours and
    normals are in the world frame, the returned points in the `frame` (7,), if there is one.
    `settings` say how far apart the points are. Raises ValueError if there are not as many normals
    as contours, or as points of a contour.
    """
    if (count := len(normals)) != len(contours):
        raise ValueError(f"normals must be as many as the {len(contours)} contours, got {count}")
    levels = None if heights is None else finite_array("heights", heights, (len(contours),))
    parts = []
    for number, (contour, directions) in enumerate(zip(contours, normals, strict=True)):
        points, outward = np.asarray(contour, float), np.asarray(directions, float)
        if levels is not None:
            points = np.column_stack([points, np.full(len(points), levels[number])])
        if outward.shape != points.shape:
            raise ValueError(
                f"normals of contour {number} must have shape {points.shape}, got {outward.shape}"
            )
        length = np.linalg.norm(outward, axis=1)
        valid = np.isfinite(points).all(axis=1) & np.isfinite(length) & (length > 0.0)
        unit = directions_into_frame(frame, outward[valid] / length[valid, None])
        parts.append((into_frame(frame, points[valid]), unit))
    used = [points for points, _ in parts if len(points)]
    means = np.array([points[:, 2].mean() for points in used])
    step = 0.0
    if len(used) and np.ptp(means) > 0.0:
        step = settings.spacing_fraction * float(np.ptp(means)) / (len(means) - 1)
    elif len(used):
        step = settings.width_fraction * float(np.ptp(used[0][:, :2], axis=0).max())
    limit = settings.min_horizontal_normal
    return stack_points([_tangent_points(points, unit, step, limit) for points, unit in parts])


def _tangent_points(
    points: Floats, normals: Floats, step: float, min_horizontal: float
) -> ContactPoints:
    """Each point, and the points `step` [m] below and above it on its tangent plane."""
    horizontal = np.hypot(normals[:, 0], normals[:, 1])
    steep = horizontal > min_horizontal
    points, normals, horizontal = points[steep], normals[steep], horizontal[steep]
    uphill = -normals[:, :2] * normals[:, 2:] / horizontal[:, None]
    uphill = np.column_stack([uphill, horizontal])
    triples = points[:, None] + step * np.array([-1.0, 0.0, 1.0])[:, None] * uphill[:, None]
    touch = np.repeat(np.arange(len(points), dtype=np.int32), 3)
    return ContactPoints(triples.reshape(-1, 3), np.repeat(normals, 3, axis=0), touch)


def slicing_pose(frame: ArrayLike | None) -> Floats | None:
    """A validated, read-only pose (7,); None for the world frame. ValueError if it is no pose."""
    if frame is None:
        return None
    pose = finite_array("frame", frame, IDENTITY_POSE.shape).copy()
    rotation_matrix(pose[3:])
    if np.array_equal(pose, IDENTITY_POSE):
        return None
    pose.setflags(write=False)
    return pose


def into_frame(frame: Floats | None, points: Floats) -> Floats:
    """Coordinates in a frame of points (n, 3) given in the world."""
    if frame is None:
        return points
    position, axes = Pose.from_array(frame)
    return (points - position) @ axes


def contacts_into_frame(frame: Floats | None, contacts: ContactPoints) -> ContactPoints:
    """Coordinates in a frame of contact points given in the world."""
    normals = contacts.normals
    return contacts._replace(
        points=into_frame(frame, contacts.points),
        normals=None if normals is None else directions_into_frame(frame, normals),
    )


def directions_into_frame(frame: Floats | None, directions: Floats) -> Floats:
    """Components in a frame of directions (n, 3) given in the world."""
    return directions if frame is None else directions @ rotation_matrix(frame[3:])
