"""Contours as they were given, each made into a closed curve of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.rebuild.slices.dropped import Dropped
from palpate.core.rebuild.slices.height_sway import height_sway
from palpate.core.rebuild.slices.slice_curve import LEAST_POINTS, slice_curve
from palpate.core.rebuild.slices.stray_heights import stray_heights
from palpate.core.rebuild.slicing import into_frame
from palpate.core.splines.closed_curve import ClosedCurve


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """One contour with its curve, before the stack is made."""

    which: int
    """Of the given contours."""
    height: float
    """m."""
    curve: ClosedCurve
    """Through its points."""
    points: Floats
    """(n, 2), those that the curve was made from, in its order, m."""
    felt: Floats
    """(n, 2), the same as they were given; those that stray are mended in `points`, m."""
    stray: Bools
    """(n,): single points that are wrong: they are not used."""
    aloft: Bools
    """(n,): those that are known to be, for they are not at the contour's height."""
    fine: Floats
    """(k, 2), the curve at even steps of its turn, m."""
    star: bool
    """Each ray from the middle of its area meets the curve once."""
    perimeter: float
    """m."""
    tilt: float
    """Root mean square of its rise and fall, m."""
    error: float
    """Standard error of the height, m."""


def loops_of(
    contours: Sequence[ArrayLike],
    heights: ArrayLike | None = None,
    first: int = 0,
    frame: Floats | None = None,
) -> tuple[Loop | Dropped, ...]:
    """Each contour as a closed curve, or why it is none; see `slices_of`.

    Parameters
    ----------
    contours : sequence of (n, 3) arrays, or of (n, 2) arrays with `heights`
        Points around each contour.
    heights : (len(contours),) array, optional
        z of plane contours, m.
    first : int
        Number of the first of them.
    frame : (7,) array, optional
        Pose of the frame around whose z axis they run, in the world in which they are given.

    Raises
    ------
    ValueError
        If a shape is another, a height is not finite, or there are heights in a frame.
    """
    if frame is not None and heights is not None:
        raise ValueError(
            "heights must be left out with a frame, for contours are then points of the world"
        )
    given = [into_frame(frame, points) for points in _given(contours, heights, first)]
    return tuple(_loop(which, points) for which, points in enumerate(given, first))


def curve_again(loop: Loop, points: Floats, stray: Bools) -> Loop:
    """The same contour with those points (n, 2) mended that stray (n,)."""
    if np.array_equal(points, loop.points):
        return replace(loop, stray=stray)
    found = slice_curve(points)
    used = found.curve.used
    if len(used) < LEAST_POINTS or found.curve.flags.degenerate:
        return loop
    return replace(
        loop,
        curve=found.curve,
        points=points[used],
        felt=loop.felt[used],
        stray=stray[used],
        aloft=loop.aloft[used],
        fine=found.fine,
        star=found.star,
        perimeter=_length(found.fine),
    )


def _given(contours: Sequence[ArrayLike], heights: ArrayLike | None, first: int) -> list[Floats]:
    """The contours as (n, 3) arrays, of their finite rows."""
    if isinstance(contours, str) or not isinstance(contours, Sequence | np.ndarray):
        raise ValueError(f"contours must be a sequence of arrays, got {type(contours).__name__}")
    if not len(contours):
        raise ValueError("contours must be at least one, got none")
    columns = 3 if heights is None else 2
    found = []
    for which, contour in enumerate(contours, first):
        points = _numbers(which, contour)
        if not points.size:
            points = points.reshape(0, columns)
        if points.ndim != 2 or points.shape[1] != columns:
            raise ValueError(
                f"contour {which} must have shape (any, {columns}), got {points.shape}"
            )
        found.append(points)
    if heights is not None:
        levels = finite_array("heights", heights, (len(found),))
        found = [
            np.column_stack([points, np.full(len(points), level)])
            for points, level in zip(found, levels, strict=True)
        ]
    return [points[np.isfinite(points).all(axis=1)] for points in found]


def _numbers(which: int, contour: ArrayLike) -> Floats:
    try:
        points = np.asarray(contour)
        if np.iscomplexobj(points):
            raise ValueError("complex ones")
        return points.astype(np.float64, copy=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"contour {which} must be an array of real numbers: {error}") from None


def _loop(which: int, points: Floats) -> Loop | Dropped:
    """The closed curve through a contour's points."""
    level = float(np.median(points[:, 2])) if len(points) else None
    if len(points) < LEAST_POINTS:
        return Dropped(which, "too few points", level)
    found = slice_curve(points[:, :2])
    used = points[found.curve.used]
    if len(used) < LEAST_POINTS:
        return Dropped(which, "in one place" if len(used) == 1 else "too few points", level)
    if found.curve.flags.degenerate:
        return Dropped(which, "on one line", level)
    perimeter = _length(found.fine)
    aloft = stray_heights(used[:, 2], perimeter)
    good = used[~aloft]
    sway = height_sway(good)
    return Loop(
        which=which,
        height=float(good[0, 2] + (good[:, 2] - good[0, 2]).mean()),
        curve=found.curve,
        points=used[:, :2],
        felt=used[:, :2],
        stray=np.zeros(len(used), np.bool_),
        aloft=aloft,
        fine=found.fine,
        star=found.star,
        perimeter=perimeter,
        tilt=sway.shape,
        error=sway.noise / float(np.sqrt(len(good))),
    )


def _length(fine: Floats) -> float:
    """Of a closed polygon (n, 2)."""
    return float(np.linalg.norm(np.roll(fine, -1, axis=0) - fine, axis=1).sum())
