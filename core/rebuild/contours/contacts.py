"""Contact points with their normals, and the frame in which an object is sliced.

Next to an edge, which no smooth surface follows, a taxel has the slopes of the plane, through a
small square of taxels with it among them, that fits best (Nagao and Matsuyama, *Edge preserving
smoothing*, 1979, who take the square that varies least); where none fits, nobody can tell how it
leans. A contour's point with a normal is three contact points: itself, and one a little above
and below in its plane, for a normal tells where the surface goes from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry import point_tree
from palpate.core.poses import IDENTITY_POSE, rotation_matrix, split_pose
from palpate.core.touch import Jet, Pad
from palpate.reprs import readable

SIDE = 3  # Taxels along the side of a square
# An edge is where a smooth surface leaves the taxels of a square by so many times more than its
# plane does, and by this share of the pitch besides, which is more than their noise.
WORSE, LEAST = 3.0, 0.02
# How a taxel leans is unknown if neither plane nor smooth surface follows it to within so many
# times what planes leave of most taxels, and the same share of the pitch.
UNLIKE = 6.0
STEP = 0.02  # Of the mean distance of contours: how far above and below the further points lie
ALONE = 1e-3  # The same of the width, where there is but one contour
LEVEL = 0.05  # Level part of a normal, of 1, below which it tells nothing of the side


@readable
class ContactPoints(NamedTuple):
    """Touched taxels, world frame."""

    points: Floats  # (n, 3), m
    normals: Floats | None  # Outward unit normals, (n, 3); None where nobody measured them
    touch: Ints  # Of each point, (n,), from 0 on: those of one touch share the error of its pose


def taxel_pitch(contacts: ContactPoints) -> float:
    """Median distance of the nearest two taxels in the touch that has most of them, m; 0 if one."""
    most = int(np.bincount(contacts.touch).argmax())
    points = contacts.points[contacts.touch == most]
    if len(points) < 2:
        return 0.0
    distances, _ = point_tree(points).query(points, k=2)
    return float(np.median(np.asarray(distances)[:, 1]))


def contact_points_of(
    pad: Pad, pose: Floats, surface: Floats, touched: Bools, jet: Jet | None
) -> ContactPoints:
    """Surface points under the touched taxels of one touch, and normals from the jet.

    `pose` (7,) is the pad's in the world, `surface` (rows, cols) lies over the plane of its face,
    m. Without a jet the normal is the pad's own. Next to an edge, which it does not follow, normals
    are those of the taxels beside it; a taxel whose normal nobody can tell is left out.
    """
    position, axes = split_pose(pose)
    x, y = pad.grid()
    slopes = np.zeros((2, *x.shape))
    if jet is not None:
        flat = x.ravel(), y.ravel()
        edge = edge_slopes(surface, jet.height(*flat).reshape(x.shape), touched, pad.pitch)
        slopes = np.where(edge.edge, edge.slopes, np.reshape(jet.slopes(*flat), slopes.shape))
        touched = touched & ~edge.unknown
    local = np.column_stack([x[touched], y[touched], surface[touched]])
    outward = np.column_stack([*slopes[:, touched], -np.ones(len(local))])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    touch = np.zeros(len(local), np.int32)
    return ContactPoints(local @ axes.T + position, outward @ axes.T, touch)


def edge_slopes(surface: Floats, smooth: Floats, touched: Bools, pitch: float) -> EdgeSlopes:
    """Slopes next to edges of heights (rows, cols), m, which a smooth surface was fitted to."""
    followed_all = np.abs(surface - smooth)[touched].max(initial=0.0) <= LEAST * pitch
    if followed_all or min(surface.shape) < SIDE:
        none = np.zeros(surface.shape, np.bool_)
        return EdgeSlopes(np.zeros((2, *surface.shape)), none, none)
    steps = pitch * (np.arange(SIDE) - SIDE // 2)
    squares = sliding_window_view(np.where(touched, surface, np.nan), (SIDE, SIDE))
    missed = sliding_window_view(np.where(touched, surface - smooth, np.nan), (SIDE, SIDE))
    spread = SIDE * float(steps @ steps)
    along_x = np.einsum("ijkl,l->ij", squares, steps) / spread
    along_y = np.einsum("ijkl,k->ij", squares, steps) / spread
    plane = along_y[..., None, None] * steps[:, None] + along_x[..., None, None] * steps
    left = squares - squares.mean(axis=(2, 3), keepdims=True) - plane
    off = np.where(np.isnan(along_x), np.inf, np.sqrt(np.mean(left**2, axis=(2, 3))))
    smooth_off = np.sqrt(np.mean(missed**2, axis=(2, 3)))
    best = _best_square(off)
    chosen, followed = off.ravel()[best], smooth_off.ravel()[best]
    found = touched & np.isfinite(chosen)
    edge = found & (followed > WORSE * chosen + LEAST * pitch)
    alone = np.abs(surface - smooth)
    known = chosen[found] if found.any() else alone[touched]
    usual = float(np.median(known)) if known.size else 0.0
    left = np.where(found, np.fmin(chosen, followed), alone)
    unknown = touched & ~edge & (left > UNLIKE * usual + LEAST * pitch)
    return EdgeSlopes(np.stack([along_x.ravel()[best], along_y.ravel()[best]]), edge, unknown)


def _best_square(off: Floats) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """For each taxel, the number of the square with it in which `off` (a, b) is least."""
    rows, cols = off.shape
    around = np.pad(off, SIDE - 1, constant_values=np.inf)
    numbers = np.pad(np.arange(rows * cols).reshape(rows, cols), SIDE - 1)
    choices, numbers = (
        sliding_window_view(one, (SIDE, SIDE)).reshape(rows + SIDE - 1, cols + SIDE - 1, -1)
        for one in (around, numbers)
    )
    return np.take_along_axis(numbers, choices.argmin(axis=2)[..., None], axis=2)[..., 0]


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


class EdgeSlopes(NamedTuple):
    """Of each taxel of an array (rows, cols)."""

    slopes: Floats  # Along the columns and along the rows, (2, rows, cols)
    edge: Bools  # Where they are to be believed rather than the smooth surface's
    unknown: Bools  # Where neither is to be believed


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
    position, axes = split_pose(frame)
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
