"""Laws of closed curves through measured points: interpolation, smoothing, order, warnings."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.geometry import signed_area
from palpate.core.splines import (
    DEFAULT_CURVE_FIT,
    ClosedCurve,
    PeriodicBasis,
    closed_curve_points,
    closed_knots,
    curve_parameters,
    fit_closed_curve,
    fit_closed_least_squares,
    gap_ratio,
    interpolate_closed,
    local_noise,
    order_closed_points,
)
from tests.core.rebuild.objects import along, polar, superellipse

FINE = np.arange(4000) / 4000
MANY = np.arange(20000) / 20000
CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
Curve = Callable[[Floats], Floats]


def ellipse(turn: Floats) -> Floats:
    return polar(turn) * [2.0, 1.0]


def bean(turn: Floats) -> Floats:
    return polar(turn, 1 + 0.35 * np.cos(4 * np.pi * turn) + 0.1 * np.sin(6 * np.pi * turn))


def noisy(sigma: float, seed: int = 0, count: int = 80, shape: Curve = bean) -> Floats:
    clean = shape(np.arange(count) / count)
    return clean + sigma * np.random.default_rng(seed).normal(size=clean.shape)


def hausdorff(result: Floats, wanted: Floats) -> float:
    """Distance between two dense curves, as a fraction of the second one's extent."""
    far = max(cKDTree(result).query(wanted)[0].max(), cKDTree(wanted).query(result)[0].max())
    return float(far / np.ptp(wanted, axis=0).max())


@pytest.mark.parametrize("shape", [ellipse, bean, lambda turn: superellipse(turn, 0.3, 1.0, 1.0)])
def test_clean_points_are_interpolated(shape: Curve):
    points = noisy(0.0, shape=shape)
    curve = fit_closed_curve(points)
    assert np.allclose(curve.at(curve.parameters), points[curve.used], rtol=0, atol=1e-14)
    assert hausdorff(curve.at(FINE), shape(MANY)) < 6e-4
    assert (curve.smoothing, curve.effective, curve.dropped) == (0.0, 80, 0)
    assert max(curve.closure_gap, curve.residual) < 1e-14 and curve.condition < 10
    assert curve.closure_gap < 1e-15 and curve.sigma == 0.0
    assert tuple(curve.flags) == (False, False, False)


