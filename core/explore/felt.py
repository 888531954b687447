"""What one touch tells the tracer: the arc where the touched surface meets the slice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.frames import split_pose
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad

STEEP = 2.0
"""Two neighbouring taxels belong to one surface if they differ by less than this many pitches."""
LEAN = 0.36
"""Slope to assume where only an edge of the pad touches: 20 degrees."""


class Felt(NamedTuple):
    """One touch, in the slicing frame."""

    points: Floats
    """The arc, (n, 3), in the direction of travel; empty if the slice was not met."""
    normals: Floats
    """Outward unit normals along it, (n, 3)."""
    across: Floats
    """Normal curvature across the contour along it, (n,), 1/m; convex is positive; 0 where the
    surface is not smooth."""
    slope: float
    """Slope of the surface against the pad along the pad's y axis."""
    deepest: Floats
    """The point of deepest compression, (3,)."""
    pad: Floats
    """Middle of the pad's face, (3,)."""
    plus: int
    """Touched taxels in the half of the pad with positive y."""
    minus: int
    """Touched taxels in the half with negative y."""


def feel_slice(
    pad: Pad,
    pose: Floats,
    surface: Floats,
    touched: Bools,
    jet: Jet | None,
    height: float,
    smooth: bool = True,
) -> Felt | None:
    """Arc of a touched surface at a slice height.

    Parameters
    ----------
    pad : Pad
        The array.
    pose : (7,) array
        Pose of the pad in the slicing frame.
    surface : (rows, cols) array
        Surface over the plane of the pad's face, m.
    touched : (rows, cols) array of bool
        Where the pad touches.
    jet : Jet or None
        The surface's jet; without one the pad's own normal stands in.
    height : float
        Height of the slice, m.
    smooth : bool
        False for an edge, which has no curvature.

    Returns
    -------
    None if nothing is touched.

    Notes
    -----
    Along each column of taxels the surface's height above the slice changes its sign between
    two rows; the arc's point is interpolated linearly between them.
    """
    if not touched.any():
        return None
    position, axes = split_pose(pose)
    x, y = pad.grid()
    above = position[2] + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * surface - height
    local = _crossings(pad, above, surface, touched)
    if len(local) and jet is not None:
        slope_x, slope_y = jet.slopes(local[:, 0], local[:, 1])
        curve = jet.second_derivatives(local[:, 0], local[:, 1])[2]
    else:
        slope_x = slope_y = curve = np.zeros(len(local))
    steepness = np.sqrt(1.0 + slope_x**2 + slope_y**2)
    outward = np.column_stack([slope_x, slope_y, -np.ones(len(local))]) / steepness[:, None]
    return Felt(
        points=local @ axes.T + position,
        normals=outward @ axes.T,
        across=curve / (steepness * (1.0 + slope_y**2)) * smooth,
        slope=float(np.median(slope_y)) if len(local) else _slope(pad, surface, touched),
        deepest=axes @ deepest_point(pad, surface, touched) + position,
        pad=position,
        plus=int((touched & (y > 0.25 * pad.pitch)).sum()),
        minus=int((touched & (y < -0.25 * pad.pitch)).sum()),
    )


def deepest_point(pad: Pad, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) under the most compressed taxel, pad frame, m."""
    x, y = pad.grid()
    pressed = np.where(touched, -(surface + pad.sag()), -np.inf)
    row, col = np.unravel_index(int(pressed.argmax()), surface.shape)
    return np.array([x[row, col], y[row, col], surface[row, col]])


def _crossings(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Floats:
    """Where the surface meets the slice, pad frame, (n, 3): at most one point a column."""
    x, y = pad.grid()
    rise = surface[1:] - surface[:-1]
    meets = (above[:-1] <= 0.0) != (above[1:] <= 0.0)
    one_surface = touched[:-1] & touched[1:] & (np.abs(rise) < STEEP * pad.pitch)
    row, col = np.nonzero(meets & one_surface)
    share = above[row, col] / (above[row, col] - above[row + 1, col])
    found = np.column_stack(
        [
            x[row, col],
            y[row, col] + share * pad.pitch,
            surface[row, col] + share * rise[row, col],
        ]
    )
    found = found[np.lexsort((np.abs(found[:, 1]), found[:, 0]))]
    first = np.ones(len(found), bool)
    first[1:] = np.diff(found[:, 0]) > 0.5 * pad.pitch
    return found[first]


def _slope(pad: Pad, surface: Floats, touched: Bools) -> float:
    """Slope along y where the slice was not met."""
    both = touched[:-1] & touched[1:]
    if both.sum() >= 2:
        return float(np.median((surface[1:] - surface[:-1])[both]) / pad.pitch)
    mean_y = float(pad.grid()[1][touched].mean())
    return -math.copysign(LEAN, mean_y)
