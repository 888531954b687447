"""Normals at a contour's points, as felt points: each is a short stretch of surface.

A normal says where the surface goes from a point, above all uphill, where the next contour may be
far. So a point with a normal is three: itself, and one a little above and below in its plane.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.felt.felt_points import FeltPoints, stack_points
from palpate.core.rebuild.slicing import into_frame, turned_into_frame

STEP = 0.02
"""Of the mean distance of contours: how far above and below the further points lie."""
ALONE = 1e-3
"""The same of the width, where there is but one contour."""
LEVEL = 0.05
"""Level part of a normal, of 1, below which it says nothing of the side."""


def normals_as_points(
    contours: Sequence[ArrayLike],
    normals: Sequence[ArrayLike],
    heights: ArrayLike | None = None,
    frame: Floats | None = None,
) -> FeltPoints:
    """Felt points of contours with normals; every point is a touch by itself.

    Parameters
    ----------
    contours : sequence of (n, 3) arrays, or of (n, 2) arrays with `heights`
        Rows that are not finite are left out.
    normals : sequence of (n, 3) arrays
        Outward, of any length; rows that are not finite or of length 0 are left out.
    heights : (m,) array, optional
        Of plane contours.
    frame : (7,) array, optional
        Pose in the world of the frame in which the felt points are to be; the contours and
        normals are given in the world.

    Raises
    ------
    ValueError
        If there are not as many normals as contours, or as points of a contour.
    """
    if len(normals) != len(contours):
        raise ValueError(
            f"normals must be as many as the {len(contours)} contours, got {len(normals)}"
        )
    levels = None if heights is None else finite_array("heights", heights, (len(contours),))
    parts = []
    for which, (given, given_normals) in enumerate(zip(contours, normals, strict=True)):
        points, beside = np.asarray(given, float), np.asarray(given_normals, float)
        if levels is not None:
            points = np.column_stack([points, np.full(len(points), levels[which])])
        if beside.shape != points.shape:
            raise ValueError(
                f"normals of contour {which} must have shape {points.shape}, got {beside.shape}"
            )
        length = np.linalg.norm(beside, axis=1)
        good = np.isfinite(points).all(axis=1) & np.isfinite(length) & (length > 0.0)
        unit = turned_into_frame(frame, beside[good] / length[good, None])
        parts.append((into_frame(frame, points[good]), unit))
    step = _step([points for points, _ in parts if len(points)])
    return stack_points([_stretches(points, unit, step) for points, unit in parts])


def _step(contours: list[Floats]) -> float:
    if not contours:
        return 0.0
    heights = np.array([points[:, 2].mean() for points in contours])
    if np.ptp(heights) > 0.0:
        return STEP * float(np.ptp(heights)) / (len(heights) - 1)
    return ALONE * float(np.ptp(contours[0][:, :2], axis=0).max())


def _stretches(points: Floats, normals: Floats, step: float) -> FeltPoints:
    level = np.hypot(normals[:, 0], normals[:, 1])
    steep = level > LEVEL
    points, normals, level = points[steep], normals[steep], level[steep]
    uphill = np.column_stack([-normals[:, :2] * normals[:, 2:] / level[:, None], level])
    three = points[:, None] + step * np.array([-1.0, 0.0, 1.0])[:, None] * uphill[:, None]
    touch = np.repeat(np.arange(len(points), dtype=np.int32), 3)
    return FeltPoints(three.reshape(-1, 3), np.repeat(normals, 3, axis=0), touch)