@pytest.mark.parametrize("count", [3, 4, 5, 40])
def test_interpolation_equals_scipys_periodic_spline(count: int):
    rng = np.random.default_rng(count)
    parameters = np.concatenate([[0.0], np.sort(rng.uniform(0.01, 0.99, count - 1))])
    points, places = rng.normal(size=(count, 2)), np.linspace(0.0, 1.0, 101)
    fit = interpolate_closed(points, parameters)
    wound = np.append(parameters, 1.0), np.vstack([points, points[:1]])
    theirs = CubicSpline(*wound, bc_type="periodic")
    assert np.array_equal(fit.knots, closed_knots(parameters))
    for order in range(3):
        wanted = theirs(places, nu=order)
        ours = closed_curve_points(fit.control, fit.knots, places, order)
        assert np.allclose(ours, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    assert np.allclose(closed_curve_points(fit.control, fit.knots, parameters), points, atol=1e-11)
    assert (fit.effective, fit.smoothing) == (count, 0.0)
    even = np.arange(40) / 40
    assert interpolate_closed(polar(even), even).condition == pytest.approx(3.0, abs=1e-9)


def penalised(parameters: Floats, count: int, strength: float) -> tuple[Floats, Floats, float]:
    """Control points per point, hat matrix and condition of the smoothing fit, densely."""
    basis = PeriodicBasis(count).matrix(parameters).toarray()
    second = np.roll(np.eye(count), 1, 1) - 2 * np.eye(count) + np.roll(np.eye(count), -1, 1)
    basis_scaled = basis / np.sqrt((basis**2).sum() / count)
    stacked = np.vstack([basis_scaled, np.sqrt(strength / 6.0) * second])
    solve = np.linalg.pinv(stacked)[:, : len(basis)] * (basis_scaled.max() / basis.max())
    return solve, basis @ solve, float(np.linalg.cond(stacked))


@pytest.mark.parametrize("strength", [0.01, 1.0, 300.0])
def test_smoothing_solves_the_penalised_system(strength: float):
    rng = np.random.default_rng(0)
    turns, points = np.sort(rng.random(60)), rng.normal(size=(60, 2))
    solve, hat, condition = penalised(turns, 12, strength)
    fit = fit_closed_least_squares(points, turns, 12, strength)
    assert np.allclose(fit.control, solve @ points, rtol=0, atol=1e-12)
    assert fit.effective == pytest.approx(np.trace(hat))
    assert fit.condition == pytest.approx(condition)
    assert fit.smoothing == strength
    assert np.array_equal(fit.parameters, turns)


@pytest.mark.parametrize("sigma", [0.003, 0.03, 0.3])
def test_cross_validation_takes_the_least_score(sigma: float):
    turns, points = np.arange(80) / 80, noisy(sigma)
    fit = fit_closed_least_squares(points, turns, 40, None)
    few = fit_closed_least_squares(points[:6], np.arange(6) / 6, 12, None)
    assert np.isfinite(few.control).all() and few.smoothing >= DEFAULT_CURVE_FIT.min_smoothing
    stiff = fit_closed_curve(points, smoothing=1e300)
    assert np.allclose(stiff.control, points.mean(axis=0), rtol=0, atol=1e-3)

    def score(strength: float) -> float:
        hat = penalised(turns, 40, strength)[1]
        return float(((points - hat @ points) ** 2).sum() / (80 - np.trace(hat)) ** 2)

    nearby = [score(fit.smoothing * 10.0**power) for power in (-1, -1 / 6, 0, 1 / 6, 1)]
    assert min(nearby) == nearby[2]
    again = fit_closed_curve(points, count=40, smoothing="gcv", parameters="chord")
    assert again.smoothing > DEFAULT_CURVE_FIT.min_smoothing


def test_weak_smoothing_moves_parameters_to_the_nearest_places():
    turns = np.arange(60) / 60
    wrong = np.mod(turns + 0.004 * np.sin(6 * np.pi * turns), 1.0)
    points = ellipse(turns)
    strengths = 1e-4, DEFAULT_CURVE_FIT.min_smoothing
    fits = [fit_closed_least_squares(points, wrong, 12, strength) for strength in strengths]
    along = []
    for fit in fits:
        places, slopes = (
            closed_curve_points(fit.control, fit.knots, fit.parameters, order) for order in (0, 1)
        )
        along.append(np.abs(((points - places) * slopes).sum(axis=1)).max())
    assert along[1] < 0.05 * along[0]
    assert np.array_equal(fits[0].parameters, wrong)


def test_parameters_follow_the_chords():
    assert curve_parameters(CORNERS, "chord").tolist() == [0.0, 0.25, 0.5, 0.75]
    oblong = np.array([[0, 0], [4, 0], [4, 1], [0, 1.0]])
    assert curve_parameters(oblong, "chord") == pytest.approx([0.0, 0.4, 0.5, 0.9])
    assert curve_parameters(oblong, "centripetal") == pytest.approx([0, 1 / 3, 1 / 2, 5 / 6])
    assert gap_ratio(oblong) == pytest.approx(4.0)
    # Square roots are taken only at corners.
    uneven = np.array([[0, 0], [0.5, 0], [0.9, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1.0]])
    edges = along(CORNERS, np.arange(36) / 36)
    edges[1] = [0.02, 0.0]
    stretched = polar(np.arange(30) / 30) * [1, 3]
    for points, same in ((edges, "centripetal"), (uneven, "chord"), (stretched, "chord")):
        found = {one: curve_parameters(points, one) for one in ("auto", "chord", "centripetal")}
        assert np.array_equal(found["auto"], found[same])
        assert not np.allclose(found["chord"], found["centripetal"], atol=1e-3)


def test_even_points_across_corners_have_even_parameters():
    points, even = along(CORNERS, (np.arange(26) + 0.3) / 26), np.arange(26) / 26
    assert np.abs(curve_parameters(points, "chord") - even).max() > 0.005
    for contour in (points, points + 0.01 * np.random.default_rng(0).normal(size=points.shape)):
        assert np.array_equal(curve_parameters(contour, "even"), even)
    turns = np.arange(30) / 30
    for uneven in (polar(turns) * [1, 3], polar(np.delete(turns, [4, 5])), CORNERS * [1, 3]):
        result, auto = curve_parameters(uneven, "even"), curve_parameters(uneven, "auto")
        assert np.array_equal(result, auto)
        assert not np.allclose(result, np.arange(len(uneven)) / len(uneven), atol=1e-3)


def test_local_noise_is_measured_without_shape():
    turn = np.arange(400) / 400
    assert local_noise(polar(turn), turn) == 0.0
    for sigma in (1e-6, 1e-3, 0.02):
        across = polar(turn) * sigma * np.random.default_rng(0).normal(size=(400, 1))
        assert local_noise(polar(turn) + across, turn) == pytest.approx(sigma, rel=0.15)
    assert local_noise(along(CORNERS, turn[::5]), turn[::5]) < 1e-12
    rough = np.random.default_rng(0).normal(size=(25, 2))
    assert local_noise(rough[:24], np.arange(24) / 24) == 0.0
    assert local_noise(rough, np.arange(25) / 25) > 0.3


def test_noise_is_smoothed_away_and_shape_is_not():
    sigma, true = 0.026, cKDTree(bean(MANY))
    smoothed, through, result = [], [], []
    for seed in range(8):
        points = noisy(sigma, seed)
        curve, passed = fit_closed_curve(points), fit_closed_curve(points, smoothing=None)
        assert curve.smoothing > 0.0 and curve.effective < 40 and len(curve.control) == 40
        places = curve.at(curve.parameters) - points[curve.used]
        assert curve.residual == pytest.approx(np.sqrt((places**2).sum(axis=1).mean()))
        assert curve.sigma**2 * (80 - curve.effective) == pytest.approx(80 * curve.residual**2)
        result.append(curve.sigma / sigma)
        smoothed.append(true.query(curve.at(FINE))[0])
        through.append(true.query(passed.at(FINE))[0])
    assert np.sqrt(np.mean(np.square(smoothed))) <= 0.55 * sigma
    assert np.sqrt(np.mean(np.square(through))) > 0.8 * sigma
    assert np.mean(result) == pytest.approx(1.0, abs=0.1)
    # Shape is not taken for noise.
    assert fit_closed_curve(noisy(1e-5)).smoothing == 0.0
    few = fit_closed_curve(noisy(0.0, count=14))
    assert few.smoothing == few.sigma == 0.0
    for side in (2, 3, 4, 6):
        curve = fit_closed_curve(along(CORNERS, np.arange(4 * side - 4) / (4 * side - 4)))
        assert curve.smoothing == 0.0 and curve.residual < 1e-15


@pytest.mark.parametrize("shape", [ellipse, bean])
@pytest.mark.parametrize("count", [None, 16, 40])
def test_uneven_points_leave_the_rest_right(shape: Curve, count: int | None):
    rng = np.random.default_rng(0)
    turns = np.sort(np.concatenate([rng.uniform(0, 0.05, 60), rng.uniform(0.05, 1, 20)]))
    curve = fit_closed_curve(shape(turns), count=count)
    assert curve.flags.uneven
    assert hausdorff(curve.at(FINE), shape(MANY)) < 0.05


def test_length_and_area_are_exact_in_any_plane():
    curve = fit_closed_curve(noisy(0.0, count=120, shape=ellipse))
    assert curve.length == pytest.approx(9.688448, rel=1e-6)
    assert curve.area == pytest.approx(2 * math.pi, rel=1e-6)
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    tilted = fit_closed_curve(noisy(0.0) @ axes[:, :2].T + [1.0, 2.0, 3.0])
    plane = fit_closed_curve(noisy(0.0))
    assert np.allclose((tilted.at(FINE) - [1.0, 2.0, 3.0]) @ axes[:, 2], 0.0, atol=1e-14)
    assert (tilted.area, tilted.length) == pytest.approx((plane.area, plane.length), rel=1e-9)
    round_about = polar(np.arange(60) / 60)
    bent = np.column_stack([round_about, 0.3 * np.cos(4 * np.pi * np.arange(60) / 60)])
    assert fit_closed_curve(bent).area is None
    far = fit_closed_curve(1e8 + np.column_stack([round_about, 0.3 * round_about[:, 1]]))
    assert far.area == pytest.approx(np.pi * np.hypot(1.0, 0.3), rel=1e-4)
    for scale, area in ((1e150, 1e300), (1e300, np.inf), (1e-300, 0.0)):
        result = fit_closed_curve(scale * noisy(0.0, count=60, shape=ellipse)).area
        assert result == pytest.approx(2 * np.pi * area, rel=1e-3)


@pytest.mark.parametrize("count", [None, 16])
@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 1e3), (1e8, 0.0), (1e-12, 0.0), (1e150, 0.0)])
def test_any_scale_and_place_give_the_same_curve(scale: float, offset: float, count: int | None):
    ring, limit = noisy(0.0), 1e-3 if offset else 1e-12
    usual, curve = (fit_closed_curve(one, count=count) for one in (ring, offset + scale * ring))
    assert curve.area is not None
    assert curve.area / scale / scale == pytest.approx(usual.area, rel=limit)
    assert curve.length / scale == pytest.approx(usual.length, rel=limit)
    assert np.allclose((curve.at(FINE) - offset) / scale, usual.at(FINE), atol=5 * limit)


