from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.geometry.polygons import edge_distance, signed_area, turn_between, winding_number
from palpate.core.splines.bases import clamped_basis
from palpate.core.splines.curve_fits import closed_curve_points
from palpate.core.splines.inversion import invert_points
from palpate.core.splines.lattices import LatticeLayer, layered_lattice
from palpate.core.splines.spline_volumes import Parallelepiped, SplineVolume
from palpate.core.thesis.layers import (
    fit_closed_curve_thesis,
    fit_closed_thesis,
    invert_thesis,
    make_layer,
    make_program_layer,
    nearest_phase,
    rectangle_scale,
    rim_cells,
    searched_scale,
)
from palpate.core.thesis.rebuilding import match_contour, ray_azimuths

Figure = Callable[[str, int], Floats]


def rim_of(control):
    cells = rim_cells((control.shape[0], control.shape[1]))
    return np.asarray(control[cells[:, 0], cells[:, 1]])


def core_of(control):
    return np.asarray(control[1:-1, 1:-1].reshape(-1, 2))


def circle(count):
    turn = ray_azimuths(count)
    return np.column_stack([np.cos(turn), np.sin(turn)])


def test_the_rim_runs_counter_clockwise_from_the_north_west():
    cells = rim_cells((4, 5))
    assert cells[0].tolist() == [0, 4]
    assert len(np.unique(cells, axis=0)) == len(cells) == 2 * (4 + 5) - 4
    assert np.abs(np.diff(cells, axis=0, append=cells[:1])).sum(axis=1).tolist() == [1] * 14
    assert signed_area(cells.astype(float)) > 0.0


def test_the_vertex_nearest_in_phase_is_found_across_the_seam():
    turn = np.radians([178.0, -176.0, 90.0, 0.0])
    polygon = np.column_stack([np.cos(turn), np.sin(turn)]) + 5.0
    assert nearest_phase(polygon, np.array([5.0, 5.0]), np.array([4.0, 5.01])) == 0
    assert nearest_phase(polygon, np.array([5.0, 5.0]), np.array([4.0, 4.9])) == 1


def test_a_layer_of_a_circle_is_upright_and_not_mirrored():
    layer = make_layer(circle(80), (5, 5))
    rim = rim_of(layer.control)
    assert np.abs(np.linalg.norm(rim, axis=1) - 1.0).max() < 0.06
    assert signed_area(rim) > 0.0
    assert (np.diff(layer.control[1:-1, 1:-1, 0], axis=0) > 0.0).all()
    assert (np.diff(layer.control[1:-1, 1:-1, 1], axis=1) > 0.0).all()
    corner = layer.control[0, -1]
    assert np.arctan2(corner[1], corner[0]) == pytest.approx(0.75 * np.pi, abs=np.pi / 16)
    assert layer.gap == 0.0
    assert not layer.moved


@pytest.mark.parametrize("sides", [(4, 4), (5, 5), (4, 7), (9, 5)])
@pytest.mark.parametrize("name", ["lobes", "u", "c"])
def test_the_core_lies_inside_the_shell(name, sides, figure):
    points = match_contour(figure(name, 120), ray_azimuths(120)).points
    layer = make_layer(points, sides)
    assert layer.control.shape == (*sides, 2)
    assert 0.0 < layer.core_scale < 1.0
    assert (winding_number(rim_of(layer.control), core_of(layer.control)) == 1).all()


def test_row_45_the_core_of_a_u_is_in_the_middle_of_its_largest_circle(figure):
    points = match_contour(figure("u", 120), ray_azimuths(120)).points
    layer = make_layer(points, (7, 7))
    rim = rim_of(layer.control)
    box = 0.5 * (rim.min(axis=0) + rim.max(axis=0))
    assert winding_number(rim, box[None])[0] == 0
    assert layer.moved
    assert (winding_number(rim, core_of(layer.control)) == 1).all()


