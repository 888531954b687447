from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline

from palpate.core.splines.bases import PeriodicBasis
from palpate.core.splines.closed_curves import (
    area_vector,
    fit_closed_curve,
    local_noise,
    order_closed_points,
)
from palpate.core.splines.curve_fits import (
    STRENGTHS,
    _bending,
    choose_smoothing,
    closed_curve_points,
    curve_parameters,
    demmler_reinsch,
    gap_ratio,
    interpolate_closed,
    moved_parameters,
)

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])


def circle(count):
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def test_the_closing_chord_is_counted():
    assert curve_parameters(SQUARE, "chord").tolist() == [0.0, 0.25, 0.5, 0.75]


def test_square_roots_are_taken_only_where_there_are_corners():
    uneven = np.array([[0, 0], [0.5, 0], [0.9, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1.0]])
    edges = np.concatenate(
        [
            np.linspace(a, b, 9, endpoint=False)
            for a, b in zip(SQUARE, np.roll(SQUARE, -1, axis=0), strict=True)
        ]
    )
    edges[1] = [0.02, 0.0]
    kinds = ("auto", "chord", "centripetal")
    for points, same in ((edges, "centripetal"), (uneven, "chord"), (circle(30) * [1, 3], "chord")):
        auto, chord, centripetal = (curve_parameters(points, kind) for kind in kinds)
        assert np.array_equal(auto, chord if same == "chord" else centripetal)
        assert not np.allclose(chord, centripetal, atol=1e-3)


def test_points_at_even_lengths_are_even_though_chords_across_corners_are_short():
    closed = np.vstack([SQUARE, SQUARE[:1]])
    at = (np.arange(26) + 0.3) / 26
    points = np.column_stack([np.interp(at, np.linspace(0, 1, 5), one) for one in closed.T])
    even = np.arange(26) / 26
    assert np.array_equal(curve_parameters(points, "even"), even)
    assert np.abs(curve_parameters(points, "chord") - even).max() > 0.005
    noisy = points + 0.01 * np.random.default_rng(0).normal(size=points.shape)
    assert np.array_equal(curve_parameters(noisy, "even"), even)


def test_points_at_uneven_lengths_take_their_chords():
    for points in (circle(30) * [1, 3], np.delete(circle(30), [4, 5], axis=0), SQUARE * [1, 3]):
        even, chord, auto = (curve_parameters(points, kind) for kind in ("even", "chord", "auto"))
        assert np.array_equal(even, auto)
        assert not np.allclose(even, np.arange(len(points)) / len(points), atol=1e-3)
        assert np.array_equal(chord, auto) or len(points) == 4


def test_the_gap_ratio_is_that_of_the_chords():
    assert gap_ratio(np.array([[0, 0], [1, 0], [1, 0.1], [0, 0.1]])) == pytest.approx(10.0)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(4, 40), st.integers(0, 10**6), st.floats(0.0, 100.0))
def test_moved_parameters_keep_their_order_however_far_the_points_lie(
    count: int, seed: int, far: float
) -> None:
    rng = np.random.default_rng(seed)
    parameters = np.sort(rng.random(count))
    if (np.diff(parameters) == 0.0).any():
        return
    points, places, slopes = far * rng.normal(size=(3, count, 2))
    moved = moved_parameters(parameters, points, places, slopes)
    assert (np.diff(moved, append=moved[0] + 1.0) > 0.0).all()


def test_a_small_move_is_that_to_the_nearest_place():
    parameters = np.arange(8) / 8
    places, slopes = circle(8), 2 * np.pi * np.roll(circle(8) @ [[0, 1], [-1, 0]], 0, axis=0)
    moved = moved_parameters(parameters, places + 1e-3 * slopes, places, slopes)
    assert np.allclose(moved, parameters + 1e-3)


def test_where_the_curve_stands_still_parameters_stay():
    parameters = np.arange(4) / 4
    still = moved_parameters(parameters, SQUARE + 1.0, SQUARE, np.zeros((4, 2)))
    assert np.array_equal(still, parameters)


