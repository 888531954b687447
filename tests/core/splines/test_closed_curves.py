from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.spatial import cKDTree

from palpate.core.geometry.polygons import area_centroid
from palpate.core.splines.closed_curves import fit_closed_curve
from palpate.core.thesis.layers import fit_closed_curve_thesis

FINE = np.arange(4000) / 4000


def ellipse(turn):
    return np.column_stack([2 * np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])


def bean(turn):
    angle = 2 * np.pi * turn
    radius = 1 + 0.35 * np.cos(2 * angle) + 0.1 * np.sin(3 * angle)
    return radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def superellipse(turn):
    c, s = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
    away = (abs(c) ** (2 / 0.3) + abs(s) ** (2 / 0.3)) ** -0.15
    return away[:, None] * np.column_stack([c, s])


def hausdorff(found, wanted):
    one, other = cKDTree(found), cKDTree(wanted)
    far = max(one.query(wanted)[0].max(), other.query(found)[0].max())
    return float(far / np.ptp(wanted, axis=0).max())


def error(curve, shape):
    return hausdorff(curve.at(FINE), shape(np.arange(20000) / 20000))


@pytest.mark.parametrize("shape", [ellipse, bean, superellipse])
def test_clean_points_are_passed(shape):
    points = shape(np.arange(80) / 80)
    curve = fit_closed_curve(points)
    assert np.allclose(curve.at(curve.parameters), points[curve.used], rtol=0, atol=1e-14)
    assert error(curve, shape) < 6e-4
    assert curve.smoothing == 0.0
    assert curve.effective == 80
    assert curve.condition < 10
    assert tuple(curve.flags) == (False, False, False)


@pytest.mark.parametrize("shape", [ellipse, bean, superellipse])
@pytest.mark.parametrize("count", [16, 24, 40])
def test_few_control_points_are_well_conditioned_and_near(shape, count):
    curve = fit_closed_curve(shape(np.arange(81) / 80), count=count)
    assert curve.control.shape == (count, 2)
    assert curve.condition < 10
    assert error(curve, shape) < {16: 3.5e-3, 24: 2.5e-3, 40: 6e-4}[count]


@pytest.mark.parametrize("count", [None, 16])
def test_the_curve_closes_with_two_derivatives(count):
    curve = fit_closed_curve(bean(np.arange(80) / 80), count=count)
    assert curve.closure_gap < 1e-15
    for derivative in range(3):
        before, after = curve.at([1.0 - 1e-12, 1e-12], derivative)
        assert np.allclose(before, after, rtol=0, atol=1e-6 * np.abs(before).max())


@pytest.mark.parametrize("shape", [ellipse, superellipse, bean])
def test_the_error_is_a_fifth_of_that_of_clamped_knots_with_pseudo_vertices(shape):
    points = shape(np.arange(81) / 80)
    ours = fit_closed_curve(points, count=16)
    theirs = fit_closed_curve_thesis(points, 16)
    share = {ellipse: 5, superellipse: 5, bean: 3}[shape]
    assert share * error(ours, shape) < error(theirs, shape)
    assert theirs.closure_gap > 0.05
    assert theirs.condition > 1e3
    assert fit_closed_curve(points).closure_gap < 1e-15


def test_noise_is_found_and_smoothed_away():
    clean, sigma = bean(np.arange(80) / 80), 0.01 * 2.6
    true = cKDTree(bean(np.arange(20000) / 20000))
    smoothed, through, found = [], [], []
    for seed in range(12):
        points = clean + sigma * np.random.default_rng(seed).normal(size=clean.shape)
        curve = fit_closed_curve(points)
        assert curve.smoothing > 0.0
        assert curve.effective < 40
        found.append(curve.sigma / sigma)
        smoothed.append(true.query(curve.at(FINE))[0])
        through.append(true.query(fit_closed_curve(points, smoothing=None).at(FINE))[0])
    assert np.sqrt(np.mean(np.square(smoothed))) <= 0.55 * sigma
    assert np.sqrt(np.mean(np.square(through))) > 0.8 * sigma
    assert np.mean(found) == pytest.approx(1.0, abs=0.1)


def test_noise_that_a_smooth_curve_cannot_be_told_from_is_left_in():
    clean = bean(np.arange(80) / 80)
    points = clean + 1e-5 * np.random.default_rng(0).normal(size=clean.shape)
    assert fit_closed_curve(points).smoothing == 0.0