def test_row_71_a_core_is_bounded_by_edges_and_not_by_the_lines_they_lie_on(figure):
    turn = 2 * np.pi * np.arange(16) / 16
    polygon = (1 + 0.45 * np.cos(3 * turn))[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    along = np.roll(polygon, -1, axis=0) - polygon
    normals = np.column_stack([along[:, 1], -along[:, 0]])
    by_lines = np.abs(np.einsum("nd,nd->n", normals, polygon - middle)) / np.linalg.norm(
        normals * half, axis=1
    )
    assert by_lines.min() == pytest.approx(0.168, abs=1e-3)
    # A layer around the same figure has room accordingly.
    layer = make_layer(match_contour(figure("lobes", 96), ray_azimuths(96)).points, (5, 5))
    assert layer.core_scale > 1.5 * by_lines.min()
    assert not layer.moved


@pytest.mark.parametrize(
    "points",
    [
        np.tile([0.2, 0.4], (12, 1)),
        np.column_stack([np.cos(ray_azimuths(12)), np.full(12, 0.3)]),
        np.cos(ray_azimuths(12))[:, None] * [0.5, 0.8],
    ],
    ids=["point", "level", "slanted"],
)
def test_a_contour_that_encloses_nothing_has_a_core_in_one_place(points):
    layer = make_layer(points, (5, 5))
    assert np.isfinite(layer.control).all()
    assert layer.core_scale < 1e-9
    assert np.ptp(core_of(layer.control), axis=0).max() < 1e-9


SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
DIAMOND = np.array([[1, 0], [0, 1], [-1, 0], [0, -1.0]])


def test_the_rectangles_of_a_square_and_a_diamond_are_the_known_ones():
    assert rectangle_scale(SQUARE, np.zeros(2), np.ones(2)) == 1.0
    assert rectangle_scale(SQUARE * [3, 2], np.zeros(2), np.array([3.0, 2.0])) == 1.0
    assert rectangle_scale(SQUARE, np.array([0.5, 0.0]), np.ones(2)) == 0.5
    assert rectangle_scale(DIAMOND, np.zeros(2), np.ones(2)) == pytest.approx(0.5)
    assert rectangle_scale(DIAMOND[::-1], np.zeros(2), np.ones(2)) == pytest.approx(0.5)


def test_the_rectangle_in_a_circle_has_its_corners_on_it():
    turn = 2 * np.pi * np.arange(720) / 720
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    assert rectangle_scale(circle, np.zeros(2), np.ones(2)) == pytest.approx(np.sqrt(0.5), abs=1e-4)


def test_there_is_none_about_a_middle_outside_or_in_what_encloses_nothing():
    assert rectangle_scale(SQUARE, np.array([2.0, 0.0]), np.ones(2)) == 0.0
    assert rectangle_scale(np.tile([0.0, 0.0], (5, 1)), np.zeros(2), np.ones(2)) == 0.0


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 10**6))
def test_the_rectangle_found_is_inside_touches_and_lies_between_two_ellipses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 15))
    polygon = rng.uniform(0.4, 1.5, (15, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    half = rng.uniform(0.3, 2.0, 2)
    middle = rng.uniform(-0.2, 0.2, 2)
    scale = rectangle_scale(polygon, middle, half)
    along = np.linspace(-1, 1, 201)
    side = np.concatenate(
        [np.column_stack([along, s * np.ones(201)]) for s in (-1, 1)]
        + [np.column_stack([s * np.ones(201), along]) for s in (-1, 1)]
    )
    around, origin = (polygon - middle) / half, np.zeros((1, 2))
    ellipse = edge_distance(around, origin)[0] * (winding_number(around, origin)[0] != 0)
    assert np.sqrt(0.5) * ellipse - 1e-12 <= scale <= ellipse + 1e-12
    if scale > 0.0:
        inside = winding_number(polygon, middle + 0.999 * scale * half * side) != 0
        assert inside.all()
        grown = middle + 1.02 * scale * half * side
        fine = np.concatenate(
            [
                a + along[:, None] * 0.5 * (b - a) + 0.5 * (b - a)
                for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
            ]
        )
        met = (np.abs(fine - middle) <= 1.02 * scale * half).all(axis=1).any()
        assert met or not (winding_number(polygon, grown) != 0).all()


def program_layer_circle(count=80):
    turn = ray_azimuths(count)
    return np.column_stack([np.cos(turn), np.sin(turn)])


@pytest.mark.parametrize("sides", [(5, 5), (7, 7), (4, 6)])
def test_a_counter_clockwise_contour_makes_a_mirrored_layer(sides):
    control = make_program_layer(program_layer_circle(), sides).control
    assert control.shape == (*sides, 2)
    assert np.isfinite(control).all()
    assert signed_area(rim_of(control)) < 0.0
    # s = t = 0 is the north-west; t falls from there, s goes east.
    assert control[0, 0, 0] < 0.0 < control[0, 0, 1]
    assert control[0, -1, 1] < 0.0
    assert control[-1, 0, 0] > 0.0


def test_a_clockwise_contour_makes_an_upright_layer():
    control = make_program_layer(program_layer_circle()[::-1], (5, 5)).control
    assert signed_area(rim_of(control)) > 0.0


def test_the_polygon_belongs_to_a_curve_that_does_not_close():
    layer = make_program_layer(program_layer_circle() * [2.0, 1.0], (5, 5))
    assert 0.05 < layer.gap < 0.3


def test_the_core_of_a_round_layer_sticks_out_of_it():
    # The box around the largest ellipse, if only the search found that one.
    control = make_program_layer(program_layer_circle(), (5, 5)).control
    assert make_program_layer(program_layer_circle(), (5, 5)).core_scale == pytest.approx(
        0.618, abs=1e-3
    )
    grown = control[2, 2] + (control[1:-1, 1:-1] - control[2, 2]) / 0.618
    assert (winding_number(rim_of(control), grown.reshape(-1, 2)) == 0).any()


def test_the_core_runs_with_the_shell_only_if_the_first_vertex_is_west_of_the_origin():
    def runs_with_shell(control):
        rim_ways = control[-1, 0] - control[0, 0], control[0, -1] - control[0, 0]
        core_ways = control[-2, 1] - control[1, 1], control[1, -2] - control[1, 1]
        turns = np.abs(turn_between(np.array(rim_ways), np.array(core_ways)))
        return bool((turns < 0.25 * np.pi).all())

    assert runs_with_shell(make_program_layer(program_layer_circle(), (5, 5)).control)
    assert not runs_with_shell(
        make_program_layer(program_layer_circle() + [5.0, 0.0], (5, 5)).control
    )


def test_a_contour_in_one_place_is_a_layer_in_one_place():
    layer = make_program_layer(np.tile([0.2, 0.4], (12, 1)), (5, 5))
    assert np.ptp(layer.control.reshape(-1, 2), axis=0).tolist() == [0.0, 0.0]
    assert layer.core_scale == layer.gap == 0.0


def isint(line, d, center):
    """isint.m."""
    a, b, c = line
    p, q = d
    xc, yc = center
    if a == 0:
        return bool(q >= abs(-c / b - yc))
    if b == 0:
        return bool(p >= abs(-c / a - xc))
    return bool(q * q * b * b + p * p * a * a >= (a * xc + b * yc + c) ** 2)


def buildgrid(polygon, center, half, n):
    """The search of buildgrid.m, line by line, with b1 for its second a1."""
    cpx, cpy = polygon.T
    dcpx, dcpy = np.diff([*cpx, cpx[0]]), np.diff([*cpy, cpy[0]])
    fib = [1.0, 1.0]
    for _ in range(48):
        fib.append(fib[-1] + fib[-2])
    a, b, tol, maxit, count = 1e-6, 1.0, 1e-6, 50, 1
    while abs(b - a) > tol and count < maxit - 1:
        y1 = y2 = 0
        for i in range(n):
            line = (dcpy[i], dcpx[i], cpy[i] * dcpx[i] - cpx[i] * dcpy[i])
            y1 += isint(line, a * half, center)
            y2 += isint(line, b * half, center)
        a1 = a + fib[maxit - count - 2] / fib[maxit - count] * (b - a)
        b1 = a + fib[maxit - count - 1] / fib[maxit - count] * (b - a)
        if y1 > 0 and y2 > 0:
            b = a1
        elif y2 > 0:
            a, b = a1, b1
        elif y1 == 0:
            a = b1
        count += 1
    return 0.5 * (a + b)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 9))
