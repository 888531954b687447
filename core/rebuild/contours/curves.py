"""The closed curve through the points of one slice, and points of many such curves at once.

Whether points were taken at even steps is judged as far as their noise lets one see; even steps
are solved by Fourier transform and evaluated together.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.geometry import area_centroid, self_intersects, turn_between
from palpate.core.splines import (
    EVEN_GAP,
    EVEN_MIDDLE,
    FLAT_SPREAD,
    LEAST_POINTS,
    UNEVEN_GAP_RATIO,
    ClosedCurve,
    ClosedPoints,
    CurveFit,
    CurveFlags,
    choose_closed_fit,
    closed_curve_points,
    closed_knots,
    curve_parameters,
    fit_closed_curve,
    gap_ratio,
    interpolate_closed,
    order_closed_points,
)

FINE = 512  # Places along each curve at which it is compared with others
LEAST_CURVE_POINTS = 3
EVEN_CONDITION = 3.0  # Of the system for even steps: its eigenvalues lie between 1/3 and 1
# Noise leaves a point off its neighbours' course along it as far as across it; points at uneven
# steps lie off along it alone. So many times farther is more than chance.
ISOTROPIC = 1.6
CLEAR = 8.0  # Chords so many times longer than the noise tell how even the steps are
WIDEST = 6  # Of the points, one in so many is the longest such chord: a sixth of a turn
# Deviation of a point from the cubic through two neighbours on either side, of its noise.
GAIN = float(np.sqrt(1.0 + 34.0 / 36.0))
MEDIAN = 0.6745  # Median size of an error of deviation 1
BACK = 0.1  # Angle by which a polygon may go back around the origin, rad: noise does


class SliceCurve(NamedTuple):
    """A curve, and what it looks like."""

    curve: ClosedCurve  # Through the points
    fine: Floats  # (FINE, 2), at even steps of its turn
    star: bool  # Each ray from the middle of its area meets it once


def slice_curve(points: Floats) -> SliceCurve:
    """Closed cubic through points (m, 2) around a contour, in any order and direction.

    It passes all points. Only where it would then meet itself, because points are nearer to each
    other than their noise, it is smoothed, if that helps.
    """
    ring = order_closed_points(points)
    if len(ring.points) < LEAST_CURVE_POINTS:
        curve = fit_closed_curve(points, parameters="even", smoothing=None)
        return SliceCurve(curve, np.repeat(ring.middle[None], FINE, axis=0), False)
    turns = slice_parameters(ring.points)
    through = _seen(ring, _through(ring.points, turns))
    if not through.curve.flags.self_intersecting:
        return through
    smooth = _seen(ring, choose_closed_fit(ring.points, turns, None, "gcv", 0.0))
    return through if smooth.curve.flags.self_intersecting else smooth


def slice_parameters(points: Floats) -> Floats:
    """Parameters (m,) of points (m, 2) around a closed curve, in turns; the first is 0.

    Even steps where the points were touched at even distances, else in proportion to the chords. Of
    points that are hardly farther apart than their noise, chords tell the noise: there only chords
    over several steps are compared.
    """
    parameters = curve_parameters(points, "even")
    count = len(points)
    even = np.arange(count) / count
    if count < LEAST_POINTS or same_steps(parameters) or not _noisy_even(points):
        return parameters
    return even


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
    noise = across / MEDIAN / GAIN
    step = float(np.median(length)) / 4.0
    reach = int(np.clip(np.ceil(CLEAR * noise / max(step, noise)), 3, max(count // WIDEST, 3)))
    chords = np.linalg.norm(np.roll(points, -reach, 0) - points, axis=1)
    tenth, quarter, most = np.quantile(chords, [0.1, 0.25, 0.75])
    return bool(chords.max() <= EVEN_GAP * tenth and most <= EVEN_MIDDLE * quarter)


def _seen(ring: ClosedPoints, fit: CurveFit) -> SliceCurve:
    """The fit in the points' own place and scale, with what should be known of it."""
    spread = np.linalg.svd(ring.points - ring.points.mean(axis=0), compute_uv=False)
    flat = bool(spread[1] <= FLAT_SPREAD * spread[0])
    if fit.smoothing == 0.0 and same_steps(fit.parameters):
        fine = _even_matrix(len(ring.points)) @ fit.control
    else:
        fine = closed_curve_points(fit.control, fit.knots, np.arange(FINE) / FINE)
    star = not flat and bool(are_star_shaped((fine - area_centroid(fine))[None])[0])
    residual = 0.0
    if fit.smoothing > 0.0:
        off = ring.points - closed_curve_points(fit.control, fit.knots, fit.parameters)
        residual = float(np.sqrt((off**2).sum(axis=1).mean()))
    curve = ClosedCurve(
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
        flags=CurveFlags(
            degenerate=flat,
            uneven=bool(gap_ratio(ring.points) > UNEVEN_GAP_RATIO),
            self_intersecting=not flat and not star and self_intersects(fine),
        ),
    )
    return SliceCurve(curve, ring.middle + ring.size * fine, star)