def variants(points: Floats, shifts: tuple[int, ...]) -> list[Floats]:
    """The same ring begun elsewhere and run in either direction."""
    every = itertools.product(shifts, (1, -1))
    return [np.roll(points, shift, axis=0)[::step] for shift, step in every]


@pytest.mark.parametrize("count", [None, 16])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("space", [False, True])
def test_begin_and_direction_change_no_bit(count: int | None, noise: float, space: bool):
    points = noisy(noise, count=60)
    if space:
        points = np.column_stack([points, np.full(60, 0.4)])
    wanted = fit_closed_curve(points, count=count)
    for turned in variants(points, (1, 17, 59)):
        result = fit_closed_curve(turned, count=count)
        assert np.array_equal(result.control, wanted.control)
        assert np.array_equal(result.knots, wanted.knots)
        assert np.array_equal(turned[result.used], points[wanted.used])
    assert signed_area(wanted.at(FINE)[:, :2]) > 0.0


def test_order_is_unique_where_points_tie():
    twice = np.array([[1, 0], [0, 1], [-1, 0], [1, 0], [0, -1], [-1, -1.0]])
    spokes = np.array([[0, 0], [3, 1], [0, 2], [3, 1], [1, -1], [3, 1], [0, 0], [3, 1.0]])
    for points in (twice, spokes, np.tile(spokes[:2], (500, 1))):
        wanted = order_closed_points(points).points
        for turned in variants(points, tuple(range(7))):
            assert np.array_equal(order_closed_points(turned).points, wanted)


