"""Contours as closed curves: each contour by itself, or refused with a reason.

Points at even steps are interpolated by Fourier transform, and all such curves are evaluated
together. Whether noise is all that makes the steps uneven is judged from the points.
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
from palpate.core.rebuild.contours.ordering import CheckedOrder, checked_order

# Why a contour is not used.
DropReason = (
    Literal["too few points", "in one place", "in one place: a touch of its end", "on one line"]
    | Literal["around no area", "repeats another at its height", "inside another at its height"]
    | Literal["crosses another at its height", "beside another at its height"]
    | Literal["unlike its neighbours", "its points are in no order"]
)
MIN_CURVE_POINTS = 3
EVEN_CONDITION = 3.0  # of the cubic spline's system at even steps: eigenvalues from 1/3 to 1
# Standard deviation of a point's distance from the cubic through two neighbours on each side, over
# that of the points.
CUBIC_GAIN = float(np.sqrt(1.0 + 34.0 / 36.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightOutlierSettings:
    """When the height of a point is wrong: compared with the median of its neighbours' heights."""

    n_each_side: int = 4  # neighbours before and after; the median bears half of them wrong
    min_sigmas: float = 6.0  # standard deviations of the heights' noise
    min_spread_ratio: float = 3.0  # over the neighbours' interquartile range, large on a slope
    min_deviation: float = 1e-4  # fraction of the perimeter: less does no harm
    max_share: float = 0.15  # of the points; beyond it the contour itself has this shape
    min_points: int = 12  # contours of fewer points are not judged


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSettings:
    """How contours become curves, and when only noise makes the steps of their points uneven."""

    n_fine: int = 512  # places along each curve at which it is compared with others
    max_noise_ratio: float = 1.6  # noise along over noise across; more means uneven steps
    min_chord_ratio: float = 8.0  # length of chords that compare steps, over the noise
    min_chords_around: int = 6  # of these chords; larger shortens the chords
    heights: HeightOutlierSettings = HeightOutlierSettings()


DEFAULT_CURVES = CurveSettings()


@dataclass(frozen=True, slots=True, eq=False)
class ContourCurve:
    """One contour with its curve, before the stack is made."""

    which: int  # number of the contour as it was given
    height: float  # [m]
    curve: splines.ClosedCurve  # through the points
    points: Floats  # (n, 2) [m], in the order of the curve; outliers are moved onto it
    as_given: Floats  # (n, 2) [m], the same points before outliers were moved
    outlier: Bools  # (n,): single points that are wrong and not used
    off_height: Bools  # (n,): outliers by their height
    fine: Floats  # (k, 2) [m], the curve at even steps of its parameter
    star: bool  # whether each ray from the centroid of its area meets the curve once
    perimeter: float  # [m]
    tilt: float  # root mean square of the smooth rise and fall of the points [m]
    error: float  # standard error of the height [m]
    rises: Floats  # (n,) [m]: of each of `points` above the height
    reordered: bool = False  # whether its points were given in no order, and were put in order
    disordered: bool = False  # whether its points have no order that is certain


def contour_curves(
    contours: Sequence[ArrayLike],
    heights: ArrayLike | None = None,
    first: int = 0,
    frame: Floats | None = None,
    settings: CurveSettings = DEFAULT_CURVES,
) -> tuple[ContourCurve | DroppedContour, ...]:
    """Each contour as a closed curve, or why it has none: too few points, in one place, on a line.

    A contour is (n, 3) points, z being the slicing axis, in any one unit (m in comments here). It
    may begin anywhere, run in either direction, and repeat its first point at the end. Points in no
    order are put in order where that is certain. Rows that are not finite are left out. With
    `heights` (len(contours),) contours are (n, 2). `first` is the number of the first contour,
    `frame` (7,) the pose in the world of the frame around whose z axis contours run.
    Raises ValueError if a shape is wrong, a height is not finite, or both heights and a frame are
    given.
    """
    if frame is not None and heights is not None:
        raise ValueError(
            "heights must be left out with a frame, for contours are then points of the world"
        )
    return tuple(
        _cached_curve(number, into_frame(frame, points).tobytes(), settings)
        for number, points in enumerate(_checked_contours(contours, heights, first), first)
    )


