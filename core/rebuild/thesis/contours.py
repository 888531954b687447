"""Contours in the cube from -1 to 1: Fung, 1999, 4.2, steps 1 to 3."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.splines.frame import Frame, upright_frame

LEAST_POINTS = 4
"""Different points of a contour, the fewest of which a curve is fitted."""
SAME = 1e-12
"""Of the size: a last point that is nearer to the first one is the first one, given again."""


class Stack(NamedTuple):
    """Level contours from the bottom to the top, normalised."""

    points: Floats
    """(m, n, 2), each point once; from -1 to 1."""
    heights: Floats
    """(m,), from -1 to 1, not falling."""
    box: Frame
    """The box around the contours, m, which the cube from -1 to 1 stands for."""
    order: Ints
    """(m,): which of the given contours each is."""


def stack_contours(contours: Sequence[ArrayLike] | Floats) -> Stack:
    """Sort contours by height and put them into the cube from -1 to 1.

    Parameters
    ----------
    contours : (m, n, 3) array or sequence of m arrays (n, 3)
        At least 2 level contours, in any order, m; each with at least 4 points around it, the
        first again at the end of all of them or of none. A contour's height is the mean of its
        points'.

    Raises
    ------
    ValueError
        If there are too few contours or points, not as many points in each, some are not
        finite, or the contours have no extent along x, y or z.
    """
    given = [np.asarray(contour, dtype=np.float64) for contour in contours]
    if len(given) < 2:
        raise ValueError(f"contours must be at least 2, got {len(given)}")
    counts = sorted({len(contour) if contour.ndim else 0 for contour in given})
    if len(counts) > 1:
        raise ValueError(f"contours must have as many points each, got {counts[0]} to {counts[-1]}")
    points = finite_array("contours", np.stack(given), (None, None, 3))
    heights = points[:, :, 2].mean(axis=1)
    low = np.append(points[:, :, :2].min(axis=(0, 1)), heights.min())
    extent = np.append(points[:, :, :2].max(axis=(0, 1)), heights.max()) - low
    if not (extent > 0.0).all():
        raise ValueError(f"contours must extend along x, y and z, got {extent.tolist()} m")
    gaps = np.abs(points[:, -1, :2] - points[:, 0, :2]).max(axis=1)
    if (gaps <= SAME * extent.max()).all():
        points = points[:, :-1]
    if points.shape[1] < LEAST_POINTS:
        raise ValueError(
            f"contours must have at least {LEAST_POINTS} different points, got {points.shape[1]}"
        )
    order = np.argsort(heights, kind="stable").astype(np.int32)
    return Stack(
        points=2.0 * (points[order, :, :2] - low[:2]) / extent[:2] - 1.0,
        heights=2.0 * (heights[order] - low[2]) / extent[2] - 1.0,
        box=upright_frame(low, extent),
        order=order,
    )
