"""Errata on closed contours, layers and correspondence (chapter 4) and on the programs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.planners import Observation, first_and_last
from palpate.core.geometry import (
    area_centroid,
    azimuth_match,
    edge_distance,
    inscribed_circle,
    turn_between,
    winding_number,
)
from palpate.core.splines import PeriodicBasis, clamped_basis, curve_parameters, fit_closed_curve
from palpate.core.splines.curve_fits import moved_parameters
from palpate.core.thesis import fit_closed_curve_thesis, rebuild_thesis
from palpate.core.thesis.layers import rectangle_scale

ORDER, COUNT, TOTAL = 4, 16, 19
SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
MIDDLE = np.zeros((1, 2))


def circle(turns: Floats | int) -> Floats:
    """Points of the unit circle at these turns, or evenly spaced by their count."""
    angle = 2 * np.pi * (np.arange(turns) / turns if isinstance(turns, int) else turns)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def test_the_closing_chord_is_lost_if_the_first_point_is_not_repeated():
    points = circle(10)
    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.cumsum(chords)[-1] / chords.sum() == pytest.approx(1.0)  # where the first one is
    assert curve_parameters(points, "chord")[-1] == pytest.approx(0.9)


def test_pseudo_vertices_and_continuity_put_three_vertices_in_one_place():
    pseudo = np.eye(3, TOTAL) - np.eye(3, TOTAL, COUNT)  # (4.31): the first three come again
    basis, ends = clamped_basis(TOTAL), np.array([0.0, 1.0])
    rows = [basis.matrix(ends, order).toarray() for order in range(3)]
    closing = np.array([row[0] - row[1] for row in rows])  # position, (4.32) and (4.33)
    for demands, together in (
        (np.vstack([pseudo, closing]), True),
        (pseudo, False),
        (closing, False),
    ):
        _, sizes, right = np.linalg.svd(demands)
        left = right[(sizes > 1e-10).sum() :]  # vertices that all demands let be
        apart = np.abs(left[:, :1] - left[:, 1:3]).max(axis=0)
        assert len(left) > 0 and (apart.max() < 1e-14 if together else apart[0] > 0.1)


def test_the_fitted_curve_never_closes():
    points = circle(np.arange(81) / 80) * [2.0, 1.0]
    printed, ours = fit_closed_curve_thesis(points, COUNT), fit_closed_curve(points, count=COUNT)
    assert printed.closure_gap > 0.05 * np.ptp(points)
    assert ours.closure_gap < 1e-15 * np.ptp(points)
    assert printed.condition > 500 * ours.condition


def test_the_vertices_are_as_many_as_the_columns():
    system = np.zeros((81 + ORDER + 1, TOTAL))  # N-hat of (4.37)
    with pytest.raises(ValueError, match="mismatch"):  # with the zeros that (4.35) puts below
        system @ np.zeros((TOTAL + ORDER + 1, 2))
    assert (system @ np.zeros((TOTAL, 2))).shape == (81 + ORDER + 1, 2)


def test_a_full_step_of_the_parameters_can_swap_points():
    # (4.40), beside a curve that is bent more than the points are apart.
    parameters, places = np.array([0.0, 0.02, 0.5]), circle(3)
    slopes = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    points = places + [[0.0, 0.03], [0.0, -0.03], [0.0, 0.0]]
    printed = parameters + ((points - places) * slopes).sum(axis=1) / (slopes**2).sum(axis=1)
    assert printed[0] > printed[1]
    assert (np.diff(moved_parameters(parameters, points, places, slopes)) > 0.0).all()


def test_contours_taken_for_control_layers_shrink_the_solid():
    basis = clamped_basis(27)
    # Contours at even heights, and at those where a control layer counts most.
    for places, shrunk in ((np.linspace(0, 1, 27), 0.0233), (basis.greville(), 0.0051)):
        height, system = 2 * places - 1, basis.matrix(places).toarray()
        layers = np.sqrt(1.04 - height**2) * (0.75 + 0.18 * np.sin(9 * height))
        off = (system @ layers - layers) / 2.0  # over the solid's height
        assert np.sqrt((off**2).mean()) == pytest.approx(shrunk, abs=1e-4)
        assert np.allclose(system @ np.linalg.solve(system, layers), layers, rtol=0, atol=1e-12)


def test_a_round_polygon_read_with_clamped_knots_is_not_round():
    fitted, turns = fit_closed_curve(circle(80), count=COUNT).control, np.arange(800) / 800
    round_ = np.linalg.norm(PeriodicBasis(COUNT).matrix(turns) @ fitted, axis=1)
    assert np.abs(round_ - 1.0).max() < 3e-4
    # A layer of 5 by 5 has 5 of the vertices on each of its sides.
    radius = np.linalg.norm(clamped_basis(5).matrix(turns) @ fitted[:5], axis=1)
    assert radius.max() > 1.015 and radius.min() < 0.99


def test_the_search_for_the_largest_ellipse_is_not_needed():
    # Table 4.2 tests two ellipses a step; the predicate is monotone, so that one would do.
    tolerance, golden, low, high, tests = 1e-3, 0.6180339887, 1e-3, 1.0, 0
    while high - low > tolerance:
        first, second = high - golden * (high - low), low + golden * (high - low)
        low, high = (
            (low, first) if first > 0.37 else (first, second) if second > 0.37 else (second, high)
        )
        tests += 2
    assert tests > math.ceil(math.log2((1.0 - tolerance) / tolerance)) == 10
    assert edge_distance(SQUARE * [0.37, 1.0], MIDDLE) == pytest.approx(0.37)


def test_the_box_around_an_ellipse_that_fits_does_not_fit():
    polygon = circle(96)
    around = edge_distance(polygon, MIDDLE)[0]
    fitting = rectangle_scale(polygon, np.zeros(2), np.ones(2))
    assert around == pytest.approx(np.sqrt(2.0) * fitting, rel=2e-3)
    assert (winding_number(polygon, around * SQUARE) == 0).all()
    assert (winding_number(polygon, 0.999 * fitting * SQUARE) != 0).all()


def test_the_programs_lattice_knows_nothing_of_the_correspondence():
    ring = circle(np.arange(25) / 24) * [2.0, 1.0]
    contours = [np.column_stack([(2 + z) * ring, np.full(25, z)]) for z in np.linspace(-1, 1, 7)]
    box, ball = (rebuild_thesis(contours, exponents=(e, e), faithful=True) for e in (0.15, 1.0))
    assert np.abs(box.parameters - ball.parameters).max() > 0.05
    assert (box.lattice.control == ball.lattice.control).all()


def test_a_ray_from_the_middle_does_not_always_meet_a_contour_once():
    arc = circle(np.linspace(-2.2, 2.2, 400) / (2 * np.pi))
    contour = np.vstack([arc, 0.7 * arc[::-1]])  # a C, with its middle outside
    azimuths = np.linspace(0, 2 * np.pi, 50, endpoint=False) + 0.01
    ahead = circle(azimuths / (2 * np.pi)) @ contour.T > 0.0
    rays = np.column_stack([-np.sin(azimuths), np.cos(azimuths)]) @ contour.T
    meetings = ((np.roll(rays, -1, axis=1) >= 0.0) != (rays >= 0.0)) & ahead
    match = azimuth_match(contour, np.zeros(2), azimuths)
    assert set(meetings.sum(axis=1)) == {0, 2}
    assert not match.inside and np.isfinite(match.points).all()


def ellipse_scale(polygon: Floats, middle: Floats, semi_axes: Floats) -> float:
    """Of the largest ellipse of that shape: in its own plane the distance from the edges."""
    around = (polygon - middle) / semi_axes
    return float(edge_distance(around, MIDDLE)[0]) if winding_number(around, MIDDLE)[0] else 0.0


def line_meets(line: Floats, p: float, q: float) -> bool:
    """isint.m, with the ellipse at the origin."""
    a, b, c = line
    if a == 0:
        return bool(q >= abs(-c / b))
    if b == 0:
        return bool(p >= abs(-c / a))
    return bool(q * q * b * b + p * p * a * a >= c * c)


def lines_of(polygon: Floats) -> Floats:
    """The right lines (dy, -dx, c) of its edges."""
    (x, y), (dx, dy) = polygon.T, (np.roll(polygon, -1, axis=0) - polygon).T
    return np.column_stack([dy, -dx, dx * y - dy * x])


def largest_free(polygon: Floats) -> float:
    lines, scales = lines_of(polygon), np.linspace(0, 1, 2001)
    return float(max(s for s in scales if not any(line_meets(one, s, s) for one in lines)))


def test_the_search_moves_on_from_places_that_it_has_not_tested():
    fib = [1.0, 1.0]
    while len(fib) < 50:
        fib.append(fib[-1] + fib[-2])

    def printed(limit: float) -> float:
        a, b, count = 1e-3, 1.0, 1
        while abs(b - a) > 1e-3 and count < 48:
            first, second = a > limit, b > limit  # tested at a and b
            a1 = a + fib[50 - count - 2] / fib[50 - count] * (b - a)
            b1 = a + fib[50 - count - 1] / fib[50 - count] * (b - a)
            if first and second:
                b = a1
            elif second:
                a, b = a1, b1  # moved to a1 and b1
            elif not first:
                a = b1
            count += 1
        return 0.5 * (a + b)

    limits = np.linspace(0.05, 0.95, 19)
    assert max(abs(printed(x) - x) for x in limits) > 0.3
    scales = [ellipse_scale(SQUARE * [x, 1.0], np.zeros(2), np.ones(2)) for x in limits]
    assert scales == pytest.approx(limits)


def test_all_edges_are_tested_and_not_as_many_as_the_grid_is_wide():
    # 16 vertices around a layer of 5 by 5
    polygon = np.where(np.arange(16) == 10, 0.3, 1.0)[:, None] * circle(16)
    blocked = [line_meets(line, 0.5, 0.5) for line in lines_of(polygon)]
    assert any(blocked) and not any(blocked[:5])
    assert ellipse_scale(polygon, np.zeros(2), np.full(2, 0.5)) == pytest.approx(0.6)


def test_the_comment_on_the_conic_has_its_axes_swapped():
    # Semi-axes 2 along x and 1 along y; the line y = 1.5 passes above. By the comment,
    # p^2 x^2 + q^2 y^2 = (pq)^2, the ellipse reaches y = 2.
    assert not line_meets(np.array([0.0, 1.0, -1.5]), 2.0, 1.0)
    box = np.array([[-3, -1.5], [3, -1.5], [3, 1.5], [-3, 1.5]])
    assert ellipse_scale(box, np.zeros(2), np.array([2.0, 1.0])) == 1.5


def test_lines_beyond_the_edges_cut_an_ellipse_that_the_edges_do_not():
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    polygon = (1 + 0.45 * np.cos(3 * turn))[:, None] * circle(16)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, axes = 0.5 * (low + high), 0.5 * (high - low)
    assert largest_free((polygon - middle) / axes) == pytest.approx(0.168, abs=1e-3)
    assert ellipse_scale(polygon, middle, axes) == pytest.approx(0.399, abs=1e-3)


def test_the_middle_of_the_box_may_lie_outside_the_polygon():
    inner = [[0.8, 1], [0.8, -0.8], [-0.8, -0.8], [-0.8, 1.0]]
    u_shape = np.array([[-1, 1], [-1, -1], [1, -1], [1, 1], *inner])
    circle_ = inscribed_circle(u_shape)
    assert winding_number(u_shape, MIDDLE)[0] == 0
    assert largest_free(u_shape) == pytest.approx(0.8, abs=0.005)
    assert ellipse_scale(u_shape, np.zeros(2), np.ones(2)) == 0.0
    assert winding_number(u_shape, circle_.middle[None])[0] == 1 and circle_.radius > 0.1


def test_an_angle_needs_no_matrix():
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.inv(np.zeros((2, 2)))  # phasediff.m, with a vertex in the middle
    first, second = np.random.default_rng(0).normal(size=(2, 50, 2))
    blocks = np.array([[[x, -y], [y, x]] for x, y in first])
    solved = np.linalg.solve(blocks, second[..., None])[..., 0]
    printed = np.arctan2(solved[:, 1], solved[:, 0])
    assert np.allclose(turn_between(first, second), printed, rtol=0, atol=1e-12)
    assert np.isfinite(turn_between(np.zeros(2), second)).all()


def heights(exponent: float) -> Floats:
    """Along a curve of the model at eta = 45 degrees, by (2.4)."""
    omega, half = np.linspace(-np.pi, np.pi, 81), math.sqrt(0.5)
    x, y = np.abs(half * np.cos(omega)), np.abs(half * np.sin(omega))
    level = x ** (2 / exponent) + y ** (2 / exponent)
    return (level + half ** (2 / exponent)) ** (-exponent / 2) * half


def untouched(top: float) -> float:
    """Share of the height above the last slice, of an object that is so high in some unit."""
    share = 2e-3 * top
    known = Observation(low=0.0, high=top, tolerance=share, resolution=share, feature=share)
    return float(1.0 - first_and_last(known)[1] / top)


VERTEX, CLOSED = np.array([-0.5, 0.1]), [circle(np.arange(n) / (n - 1)) for n in (81, 41)]
DENSE = circle(np.concatenate([np.linspace(0, 0.25, 60, False), np.linspace(0.25, 1, 20, False)]))
EDGE = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])  # the first edge lies on x + y = 1
FIGURES = {
    # computed, stated, and the largest difference
    "test_the_sum_of_squares_is_compared_with_a_length": [
        # (4.39) at two scales, against the tolerance: a share of the diameter
        ([(0.05 * s) ** 2 < 0.02 * s for s in (1e-3, 1e3)], [True, False], 0.0),
        ([0.05 * s < 0.02 * s for s in (1e-3, 1e3)], [False, False], 0.0),
    ],
    "test_the_mean_of_a_closed_contour_counts_its_first_point_twice": [
        ([np.linalg.norm(one.mean(axis=0)) for one in CLOSED], [0.0123, 0.0244], 1e-4),
        ([np.linalg.norm(area_centroid(one)) for one in CLOSED], [0.0, 0.0], 1e-15),
    ],
    "test_the_mean_of_uneven_points_lies_where_they_are_dense": [
        (np.linalg.norm(DENSE.mean(axis=0)), 0.6, 0.05),
        (np.linalg.norm(area_centroid(DENSE)), 0.0, 0.01),
    ],
    "test_the_normal_of_an_edge_has_a_minus": [
        (lines_of(EDGE)[0] @ [0.5, 0.5, 1.0], 0.0, 1e-15),
        (lines_of(EDGE)[0] * [1, -1, 1] @ [0.0, 1.0, 1.0], -2.0, 1e-15),  # as buildgrid.m has it
    ],
    "test_a_quadrant_is_taken_about_the_middle_and_not_about_the_origin": [
        # one contour, and the same felt 500 mm further on; then about its middle
        ([abs(math.atan2(y, x)) > 1.5708 for x, y in (VERTEX, VERTEX + 500)], [True, False], 0.0),
        (abs(turn_between(np.array([1.0, 0.0]), VERTEX)) > 1.5708, True, 0.0),
    ],
    "test_the_models_contours_leave_out_its_ends": [
        (np.sin(np.arctan2(np.linspace(-1, 1, 27), 1.0)).max(), 0.7071, 1e-4)  # on a unit ball
    ],
    "test_the_program_takes_a_box_for_every_object": [
        (np.ptp(heights(0.15)) > 0.03, True, 0.0),  # no plane curve, yet paired with one
        (np.ptp(heights(1.0)), 0.0, 1e-15),
    ],
    "test_the_caps_depend_on_the_unit_of_length": [
        # Half of 0.02 beyond the last contour, of one object 100 mm high in mm and in m.
        (0.01 / np.array([100.0, 0.1]), [1e-4, 0.1], 1e-12),
        # Slices at 3 and 97 % of the height leave 3 % of it, in either unit.
        ([untouched(100.0), untouched(0.1)], [0.03, 0.03], 1e-9),
    ],
}


@pytest.mark.parametrize("name", FIGURES)
def test_figures(name):
    for computed, stated, tolerance in FIGURES[name]:
        assert computed == pytest.approx(stated, abs=tolerance, rel=0.0)