def test_noise_between_neighbours_is_measured():
    turn = np.arange(400) / 400
    clean = circle(400)
    assert local_noise(clean, turn) == 0.0
    for sigma in (1e-6, 1e-3, 0.02):
        across = clean * sigma * np.random.default_rng(0).normal(size=(400, 1))
        assert local_noise(clean + across, turn) == pytest.approx(sigma, rel=0.15)


def test_corners_are_not_noise():
    turn = np.arange(80) / 80
    around = np.vstack([SQUARE, SQUARE[:1]])
    points = np.column_stack(
        [np.interp(turn, np.linspace(0, 1, 5), around[:, axis]) for axis in (0, 1)]
    )
    assert local_noise(points, turn) < 1e-12


def test_too_few_points_show_no_noise():
    assert local_noise(np.random.default_rng(0).normal(size=(7, 2)), np.arange(7) / 7) == 0.0


@pytest.mark.parametrize("count", [3, 4, 5, 40])
def test_the_interpolating_spline_passes_its_points_at_any_parameters(count):
    rng = np.random.default_rng(count)
    parameters = np.concatenate([[0.0], np.sort(rng.uniform(0.01, 0.99, count - 1))])
    points = rng.normal(size=(count, 2))
    fit = interpolate_closed(points, parameters)
    assert np.allclose(closed_curve_points(fit.control, fit.knots, parameters), points, atol=1e-11)
    for order in range(3):
        first, last = closed_curve_points(fit.control, fit.knots, np.array([0.0, 1.0]), order)
        assert np.allclose(first, last, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [3, 4, 40])
def test_it_is_the_closed_cubic_spline_of_scipy(count):
    rng = np.random.default_rng(count)
    parameters = np.concatenate([[0.0], np.sort(rng.uniform(0.01, 0.99, count - 1))])
    points = rng.normal(size=(count, 2))
    fit, places = interpolate_closed(points, parameters), np.linspace(0.0, 1.0, 101)
    wound = np.append(parameters, 1.0), np.vstack([points, points[:1]])
    theirs = CubicSpline(*wound, bc_type="periodic")(places)
    ours = closed_curve_points(fit.control, fit.knots, places)
    np.testing.assert_allclose(ours, theirs, atol=1e-12 * np.abs(theirs).max())


def test_the_condition_of_even_interpolation_is_3():
    fit = interpolate_closed(circle(40), np.arange(40) / 40)
    assert fit.condition == pytest.approx(3.0, abs=1e-9)


def test_smoothing_of_pure_noise_is_strong_and_of_a_clean_curve_weak():
    rng = np.random.default_rng(0)
    basis = np.repeat(np.eye(20), 4, axis=0)
    second = np.roll(np.eye(20), 1, axis=1) - 2 * np.eye(20) + np.roll(np.eye(20), -1, axis=1)
    bending = second.T @ second / 6
    noise = rng.normal(size=(80, 1))
    wave = np.repeat(np.sin(6 * np.pi * np.arange(20) / 20), 4)[:, None]
    assert choose_smoothing(basis, bending, noise) > 10.0
    assert choose_smoothing(basis, bending, wave + 1e-6 * noise) == STRENGTHS[0]


def test_smoothing_is_chosen_where_control_points_see_no_point():
    basis = np.eye(6, 12)
    second = np.roll(np.eye(12), 1, axis=1) - 2 * np.eye(12) + np.roll(np.eye(12), -1, axis=1)
    chosen = choose_smoothing(basis, second.T @ second / 6, np.arange(6.0)[:, None])
    assert STRENGTHS[0] <= chosen <= STRENGTHS[-1]


def test_the_ring_is_the_same_wherever_two_points_tie():
    twice = np.array([[1, 0], [0, 1], [-1, 0], [1, 0], [0, -1], [-1, -1.0]])
    wanted = order_closed_points(twice).points
    for shift in range(6):
        for way in (1, -1):
            assert np.array_equal(
                order_closed_points(np.roll(twice, shift, axis=0)[::way]).points, wanted
            )


