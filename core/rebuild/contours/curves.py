"""Contours as closed curves: each as it was given, or refused with a reason, and many at once.

Whether points were taken at even steps is judged as far as their noise lets one see; even steps are
solved by Fourier transform and evaluated together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import splines
from palpate.core.arrays import PROBABLE_ERROR, Bools, Floats, finite_array, probable_error_sigma
from palpate.core.geometry import area_centroid, is_simple_ring, self_intersects, turn_between
from palpate.core.rebuild.contours.contacts import into_frame
from palpate.core.rebuild.contours.ordering import FoundOrder, found_order

REACH = 4  # Points on either side; half of them may be wrong
CLEARLY = 6.0  # Deviations from which on a point is away from the median of those beside it,
SPREAD = 3.0  # and of the middle half of those beside it, for a contour may rise and fall,
LEAST = 1e-4  # and of the perimeter: less does no harm
MOST = 0.15  # Share of the points beyond which the contour itself is like that
LEAST_HEIGHT_POINTS = 12
SHOWN = 6  # Most contours that a sentence names
# Why a contour is not used.
DropReason = (
    Literal["too few points", "in one place", "in one place: a touch of its end", "on one line"]
    | Literal["around no area", "repeats another at its height", "inside another at its height"]
    | Literal["crosses another at its height", "beside another at its height"]
    | Literal["unlike its neighbours", "its points are in no order"]
)
FINE = 512  # Places along each curve at which it is compared with others
LEAST_CURVE_POINTS = 3
KEPT = 512  # Curves that are kept: the last ones
EVEN_CONDITION = 3.0  # Of the system for even steps: its eigenvalues lie between 1/3 and 1
ISOTROPIC = 1.6  # So many times farther along the contour than across is no noise: it is uneven
CLEAR = 8.0  # Chords so many times longer than the noise tell how even the steps are
WIDEST = 6  # Of the points, one in so many is the longest such chord: a sixth of a turn
CUBIC_GAIN = float(np.sqrt(1.0 + 34.0 / 36.0))  # Of noise, from the cubic through two on each side
BACK = 0.1  # Angle by which a polygon may go back around the origin, rad: noise does


@dataclass(frozen=True, slots=True, eq=False)
class ContourCurve:
    """One contour with its curve, before the stack is made."""

    which: int  # Of the given contours
    height: float  # m
    curve: splines.ClosedCurve  # Through its points
    points: Floats  # (n, 2), those that the curve was made from, in its order, m
    as_given: Floats  # (n, 2), the same as they were given; outliers are mended in `points`, m
    outlier: Bools  # (n,): single points that are wrong: they are not used
    off_height: Bools  # (n,): those that are known to be, for they are not at the contour's height
    fine: Floats  # (k, 2), the curve at even steps of its turn, m
    star: bool  # Each ray from the middle of its area meets the curve once
    perimeter: float  # m
    tilt: float  # Root mean square of its rise and fall, m
    error: float  # Standard error of the height, m
    rises: Floats  # (n,): how far each of `points` lies above the height, m
    reordered: bool = False  # Its points were given in no order, and were put in order
    disordered: bool = False  # Its points were given in no order, and have no safe one


def contour_curves(
    contours: Sequence[ArrayLike],
    heights: ArrayLike | None = None,
    first: int = 0,
    frame: Floats | None = None,
) -> tuple[ContourCurve | DroppedContour, ...]:
    """Each contour as a closed curve, or why it is none: too few points, in one place, on a line.

    A contour is (n, 3) points, z the slicing axis, in any one unit (written m here): begun
    anywhere, in either direction, any number of them, the first again at the end or not. Points in
    no order are put in order where that is safe. Rows that are not finite are left out. With
    `heights` (len(contours),) they are (n, 2). `first` is the number of the first; `frame` (7,) the
    pose of the frame around whose z axis they run, in the world.
    Raises ValueError if a shape is another, or a height is not finite or beside a frame.
    """
    if frame is not None and heights is not None:
        raise ValueError(
            "heights must be left out with a frame, for contours are then points of the world"
        )
    given = enumerate(_given(contours, heights, first), first)
    return tuple(_kept(which, into_frame(frame, points).tobytes()) for which, points in given)


def _given(contours: Sequence[ArrayLike], heights: ArrayLike | None, first: int) -> list[Floats]:
    """The contours as (n, 3) arrays, of their finite rows."""
    if isinstance(contours, str) or not isinstance(contours, Sequence | np.ndarray):
        raise ValueError(f"contours must be a sequence of arrays, got {type(contours).__name__}")
    if not len(contours):
        raise ValueError("contours must be at least one, got none")
    width = 3 if heights is None else 2
    found = []
    for which, contour in enumerate(contours, first):
        try:
            array = np.asarray(contour)
            if np.iscomplexobj(array):
                raise ValueError("complex ones")
            points = array.astype(np.float64, copy=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"contour {which} must be an array of real numbers: {error}") from None
        if not points.size:
            points = points.reshape(0, width)
        if points.ndim != 2 or points.shape[1] != width:
            raise ValueError(f"contour {which} must have shape (any, {width}), got {points.shape}")
        found.append(points)
    if heights is not None:
        pairs = zip(found, finite_array("heights", heights, (len(found),)), strict=True)
        found = [np.column_stack([points, np.full(len(points), z)]) for points, z in pairs]
    return [points[np.isfinite(points).all(axis=1)] for points in found]


@lru_cache(maxsize=KEPT)
def _kept(which: int, points: bytes) -> ContourCurve | DroppedContour:
    """The curve of points (n, 3): models of ever more contours have most of them in common."""
    return _contour_curve(which, np.frombuffer(points).reshape(-1, 3))


def _contour_curve(which: int, points: Floats) -> ContourCurve | DroppedContour:
    level = float(np.median(points[:, 2])) if len(points) else None
    if len(points) < LEAST_CURVE_POINTS:
        return DroppedContour(which, "too few points", level)
    order = FoundOrder(None, False)
    if not is_simple_ring(points[:, :2]):
        order = found_order(points[:, :2])
        points = points if order.rows is None else points[order.rows]
    found = slice_curve(points[:, :2])
    used = points[found.curve.used]
    if len(used) < LEAST_CURVE_POINTS:
        return DroppedContour(which, "in one place" if len(used) == 1 else "too few points", level)
    if found.curve.flags.degenerate:
        return DroppedContour(which, "on one line", level)
    perimeter = _length(found.fine)
    off_height = height_outliers(used[:, 2], perimeter)
    good = used[~off_height]
    tilt, noise = height_residual_of(good)
    height = float(good[0, 2] + (good[:, 2] - good[0, 2]).mean())
    return ContourCurve(
        which=which,
        height=height,
        curve=found.curve,
        points=used[:, :2],
        as_given=used[:, :2],
        outlier=np.zeros(len(used), np.bool_),
        off_height=off_height,
        fine=found.fine,
        star=found.star,
        perimeter=perimeter,
        tilt=tilt,
        error=noise / float(np.sqrt(len(good))),
        rises=used[:, 2] - height,
        reordered=order.rows is not None,
        disordered=order.disordered,
    )


def height_outliers(z: Floats, perimeter: float) -> Bools:
    """Which points, by their z (n,) in order, are far from the middle of those beside."""
    if len(z) < LEAST_HEIGHT_POINTS:
        return np.zeros(len(z), np.bool_)
    near = np.stack([np.roll(z, by) for by in range(-REACH, REACH + 1)])
    low, middle, high = np.quantile(near, [0.25, 0.5, 0.75], axis=0)
    off = np.abs(z - middle)
    least = max(CLEARLY * probable_error_sigma(off), LEAST * perimeter)
    outlier: Bools = off > np.maximum(SPREAD * (high - low), least)
    return np.asarray(outlier & (outlier.mean() <= MOST))


def height_residual_of(points: Floats) -> tuple[float, float]:
    """Root mean square departures of z of points (n, 3) from its mean: of a shape, and of noise, m.

    The shape is a quadric over the plane; the share that noise alone would have in the fit is taken
    out of it. Of 6 points and fewer all is taken for shape.
    """
    z = points[:, 2] - points[0, 2]
    z = z - z.mean()
    size = float(np.abs(z).max())
    if size == 0.0:
        return 0.0, 0.0
    near = points[:, :2] - points[:, :2].mean(axis=0)
    x, y = (near / np.abs(near).max()).T
    quadric = quadric_terms(x, y)
    # A circle cannot tell the bowl from the constant: the shortest of all solutions will do.
    solution, _, rank, _ = np.linalg.lstsq(quadric, z / size, rcond=None)
    explained = quadric @ solution
    spare = len(z) - int(rank)
    left = float(((z / size - explained) ** 2).sum())
    noise = np.sqrt(left / spare) if spare > 0 else 0.0
    shape = np.sqrt(max(float((explained**2).mean()) - noise**2 * (rank - 1) / len(z), 0.0))
    return size * float(shape), size * float(noise)


def quadric_terms(x: Floats, y: Floats) -> Floats:
    """Monomials up to the second degree at places (n,), (n, 6)."""
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


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
        rises=loop.rises[used],
        fine=found.fine,
        star=found.star,
        perimeter=_length(found.fine),
    )


def slice_curve(points: Floats) -> SliceCurve:
    """Closed cubic through points (m, 2) in any order, smoothed only where it would meet itself."""
    ring = splines.order_closed_points(points)
    if len(ring.points) < LEAST_CURVE_POINTS:
        curve = splines.fit_closed_curve(points, parameters="even", smoothing=None)
        return SliceCurve(curve, np.repeat(ring.middle[None], FINE, axis=0), False)
    turns = slice_parameters(ring.points)
    through = _seen(ring, _through(ring.points, turns))
    if not through.curve.flags.self_intersecting:
        return through
    smooth = _seen(ring, splines.choose_closed_fit(ring.points, turns, None, "gcv", 0.0))
    return through if smooth.curve.flags.self_intersecting else smooth


def slice_parameters(points: Floats) -> Floats:
    """Parameters (m,) of points (m, 2), in turns: even if their steps are, else by chords."""
    parameters = splines.curve_parameters(points, "even")
    if (
        len(points) < splines.DEFAULT_CLOSED_CURVE.min_noise_points
        or same_steps(parameters)
        or not _noisy_even(points)
    ):
        return parameters
    return np.arange(len(points)) / len(points)


def _noisy_even(points: Floats) -> bool:
    """Whether noise is all that makes the steps of points (m, 2) uneven."""
    count = len(points)
    one, two = (np.roll(points, n, 0) + np.roll(points, -n, 0) for n in (1, 2))
    off = points - (4.0 * one - two) / 6.0
    ahead = np.roll(points, -2, 0) - np.roll(points, 2, 0)
    length = np.linalg.norm(ahead, axis=1)
    ahead = ahead / np.where(length > 0.0, length, 1.0)[:, None]
    along = float(np.median(np.abs((off * ahead).sum(axis=1))))
    across = float(np.median(np.abs(off[:, 0] * ahead[:, 1] - off[:, 1] * ahead[:, 0])))
    if not 0.0 < along <= ISOTROPIC * across:
        return False
    noise = across / PROBABLE_ERROR / CUBIC_GAIN
    step = float(np.median(length)) / 4.0
    reach = int(np.clip(np.ceil(CLEAR * noise / max(step, noise)), 3, max(count // WIDEST, 3)))
    chords = np.linalg.norm(np.roll(points, -reach, 0) - points, axis=1)
    return splines.are_even_chords(chords, reach)


def _seen(ring: splines.ClosedPoints, fit: splines.CurveFit) -> SliceCurve:
    """The fit in the points' own place and scale, with what should be known of it."""
    spread = np.linalg.svd(ring.points - ring.points.mean(axis=0), compute_uv=False)
    flat = bool(spread[1] <= splines.DEFAULT_CLOSED_CURVE.max_flat_spread * spread[0])
    if fit.smoothing == 0.0 and same_steps(fit.parameters):
        fine = _even_matrix(len(ring.points)) @ fit.control
    else:
        fine = splines.closed_curve_points(fit.control, fit.knots, np.arange(FINE) / FINE)
    star = not flat and bool(are_star_shaped((fine - area_centroid(fine))[None])[0])
    residual = 0.0
    if fit.smoothing > 0.0:
        off = ring.points - splines.closed_curve_points(fit.control, fit.knots, fit.parameters)
        residual = float(np.sqrt((off**2).sum(axis=1).mean()))
    curve = splines.ClosedCurve(
        control=ring.middle + ring.size * fit.control,
        knots=fit.knots,
        parameters=fit.parameters,
        used=ring.rows,
        dropped=ring.dropped,
        residual=ring.size * residual,
        sigma=ring.size * residual,
        condition=fit.condition,
        effective=fit.effective,
        smoothing=fit.smoothing,
        flags=splines.CurveFlags(
            degenerate=flat,
            uneven=bool(splines.gap_ratio(ring.points) > splines.DEFAULT_CURVE_FIT.max_gap_ratio),
            self_intersecting=not flat and not star and self_intersects(fine),
        ),
    )
    return SliceCurve(curve, ring.middle + ring.size * fine, star)