def _checked_contours(
    contours: Sequence[ArrayLike], heights: ArrayLike | None, first: int
) -> list[Floats]:
    """The contours as (n, 3) arrays of their finite rows."""
    if isinstance(contours, str) or not isinstance(contours, Sequence | np.ndarray):
        raise ValueError(f"contours must be a sequence of arrays, got {type(contours).__name__}")
    if not len(contours):
        raise ValueError("contours must be at least one, got none")
    width = 3 if heights is None else 2
    checked = []
    for number, contour in enumerate(contours, first):
        try:
            array = np.asarray(contour)
            if np.iscomplexobj(array):
                raise ValueError("complex ones")
            points = array.astype(np.float64, copy=False)
        except (TypeError, ValueError) as error:
            message = f"contour {number} must be an array of real numbers: {error}"
            raise ValueError(message) from None
        if not points.size:
            points = points.reshape(0, width)
        if points.ndim != 2 or points.shape[1] != width:
            raise ValueError(f"contour {number} must have shape (any, {width}), got {points.shape}")
        checked.append(points)
    if heights is not None:
        pairs = zip(checked, finite_array("heights", heights, (len(checked),)), strict=True)
        checked = [np.column_stack([points, np.full(len(points), z)]) for points, z in pairs]
    return [points[np.isfinite(points).all(axis=1)] for points in checked]


@lru_cache(maxsize=512)
def _cached_curve(
    number: int, points: bytes, settings: CurveSettings
) -> ContourCurve | DroppedContour:
    """The curve of points (n, 3): growing sets of contours have most of them in common."""
    return _contour_curve(number, np.frombuffer(points).reshape(-1, 3), settings)


def _contour_curve(
    number: int, points: Floats, settings: CurveSettings
) -> ContourCurve | DroppedContour:
    level = float(np.median(points[:, 2])) if len(points) else None
    if len(points) < MIN_CURVE_POINTS:
        return DroppedContour(number, "too few points", level)
    order = CheckedOrder(None, False)
    if not is_simple_ring(points[:, :2]):
        order = checked_order(points[:, :2])
        points = points if order.rows is None else points[order.rows]
    fit = slice_curve(points[:, :2], settings)
    used = points[fit.curve.used]
    if len(used) < MIN_CURVE_POINTS:
        return DroppedContour(number, "in one place" if len(used) == 1 else "too few points", level)
    if fit.curve.flags.degenerate:
        return DroppedContour(number, "on one line", level)
    perimeter = _length(fit.fine)
    off_height = height_outliers(used[:, 2], perimeter, settings.heights)
    good = used[~off_height]
    tilt, noise = height_residual_of(good)
    height = float(good[0, 2] + (good[:, 2] - good[0, 2]).mean())
    return ContourCurve(
        which=number,
        height=height,
        curve=fit.curve,
        points=used[:, :2],
        as_given=used[:, :2],
        outlier=np.zeros(len(used), np.bool_),
        off_height=off_height,
        fine=fit.fine,
        star=fit.is_star_shaped,
        perimeter=perimeter,
        tilt=tilt,
        error=noise / float(np.sqrt(len(good))),
        rises=used[:, 2] - height,
        reordered=order.rows is not None,
        disordered=order.is_disordered,
    )


def height_outliers(z: Floats, perimeter: float, settings: HeightOutlierSettings) -> Bools:
    """Points (n,) whose heights z (n,), in order around the contour, are far from their median."""
    if len(z) < settings.min_points:
        return np.zeros(len(z), np.bool_)
    shifts = range(-settings.n_each_side, settings.n_each_side + 1)
    low, middle, high = np.quantile([np.roll(z, by) for by in shifts], [0.25, 0.5, 0.75], axis=0)
    off = np.abs(z - middle)
    min_off = settings.min_sigmas * probable_error_sigma(off)
    min_off = max(min_off, settings.min_deviation * perimeter)
    outlier: Bools = off > np.maximum(settings.min_spread_ratio * (high - low), min_off)
    return np.asarray(outlier & (outlier.mean() <= settings.max_share))


def height_residual_of(points: Floats) -> tuple[float, float]:
    """Root mean square [m] of the smooth and of the random part of z - mean(z) of points (n, 3).

    The smooth part is a quadric over the plane, without the share that noise has in its fit. Of 6
    points or fewer all is taken for smooth.
    """
    z = points[:, 2] - points[0, 2]
    z = z - z.mean()
    size = float(np.abs(z).max())
    if size == 0.0:
        return 0.0, 0.0
    near = points[:, :2] - points[:, :2].mean(axis=0)
    x, y = (near / np.abs(near).max()).T
    quadric = quadric_terms(x, y)
    # On a circle the bowl and the constant are the same: least squares takes the shortest solution.
    solution, _, rank, _ = np.linalg.lstsq(quadric, z / size, rcond=None)
    explained = quadric @ solution
    spare = len(z) - int(rank)
    left = float(((z / size - explained) ** 2).sum())
    noise = np.sqrt(left / spare) if spare > 0 else 0.0
    shape = np.sqrt(max(float((explained**2).mean()) - noise**2 * (rank - 1) / len(z), 0.0))
    return size * float(shape), size * float(noise)


