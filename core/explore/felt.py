"""What one touch tells the tracer: the arc where the touched surface meets the slice."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.band import felt_bands
from palpate.core.explore.crossing import crossings, one_surface
from palpate.core.frames import split_pose
from palpate.core.touch.jet import Jet
from palpate.core.touch.pad import Pad

NEIGHBOURS = 8
"""Pairs of taxels that tell the slope nearest to the slice."""
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
    low: Floats
    """Lowest height felt below each of its points without a break, (n,), m."""
    high: Floats
    """Highest height felt above them, (n,), m."""
    slope: float
    """Slope of the surface against the pad along the pad's y axis, where it is nearest to the
    slice."""
    nearest: Floats
    """The touched point nearest to the slice in height, (3,)."""
    pad: Floats
    """Middle of the pad's face, (3,)."""
    above: int
    """Touched taxels above the slice."""
    below: int
    """Touched taxels below it."""


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
    """
    if not touched.any():
        return None
    position, axes = split_pose(pose)
    x, y = pad.grid()
    above = position[2] + axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * surface - height
    found = crossings(pad, above, surface, touched)
    low, high = felt_bands(above, one_surface(pad, surface, touched), found)
    local = found.places
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
        low=height + low,
        high=height + high,
        slope=float(np.median(slope_y)) if len(local) else _slope(pad, above, surface, touched),
        nearest=axes @ _nearest(pad, above, surface, touched) + position,
        pad=position,
        above=int((touched & (above > 0.0)).sum()),
        below=int((touched & (above < 0.0)).sum()),
    )


def deepest_point(pad: Pad, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) under the most compressed taxel, pad frame, m."""
    x, y = pad.grid()
    pressed = np.where(touched, -(surface + pad.sag()), -np.inf)
    row, col = np.unravel_index(int(pressed.argmax()), surface.shape)
    return np.array([x[row, col], y[row, col], surface[row, col]])


def _nearest(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Floats:
    """The surface's point (3,) nearest to the slice in height, pad frame, m."""
    x, y = pad.grid()
    nearest = np.where(touched, np.abs(above), np.inf).argmin()
    row, col = np.unravel_index(int(nearest), surface.shape)
    return np.array([x[row, col], y[row, col], surface[row, col]])


def _slope(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> float:
    """Slope along y at the touched rows nearest to the slice, which was not met."""
    both = touched[:-1] & touched[1:]
    if both.sum() < 2:
        mean_y = float(pad.grid()[1][touched].mean())
        return -math.copysign(LEAN, mean_y)
    away = np.abs(above[1:] + above[:-1])[both]
    rise = (surface[1:] - surface[:-1])[both] / pad.pitch
    return float(np.median(rise[np.argsort(away, kind="stable")[:NEIGHBOURS]]))