def test_few_points_of_a_smooth_curve_are_not_taken_for_noise():
    curve = fit_closed_curve(bean(np.arange(14) / 14))
    assert curve.smoothing == 0.0
    assert curve.sigma == 0.0


def test_more_smoothing_leaves_fewer_degrees_of_freedom():
    points = bean(np.arange(80) / 80)
    spent = [
        fit_closed_curve(points, count=30, smoothing=weight).effective
        for weight in (0.0, 0.1, 10.0, 1e4)
    ]
    assert (np.diff(spent) < 0.0).all()
    assert spent[0] == pytest.approx(30, abs=0.01)


def test_length_and_area_are_those_of_the_shape():
    curve = fit_closed_curve(ellipse(np.arange(120) / 120))
    assert curve.length == pytest.approx(9.688448, rel=1e-6)
    assert curve.area == pytest.approx(2 * math.pi, rel=1e-6)


def test_a_contour_in_space_keeps_its_plane():
    flat = bean(np.arange(80) / 80)
    axes = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    curve = fit_closed_curve(flat @ axes[:, :2].T + [1.0, 2.0, 3.0])
    assert curve.control.shape == (80, 3)
    assert np.allclose((curve.at(FINE) - [1.0, 2.0, 3.0]) @ axes[:, 2], 0.0, atol=1e-14)
    plane = fit_closed_curve(flat)
    assert plane.area is not None
    assert curve.area == pytest.approx(plane.area, rel=1e-9)
    assert curve.length == pytest.approx(plane.length, rel=1e-9)


def test_a_curve_that_is_not_plane_has_no_area():
    turn = np.arange(60) / 60
    bent = np.column_stack([ellipse(turn), 0.3 * np.cos(4 * np.pi * turn)])
    assert fit_closed_curve(bent).area is None


def test_derivatives_are_those_of_the_curve():
    curve = fit_closed_curve(bean(np.arange(50) / 50), count=20)
    turns, step = np.random.default_rng(0).random(30), 1e-4
    for order in (1, 2):
        ahead, back = curve.at(turns + step, order - 1), curve.at(turns - step, order - 1)
        assert np.allclose((ahead - back) / (2 * step), curve.at(turns, order), rtol=0, atol=0.05)


def test_three_points_make_a_rounded_triangle():
    corners = np.array([[0, 0], [1, 0], [0, 1.0]])
    curve = fit_closed_curve(corners)
    assert hausdorff(np.vstack([curve.at(FINE), corners]), curve.at(FINE)) < 1e-3
    assert not curve.flags.degenerate


def test_two_points_are_gone_between_and_points_on_a_line_flagged():
    there_and_back = fit_closed_curve([[0.0, 0.0], [1.0, 0.0]])
    assert there_and_back.flags.degenerate
    assert np.isfinite(there_and_back.at(FINE)).all()
    assert np.allclose(there_and_back.at(FINE)[:, 1], 0.0, atol=1e-15)
    assert np.ptp(there_and_back.at(FINE)[:, 0]) == pytest.approx(1.0, abs=1e-3)
    line = np.column_stack([np.linspace(0, 1, 9), np.linspace(0, 2, 9)])
    assert fit_closed_curve(line).flags.degenerate
    assert np.isfinite(fit_closed_curve(line).control).all()


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    st.integers(5, 60),
    st.integers(0, 10**6),
    st.sampled_from([None, 8, 16]),
    st.floats(-12, 12),
    st.sampled_from([0.0, 0.02, 1.0]),
)
def test_any_points_give_a_finite_curve_near_them(
    many: int, seed: int, count: int | None, scale: float, noise: float
) -> None:
    rng = np.random.default_rng(seed)
    points = 10**scale * (bean(np.sort(rng.random(many))) + noise * rng.normal(size=(many, 2)))
    curve = fit_closed_curve(points, count=count)
    assert np.isfinite(curve.at(FINE)).all()
    assert np.isfinite([curve.condition, curve.sigma, curve.residual, curve.length]).all()
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = np.maximum(low - curve.at(FINE), curve.at(FINE) - high).max()
    assert beyond < 2 * (high - low).max()
    assert curve.closure_gap < 1e-13 * (high - low).max()


