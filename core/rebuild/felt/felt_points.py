"""Everything that touches felt, as points on the surface with their normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.frames import split_pose
from palpate.core.rebuild.felt.edge_slopes import edge_slopes
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad


class FeltPoints(NamedTuple):
    """Touched taxels, world frame."""

    points: Floats
    """(n, 3), m."""
    normals: Floats | None
    """Outward unit normals, (n, 3); None where nobody measured them."""
    touch: Ints
    """The touch that felt each point, (n,), not negative: those of one touch share the error of
    its pose."""


def felt_points(
    pad: Pad, pose: Floats, surface: Floats, touched: Bools, jet: Jet | None
) -> FeltPoints:
    """Surface points under the touched taxels of one touch, and normals from the jet.

    Parameters
    ----------
    pad : Pad
        The array.
    pose : (7,) array
        Pose of the pad in the world.
    surface : (rows, cols) array
        Surface over the plane of the pad's face, m.
    touched : (rows, cols) array of bool
        Which taxels count.
    jet : Jet or None
        Without one the normal is the pad's own. Next to an edge, which it does not follow,
        normals are those of the taxels beside it; a taxel whose normal nobody can tell is left out.
    """
    position, axes = split_pose(pose)
    x, y = pad.grid()
    slope_x = slope_y = np.zeros(x.shape)
    if jet is not None:
        flat = x.ravel(), y.ravel()
        edge = edge_slopes(surface, jet.height(*flat).reshape(x.shape), touched, pad.pitch)
        smooth_x, smooth_y = (each.reshape(x.shape) for each in jet.slopes(*flat))
        slope_x = np.where(edge.edge, edge.slope_x, smooth_x)
        slope_y = np.where(edge.edge, edge.slope_y, smooth_y)
        touched = touched & ~edge.unknown
    local = np.column_stack([x[touched], y[touched], surface[touched]])
    slope_x, slope_y = slope_x[touched], slope_y[touched]
    outward = np.column_stack([slope_x, slope_y, -np.ones(len(local))])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    one = np.zeros(len(local), np.int32)
    return FeltPoints(local @ axes.T + position, outward @ axes.T, one)


def stack_points(parts: list[FeltPoints]) -> FeltPoints:
    """All points of several touches, or of stacks of them; no two parts share a touch.

    Without normals if a part has none.
    """
    if not parts:
        return FeltPoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int32))
    counts = [int(part.touch.max(initial=-1)) + 1 for part in parts]
    firsts = np.cumsum([0, *counts[:-1]])
    touch = [part.touch + first for part, first in zip(parts, firsts, strict=True)]
    normals = [part.normals for part in parts if part.normals is not None]
    return FeltPoints(
        np.concatenate([part.points for part in parts]),
        np.concatenate(normals) if len(normals) == len(parts) else None,
        np.concatenate(touch).astype(np.int32),
    )


def checked(felt: object) -> FeltPoints:
    """The same, once it is known that it can be used.

    Raises
    ------
    ValueError
        If it is nothing of the kind, shapes do not fit, a number is not finite, a normal has no
        length, or a touch is negative or no whole number.
    """
    if not isinstance(felt, FeltPoints):
        kind = type(felt).__name__
        raise ValueError(f"patches must be FeltPoints(points, normals, touch), got {kind}")
    points = finite_array("patches.points", felt.points, (None, 3))
    touch = finite_array("patches.touch", felt.touch, (len(points),))
    if len(touch) and not (touch.min() >= 0.0 and (touch == np.round(touch)).all()):
        raise ValueError(
            f"patches.touch must be whole numbers from 0 on, got {touch.min():g} to {touch.max():g}"
        )
    numbers = np.unique(touch, return_inverse=True)[1].astype(np.int32)
    if felt.normals is None:
        return FeltPoints(points, None, numbers)
    normals = finite_array("patches.normals", felt.normals, points.shape)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    if not (length > 0.0).all():
        raise ValueError(f"patches.normals must have a length, got {int((length == 0).sum())} of 0")
    return FeltPoints(points, normals / length, numbers)
