"""Measured contours, and clouds of points at repeated heights cut into contours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.rebuild.contours import ContactPoints, order_points


class MeasuredContours(NamedTuple):
    """Contours of a file of points, in the file's own unit until `scaled`."""

    contours: tuple[Floats, ...]  # (n, 3) each
    places: tuple[str, ...]  # name of each in errors: its number, and its lines if any
    normals: tuple[Floats, ...] | None = None  # outward, (n, 3) each
    taxels: ContactPoints | None = None  # all contacts, with numbers of touches
    tops: Floats | None = None  # contacts of the ends, (k, 3)
    # Pose (7,) of the slicing frame, about whose z axis the contours run, in the frame of the
    # points; None: the same frame.
    frame: Floats | None = None
    notes: tuple[str, ...] = ()  # on the reading, in sentences for the user

    def scaled(self, metres: float) -> MeasuredContours:
        """The contours with all lengths multiplied by `metres`."""
        tops = None if self.tops is None else metres * self.tops
        frame = self.frame
        if frame is not None:
            frame = np.concatenate([metres * frame[:3], frame[3:]])
        taxels = self.taxels and self.taxels._replace(points=metres * self.taxels.points)
        contours = tuple(metres * contour for contour in self.contours)
        return self._replace(contours=contours, tops=tops, taxels=taxels, frame=frame)


def contact_points_of(
    contours: tuple[Floats, ...], normals: tuple[Floats, ...] | None, touches: Ints
) -> ContactPoints:
    """Contacts at the points of contours, with numbers (n,) of touches, from any number on."""
    numbers = np.unique(touches, return_inverse=True)[1].reshape(-1).astype(np.int32)
    unit = None
    if normals is not None:
        stacked = np.concatenate(normals)
        lengths = np.linalg.norm(stacked, axis=1, keepdims=True)
        if (lengths > 0.0).all():
            unit = stacked / lengths
    return ContactPoints(np.concatenate(contours), unit, numbers)


def slice_cloud(points: Floats) -> MeasuredContours:
    """Contours of points (n, 3) in no order.

    Raises ValueError if the points do not lie at repeated heights.
    """
    slice_of, spread = slices_by_height(points[:, 2])
    count = int(slice_of.max()) + 1
    contours, n_tours = [], 0
    for number in range(count):
        rows = np.flatnonzero(slice_of == number)
        order = order_points(points[rows, :2])
        n_tours += not order.by_azimuth
        contours.append(points[rows[order.rows]])
    heights = [float(contour[:, 2].mean()) for contour in contours]
    notes = [
        f"a cloud without order: {len(points)} points lie at {count} heights, within "
        f"{spread:.3g} of each; they were put in order by azimuth about each slice's middle"
    ]
    if n_tours:
        notes.append(
            f"{n_tours} of {count} slices are not star-shaped: there the shortest way from point "
            "to point was taken"
        )
    places = tuple(f"slice {i} (z = {z:.4g})" for i, z in enumerate(heights))
    return MeasuredContours(tuple(contours), places, notes=tuple(notes))


def slices_by_height(
    z: Floats, min_gap_ratio: float = 3.0, min_mean_points: int = 3
) -> tuple[Ints, float]:
    """The slice of each height (n,), from the lowest, and the largest spread within a slice.

    The smallest gap between slices is at least `min_gap_ratio` times the largest step within one.
    Raises ValueError if no such cut gives 2 slices with a mean of `min_mean_points` points.
    """
    order = np.argsort(z, kind="stable")
    levels = z[order]
    steps = np.diff(levels)
    ranked = np.sort(steps)[::-1]
    # Rounding in a file must not count as a step.
    min_step = 1e-9 * max(float(levels[-1] - levels[0]), np.finfo(float).tiny)
    max_cuts = len(z) // min_mean_points - 1
    ratio = ranked[:max_cuts] / np.maximum(ranked[1 : max_cuts + 1], min_step)
    cuts = int(np.argmax(ratio)) + 1 if len(ratio) else 0
    if not cuts or ratio[cuts - 1] < min_gap_ratio or ranked[cuts - 1] <= min_step:
        raise ValueError(
            "the points do not lie at repeated heights: give each contour a number in a column "
            "named contour, or the points normals, and take --method general"
        )
    threshold = 0.5 * (ranked[cuts - 1] + ranked[cuts])
    slice_of = np.empty(len(z), np.int32)
    slice_of[order] = np.concatenate([[0], np.cumsum(steps > threshold)])
    spreads = [np.ptp(z[slice_of == number]) for number in range(cuts + 1)]
    return slice_of, float(max(spreads))