@lru_cache(maxsize=64)
def _even_matrix(count: int) -> Floats:
    """From the control points of even steps to the fine curve, (FINE, count)."""
    knots = splines.closed_knots(np.arange(count) / count)
    matrix = splines.closed_curve_points(np.eye(count), knots, np.arange(FINE) / FINE)
    matrix.setflags(write=False)
    return matrix


def _through(points: Floats, turns: Floats) -> splines.CurveFit:
    """The curve through all points; at even steps its system is solved by waves."""
    count = len(points)
    if not same_steps(turns):
        return splines.interpolate_closed(points, turns)
    waves = np.fft.rfft(points, axis=0)
    gain = (2.0 + np.cos(2.0 * np.pi * np.arange(len(waves)) / count)) / 3.0
    control = np.fft.irfft(waves / gain[:, None], count, axis=0)
    return splines.CurveFit(
        control=np.roll(control, 1, axis=0),
        knots=splines.closed_knots(turns),
        parameters=turns,
        condition=EVEN_CONDITION,
        effective=float(count),
        smoothing=0.0,
    )


def _length(fine: Floats) -> float:
    """Of a closed polygon (n, 2)."""
    return float(np.linalg.norm(np.roll(fine, -1, axis=0) - fine, axis=1).sum())


class DroppedContour(NamedTuple):
    """A contour that is not used."""

    which: int  # Of the given contours
    why: DropReason
    height: float | None = None  # Its height, if it has one, m
    off: float = 0.0  # By how much it contradicts its neighbours, root mean square, m, if so
    # It is unlike them in its size alone, and whole: it may as well have touched what no other
    # contour did, a neck or a groove, and nothing tells. It is left out, for a wrong contour costs
    # more than a groove that is missed.
    may_be_feature: bool = False


