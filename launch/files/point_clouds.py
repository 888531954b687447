"""Contours as they were read, and clouds of points at repeated heights cut into contours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.contours import ContactPoints, order_points

MIN_CONTOUR_POINTS = 3  # Of a contour
GAP_RATIO = 3.0  # Times as large as any step within a slice is the least step from one to the next


class MeasuredContours(NamedTuple):
    """What a file of points holds, in the file's own unit until `scaled`."""

    contours: tuple[Floats, ...]  # (n, 3) each
    places: tuple[str, ...]  # What each is called in messages: its number, and its lines if any
    normals: tuple[Floats, ...] | None = None  # (n, 3) each, outwards, or none
    taxels: ContactPoints | None = None  # All that was touched, by number of touch, if known
    tops: Floats | None = None  # (k, 3): where the ends were touched
    # Pose (7,) of the slicing frame, around whose z axis the contours run, in that of the points;
    # the same if None.
    frame: Floats | None = None
    notes: tuple[str, ...] = ()  # What was done that a user should know, in sentences

    def scaled(self, metres: float) -> MeasuredContours:
        """Lengths times so much."""
        tops = None if self.tops is None else metres * self.tops
        frame = self.frame
        if frame is not None:
            frame = np.concatenate([metres * frame[:3], frame[3:]])
        taxels = self.taxels and self.taxels._replace(points=metres * self.taxels.points)
        contours = tuple(metres * one for one in self.contours)
        return self._replace(contours=contours, tops=tops, taxels=taxels, frame=frame)


def contact_points_of(
    contours: tuple[Floats, ...], normals: tuple[Floats, ...] | None, touches: Ints
) -> ContactPoints:
    """The points of contours as what touches, (n,) numbers from any on, measured."""
    numbers = np.unique(touches, return_inverse=True)[1].reshape(-1).astype(np.int32)
    unit = None
    if normals is not None:
        stacked = np.concatenate(normals)
        lengths = np.linalg.norm(stacked, axis=1, keepdims=True)
        if (lengths > 0.0).all():
            unit = stacked / lengths
    return ContactPoints(np.concatenate(contours), unit, numbers)


def slice_cloud(points: Floats) -> MeasuredContours:
    """Contours from points (n, 3) in no order.

    Raises ValueError if the points do not lie at repeated heights.
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
    return MeasuredContours(tuple(contours), places, notes=tuple(notes))


def slices_by_height(z: Floats) -> tuple[Ints, float]:
    """The slice of each height (n,), from the lowest, and the widest spread within a slice.

    Cut where neighbouring heights lie clearly farther apart than all that are kept together. Raises
    ValueError if no such cut leaves at least 3 points in each slice on average, and 2 slices.
    """
    order = np.argsort(z, kind="stable")
    levels = z[order]
    steps = np.diff(levels)
    ranked = np.sort(steps)[::-1]
    # Rounding of a file must not count as a step: nothing is smaller than this share of all.
    least = 1e-9 * max(float(levels[-1] - levels[0]), np.finfo(float).tiny)
    most = len(z) // MIN_CONTOUR_POINTS - 1
    ratio = ranked[:most] / np.maximum(ranked[1 : most + 1], least)
    cuts = int(np.argmax(ratio)) + 1 if len(ratio) else 0
    if not cuts or ratio[cuts - 1] < GAP_RATIO or ranked[cuts - 1] <= least:
        raise ValueError(
            "the points do not lie at repeated heights: give each contour a number in a column "
            "named contour, or the points normals, and take --method general"
        )
    apart = 0.5 * (ranked[cuts - 1] + ranked[cuts])
    slice_of = np.empty(len(z), np.int32)
    slice_of[order] = np.concatenate([[0], np.cumsum(steps > apart)])
    spreads = [np.ptp(z[slice_of == number]) for number in range(cuts + 1)]
    return slice_of, float(max(spreads))