def test_order_drops_repeated_and_infinite_points():
    points = np.array([[0, 0], [np.nan, 0], [2, 0], [2, 0], [2, 1], [0, 1], [0, 0.0]])
    ring = order_closed_points(points)
    assert (ring.dropped, len(ring.rows), ring.size) == (1, 4, 2.0)
    assert np.allclose(ring.middle + ring.size * ring.points, points[ring.rows])
    assert points[ring.rows].tolist() == [[2, 1], [0, 1], [0, 0], [2, 0]]
    clean = noisy(0.0, count=60)
    holed = np.insert(clean, [3, 30, 60], [[np.nan, 0], [np.inf, 1], [0, -np.inf]], axis=0)
    closed = np.vstack([clean, clean[:1]])
    for count in (None, 16):
        wanted = fit_closed_curve(clean, count=count)
        for result in (holed, closed, np.repeat(closed, 3, axis=0)):
            curve = fit_closed_curve(result, count=count)
            assert curve.dropped == np.count_nonzero(~np.isfinite(result).all(axis=1))
            assert np.array_equal(curve.control, wanted.control)
            assert np.array_equal(result[curve.used], clean[wanted.used])


def test_degenerate_and_self_intersecting_curves_are_flagged():
    for many in (1, 40):
        curve = fit_closed_curve(np.tile([0.1, -0.2], (many, 1)))
        assert curve.flags.degenerate and not curve.flags.uneven
        assert np.array_equal(curve.at([0.0, 0.3]), [[0.1, -0.2], [0.1, -0.2]])
        assert curve.area == curve.length == curve.closure_gap == 0.0
    barely = 1e3 + 1e-13 * np.random.default_rng(0).random((40, 2))
    assert fit_closed_curve(barely).flags.degenerate
    line = fit_closed_curve(np.linspace(0, 1, 9)[:, None] * [1.0, 2.0])
    assert line.flags.degenerate and np.isfinite(line.control).all()
    two = fit_closed_curve(CORNERS[:2])
    assert np.allclose(two.at(FINE)[:, 1], 0.0, atol=1e-15) and two.flags.degenerate
    assert np.ptp(two.at(FINE)[:, 0]) == pytest.approx(1.0, abs=1e-3)
    triangle = fit_closed_curve(CORNERS[[0, 1, 3]])
    assert cKDTree(triangle.at(FINE)).query(CORNERS[[0, 1, 3]])[0].max() < 1e-3
    assert not triangle.flags.degenerate
    # Curves that meet themselves are flagged as well.
    angle = 2 * np.pi * np.arange(80) / 80
    eight = fit_closed_curve(np.column_stack([np.sin(angle), np.sin(2 * angle)]))
    assert eight.flags.self_intersecting and not eight.flags.degenerate
    assert eight.area == pytest.approx(0.0, abs=1e-3)
    limacon = (1.0 + 1.3 * np.cos(angle))[:, None] * polar(np.arange(80) / 80)
    assert fit_closed_curve(limacon).flags.self_intersecting
    right = np.column_stack([1 - np.cos(angle), np.sin(angle)])
    assert fit_closed_curve(np.vstack([right, -right[::-1]])).flags.self_intersecting