def drop_reasons(dropped: Sequence[DroppedContour]) -> str:
    """Which contours are not used, and why, as one sentence of bearable length."""
    told = "; ".join(f"contour {one.which}: {one.why}" for one in dropped[:SHOWN])
    return told + (f"; and {len(dropped) - SHOWN} more" if len(dropped) > SHOWN else "")


class SliceCurve(NamedTuple):
    """A curve, and what it looks like."""

    curve: splines.ClosedCurve  # Through the points
    fine: Floats  # (FINE, 2), at even steps of its turn
    star: bool  # Each ray from the middle of its area meets it once


def same_steps(parameters: Floats) -> bool:
    """Whether parameters (m,) are at even steps."""
    return bool(np.array_equal(parameters, np.arange(len(parameters)) / len(parameters)))


def are_star_shaped(away: Floats) -> Bools:
    """Whether polygons (M, n, 2) are seen from the origin in one turn, always onwards."""
    rises = turn_between(away, np.roll(away, -1, axis=1))
    once = np.abs(rises.sum(axis=1) - 2.0 * np.pi) < 1.0
    return np.asarray(once & (rises > 0.0).all(axis=1))


def are_nearly_star_shaped(away: Floats) -> Bools:
    """Whether they go around the origin once and hardly ever back."""
    twice = np.concatenate([away, away], axis=1)
    rises = turn_between(twice, np.roll(twice, -1, axis=1))
    turned = np.cumsum(rises[:, :-1], axis=1)
    back = (np.maximum.accumulate(turned, axis=1) - turned).max(axis=1)
    return np.asarray((turned[:, -1] > 3.0 * np.pi) & (back <= BACK))