def test_what_was_asked_for_wrongly_is_refused():
    points = ellipse(np.arange(20) / 20)
    with pytest.raises(ValueError, match=r"points must have shape .*, got \(20, 4\)"):
        fit_closed_curve(np.zeros((20, 4)))
    with pytest.raises(ValueError, match="count must be at least 4, got 3"):
        fit_closed_curve(points, count=3)
    with pytest.raises(ValueError, match=r"smoothing must be 0 or more and finite, got -1\.0"):
        fit_closed_curve(points, smoothing=-1.0)
    with pytest.raises(
        ValueError, match="smoothing must be auto, gcv, a number or None, got 'some'"
    ):
        fit_closed_curve(points, smoothing="some")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"parameters must be one of auto, chord, .*, got 'x'"):
        fit_closed_curve(points, parameters="x")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="x must be finite"):
        fit_closed_curve(points).at([0.0, np.nan])
    with pytest.raises(ValueError, match="points must have at least one finite row, got 2 rows"):
        fit_closed_curve(np.full((2, 2), np.nan))
    with pytest.raises(ValueError, match="derivatives must be 0 or more, got -1"):
        fit_closed_curve(points).at(0.0, -1)


def test_the_area_of_a_huge_curve_is_no_nan():
    for scale, area in ((1e150, 1e300), (1e300, np.inf), (1e-300, 0.0)):
        found = fit_closed_curve(scale * ellipse(np.arange(60) / 60)).area
        assert found == pytest.approx(2 * np.pi * area, rel=1e-3)


def test_a_tilted_contour_far_away_is_plane_but_for_rounding():
    circle = ellipse(np.arange(60) / 60) * [0.5, 1.0]
    tilted = np.column_stack([circle, 0.3 * circle[:, 1]])
    area = fit_closed_curve(1e8 + tilted).area
    assert area == pytest.approx(np.pi * np.hypot(1.0, 0.3), rel=1e-4)


def test_any_amount_of_smoothing_leaves_a_curve():
    for amount in (1e6, 1e12, 1e300):
        curve = fit_closed_curve(ellipse(np.arange(20) / 20), smoothing=amount)
        assert np.allclose(curve.control, 0.0, rtol=0, atol=1e-3)


MANY = np.arange(20000) / 20000


def square(turn):
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0.0]])
    around = np.linspace(0, 1, 5)
    return np.column_stack([np.interp(turn, around, corners[:, axis]) for axis in (0, 1)])


def relative_hausdorff(found, wanted):
    far = max(cKDTree(found).query(wanted)[0].max(), cKDTree(wanted).query(found)[0].max())
    return float(far / np.ptp(wanted, axis=0).max())


@pytest.mark.parametrize("many", [1, 40])
def test_points_in_one_place_give_that_place_and_are_flagged(many):
    curve = fit_closed_curve(np.tile([0.1, -0.2], (many, 1)))
    assert curve.flags.degenerate
    assert np.array_equal(curve.at([0.0, 0.3]), [[0.1, -0.2], [0.1, -0.2]])
    assert curve.area == curve.length == curve.closure_gap == 0.0
    barely = 1e3 + 1e-13 * np.random.default_rng(0).random((40, 2))
    assert fit_closed_curve(barely).flags.degenerate


@pytest.mark.parametrize("count", [None, 16])
def test_duplicates_an_open_end_and_a_closed_one_give_one_curve(count):
    open_end = bean(np.arange(60) / 60)
    closed = np.vstack([open_end, open_end[:1]])
    doubled = np.repeat(closed, 3, axis=0)
    wanted = fit_closed_curve(open_end, count=count)
    for points in (closed, doubled):
        found = fit_closed_curve(points, count=count)
        assert np.array_equal(found.control, wanted.control)
        assert np.array_equal(points[found.used], open_end[wanted.used])


def test_as_many_control_points_as_points_do_no_harm():
    # With even knots and no bending the error is 3000 times the noise.
    noise = 0.026 * np.random.default_rng(0).normal(size=(80, 2))
    curve = fit_closed_curve(bean(np.arange(80) / 80) + noise, count=80, smoothing=None)
    away = cKDTree(bean(MANY)).query(curve.at(FINE))[0]
    assert np.sqrt(np.mean(away**2)) < 1.5 * 0.026
    assert curve.condition < 1e3