def fit(points: Floats | None = None, **options: object) -> ClosedCurve:
    points = ellipse(np.arange(20) / 20) if points is None else points
    return fit_closed_curve(points, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("call", "words"), [
    (lambda: fit(np.zeros((20, 4))), r"points must have shape .*, got \(20, 4\)"),
    (lambda: fit(np.full((2, 2), np.nan)), "points must have at least one finite row, got 2 rows"),
    (lambda: fit(1e308 * (2 * CORNERS - 1)), r"points must spread less than 1\.79769e\+308 m"),
    (lambda: fit(count=3), "count must be at least 4, got 3"),
    (lambda: fit(smoothing=-1.0), r"smoothing must be 0 or more and finite, got -1\.0"),
    (lambda: fit(smoothing=np.inf), "smoothing must be 0 or more and finite, got inf"),
    (lambda: fit(smoothing="some"), "smoothing must be auto, gcv, a number or None, got 'some'"),
    (lambda: fit(parameters="x"), r"parameters must be one of auto, chord, .*, got 'x'"),
    (lambda: fit().at([0.0, np.nan]), "x must be finite"),
    (lambda: fit().at(0.0, -1), "derivatives must be 0 or more, got -1"),
])  # fmt: skip
def test_bad_input_is_refused(call: Callable[[], object], words: str):
    with pytest.raises(ValueError, match=words):
        call()