def chord_places(fine: Floats, turns: Floats) -> Floats:
    """Points (..., M, k, 2) of curves (M, n, 2) at turns (..., M, k), on chords of the curves."""
    count = fine.shape[1]
    place = np.mod(turns, 1.0) * count
    first = place.astype(np.intp)
    share = (place - first)[..., None]
    row = np.arange(len(fine))[:, None]
    begin, end = fine[row, first % count], fine[row, (first + 1) % count]
    return np.asarray(begin + share * (end - begin))


def curve_places(curves: Sequence[splines.ClosedCurve], turns: Floats) -> Floats:
    """Points (M, k, 2) of M curves at turns (M, k); those of even steps, as most have, together."""
    even = [curve.smoothing == 0.0 and same_steps(curve.parameters) for curve in curves]
    found = np.empty((*turns.shape, 2))
    if any(even):
        together = [curve for curve, one in zip(curves, even, strict=True) if one]
        found[even] = _even_places(together, turns[even])
    for row, (curve, one) in enumerate(zip(curves, even, strict=True)):
        if not one:
            inside = np.mod(turns[row], 1.0)
            found[row] = splines.closed_curve_points(curve.control, curve.knots, inside)
    return found


def _even_places(curves: Sequence[splines.ClosedCurve], turns: Floats) -> Floats:
    counts = np.array([len(curve.control) for curve in curves])
    begin = (np.cumsum(counts) - counts)[:, None]
    control = np.concatenate([curve.control for curve in curves])
    place = np.mod(turns, 1.0) * counts[:, None]
    first = np.floor(place)
    x = place - first
    span = first.astype(np.intp)
    weights = (
        (1.0 - x) ** 3 / 6.0,
        (3.0 * x**3 - 6.0 * x**2 + 4.0) / 6.0,
        (-3.0 * x**3 + 3.0 * x**2 + 3.0 * x + 1.0) / 6.0,
        x**3 / 6.0,
    )
    points = np.zeros((*turns.shape, 2))
    for by, weight in enumerate(weights):
        points += weight[..., None] * control[begin + (span + by) % counts[:, None]]
    return points
