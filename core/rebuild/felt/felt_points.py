"""Everything that one touch felt, as points on the surface with their normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.frames import split_pose
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad


class FeltPoints(NamedTuple):
    """Touched taxels, world frame."""

    points: Floats
    """(n, 3), m."""
    normals: Floats
    """Outward unit normals, (n, 3)."""


def felt_points(
    pad: Pad, pose: Floats, surface: Floats, touched: Bools, jet: Jet | None
) -> FeltPoints:
    """Surface points under the touched taxels, (n, 3), and normals from the jet.

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
        Without one the normal is the pad's own.
    """
    position, axes = split_pose(pose)
    x, y = pad.grid()
    local = np.column_stack([x[touched], y[touched], surface[touched]])
    slope_x = slope_y = np.zeros(len(local))
    if jet is not None:
        slope_x, slope_y = jet.slopes(local[:, 0], local[:, 1])
    outward = np.column_stack([slope_x, slope_y, -np.ones(len(local))])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    return FeltPoints(local @ axes.T + position, outward @ axes.T)


def stack_points(parts: list[FeltPoints]) -> FeltPoints:
    """All points of several touches."""
    if not parts:
        return FeltPoints(np.zeros((0, 3)), np.zeros((0, 3)))
    return FeltPoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))