def quadric_terms(x: Floats, y: Floats) -> Floats:
    """Monomials 1, x, y, x^2, x y, y^2 at places (n,): (n, 6)."""
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def refitted_curve(
    loop: ContourCurve, points: Floats, outlier: Bools, settings: CurveSettings = DEFAULT_CURVES
) -> ContourCurve:
    """The contour with its outliers (n,) moved to predicted places: its points are now (n, 2)."""
    if np.array_equal(points, loop.points):
        return replace(loop, outlier=outlier)
    fit = slice_curve(points, settings)
    used = fit.curve.used
    if len(used) < MIN_CURVE_POINTS or fit.curve.flags.degenerate:
        return loop
    return replace(
        loop,
        curve=fit.curve,
        points=points[used],
        as_given=loop.as_given[used],
        outlier=outlier[used],
        off_height=loop.off_height[used],
        rises=loop.rises[used],
        fine=fit.fine,
        star=fit.is_star_shaped,
        perimeter=_length(fit.fine),
    )


def slice_curve(points: Floats, settings: CurveSettings) -> SliceCurve:
    """Closed cubic through points (m, 2), smoothed only if it would else intersect itself."""
    ring = splines.order_closed_points(points)
    if len(ring.points) < MIN_CURVE_POINTS:
        curve = splines.fit_closed_curve(points, parameters="even", smoothing=None)
        return SliceCurve(curve, np.repeat(ring.middle[None], settings.n_fine, axis=0), False)
    turns = slice_parameters(ring.points, settings)
    exact = _scaled_back(ring, _interpolated(ring.points, turns), settings.n_fine)
    if not exact.curve.flags.self_intersecting:
        return exact
    fit = splines.choose_closed_fit(ring.points, turns, None, "gcv", 0.0)
    smooth = _scaled_back(ring, fit, settings.n_fine)
    return exact if smooth.curve.flags.self_intersecting else smooth


def slice_parameters(points: Floats, settings: CurveSettings) -> Floats:
    """Parameters (m,) [turns] of points (m, 2): even if their steps are even, else by chords."""
    parameters = splines.curve_parameters(points, "even")
    if len(points) < splines.DEFAULT_CLOSED_CURVE.min_noise_points or has_even_steps(parameters):
        return parameters
    if not _is_even_but_noisy(points, settings):
        return parameters
    return np.arange(len(points)) / len(points)