def test_the_ring_remembers_which_points_it_is_made_of():
    points = np.array([[0, 0], [np.nan, 0], [2, 0], [2, 0], [2, 1], [0, 1], [0, 0.0]])
    ring = order_closed_points(points)
    assert ring.dropped == 1
    assert len(ring.rows) == 4
    assert np.allclose(ring.middle + ring.size * ring.points, points[ring.rows])
    assert area_vector(ring.points)[0] > 0.0


def test_a_ring_that_comes_back_to_its_first_point_begins_at_one_place():
    spokes = np.array([[0, 0], [3, 1], [0, 2], [3, 1], [1, -1], [3, 1], [0, 0], [3, 1.0]])
    for points in (spokes, np.tile(spokes[:2], (500, 1))):
        wanted = order_closed_points(points).points
        for shift in (1, 2, 5, 7):
            for way in (1, -1):
                found = order_closed_points(np.roll(points, shift, axis=0)[::way])
                assert np.array_equal(found.points, wanted)


def test_points_that_spread_too_far_are_refused():
    with pytest.raises(ValueError, match=r"points must spread less than 1\.79769e\+308 m"):
        order_closed_points(1e308 * SQUARE - 1e308 * (1.0 - SQUARE))


@pytest.mark.parametrize("side", [2, 3, 4, 6])
def test_the_corners_of_a_square_of_few_points_are_not_taken_for_noise(side):
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    sides = [
        np.linspace(corner, following, side, endpoint=False)
        for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    curve = fit_closed_curve(np.concatenate(sides))
    assert curve.smoothing == 0.0
    assert curve.residual < 1e-15


def system(points, count):
    basis = PeriodicBasis(count).matrix(points).toarray()
    second = np.roll(np.eye(count), 1, 1) - 2 * np.eye(count) + np.roll(np.eye(count), -1, 1)
    weight = basis.T @ basis
    return weight / np.trace(weight) * count, second.T @ second / 6.0, basis


def test_keeping_each_mode_in_part_solves_the_penalised_system():
    rng = np.random.default_rng(0)
    points, values = rng.random(60), rng.normal(size=60)
    weight, bending, basis = system(points, 12)
    modes = demmler_reinsch(weight, bending, basis)
    scale = np.trace(basis.T @ basis) / 12
    for strength in (1e-8, 0.1, 1e3):
        wanted = np.linalg.solve(weight + strength * bending, basis.T @ values / scale)
        kept = modes.kept(np.array([strength]))[0]
        found = modes.control @ (kept * (modes.shapes.T @ values))
        assert np.allclose(found, wanted, rtol=1e-9, atol=1e-11 * np.abs(wanted).max())


def test_shapes_are_the_basis_times_their_coefficients_and_orthonormal():
    weight, bending, basis = system(np.random.default_rng(1).random(50), 10)
    modes = demmler_reinsch(weight, bending, basis)
    assert np.allclose(modes.shapes, basis @ modes.control, atol=1e-12)
    assert np.allclose(modes.shapes.T @ modes.shapes, np.eye(10), atol=1e-9)
    assert np.count_nonzero(modes.stiffness < 1e-12) == 1


def test_what_no_point_sees_drops_out():
    weight, bending, basis = system(np.linspace(0.0, 0.3, 40), 16)
    modes = demmler_reinsch(weight, bending, basis)
    assert modes.shapes.shape[1] < 16
    assert np.isfinite(modes.control).all()


def test_what_is_lost_is_exact_however_little_it_is():
    weight, bending, basis = system(np.arange(40) / 40, 10)
    modes = demmler_reinsch(weight, bending, basis)
    weak = np.array([1e-30])
    assert np.allclose(modes.lost(weak)[0], 1e-30 * modes.stiffness, rtol=1e-12)
    assert np.allclose(modes.kept(weak) + modes.lost(weak), 1.0)


def test_bending_is_the_sum_of_squared_second_differences_over_its_mean_diagonal():
    form, values = _bending(9), np.random.default_rng(0).normal(size=9)
    second = np.roll(values, 1) - 2.0 * values + np.roll(values, -1)
    assert values @ form @ values == pytest.approx(second @ second / 6.0)
    assert np.trace(form) == pytest.approx(9.0)
