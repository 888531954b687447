"""Contours as they were given, each made into a closed curve or refused with a reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array
from palpate.core.rebuild.contours.contacts import into_frame
from palpate.core.rebuild.contours.curves import LEAST_CURVE_POINTS, slice_curve
from palpate.core.splines import ClosedCurve

MEDIAN = 0.6745  # Median size of an error of deviation 1
REACH = 4  # Points on either side; half of them may be wrong
CLEARLY = 6.0  # Deviations from which on a point is away from the median of those beside it,
SPREAD = 3.0  # and of the middle half of those beside it, for a contour may rise and fall,
LEAST = 1e-4  # and of the perimeter: less does no harm
MOST = 0.15  # Share of the points beyond which the contour itself is like that
LEAST_HEIGHT_POINTS = 12
SHOWN = 6  # Most contours that a sentence names
# Why a contour is not used.
DropReason = Literal[
    "too few points",
    "in one place",
    "in one place: a touch of its end",
    "on one line",
    "around no area",
    "repeats another at its height",
    "inside another at its height",
    "crosses another at its height",
    "beside another at its height",
    "unlike its neighbours",
]


@dataclass(frozen=True, slots=True, eq=False)
class ContourCurve:
    """One contour with its curve, before the stack is made."""

    which: int  # Of the given contours
    height: float  # m
    curve: ClosedCurve  # Through its points
    points: Floats  # (n, 2), those that the curve was made from, in its order, m
    as_given: Floats  # (n, 2), the same as they were given; outliers are mended in `points`, m
    outlier: Bools  # (n,): single points that are wrong: they are not used
    off_height: Bools  # (n,): those that are known to be, for they are not at the contour's height
    fine: Floats  # (k, 2), the curve at even steps of its turn, m
    star: bool  # Each ray from the middle of its area meets the curve once
    perimeter: float  # m
    tilt: float  # Root mean square of its rise and fall, m
    error: float  # Standard error of the height, m


def contour_curves(
    contours: Sequence[ArrayLike],
    heights: ArrayLike | None = None,
    first: int = 0,
    frame: Floats | None = None,
) -> tuple[ContourCurve | DroppedContour, ...]:
    """Each contour as a closed curve, or why it is none; contours and heights as of `slices_of`.

    `first` is the number of the first of them; `frame` (7,) the pose of the frame around whose z
    axis they run, in the world in which they are given.

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
    return tuple(_contour_curve(which, points) for which, points in enumerate(given, first))


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


def _contour_curve(which: int, points: Floats) -> ContourCurve | DroppedContour:
    level = float(np.median(points[:, 2])) if len(points) else None
    if len(points) < LEAST_CURVE_POINTS:
        return DroppedContour(which, "too few points", level)
    found = slice_curve(points[:, :2])
    used = points[found.curve.used]
    if len(used) < LEAST_CURVE_POINTS:
        return DroppedContour(which, "in one place" if len(used) == 1 else "too few points", level)
    if found.curve.flags.degenerate:
        return DroppedContour(which, "on one line", level)
    perimeter = _length(found.fine)
    off_height = height_outliers(used[:, 2], perimeter)
    good = used[~off_height]
    height_residual = height_residual_of(good)
    return ContourCurve(
        which=which,
        height=float(good[0, 2] + (good[:, 2] - good[0, 2]).mean()),
        curve=found.curve,
        points=used[:, :2],
        as_given=used[:, :2],
        outlier=np.zeros(len(used), np.bool_),
        off_height=off_height,
        fine=found.fine,
        star=found.star,
        perimeter=perimeter,
        tilt=height_residual.shape,
        error=height_residual.noise / float(np.sqrt(len(good))),
    )


def height_outliers(z: Floats, perimeter: float) -> Bools:
    """Which points of a contour, by their z (n,) in order around, are far above or below it.

    A contour that is tilted or bent changes its height little by little: its points are in the
    middle of those beside them.
    """
    nothing = np.zeros(len(z), np.bool_)
    if len(z) < LEAST_HEIGHT_POINTS:
        return nothing
    near = np.stack([np.roll(z, by) for by in range(-REACH, REACH + 1)])
    low, middle, high = np.quantile(near, [0.25, 0.5, 0.75], axis=0)
    off = np.abs(z - middle)
    scale = float(np.median(off)) / MEDIAN
    outlier: Bools = off > np.maximum(
        SPREAD * (high - low), max(CLEARLY * scale, LEAST * perimeter)
    )
    return nothing if outlier.mean() > MOST else outlier


def height_residual_of(points: Floats) -> HeightResidual:
    """How z of points (n, 3) departs from its mean: from a quadric over the plane.

    The share that noise alone would have in the fit is taken out of it; of 6 points and fewer all
    is taken for shape.
    """
    z = points[:, 2] - points[0, 2]
    z = z - z.mean()
    size = float(np.abs(z).max())
    if size == 0.0:
        return HeightResidual(0.0, 0.0)
    near = points[:, :2] - points[:, :2].mean(axis=0)
    x, y = (near / np.abs(near).max()).T
    quadric = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    # A circle cannot tell the bowl from the constant: the shortest of all solutions will do.
    solution, _, rank, _ = np.linalg.lstsq(quadric, z / size, rcond=None)
    explained = quadric @ solution
    spare = len(z) - int(rank)
    left = float(((z / size - explained) ** 2).sum())
    noise = np.sqrt(left / spare) if spare > 0 else 0.0
    shape = np.sqrt(max(float((explained**2).mean()) - noise**2 * (rank - 1) / len(z), 0.0))
    return HeightResidual(size * float(shape), size * float(noise))


def refitted_curve(loop: ContourCurve, points: Floats, outlier: Bools) -> ContourCurve:
    """The same contour with its outliers (n,) moved to where they should be, points (n, 2)."""
    if np.array_equal(points, loop.points):
        return replace(loop, outlier=outlier)
    found = slice_curve(points)
    used = found.curve.used
    if len(used) < LEAST_CURVE_POINTS or found.curve.flags.degenerate:
        return loop
    return replace(
        loop,
        curve=found.curve,
        points=points[used],
        as_given=loop.as_given[used],
        outlier=outlier[used],
        off_height=loop.off_height[used],
        fine=found.fine,
        star=found.star,
        perimeter=_length(found.fine),
    )


def _length(fine: Floats) -> float:
    """Of a closed polygon (n, 2)."""
    return float(np.linalg.norm(np.roll(fine, -1, axis=0) - fine, axis=1).sum())


class HeightResidual(NamedTuple):
    """Departures of a contour's z from its mean, root mean square."""

    shape: float  # What a smooth surface explains: the contour is tilted or bent, m
    noise: float  # What it does not, m


class DroppedContour(NamedTuple):
    """A contour that is not used."""

    which: int  # Of the given contours
    why: DropReason
    height: float | None = None  # Its height, if it has one, m
    # By how much it contradicts its neighbours, root mean square, m, if that is why.
    off: float = 0.0
    # It is unlike them in its size alone, and whole: it may as well have touched what no other
    # contour did, a neck or a groove, and nothing tells. It is left out, for a wrong contour costs
    # more than a groove that is missed.
    may_be_feature: bool = False


def drop_reasons(dropped: Sequence[DroppedContour]) -> str:
    """Which contours are not used, and why, as one sentence of bearable length."""
    told = "; ".join(f"contour {one.which}: {one.why}" for one in dropped[:SHOWN])
    return told + (f"; and {len(dropped) - SHOWN} more" if len(dropped) > SHOWN else "")