def _is_even_but_noisy(points: Floats, settings: CurveSettings) -> bool:
    """Whether noise is all that makes the steps of points (m, 2) uneven."""
    count = len(points)
    nearest, second = (np.roll(points, n, 0) + np.roll(points, -n, 0) for n in (1, 2))
    off = points - (4.0 * nearest - second) / 6.0
    ahead = np.roll(points, -2, 0) - np.roll(points, 2, 0)
    length = np.linalg.norm(ahead, axis=1)
    ahead = ahead / np.where(length > 0.0, length, 1.0)[:, None]
    along = float(np.median(np.abs((off * ahead).sum(axis=1))))
    across = float(np.median(np.abs(off[:, 0] * ahead[:, 1] - off[:, 1] * ahead[:, 0])))
    if not 0.0 < along <= settings.max_noise_ratio * across:
        return False
    noise = across / PROBABLE_ERROR / CUBIC_GAIN
    step = float(np.median(length)) / 4.0
    wanted = np.ceil(settings.min_chord_ratio * noise / max(step, noise))
    span = int(np.clip(wanted, 3, max(count // settings.min_chords_around, 3)))
    chords = np.linalg.norm(np.roll(points, -span, 0) - points, axis=1)
    return splines.are_even_chords(chords, span)


def _scaled_back(ring: splines.ClosedPoints, fit: splines.CurveFit, n_fine: int) -> SliceCurve:
    """The fit at the points' own place and scale, with its figures and flags."""
    spread = np.linalg.svd(ring.points - ring.points.mean(axis=0), compute_uv=False)
    flat = bool(spread[1] <= splines.DEFAULT_CLOSED_CURVE.max_flat_spread * spread[0])
    if fit.smoothing == 0.0 and has_even_steps(fit.parameters):
        fine = _even_matrix(len(ring.points), n_fine) @ fit.control
    else:
        fine = splines.closed_curve_points(fit.control, fit.knots, np.arange(n_fine) / n_fine)
    is_star_shaped = not flat and bool(are_star_shaped((fine - area_centroid(fine))[None])[0])
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
            self_intersecting=not flat and not is_star_shaped and self_intersects(fine),
        ),
    )
    return SliceCurve(curve, ring.middle + ring.size * fine, is_star_shaped)


@lru_cache(maxsize=64)
def _even_matrix(count: int, n_fine: int) -> Floats:
    """Matrix (n_fine, count) from the control points at even steps to the fine curve."""
    knots = splines.closed_knots(np.arange(count) / count)
    matrix = splines.closed_curve_points(np.eye(count), knots, np.arange(n_fine) / n_fine)
    matrix.setflags(write=False)
    return matrix


def _interpolated(points: Floats, turns: Floats) -> splines.CurveFit:
    """The curve through all points; at even steps its system is solved by Fourier transform."""
    count = len(points)
    if not has_even_steps(turns):
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
    """Perimeter of a closed polygon (n, 2)."""
    return float(np.linalg.norm(np.roll(fine, -1, axis=0) - fine, axis=1).sum())


class DroppedContour(NamedTuple):
    """A contour that is not used."""

    which: int  # number of the contour as it was given
    why: DropReason
    height: float | None = None  # [m], if it has one
    off: float = 0.0  # root mean square difference from its neighbours' prediction [m], if wrong
    # Whether it differs from its neighbours in size alone: it may have touched a neck or a groove
    # that no other contour did. It is left out: a wrong contour costs more than a missed groove.
    may_be_feature: bool = False


def drop_reasons(dropped: Sequence[DroppedContour], max_shown: int = 6) -> str:
    """One sentence on the contours that are not used, and why; the first `max_shown` are named."""
    reasons = [f"contour {contour.which}: {contour.why}" for contour in dropped[:max_shown]]
    if len(dropped) > max_shown:
        reasons.append(f"and {len(dropped) - max_shown} more")
    return "; ".join(reasons)


class SliceCurve(NamedTuple):
    """A curve through the points of a contour."""

    curve: splines.ClosedCurve
    fine: Floats  # (n_fine, 2), at even steps of its parameter
    is_star_shaped: bool  # whether each ray from the centroid of its area meets it once


def has_even_steps(parameters: Floats) -> bool:
    """Whether parameters (m,) are at even steps."""
    return bool(np.array_equal(parameters, np.arange(len(parameters)) / len(parameters)))


def are_star_shaped(away: Floats) -> Bools:
    """Whether polygons (M, n, 2) run once counter-clockwise around the origin, never backwards."""
    rises = turn_between(away, np.roll(away, -1, axis=1))
    once = np.abs(rises.sum(axis=1) - 2.0 * np.pi) < 1.0
    return np.asarray(once & (rises > 0.0).all(axis=1))


def are_nearly_star_shaped(away: Floats, max_back_angle: float = 0.1) -> Bools:
    """Whether polygons (M, n, 2) run once around the origin, and back by at most an angle [rad].

    The default for `max_back_angle` allows for noise.
    """
    twice = np.concatenate([away, away], axis=1)
    rises = turn_between(twice, np.roll(twice, -1, axis=1))
    turned = np.cumsum(rises[:, :-1], axis=1)
    back = (np.maximum.accumulate(turned, axis=1) - turned).max(axis=1)
    return np.asarray((turned[:, -1] > 3.0 * np.pi) & (back <= max_back_angle))


def chord_places(fine: Floats, turns: Floats) -> Floats:
    """Points (..., M, k, 2) at turns (..., M, k) of curves (M, n, 2), on the polygons' chords."""
    count = fine.shape[1]
    place = np.mod(turns, 1.0) * count
    first = place.astype(np.intp)
    share = (place - first)[..., None]
    row = np.arange(len(fine))[:, None]
    begin, end = fine[row, first % count], fine[row, (first + 1) % count]
    return np.asarray(begin + share * (end - begin))


def curve_places(curves: Sequence[splines.ClosedCurve], turns: Floats) -> Floats:
    """Points (M, k, 2) of M curves at turns (M, k); curves of even steps are evaluated together."""
    even = [curve.smoothing == 0.0 and has_even_steps(curve.parameters) for curve in curves]
    points = np.empty((*turns.shape, 2))
    if any(even):
        together = [curve for curve, is_even in zip(curves, even, strict=True) if is_even]
        points[even] = _even_places(together, turns[even])
    for row in np.flatnonzero(~np.array(even)).tolist():
        curve, inside = curves[row], np.mod(turns[row], 1.0)
        points[row] = splines.closed_curve_points(curve.control, curve.knots, inside)
    return points


def _even_places(curves: Sequence[splines.ClosedCurve], turns: Floats) -> Floats:
    """Points (M, k, 2) at turns (M, k) of uniform cubic curves, by their basis functions."""
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
