from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.superquadrics import (
    Superquadric,
    SurfacePoints,
    gauge_and_gradient,
    inside_outside,
    p_norm,
    p_norm_curvature,
    regular_points,
    trigonometric_points,
)

Volume = Callable[[Mesh], float]
Closed = Callable[[Mesh], bool]


def gauge_by_logarithms(shape, points):
    """The gauge, (2.6) to the power 1/2, written another way: no power can overflow."""
    e1, e2 = shape.exponents
    with np.errstate(divide="ignore"):
        x, y, z = np.log(np.abs(points / shape.size)).T
    with np.errstate(invalid="ignore"):
        across = 0.5 * e2 * np.logaddexp(2 / e2 * x, 2 / e2 * y)
        return np.asarray(np.exp(0.5 * e1 * np.logaddexp(2 / e1 * across, 2 / e1 * z)))


def ranges_by_bisection(shape, origins, direction, reach):
    """Least gauge on each ray, and the range at which the ray first enters."""

    def gauge(travelled):
        return gauge_by_logarithms(shape, origins + travelled[:, None] * direction)

    low, high = np.zeros(len(origins)), np.full(len(origins), reach)
    for _ in range(150):  # the gauge is convex along a ray
        third = (high - low) / 3
        nearer = gauge(low + third) <= gauge(high - third)
        low, high = np.where(nearer, low, low + third), np.where(nearer, high - third, high)
    deepest = high
    low, high = np.zeros(len(origins)), deepest.copy()
    for _ in range(60):
        middle = 0.5 * (low + high)
        inside = gauge(middle) <= 1.0
        low, high = np.where(inside, low, middle), np.where(inside, middle, high)
    return gauge(deepest), high


def test_rays_agree_with_bisection_for_all_exponents():
    rng = np.random.default_rng(0)
    hits = 0
    for number in range(60):
        exponents = np.exp(rng.uniform(math.log(0.02), math.log(2.0), 2))
        shape = Superquadric(rng.uniform(0.01, 0.06, 3), exponents)
        direction = rng.normal(size=3) if number % 3 else np.eye(3)[number // 3 % 3]
        direction /= np.linalg.norm(direction)
        far = 3 * shape.size.max()
        places = rng.uniform(-1.2, 1.2, (60, 3))
        places[:20] = rng.choice([-1.0, -0.5, 0.0, 1.0], (20, 3))  # faces, edges, corners, axis
        origins = places * shape.size - far * direction
        found = shape.cast(origins, direction, 3 * far)
        least, wanted = ranges_by_bisection(shape, origins, direction, 3 * far)
        met = np.isfinite(found)
        assert met[least < 1 - 1e-9].all()
        assert (found[least > 1 + 1e-9] == MISS).all()
        clear = met & (least < 1 - 1e-9)
        assert np.allclose(found[clear], wanted[clear], rtol=0, atol=1e-11)
        hits += int(clear.sum())
    assert hits > 1000


@pytest.mark.parametrize("trials", [12, pytest.param(60, marks=pytest.mark.slow)])
def test_rays_agree_with_extended_precision_to_12_digits(oracle, trials):
    rng = np.random.default_rng(21)
    met_in_all = 0
    for _ in range(trials):
        size, exponents = rng.uniform(0.01, 0.06, 3), np.exp(rng.uniform(math.log(0.02), 0.69, 2))
        shape = Superquadric(size, exponents)
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        surface = shape.mesh(3).vertices
        spread = np.repeat([0.0, 1e-5, 1e-3], 8)[:, None] * rng.normal(size=(24, 3))
        origins = surface[rng.integers(len(surface), size=24)] + spread - 0.1 * direction
        found = shape.cast(origins, direction, 0.3)
        wanted = oracle(size, exponents).entries(origins, direction, 0.3)
        clear = np.abs(wanted.least) > 1e-12
        assert np.array_equal(np.isfinite(found)[clear], np.isfinite(wanted.ranges)[clear])
        met = np.isfinite(found) & np.isfinite(wanted.ranges)
        assert np.abs(found[met] - wanted.ranges[met]).max() < 1e-12 * size.max()
        met_in_all += int(met.sum())
    assert met_in_all > 15 * trials


@settings(max_examples=100, deadline=None)
@given(
    e1=st.floats(0.02, 2.0),
    e2=st.floats(0.02, 2.0),
    place=st.tuples(*[st.floats(-1.2, 1.2)] * 3),
    towards=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda d: max(map(abs, d)) > 1e-3),
    reach=st.floats(0.0, 0.3),
)
def test_a_hit_has_gauge_1_and_a_longer_reach_changes_no_hit(
    e1: float,
    e2: float,
    place: tuple[float, float, float],
    towards: tuple[float, float, float],
    reach: float,
) -> None:
    shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array([e1, e2]))
    direction = np.array(towards) / np.linalg.norm(towards)
    origins = np.array([place]) * shape.size - np.array([[0.0], [0.1]]) * direction
    found, longer = shape.cast(origins, direction, reach), shape.cast(origins, direction, 0.6)
    assert ((found == longer) | ((found == MISS) & (longer > reach))).all()
    assert np.array_equal(found == INSIDE, shape.gauge(origins) <= 1.0)
    met = np.isfinite(longer)
    at = shape.gauge(origins[met] + longer[met, None] * direction)
    assert np.allclose(at, 1.0, rtol=0, atol=1e-12)


