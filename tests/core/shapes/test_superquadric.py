from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.superquadric import Superquadric

Volume = Callable[[Mesh], float]
Closed = Callable[[Mesh], bool]


def gauge_by_logarithms(shape: Superquadric, points: Floats) -> Floats:
    """The gauge, (2.6) to the power 1/2, written another way: no power can overflow."""
    e1, e2 = shape.exponents
    with np.errstate(divide="ignore"):
        x, y, z = np.log(np.abs(points / shape.size)).T
    with np.errstate(invalid="ignore"):
        across = 0.5 * e2 * np.logaddexp(2 / e2 * x, 2 / e2 * y)
        return np.asarray(np.exp(0.5 * e1 * np.logaddexp(2 / e1 * across, 2 / e1 * z)))


def ranges_by_bisection(
    shape: Superquadric, origins: Floats, direction: Floats, reach: float
) -> tuple[Floats, Floats]:
    """Least gauge on each ray, and the range at which the ray first enters."""

    def gauge(travelled: Floats) -> Floats:
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


def test_rays_agree_with_bisection_for_all_exponents() -> None:
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


def test_rays_agree_with_extended_precision_to_12_digits(oracle: Any) -> None:
    rng = np.random.default_rng(21)
    met_in_all = 0
    for _ in range(60):
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
    assert met_in_all > 900


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


def test_the_gauge_bends_no_more_than_its_smoothness_allows() -> None:
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


def test_the_function_is_negative_inside_and_its_slope_that_of_differences() -> None:
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
def test_a_ray_on_an_axis_meets_the_end_of_that_axis(exponent: float, axis: int) -> None:
    shape = Superquadric(np.array([0.01, 0.02, 0.03]), np.full(2, exponent))
    unit = np.eye(3)[axis]
    found = shape.cast(np.array([0.1 * unit, -0.1 * unit]), -unit, 1.0)
    assert found[0] == pytest.approx(0.1 - shape.size[axis], abs=1e-14)
    assert found[1] == MISS


@pytest.mark.parametrize(("across", "met"), [(0.0299, True), (0.0301, False)])
def test_a_ray_along_a_face_meets_it_just_inside_and_misses_just_outside(
    across: float, met: bool
) -> None:
    shape = Superquadric(np.full(3, 0.03), np.full(2, 0.05))
    found = shape.cast(np.array([[across, 0.0, 0.1]]), np.array([0.0, 0.0, -1.0]), 1.0)
    assert np.isfinite(found[0]) == met


def test_a_ray_at_an_edge_and_at_a_corner_meets_it() -> None:
    for corner in ([1.0, 1.0, 0.0], [1.0, 1.0, 1.0]):
        shape = Superquadric(np.full(3, 0.03), np.full(2, 0.05))
        unit = np.array(corner) / math.sqrt(sum(corner))
        found = shape.cast(0.1 * unit[None], -unit, 1.0)[0]
        e = 0.05
        edge = 0.03 * math.sqrt(2) * 2 ** (-e / 2)
        vertex = 0.03 * math.sqrt(3) * (2 ** (e / e) + 1) ** (-e / 2)
        assert found == pytest.approx(0.1 - (vertex if corner[2] else edge), abs=1e-13)


def test_rays_nearly_parallel_to_a_sharp_face_miss_without_a_warning() -> None:
    shape = Superquadric(np.full(3, 0.03), np.full(2, 0.02))
    across = 0.03 * np.geomspace(1e-12, 1.0, 2000)
    origins = np.column_stack([across, 0 * across, np.full(2000, 0.09)])
    assert (shape.cast(origins, np.array([-1.0, 0.0, 0.0]), 1.0) == MISS).all()


def test_a_ray_stops_at_its_reach(ball: Superquadric) -> None:
    origin, down = np.array([[0.0, 0.0, 0.1]]), np.array([0.0, 0.0, -1.0])
    assert ball.cast(origin, down, 0.0699)[0] == MISS
    assert ball.cast(origin, down, 0.0701)[0] == pytest.approx(0.07, abs=1e-14)
    assert ball.cast(origin, -down, 1.0)[0] == MISS


@pytest.mark.parametrize("exponent", [0.02, 1.0, 2.0])
def test_a_ray_that_starts_inside_says_so(exponent: float) -> None:
    shape = Superquadric(np.array([0.01, 0.02, 0.03]), np.full(2, exponent))
    origins = np.array([[0.0, 0.0, 0.0], [0.0099, 0, 0], [0, 0, -0.0299], [0.01, 0.02, 0.04]])
    found = shape.cast(origins, np.array([1.0, 0.0, 0.0]), 1e-3)
    assert found[:3].tolist() == [INSIDE] * 3
    assert found[3] == MISS


def test_the_gauge_is_homogeneous_symmetric_and_finite() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(100, 3)) * np.exp(rng.normal(size=(100, 1)))
    for exponents in ([0.02, 0.02], [0.02, 2.0], [0.7, 1.3]):
        shape = Superquadric(np.array([0.3, 0.2, 0.1]), np.array(exponents))
        gauge = shape.gauge(points)
        assert np.allclose(gauge, gauge_by_logarithms(shape, points), rtol=1e-12)
        assert np.allclose(shape.gauge(-points * [1, -1, 1]), gauge, rtol=1e-14)
        assert np.allclose(shape.gauge(1e6 * points), 1e6 * gauge, rtol=1e-13)
        assert np.isfinite(shape.gauge(np.array([[0, 0, 0], [1e-200, 0, 0], [9, 9, 9.0]]))).all()


def test_the_gauge_of_a_ball_is_the_distance_in_radii(ball: Superquadric) -> None:
    points = np.random.default_rng(3).normal(size=(50, 3))
    assert np.allclose(ball.gauge(points), np.linalg.norm(points, axis=1) / 0.03, rtol=1e-14)


@pytest.mark.parametrize("exponents", [[0.1, 0.1], [1.0, 1.0], [2.0, 2.0], [0.3, 1.7]])
def test_the_mesh_is_closed_turned_outwards_and_on_the_surface(
    exponents: list[float], is_closed: Closed, signed_volume: Volume
) -> None:
    shape = Superquadric(np.array([0.03, 0.02, 0.04]), np.array(exponents))
    mesh = shape.mesh(4)
    assert is_closed(mesh)
    assert np.allclose(shape.gauge(mesh.vertices), 1.0, atol=1e-13)
    e1, e2 = exponents

    def beta(a: float, b: float) -> float:
        return math.gamma(a) * math.gamma(b) / math.gamma(a + b)

    exact = 2 * 0.03 * 0.02 * 0.04 * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2)
    assert 0.97 * exact < signed_volume(mesh) < exact


def test_the_bounds_are_the_semi_axes(box: Superquadric) -> None:
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
def test_what_is_no_superquadric_is_refused(
    size: list[float], exponents: list[float], words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        Superquadric(np.array(size), np.array(exponents))
