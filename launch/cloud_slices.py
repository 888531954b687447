"""A cloud of points at repeated heights, cut into contours."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.launch.point_order import order_points
from palpate.launch.points_found import PointsFound

LEAST_POINTS = 3
"""Of a contour."""
CLEARER = 3.0
"""Times as large as any step within a slice is the least step from one to the next."""


def cut_cloud(points: Floats) -> PointsFound:
    """Contours from points (n, 3) in no order.

    Raises
    ------
    ValueError
        If the points do not lie at repeated heights.
    """
    slice_of, spread = slices_by_height(points[:, 2])
    count = int(slice_of.max()) + 1
    contours, toured = [], 0
    for number in range(count):
        rows = np.flatnonzero(slice_of == number)
        order = order_points(points[rows, :2])
        toured += not order.by_azimuth
        contours.append(points[rows[order.rows]])
    heights = [float(one[:, 2].mean()) for one in contours]
    notes = [
        f"a cloud without order: {len(points)} points lie at {count} heights, within "
        f"{spread:.3g} of each; they were put in order by azimuth about each slice's middle"
    ]
    if toured:
        notes.append(
            f"{toured} of {count} slices are not star-shaped: there the shortest way from point "
            "to point was taken"
        )
    places = tuple(f"slice {i} (z = {z:.4g})" for i, z in enumerate(heights))
    return PointsFound(tuple(contours), places, notes=tuple(notes))


def slices_by_height(z: Floats) -> tuple[Ints, float]:
    """The slice of each height (n,), from the lowest, and the widest spread within a slice.

    Cut where neighbouring heights lie clearly farther apart than all that are kept together.

    Raises
    ------
    ValueError
        If no such cut leaves at least 3 points in each slice on average, and 2 slices.
    """
    order = np.argsort(z, kind="stable")
    levels = z[order]
    steps = np.diff(levels)
    ranked = np.sort(steps)[::-1]
    # Rounding of a file must not count as a step: nothing is smaller than this share of all.
    least = 1e-9 * max(float(levels[-1] - levels[0]), np.finfo(float).tiny)
    most = len(z) // LEAST_POINTS - 1
    ratio = ranked[:most] / np.maximum(ranked[1 : most + 1], least)
    cuts = int(np.argmax(ratio)) + 1 if len(ratio) else 0
    if not cuts or ratio[cuts - 1] < CLEARER or ranked[cuts - 1] <= least:
        raise ValueError(
            "the points do not lie at repeated heights: give each contour a number in a column "
            "named contour, or slice the cloud first"
        )
    apart = 0.5 * (ranked[cuts - 1] + ranked[cuts])
    slice_of = np.empty(len(z), np.int32)
    slice_of[order] = np.concatenate([[0], np.cumsum(steps > apart)])
    spreads = [np.ptp(z[slice_of == number]) for number in range(cuts + 1)]
    return slice_of, float(max(spreads))
