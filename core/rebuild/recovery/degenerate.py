"""Points that no superquadric can be fitted to, and what is said of them instead."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import pose_of
from palpate.core.rebuild.recovery.axes import principal_axes
from palpate.core.rebuild.recovery.canonical import Solid, canonical
from palpate.core.rebuild.recovery.normal_distance import RIGID, Warps, distances_alone
from palpate.core.rebuild.recovery.recovery import Doubt, Recovery, names_of, units_of
from palpate.core.shapes.bend import Bend

NO_EXTENT = 1e-6
"""Of the largest extent."""
ROUNDING = 1e-14
"""Of the distance from the origin: points that are nearer together are one."""
LEAST = 1e-150
"""m: so are points nearer together than this, whose squares would underflow."""
THINNEST = 1e-3
"""Of the largest extent: no ellipsoid is given thinner than this."""


def degeneracy(points: Floats, needed: int) -> Doubt | None:
    """Why points (n, 3) cannot be fitted, or None if nothing is the matter."""
    if not len(points):
        return "too few points"
    centred = points - points.mean(axis=0)
    widths = np.ptp(centred @ principal_axes(centred), axis=0)
    if together(float(widths.max()), points):
        return "identical points"
    thin = int((widths <= NO_EXTENT * widths.max()).sum())
    if thin:
        return "collinear points" if thin == 2 else "coplanar points"
    return "too few points" if len(points) < needed else None


def together(extent: float, points: Floats) -> bool:
    """True if some of points (n, 3), of this extent, are in one place."""
    return not extent > max(ROUNDING * float(np.abs(points).max()), LEAST)


def unfitted(points: Floats, warps: Warps, doubt: Doubt) -> Recovery:
    """An ellipsoid in the box of the points' principal axes, and why there is nothing better."""
    size, axes, middle = _ellipsoid_about(points)
    solid = canonical(Solid(size, np.ones(2), axes, np.zeros(2), np.zeros(2)))
    unit = float(size.max())
    residuals = np.zeros(len(points))
    if unit > 0.0:
        residuals = unit * _distances(solid, (points - middle) / unit, unit)
    units = units_of(warps, unit) if unit > 0.0 else np.ones(warps.total)
    return Recovery(
        size=solid.size,
        exponents=solid.exponents,
        pose=pose_of(middle, solid.axes),
        taper=np.zeros(2),
        bend=Bend(0.0),
        residuals=residuals,
        inliers=np.zeros(len(points), bool),
        rms=float(np.sqrt(np.mean(residuals**2))) if len(points) else 0.0,
        covariance=np.diag(units**2),
        names=names_of(warps),
        rank=0,
        condition=0.0,
        uncovered=1.0,
        looseness=unit,
        converged=False,
        doubts=(doubt,),
        choice=None,
        starts=0,
        steps=0,
    )


def _distances(solid: Solid, points: Floats, unit: float) -> Floats:
    """Distances (n,) of points about an ellipsoid's middle, all in the same unit."""
    parameters = np.zeros((1, RIGID))
    parameters[0, :5] = np.concatenate([np.log(solid.size / unit), solid.exponents])
    rigid = Warps(taper=False, bend=False)
    return np.asarray(distances_alone(parameters, points, solid.axes[None], rigid)[0])


def _ellipsoid_about(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Semi-axes (3,), axes (3, 3) and middle (3,)."""
    if not len(points):
        return np.zeros(3), np.eye(3), np.zeros(3)
    mean = points.mean(axis=0)
    axes = principal_axes(points - mean)
    places = (points - mean) @ axes
    low, high = places.min(axis=0), places.max(axis=0)
    size = 0.5 * (high - low)
    if together(2.0 * float(size.max()), points):
        return np.zeros(3), axes, mean
    return np.maximum(size, THINNEST * size.max()), axes, mean + axes @ (0.5 * (low + high))