@lru_cache(maxsize=64)
def _even_matrix(count: int) -> Floats:
    """From the control points of even steps to the fine curve, (FINE, count)."""
    knots = closed_knots(np.arange(count) / count)
    matrix = closed_curve_points(np.eye(count), knots, np.arange(FINE) / FINE)
    matrix.setflags(write=False)
    return matrix


def _through(points: Floats, turns: Floats) -> CurveFit:
    """The curve through all points; at even steps its system is solved by waves."""
    count = len(points)
    if not same_steps(turns):
        return interpolate_closed(points, turns)
    waves = np.fft.rfft(points, axis=0)
    gain = (2.0 + np.cos(2.0 * np.pi * np.arange(len(waves)) / count)) / 3.0
    control = np.fft.irfft(waves / gain[:, None], count, axis=0)
    return CurveFit(
        control=np.roll(control, 1, axis=0),
        knots=closed_knots(turns),
        parameters=turns,
        condition=EVEN_CONDITION,
        effective=float(count),
        smoothing=0.0,
    )


def same_steps(parameters: Floats) -> bool:
    """Whether parameters (m,) are at even steps."""
    return bool(np.array_equal(parameters, np.arange(len(parameters)) / len(parameters)))


def are_star_shaped(away: Floats) -> Bools:
    """Whether polygons (M, n, 2) are seen from the origin in one turn, always onwards."""
    rises = turn_between(away, np.roll(away, -1, axis=1))
    once = np.abs(rises.sum(axis=1) - 2.0 * np.pi) < 1.0
    star: Bools = once & (rises > 0.0).all(axis=1)
    return star


def are_nearly_star_shaped(away: Floats) -> Bools:
    """Whether they go around the origin once and hardly ever back."""
    twice = np.concatenate([away, away], axis=1)
    rises = turn_between(twice, np.roll(twice, -1, axis=1))
    turned = np.cumsum(rises[:, :-1], axis=1)
    back = (np.maximum.accumulate(turned, axis=1) - turned).max(axis=1)
    nearly: Bools = (turned[:, -1] > 3.0 * np.pi) & (back <= BACK)
    return nearly


def chord_places(fine: Floats, turns: Floats) -> Floats:
    """Points (..., M, k, 2) of curves (M, n, 2) at turns (..., M, k), on chords of the curves."""
    count = fine.shape[1]
    place = np.mod(turns, 1.0) * count
    first = place.astype(np.intp)
    share = (place - first)[..., None]
    row = np.arange(len(fine))[:, None]
    begin, end = fine[row, first % count], fine[row, (first + 1) % count]
    points: Floats = begin + share * (end - begin)
    return points


def curve_places(curves: Sequence[ClosedCurve], turns: Floats) -> Floats:
    """Points (M, k, 2) of M curves at turns (M, k); those of even steps, as most have, together."""
    even = [curve.smoothing == 0.0 and same_steps(curve.parameters) for curve in curves]
    found = np.empty((*turns.shape, 2))
    if any(even):
        together = [curve for curve, one in zip(curves, even, strict=True) if one]
        found[even] = _even_places(together, turns[even])
    for row, (curve, one) in enumerate(zip(curves, even, strict=True)):
        if not one:
            found[row] = curve.at(turns[row])
    return found


def _even_places(curves: Sequence[ClosedCurve], turns: Floats) -> Floats:
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