def test_the_gauge_bends_no_more_than_its_smoothness_allows():
    rng = np.random.default_rng(4)
    for exponents in ([1.0, 1.0], [0.1, 0.1], [0.05, 1.0], [1.0, 0.05], [0.3, 0.7]):
        shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array(exponents))
        points = shape.mesh(4).vertices
        direction = rng.normal(size=3)
        towards = np.broadcast_to(direction, points.shape)
        step = 1e-7
        second = (
            shape.inside_out(points + step * direction, towards)[1]
            - shape.inside_out(points, towards)[1]
        ) / step
        speed = shape.gauge(direction[None])[0]
        assert second.max() <= shape.smoothness() * speed**2 * (1 + 1e-3)
        assert second.max() > 1e-3 * shape.smoothness() * speed**2
    assert Superquadric(np.ones(3), np.array([1.0, 1.01])).smoothness() == np.inf


def test_the_function_is_negative_inside_and_its_slope_that_of_differences():
    shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array([0.4, 1.7]))
    points = shape.mesh(3).vertices * np.random.default_rng(0).uniform(0.5, 1.5, (642, 1))
    directions = np.random.default_rng(1).normal(size=points.shape)
    value, slope = shape.inside_out(points, directions)
    assert np.allclose(value, shape.gauge(points) - 1.0, atol=1e-15)
    ahead, back = (shape.gauge(points + step * directions) for step in (1e-8, -1e-8))
    clear = np.abs(points).min(axis=1) > 1e-6  # away from the creases
    assert np.allclose(slope[clear], (ahead - back)[clear] / 2e-8, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("exponent", [0.02, 0.1, 1.0, 2.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_ray_on_an_axis_meets_the_end_of_that_axis(exponent, axis):
    shape = Superquadric(np.array([0.01, 0.02, 0.03]), np.full(2, exponent))
    unit = np.eye(3)[axis]
    found = shape.cast(np.array([0.1 * unit, -0.1 * unit]), -unit, 1.0)
    assert found[0] == pytest.approx(0.1 - shape.size[axis], abs=1e-14)
    assert found[1] == MISS


@pytest.mark.parametrize(("across", "met"), [(0.0299, True), (0.0301, False)])
def test_a_ray_along_a_face_meets_it_just_inside_and_misses_just_outside(across, met):
    shape = Superquadric(np.full(3, 0.03), np.full(2, 0.05))
    found = shape.cast(np.array([[across, 0.0, 0.1]]), np.array([0.0, 0.0, -1.0]), 1.0)
    assert np.isfinite(found[0]) == met


def test_a_ray_at_an_edge_and_at_a_corner_meets_it():
    for corner in ([1.0, 1.0, 0.0], [1.0, 1.0, 1.0]):
        shape = Superquadric(np.full(3, 0.03), np.full(2, 0.05))
        unit = np.array(corner) / math.sqrt(sum(corner))
        found = shape.cast(0.1 * unit[None], -unit, 1.0)[0]
        e = 0.05
        edge = 0.03 * math.sqrt(2) * 2 ** (-e / 2)
        vertex = 0.03 * math.sqrt(3) * (2 ** (e / e) + 1) ** (-e / 2)
        assert found == pytest.approx(0.1 - (vertex if corner[2] else edge), abs=1e-13)


def test_rays_nearly_parallel_to_a_sharp_face_miss_without_a_warning():
    shape = Superquadric(np.full(3, 0.03), np.full(2, 0.02))
    across = 0.03 * np.geomspace(1e-12, 1.0, 2000)
    origins = np.column_stack([across, 0 * across, np.full(2000, 0.09)])
    assert (shape.cast(origins, np.array([-1.0, 0.0, 0.0]), 1.0) == MISS).all()


def test_a_ray_stops_at_its_reach(ball):
    origin, down = np.array([[0.0, 0.0, 0.1]]), np.array([0.0, 0.0, -1.0])
    assert ball.cast(origin, down, 0.0699)[0] == MISS
    assert ball.cast(origin, down, 0.0701)[0] == pytest.approx(0.07, abs=1e-14)
    assert ball.cast(origin, -down, 1.0)[0] == MISS


@pytest.mark.parametrize("exponent", [0.02, 1.0, 2.0])
def test_a_ray_that_starts_inside_says_so(exponent):
    shape = Superquadric(np.array([0.01, 0.02, 0.03]), np.full(2, exponent))
    origins = np.array([[0.0, 0.0, 0.0], [0.0099, 0, 0], [0, 0, -0.0299], [0.01, 0.02, 0.04]])
    found = shape.cast(origins, np.array([1.0, 0.0, 0.0]), 1e-3)
    assert found[:3].tolist() == [INSIDE] * 3
    assert found[3] == MISS


def test_the_gauge_is_homogeneous_symmetric_and_finite():
    rng = np.random.default_rng(2)
    points = rng.normal(size=(100, 3)) * np.exp(rng.normal(size=(100, 1)))
    for exponents in ([0.02, 0.02], [0.02, 2.0], [0.7, 1.3]):
        shape = Superquadric(np.array([0.3, 0.2, 0.1]), np.array(exponents))
        gauge = shape.gauge(points)
        assert np.allclose(gauge, gauge_by_logarithms(shape, points), rtol=1e-12)
        assert np.allclose(shape.gauge(-points * [1, -1, 1]), gauge, rtol=1e-14)
        assert np.allclose(shape.gauge(1e6 * points), 1e6 * gauge, rtol=1e-13)
        assert np.isfinite(shape.gauge(np.array([[0, 0, 0], [1e-200, 0, 0], [9, 9, 9.0]]))).all()


def test_the_gauge_of_a_ball_is_the_distance_in_radii(ball):
    points = np.random.default_rng(3).normal(size=(50, 3))
    assert np.allclose(ball.gauge(points), np.linalg.norm(points, axis=1) / 0.03, rtol=1e-14)


@pytest.mark.parametrize("exponents", [[0.1, 0.1], [1.0, 1.0], [2.0, 2.0], [0.3, 1.7]])
def test_the_mesh_is_closed_turned_outwards_and_on_the_surface(exponents, is_closed, signed_volume):
    shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array(exponents))
    mesh = shape.mesh(4)
    assert is_closed(mesh)
    assert np.allclose(shape.gauge(mesh.vertices), 1.0, atol=1e-13)
    e1, e2 = exponents

    def beta(a, b):
        return math.gamma(a) * math.gamma(b) / math.gamma(a + b)

    exact = 2 * 0.03 * 0.02 * 0.04 * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2)
    assert 0.97 * exact < signed_volume(mesh) < exact


def test_the_bounds_are_the_semi_axes(box):
    assert box.bounds().tolist() == [[-0.03, -0.02, -0.04], [0.03, 0.02, 0.04]]
    assert box.enclosure().tolist() == box.bounds().tolist()


@pytest.mark.parametrize(
    ("size", "exponents", "words"),
    [
        ([0.0, 1.0, 1.0], [1.0, 1.0], r"size must be positive, got \[0.0, 1.0, 1.0\] m"),
        ([-1.0, 1.0, 1.0], [1.0, 1.0], "size must be positive"),
        ([1.0, 1.0], [1.0, 1.0], r"size must have shape \(3\), got \(2,\)"),
        ([1.0, 1.0, math.nan], [1.0, 1.0], "size must be finite"),
        ([1.0, 1.0, 1.0], [0.019, 1.0], r"exponents must lie between 0.02 and 2.0, got \[0.019"),
        ([1.0, 1.0, 1.0], [1.0, 2.001], "exponents must lie between"),
        ([1.0, 1.0, 1.0], [1.0], r"exponents must have shape \(2\)"),
    ],
)
def test_what_is_no_superquadric_is_refused(size, exponents, words):
    with pytest.raises(ValueError, match=words):
        Superquadric(np.array(size), np.array(exponents))


SIZE = np.array([0.03, 0.02, 0.04])


@pytest.mark.parametrize("exponents", [[0.1, 0.1], [1.0, 1.0], [0.4, 1.6], [2.0, 2.0]])
def test_normals_are_unit_point_outwards_and_are_square_to_the_surface(exponents):
    shape = Superquadric(SIZE, np.array(exponents))
    points = shape.mesh(3).vertices
    normals = shape.normals(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-15)
    assert (np.einsum("ni,ni->n", normals, points) > 0).all()
    rng = np.random.default_rng(0)
    tangent = np.cross(normals, rng.normal(size=points.shape))
    slope = shape.inside_out(points, tangent)[1]
    clear = np.abs(points / SIZE).min(axis=1) > 1e-3
    assert np.abs(slope[clear]).max() < 1e-12


@pytest.mark.parametrize("exponents", [[2.0, 2.0], [1.0, 2.0]])
def test_normals_on_creases_poles_and_at_the_centre_are_what_is_promised(exponents):
    shape = Superquadric(SIZE, np.array(exponents))
    points = np.array([[0.0, 0.0, 0.04], [0.0, 0.01, 0.02], [0.0, 0.0, 0.0], [0.03, 0.0, 0.0]])
    normals = shape.normals(points)
    assert normals[0].tolist() == [0.0, 0.0, 1.0]
    assert normals[1, 0] == 0.0
    assert normals[2].tolist() == [0.0, 0.0, 1.0]
    assert normals[3].tolist() == [1.0, 0.0, 0.0]
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


STEP = 1e-6
X, Y = np.random.default_rng(0).uniform(0.05, 1.0, (2, 300))


def exponent(e):
    return np.asarray(e)


@pytest.mark.parametrize("e", [0.02, 0.1, 0.7, 1.0, 1.6, 2.0])
def test_the_norm_of_exponent_e_is_the_root_of_a_sum_of_powers(e):
    power = np.longdouble(2) / np.longdouble(e)
    wanted = np.exp(np.logaddexp(power * np.log(X, dtype=np.longdouble), power * np.log(Y)) / power)
    assert np.allclose(p_norm(X, Y, exponent(e)).value, wanted.astype(float), rtol=1e-15)


@pytest.mark.parametrize("e", [0.1, 0.7, 1.0, 1.6])
def test_its_slopes_are_those_of_differences(e):
    at = p_norm(X, Y, exponent(e))

    def slope(dx, dy, de):
        ahead = p_norm(X + STEP * dx, Y + STEP * dy, exponent(e + STEP * de)).value
        back = p_norm(X - STEP * dx, Y - STEP * dy, exponent(e - STEP * de)).value
        return np.asarray((ahead - back) / (2 * STEP))

    assert np.allclose(at.by_x, slope(1, 0, 0), rtol=0, atol=1e-8)
    assert np.allclose(at.by_y, slope(0, 1, 0), rtol=0, atol=1e-8)
    assert np.allclose(at.by_exponent, slope(0, 0, 1), rtol=0, atol=1e-8)


@pytest.mark.parametrize("e", [0.1, 0.7, 1.0, 1.6])
def test_its_second_derivatives_are_those_of_differences_of_slopes(e):
    along_x, along_y = np.random.default_rng(1).normal(size=(2, 300))
    found = p_norm_curvature(p_norm(X, Y, exponent(e)), along_x, along_y, exponent(e))

    def slope(dx, dy, de):
        ahead = p_norm(X + STEP * dx, Y + STEP * dy, exponent(e + STEP * de))
        back = p_norm(X - STEP * dx, Y - STEP * dy, exponent(e - STEP * de))
        by_x, by_y = ahead.by_x - back.by_x, ahead.by_y - back.by_y
        return np.asarray((by_x * along_x + by_y * along_y) / (2 * STEP))

    clear = np.minimum(X, Y) > 2e-3 * np.maximum(X, Y)
    for mine, wanted in (
        (found.by_x, slope(1, 0, 0)),
        (found.by_y, slope(0, 1, 0)),
        (found.by_exponent, slope(0, 0, 1)),
    ):
        assert np.allclose(mine[clear], wanted[clear], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("e", [0.01, 0.5, 1.0, 1.5, 2.0])
def test_second_derivatives_on_a_crease_are_finite(e):
    x, y = np.array([0.0, 1.0, 0.0, 1e-200, 1.0]), np.array([1.0, 0.0, 0.0, 1.0, 1e-12])
    found = p_norm_curvature(p_norm(x, y, exponent(e)), np.ones(5), -np.ones(5), exponent(e))
    assert all(np.isfinite(part).all() for part in found)


def test_the_gradient_points_outwards_and_is_that_of_differences():
    points = np.random.default_rng(2).normal(size=(200, 3))
    for pair in ([0.1, 0.1], [1.0, 1.0], [0.4, 1.7], [2.0, 2.0]):
        exponents = np.array(pair)
        value, slope = gauge_and_gradient(points, exponents)
        for axis in range(3):
            step = STEP * np.eye(3)[axis]
            ahead, back = (
                gauge_and_gradient(points + step, exponents)[0],
                gauge_and_gradient(points - step, exponents),
            )
            wanted = (ahead - back[0]) / (2 * STEP)
            assert np.allclose(slope[:, axis], wanted, rtol=0, atol=1e-6)
        # Euler: the gauge is homogeneous.
        assert np.allclose(np.einsum("ni,ni->n", slope, points), value, rtol=1e-14)


Way = Callable[[Superquadric, Floats, Floats], SurfacePoints]
PAIRS = [[0.02, 0.02], [0.15, 0.15], [1.0, 1.0], [0.4, 1.6], [2.0, 2.0]]


def grid_of_angles(rows, columns):
    eta = np.linspace(-0.5 * math.pi, 0.5 * math.pi, rows)
    omega = -math.pi + 2.0 * math.pi / columns * np.arange(columns)
    return np.repeat(eta, columns), np.tile(omega, rows)


@pytest.mark.parametrize("way", [trigonometric_points, regular_points])
@pytest.mark.parametrize("exponents", PAIRS)
def test_points_lie_on_the_surface_and_normals_are_those_of_the_gauge(way, exponents):
    shape = Superquadric(SIZE, np.array(exponents))
    points, normals = way(shape, *grid_of_angles(31, 40))
    assert np.abs(shape.gauge(points) - 1.0).max() < 1e-14
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-15)
    inner = np.abs(points / SIZE).min(axis=1) > 1e-3  # off the creases
    assert np.abs(normals[inner] - shape.normals(points[inner])).max() < 1e-9


@pytest.mark.parametrize("way", [trigonometric_points, regular_points])
@pytest.mark.parametrize("exponents", PAIRS)
def test_poles_and_seam_have_their_points_and_normals(way, exponents):
    shape = Superquadric(SIZE, np.array(exponents))
    eta = np.array([0.5, -0.5, 0.0, 0.0]) * math.pi
    points, normals = way(shape, eta, np.array([0.3, 0.3, -math.pi, 0.5 * math.pi]))
    wanted = np.array([[0, 0, 1], [0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    assert np.array_equal(points[2:], wanted[2:] * SIZE)
    assert np.allclose(points[:2], wanted[:2] * SIZE, atol=1e-16)
    assert np.isfinite(normals).all()
    assert (np.einsum("ni,ni->n", normals, wanted) > 0.2).all()


def test_every_power_keeps_its_sign():
    eta, omega = grid_of_angles(20, 40)
    points = trigonometric_points(Superquadric(SIZE, np.array([0.3, 0.7])), eta, omega).points
    wanted = np.column_stack([np.cos(omega), np.sin(omega), np.sin(eta)])
    clear = (np.abs(wanted) > 1e-9).all(axis=1) & (np.abs(eta) < 1.5)
    assert (np.sign(points) == np.sign(wanted))[clear].all()
    assert clear.sum() > 500


def test_regular_points_are_far_more_evenly_spaced_on_a_box():
    shape = Superquadric(np.ones(3), np.full(2, 0.1))
    omega = grid_of_angles(2, 80)[1][:80]
    unevenness = {}
    for way in (trigonometric_points, regular_points):
        ring = way(shape, np.zeros(80), omega).points
        gaps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
        unevenness[way] = gaps.max() / gaps.min()
    assert unevenness[regular_points] < 2.0
    assert unevenness[trigonometric_points] > 50.0


def test_angles_that_do_not_match_are_refused():
    shape = Superquadric(SIZE, np.ones(2))
    with pytest.raises(ValueError, match=r"omega must have shape \(2\), got \(3,\)"):
        regular_points(shape, np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="eta must be finite"):
        trigonometric_points(shape, np.array([math.inf]), np.zeros(1))


HARD_PAIRS = [[0.01, 0.01], [0.05, 0.05], [0.1, 2.0], [1.0, 1.0], [2.0, 0.1], [2.0, 2.0]]
POINTS = np.random.default_rng(0).uniform(-1, 1, (500, 3))


def all_finite(found):
    return all(np.isfinite(part).all() for part in found)


@pytest.mark.parametrize("exponents", HARD_PAIRS)
def test_f_is_finite_and_the_same_in_all_octants(exponents):
    wanted = inside_outside(np.abs(POINTS), exponents)
    for signs in np.array(np.meshgrid([1, -1], [1, -1], [1, -1])).reshape(3, 8).T:
        found = inside_outside(np.abs(POINTS) * signs, exponents)
        assert all_finite(found)
        assert np.array_equal(found.value, wanted.value)
        assert np.array_equal(found.by_place * signs, wanted.by_place)


@pytest.mark.parametrize("exponent", [0.01, 0.02, 0.05])
def test_30_sizes_away_along_an_axis_f_is_900_where_its_powers_overflow(exponent):
    found = inside_outside(30.0 * np.eye(3), [exponent, exponent])
    assert np.exp(found.value) == pytest.approx(900.0, rel=1e-14)
    assert 30.0 ** (2 / 0.01) > 1e295  # and its square is none


@pytest.mark.parametrize("exponents", HARD_PAIRS)
def test_at_the_centre_f_is_0_its_gradient_finite_and_the_distance_inwards(exponents):
    found = inside_outside(np.zeros((1, 3)), exponents)
    assert all_finite(found)
    assert np.exp(found.value[0]) == 0.0
    assert found.by_place.tolist() == [[0.0, 0.0, 0.0]]
    shape = Superquadric(np.array([0.3, 0.2, 0.1]), np.maximum(exponents, 0.02))
    # The radial distance |x| (1 - 1 / gauge) of points closer and closer to the centre.
    near = np.outer([1e-3, 1e-9, 1e-200], [1.0, 0.0, 0.0])
    radial = np.abs(near[:, 0]) - np.abs(near[:, 0]) / shape.gauge(near)
    assert radial == pytest.approx([-0.299, -0.3, -0.3], abs=1e-8)
    assert shape.normals(np.zeros((1, 3))).tolist() == [[0.0, 0.0, 1.0]]


@pytest.mark.parametrize("exponents", [[2.0, 2.0], [1.0, 2.0], [2.0, 1.0], [1.5, 1.5]])
def test_on_a_crease_the_gradient_is_finite_and_the_mean_of_both_sides(exponents):
    on = np.array([[0.0, 0.6, 0.4], [0.6, 0.0, 0.4], [0.6, 0.4, 0.0], [0.0, 0.0, 1.0]])
    found = inside_outside(on, exponents)
    assert all_finite(found)
    gauge = np.exp(0.5 * found.value)
    assert (np.abs(found.by_place) <= 2.0 / gauge[:, None] * (1 + 1e-15)).all()
    for row, axis in enumerate([0, 1, 2]):
        sides = [on[row] + way * 1e-9 * np.eye(3)[axis] for way in (1, -1)]
        mean = inside_outside(sides, exponents).by_place.mean(axis=0)
        assert found.by_place[row] == pytest.approx(mean, abs=1e-4)


@pytest.mark.parametrize("exponents", HARD_PAIRS)
def test_coordinates_that_underflow_when_squared_are_finite(exponents):
    points = [[1e-200, 1, 1], [1, 1e-200, 1e-200], [1e-200] * 3, [1e5] * 3, [1e-300, 0, 1e5]]
    found = inside_outside(points, exponents)
    assert all_finite(found)
    assert found.value[2] == pytest.approx(found.value[3] - 2 * math.log(1e205), abs=1e-11)


def test_a_taper_to_a_tip_is_refused_and_one_nearly_to_a_tip_ends_in_a_point():
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        Taper(-1.0, 0.0, 0.5)
    nearly = Taper(-1.0 + 1e-12, -1.0 + 1e-12, 0.5)
    rim = np.array([[0.3, 0.2, 0.5], [-0.3, 0.2, 0.5]])
    assert np.abs(nearly(rim)[:, :2]).max() < 1e-12
    assert np.allclose(nearly.inverse(nearly(rim)), rim, rtol=1e-15, atol=0)


@pytest.mark.parametrize("curvature", [0.0, 1e-300, 1e-16, 1e-9])
def test_a_bend_of_next_to_nothing_is_no_division_by_it(curvature):
    bend, (x, y, z) = Bend(curvature), POINTS.T
    first_order = np.column_stack([x + 0.5 * curvature * z * z, y, z - curvature * x * z])
    assert np.abs(bend(POINTS) - first_order).max() < 1e-14
    assert np.abs(bend.inverse(bend(POINTS)) - POINTS).max() < 1e-14


def test_what_a_bend_would_fold_is_refused_and_every_place_was_bent_from_where_it_is_not():
    bend = Bend(2.0, 0.3)
    for folded in ([0.6, 0.2, 0.0], [0.0, 0.0, 1.6], [0.0, 0.0, -1.6]):
        with pytest.raises(ValueError, match="all that is bent must be nearer"):
            bend(np.array([folded]))
    anywhere = 3.0 * POINTS
    before = bend.inverse(anywhere)
    assert (2.0 * (before[:, :2] @ bend.towards) < 1.0).all()
    assert (2.0 * np.abs(before[:, 2]) < math.pi).all()
    assert np.abs(bend(before) - anywhere).max() < 1e-14


def test_a_bend_of_points_at_negative_x_has_their_sign():
    at = np.array([[-0.4, 0.1, 0.0]])
    assert Bend(0.5, 0.0)(at) == pytest.approx(at, abs=1e-16)
    printed = math.cos(0.0 - math.atan(0.1 / -0.4)) * math.hypot(0.4, 0.1)
    assert printed == pytest.approx(0.4)  # where -0.4 is right


def test_the_inverse_in_order_gives_the_points_back_and_out_of_order_does_not():
    bend, taper = Bend(0.6, 0.4), Taper(0.5, -0.4, 1.0)
    there = bend(taper(POINTS))
    assert np.abs(taper.inverse(bend.inverse(there)) - POINTS).max() < 1e-14
    assert np.abs(bend.inverse(taper.inverse(there)) - POINTS).max() > 0.3