def test_the_search_is_that_of_the_program(seed: int, edges: int) -> None:
    rng = np.random.default_rng(seed)
    polygon = rng.uniform(-1, 1, (9, 2))
    middle, half = rng.uniform(-0.3, 0.3, 2), rng.uniform(0.2, 1.0, 2)
    assert searched_scale(polygon, middle, half, edges) == pytest.approx(
        buildgrid(polygon, middle, half, edges), abs=1e-9
    )


def test_the_search_ends_at_one_of_a_few_numbers_whatever_the_polygon():
    scales = set()
    for width in np.linspace(0.65, 0.95, 31):
        box = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * [width, 1.0]
        scales.add(round(searched_scale(box, np.zeros(2), np.ones(2), 4), 3))
    assert scales == {0.618}


def test_an_edge_without_length_is_no_line():
    box = np.array([[-1, -1], [-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    assert np.isfinite(searched_scale(box, np.zeros(2), np.ones(2), 1))


AT = np.random.default_rng(0).random((500, 3))
TURN = 2 * np.pi * np.arange(40) / 40
CIRCLE = np.column_stack([np.cos(TURN), np.sin(TURN)])


def noisy(amplitude, seed=0):
    """A deformed volume; the amplitude is in quarters of its size, as in the published figures."""
    bases = clamped_basis(7), clamped_basis(7), clamped_basis(9)
    control = Parallelepiped(-np.ones(3), 2.0 * np.eye(3)).greville_control(bases)
    noise = np.random.default_rng(seed).normal(size=control.shape)
    return SplineVolume(control + 0.5 * amplitude * noise, bases)


def test_constraints_and_pseudo_vertices_of_clamped_knots_contradict_each_other():
    fit = fit_closed_thesis(CIRCLE, np.arange(40) / 40, 16)
    first, last = closed_curve_points(fit.control, fit.knots, np.array([0.0, 1.0]))
    assert np.linalg.norm(first - last) > 0.05


def test_a_curve_has_its_vertices_and_none_goes_around_one_place():
    assert fit_closed_curve_thesis(CIRCLE).control.shape == (16, 2)
    with pytest.raises(ValueError, match="at least 2 places, got 1"):
        fit_closed_curve_thesis(np.ones((5, 2)))


def test_inversion_takes_no_step_from_the_solution_and_no_points_have_no_parameters():
    volume = noisy(0.0)  # of which the affine guess is the answer
    found = invert_thesis(volume, volume.at(AT))
    assert not found.steps.any()
    assert found.converged.all()
    assert [len(part) for part in invert_thesis(volume, np.zeros((0, 3)))] == [0] * 5


def test_the_thesis_finds_the_same_parameters_where_it_converges():
    volume = noisy(0.1)
    found = invert_thesis(volume, volume.at(AT))
    assert found.converged.mean() > 0.99
    off = np.abs(found.parameters - AT)[found.converged]
    assert off.max() < 1e-5
    assert found.steps.max() > 1


def test_the_thesis_fails_where_the_volume_folds():
    volume = noisy(0.8, seed=1)
    points = volume.at(AT)
    assert invert_thesis(volume, points).converged.mean() < 0.7
    assert invert_points(volume, points).converged.mean() > 0.99


def test_the_thesis_gives_up_where_its_matrix_is_singular():
    volume = noisy(0.1)
    flat = SplineVolume(volume.control * [1.0, 1.0, 0.0], volume.bases)
    found = invert_thesis(flat, flat.at(AT) + [0.0, 0.0, 0.1])
    assert not found.converged.any()
    assert np.isfinite(found.parameters).all()
    assert np.isfinite(found.residual).all()


def test_where_a_lattice_stands_does_not_loosen_the_inversion():
    box = np.array([[1e3, -0.05, -0.05], [1e3 + 0.1, 0.05, 0.05]])
    turns = [LatticeLayer(turn=turn) for turn in (0.0, 0.2, 0.5, 0.6)]
    lattice = layered_lattice(box - [1e3 + 0.05, 0, 0], turns)
    far = SplineVolume(lattice.control + [1e3, 0.0, 0.0], lattice.volume.bases)
    places = np.random.default_rng(0).uniform(0.2, 0.8, (20, 3))
    found = invert_thesis(far, far.at(places))
    assert found.converged.all()
    assert found.residual.max() < 2e-7