@pytest.mark.parametrize("shape", [ellipse, bean])
@pytest.mark.parametrize("count", [None, 16, 40])
def test_most_points_in_a_twentieth_of_the_curve_leave_the_rest_right(shape, count):
    rng = np.random.default_rng(0)
    turns = np.sort(np.concatenate([rng.uniform(0, 0.05, 60), rng.uniform(0.05, 1, 20)]))
    curve = fit_closed_curve(shape(turns), count=count)
    assert curve.flags.uneven
    assert relative_hausdorff(curve.at(FINE), shape(MANY)) < 0.05


@pytest.mark.parametrize("count", [None, 40])
def test_the_corners_of_a_square_are_kept_without_overshoot(count):
    curve = fit_closed_curve(square(np.arange(80) / 80), count=count)
    places = curve.at(FINE)
    assert relative_hausdorff(places, square(MANY)) < 0.008
    assert places.min() > -0.05
    assert places.max() < 1.05


@pytest.mark.parametrize("count", [None, 16])
@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 1e3), (1e8, 0.0), (1e-12, 0.0), (1e150, 0.0)])
def test_a_tiny_ring_far_away_and_a_huge_one_are_as_good_as_any(scale, offset, count):
    # Summed about the origin the area of the first is 12.0 instead of 3.14.
    ring = bean(np.arange(80) / 80)
    usual = fit_closed_curve(ring, count=count)
    curve = fit_closed_curve(offset + scale * ring, count=count)
    rounded = 1e-3 if offset else 1e-12
    assert usual.area is not None
    assert curve.area is not None
    assert curve.area / scale / scale == pytest.approx(usual.area, rel=rounded)
    assert curve.length / scale == pytest.approx(usual.length, rel=rounded)
    assert relative_hausdorff((curve.at(FINE) - offset) / scale, usual.at(FINE)) < 2 * rounded
    middle = (area_centroid(offset + scale * ring) - offset) / scale
    assert np.allclose(middle, area_centroid(ring), rtol=0, atol=rounded)


def test_a_figure_of_eight_and_a_curve_that_touches_itself_are_flagged():
    # The area of the first is next to 0.
    angle = 2 * np.pi * np.arange(80) / 80
    eight = fit_closed_curve(np.column_stack([np.sin(angle), np.sin(2 * angle)]))
    assert eight.flags.self_intersecting
    assert not eight.flags.degenerate
    assert eight.area == pytest.approx(0.0, abs=1e-3)
    limacon = (1.0 + 1.3 * np.cos(angle))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    assert fit_closed_curve(limacon).flags.self_intersecting
    right = np.column_stack([1 - np.cos(angle), np.sin(angle)])
    touching = fit_closed_curve(np.vstack([right, -right[::-1]]))  # round 0 both times as far
    assert touching.flags.self_intersecting
    assert not fit_closed_curve(bean(np.arange(80) / 80)).flags.self_intersecting


def test_rows_that_are_not_finite_are_dropped_and_counted():
    points = bean(np.arange(60) / 60)
    holed = np.insert(points, [3, 30, 60], [[np.nan, 0.0], [np.inf, 1.0], [0.0, -np.inf]], axis=0)
    curve = fit_closed_curve(holed)
    assert curve.dropped == 3
    assert np.array_equal(curve.control, fit_closed_curve(points).control)
    assert np.isfinite(holed[curve.used]).all()


@pytest.mark.parametrize("count", [None, 16])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("space", [False, True])
def test_neither_the_beginning_nor_the_direction_changes_the_curve(count, noise, space):
    points = bean(np.arange(60) / 60)
    points += noise * np.random.default_rng(0).normal(size=points.shape)
    if space:
        points = np.column_stack([points, np.full(60, 0.4)])
    wanted = fit_closed_curve(points, count=count)
    for shift in (1, 17, 59):
        for way in (1, -1):
            turned = np.roll(points, shift, axis=0)[::way]
            found = fit_closed_curve(turned, count=count)
            assert np.array_equal(found.control, wanted.control)
            assert np.array_equal(found.knots, wanted.knots)
            assert np.array_equal(turned[found.used], points[wanted.used])
    places = wanted.at(FINE)[:, :2]
    following = np.roll(places, -1, axis=0)
    assert (places[:, 0] * following[:, 1] - places[:, 1] * following[:, 0]).sum() > 0.0
