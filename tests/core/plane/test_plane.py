from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.plane.angle_between import angle_between, turn_between
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.crossings import crosses_itself
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.signed_area import signed_area
from palpate.core.plane.winding import winding_number

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
SEEDS = st.integers(0, 10**6)


def test_the_area_is_positive_counter_clockwise() -> None:
    assert signed_area(SQUARE) == 1.0
    assert signed_area(SQUARE[::-1]) == -1.0
    assert signed_area(1e6 + 1e-6 * SQUARE) == pytest.approx(1e-12, rel=1e-3)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(SEEDS, st.floats(0.1, 10.0), st.floats(-3.0, 3.0))
def test_the_centroid_moves_with_the_figure(seed: int, scale: float, angle: float) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 12))
    figure = rng.uniform(0.5, 1.5, (12, 1)) * np.column_stack([np.cos(turn), np.sin(turn)])
    cosine, sine = math.cos(angle), math.sin(angle)
    rotation, shift = np.array([[cosine, -sine], [sine, cosine]]), rng.normal(size=2)
    moved = scale * figure @ rotation.T + shift
    wanted = scale * rotation @ area_centroid(figure) + shift
    assert np.allclose(area_centroid(moved), wanted, rtol=0, atol=1e-11 * scale)


def test_the_centroid_of_a_triangle_is_the_mean_of_its_corners() -> None:
    corners = np.array([[0, 0, 7], [3, 0, 7], [0, 6, 7.0]])
    assert np.allclose(area_centroid(corners), [1, 2])


@settings(derandomize=True, deadline=None, max_examples=40)
@given(SEEDS, st.floats(-12.0, 0.49))
def test_angles_are_found_at_any_size_of_the_vectors(seed: int, power: float) -> None:
    rng, angle = np.random.default_rng(seed), 10.0**power
    plane, _ = np.linalg.qr(rng.normal(size=(3, 2)))
    first = 10.0 ** rng.uniform(-200, 150) * plane[:, 0]
    second = 10.0 ** rng.uniform(-200, 150) * (plane @ [math.cos(angle), math.sin(angle)])
    assert angle_between(first, second) == pytest.approx(angle, rel=1e-12, abs=1e-15)


def test_turns_are_positive_counter_clockwise() -> None:
    east, north = np.array([2.0, 0.0]), np.array([0.0, 0.5])
    assert turn_between(east, north) == pytest.approx(np.pi / 2)
    assert turn_between(north, east) == pytest.approx(-np.pi / 2)
    assert turn_between(east, -east) == pytest.approx(np.pi)
    assert np.array_equal(angle_between(np.array([east, north]), east), [0.0, np.pi / 2])


def test_half_a_turn_is_positive_whatever_the_sign_of_zero() -> None:
    for zero in (0.0, -0.0):
        for x in (1.0, -1.0):
            assert turn_between(np.array([x, zero]), np.array([-x, 0.0])) == np.pi


def test_a_direction_of_no_length_makes_no_angle() -> None:
    assert angle_between(np.zeros(3), np.array([1.0, 2.0, 3.0])) == 0.0


@settings(derandomize=True, deadline=None, max_examples=30)
@given(SEEDS)
def test_winding_and_distance_agree_with_sums_of_angles_and_fine_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygon, points = rng.normal(size=(9, 2)), rng.normal(size=(40, 2))
    away = polygon - points[:, None, :]
    angles = turn_between(away, np.roll(away, -1, axis=1)).sum(axis=1)
    assert np.array_equal(winding_number(polygon, points), np.round(angles / (2 * np.pi)))
    share = np.linspace(0, 1, 400)[:, None, None]
    edges = (1 - share) * polygon + share * np.roll(polygon, -1, axis=0)
    sampled = np.linalg.norm(points[:, None] - edges.reshape(1, -1, 2), axis=2).min(axis=1)
    distance = edge_distance(polygon, points)
    assert (distance <= sampled + 1e-12).all()
    assert np.allclose(distance, sampled, atol=1e-2)


def test_an_edge_of_no_length_is_a_point() -> None:
    doubled = np.repeat(SQUARE, 2, axis=0)
    assert edge_distance(doubled, np.array([[0.5, 0.2]]))[0] == pytest.approx(0.2)


def _crosses_plainly(polygon: Floats) -> bool:
    count = len(polygon)

    def side(a: Floats, b: Floats, c: Floats) -> float:
        return float((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])

    for i in range(count):
        for j in range(i + 2, count):
            if i == 0 and j == count - 1:
                continue
            a, b = polygon[i], polygon[(i + 1) % count]
            c, d = polygon[j], polygon[(j + 1) % count]
            if side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0:
                return True
    return False


@settings(derandomize=True, deadline=None, max_examples=50)
@given(SEEDS, st.integers(3, 12), st.floats(0.0, 0.5))
def test_crossings_are_those_that_all_pairs_show(seed: int, count: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * np.arange(count) / count
    polygon = np.column_stack([np.cos(turn), np.sin(turn)]) + noise * rng.normal(size=(count, 2))
    assert crosses_itself(polygon) == _crosses_plainly(polygon)


def test_a_polygon_that_touches_itself_meets_itself(three_lobes: Callable[..., Floats]) -> None:
    touching = np.array([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2.0]])
    assert crosses_itself(touching)
    assert not crosses_itself(SQUARE)
    assert not crosses_itself(three_lobes(0.9))
    assert crosses_itself(SQUARE[[0, 2, 1, 3]])


@pytest.mark.parametrize("scale", [1e-200, 1e-9, 1.0, 1e200])
def test_vertices_that_come_twice_are_no_touch(scale: float) -> None:
    closed = scale * np.vstack([SQUARE, SQUARE[:1]])
    assert not crosses_itself(closed)
    assert not crosses_itself(np.repeat(closed, 3, axis=0))
    assert crosses_itself(closed[[0, 2, 1, 3, 0]])
    assert not crosses_itself(np.zeros((9, 2)))


@pytest.mark.parametrize("count", [33, 64, 65, 1000])
def test_one_crossing_among_many_edges_is_found_wherever_it_is(count: int) -> None:
    turn = 2 * np.pi * np.arange(count) / count
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    assert not crosses_itself(circle)
    for place in range(0, count, max(count // 33, 1)):
        crossed = np.roll(circle, place, axis=0)
        crossed[[5, 6]] = crossed[[6, 5]]
        assert crosses_itself(crossed)


def test_no_polygon_and_what_is_not_finite_are_refused() -> None:
    origin, nan = np.zeros((1, 2)), np.full((1, 2), math.nan)
    for measure in (signed_area, area_centroid):
        with pytest.raises(ValueError, match="polygon must have at least 1 vertex, got 0"):
            measure(np.zeros((0, 2)))
    with pytest.raises(ValueError, match="polygon must be finite"):
        crosses_itself(nan)
    for relate in (edge_distance, winding_number):
        with pytest.raises(ValueError, match="polygon must have at least 1 vertex, got 0"):
            relate(np.zeros((0, 2)), origin)
        with pytest.raises(ValueError, match="points must be finite"):
            relate(SQUARE, nan)
    with pytest.raises(ValueError, match="second must be finite"):
        angle_between(SQUARE[1], nan)
    with pytest.raises(ValueError, match=r"first must have shape \(..., 2\), got \(3,\)"):
        turn_between(np.zeros(3), SQUARE[1])
    with pytest.raises(ValueError, match=r"first must have shape \(..., 2\) or \(..., 3\)"):
        angle_between(np.zeros(4), np.zeros(4))
