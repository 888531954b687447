from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.core.shapes.global_deformations import Bend, Taper, clip_to_bent_box


def test_it_widens_the_top_and_narrows_the_bottom_in_proportion_to_the_height():
    taper = Taper(0.4, -0.2, half_height=0.05)
    points = np.array([[0.01, 0.02, z] for z in (-0.05, 0.0, 0.025, 0.05)])
    moved = taper(points)
    assert np.allclose(moved[:, 0], 0.01 * np.array([0.6, 1.0, 1.2, 1.4]))
    assert np.allclose(moved[:, 1], 0.02 * np.array([1.2, 1.0, 0.9, 0.8]))
    assert np.array_equal(moved[:, 2], points[:, 2])


def test_no_taper_moves_nothing():
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert np.array_equal(Taper(0.0, 0.0, 1.0)(points), points)


@pytest.mark.parametrize("share", [0.0, 0.4, -0.7, 0.999, -0.999, 1 - 1e-9])
def test_it_can_be_undone_below_1(share):
    points = np.random.default_rng(0).uniform(-2, 2, (200, 3))
    taper = Taper(share, -share, 1.0)
    assert np.allclose(taper.inverse(taper(points)), points, rtol=1e-15, atol=0)


def test_beyond_the_ends_the_widths_are_those_of_the_ends():
    moved = Taper(0.5, -0.5, 1.0)(np.array([[1.0, 1.0, 3.0], [1.0, 1.0, -3.0]]))
    assert moved.tolist() == [[1.5, 0.5, 3.0], [0.5, 1.5, -3.0]]


@pytest.mark.parametrize("share", [1.0, -1.0, 1.5, math.nan])
def test_a_taper_that_collapses_a_section_is_refused(share):
    with pytest.raises(ValueError, match=rf"taper must lie between -1 and 1, got \[{share}, 0.0\]"):
        Taper(share, 0.0, 1.0)
    with pytest.raises(ValueError, match=rf"taper must lie between -1 and 1, got \[0.0, {share}\]"):
        Taper(0.0, share, 1.0)


CURVATURES = [0.0, 1e-310, 1e-300, 1e-200, 1e-16, 1e-12, 1e-9, 1e-3, 0.1, 0.6, -0.6]
POINTS = np.random.default_rng(0).uniform(-1, 1, (500, 3))


def test_the_axis_becomes_an_arc_of_the_same_length():
    heights = np.linspace(-2.0, 2.0, 100_001)
    axis = np.column_stack([0 * heights, 0 * heights, heights])
    arc = Bend(0.5)(axis)
    length = float(np.linalg.norm(np.diff(arc, axis=0), axis=1).sum())
    assert length == pytest.approx(4.0, abs=1e-9)
    assert np.allclose(np.linalg.norm(arc - [2.0, 0.0, 0.0], axis=1), 2.0, rtol=0, atol=1e-14)
    assert arc[-1] == pytest.approx([2 * (1 - math.cos(1)), 0.0, 2 * math.sin(1)], abs=1e-15)


def test_both_ends_move_towards_the_direction_and_away_for_a_negative_curvature():
    ends = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    for direction in (0.0, 1.0, 2.5, -2.0):
        towards = np.array([math.cos(direction), math.sin(direction)])
        for curvature in (0.4, -0.4):
            moved = Bend(curvature, direction)(ends)
            wanted = np.outer([1, 1], towards) * (1 - math.cos(0.4)) / curvature
            assert np.allclose(moved[:, :2], wanted, rtol=0, atol=1e-15)


def test_points_beyond_the_axis_keep_their_side():
    """With an arc tangent of y / x the point at x < 0 would go to the other side."""
    moved = Bend(0.5)(np.array([[-0.4, 0.0, 0.3], [0.4, 0.0, 0.3]]))
    rise = (1 - math.cos(0.15)) / 0.5
    assert moved[:, 0] == pytest.approx([rise - 0.4 * math.cos(0.15), rise + 0.4 * math.cos(0.15)])


@pytest.mark.parametrize("curvature", CURVATURES)
@pytest.mark.parametrize("direction", [0.0, 1.0, -2.5])
def test_it_can_be_undone_however_small_it_is(curvature, direction):
    bend = Bend(curvature, direction)
    assert np.allclose(bend.inverse(bend(POINTS)), POINTS, rtol=0, atol=2e-15)


@pytest.mark.parametrize("curvature", [0.0, 1e-310, 1e-300, 1e-200, 1e-16])
def test_a_bend_of_next_to_nothing_moves_next_to_nothing(curvature):
    assert np.allclose(Bend(curvature, 0.7)(POINTS), POINTS, rtol=0, atol=4e-16)


@pytest.mark.parametrize("curvature", [1e-9, 1e-6, 1e-4])
def test_a_small_bend_moves_by_the_first_term_of_its_series(curvature):
    moved = Bend(curvature)(POINTS)
    x, y, z = POINTS.T
    wanted = np.column_stack([x + curvature * z * z / 2, y, z - curvature * x * z])
    assert np.allclose(moved, wanted, rtol=0, atol=curvature**2 + 3e-16)


def test_it_keeps_the_volume_of_what_is_symmetric():
    bend, step = Bend(0.6, 0.4), 1e-6
    columns = [
        (bend(POINTS + step * axis) - bend(POINTS - step * axis)) / (2 * step) for axis in np.eye(3)
    ]
    inwards = POINTS[:, :2] @ bend.towards
    wanted = 1.0 - 0.6 * inwards  # the fibres' length
    assert np.allclose(np.linalg.det(np.stack(columns, axis=2)), wanted, atol=1e-9)


@given(
    curvature=st.floats(-0.99, 0.99),
    direction=st.floats(-7, 7),
    taper=st.tuples(st.floats(-0.95, 0.95), st.floats(-0.95, 0.95)),
    point=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
)
def test_taper_then_bend_is_undone_by_unbend_then_untaper(
    curvature: float,
    direction: float,
    taper: tuple[float, float],
    point: tuple[float, float, float],
) -> None:
    bend, tapering, points = Bend(curvature, direction), Taper(*taper, 0.5), np.array([point])
    back = tapering.inverse(bend.inverse(bend(tapering(points))))
    assert np.allclose(back, points, rtol=0, atol=1e-13)


def test_the_other_order_gives_another_solid():
    bend, taper = Bend(0.6), Taper(0.5, 0.5, 1.0)
    assert not np.allclose(bend(taper(POINTS)), taper(bend(POINTS)), atol=0.1)


def test_the_centre_of_curvature_has_an_inverse_too():
    back = Bend(0.5).inverse(np.array([[2.0, 0.3, 0.0]]))
    assert np.array_equal(back, [[2.0, 0.3, 0.0]])


@pytest.mark.parametrize("curvature", [0.5, -0.5])
def test_points_beyond_the_centre_are_refused(curvature):
    centre = 1 / curvature
    Bend(curvature)(np.array([[0.999 * centre, 0.0, 0.0], [-9 * centre, 0.0, 0.0]]))
    words = rf"a bend of {curvature} 1/m has its centre 2 m from the axis: .* got 2.5 m"
    with pytest.raises(ValueError, match=words):
        Bend(curvature)(np.array([[1.25 * centre, 0.0, 0.0]]))
    with pytest.raises(ValueError, match="got 2 m"):
        Bend(curvature)(np.array([[centre, 0.0, 0.0]]))


def test_heights_at_which_the_circle_closes_are_refused():
    Bend(-0.5)(np.array([[0.0, 0.0, 6.28]]))
    words = "a bend of -0.5 1/m closes the circle 6.28 m above and below the middle: .* got 6.3 m"
    with pytest.raises(ValueError, match=words):
        Bend(-0.5)(np.array([[0.0, 0.0, -6.3]]))


@pytest.mark.parametrize(("curvature", "direction"), [(math.nan, 0.0), (1.0, math.inf)])
def test_what_is_not_finite_is_refused(curvature, direction):
    words = f"finite curvature and direction, got {curvature} 1/m and {direction} rad"
    with pytest.raises(ValueError, match=words):
        Bend(curvature, direction)


HALF = np.array([0.02, 0.015, 0.05])
WAYS = np.linspace(0.0, 0.6, 1201)


@pytest.mark.parametrize(
    "curvature", [0.0, 1e-300, 1e-16, 1e-3, 8.0, -8.0, 31.0, 32.0, 45.0, -49.0]
)
def test_rays_are_in_the_box_just_where_they_are_when_it_is_straightened(curvature):
    rng = np.random.default_rng(2)
    bend = Bend(curvature)
    for number in range(60):
        direction = rng.normal(size=3)
        direction[rng.random(3) < 0.15 * (number % 3)] = 0.0
        if not direction.any():
            continue
        direction /= np.linalg.norm(direction)
        origins = rng.uniform(-0.06, 0.06, (30, 3))
        origins[:2] = np.zeros(3), [1 / curvature if abs(curvature) > 1 else 0.02, 0.0, 0.0]
        starts, ends, gaps = clip_to_bent_box(origins.T, direction, HALF, curvature)
        told = (starts[:, None] <= WAYS) & (ends[:, None] >= WAYS)
        for begin, end in gaps:
            told &= ~((begin[:, None] < WAYS) & (end[:, None] > WAYS))
        places = origins[:, None] + WAYS[None, :, None] * direction
        straight = bend.inverse(places.reshape(-1, 3)).reshape(places.shape)
        depth = (1.0 - np.abs(straight) / HALF).min(axis=2)
        clear = np.abs(depth) > 1e-9
        assert np.array_equal(told[clear], depth[clear] > 0)


@pytest.mark.parametrize("curvature", [8.0, 40.0])
def test_no_two_gaps_of_a_ray_meet_unless_they_are_one(curvature):
    rng = np.random.default_rng(3)
    origins = rng.uniform(-0.1, 0.1, (200, 3))
    gaps = clip_to_bent_box(origins.T, np.array([0.6, 0.0, 0.8]), HALF, curvature)[2]
    assert len(gaps) == (1 if curvature * HALF[2] < math.pi / 2 else 2)
    first, second = gaps[0], gaps[-1]
    same = (first[0] == second[0]) & (first[1] == second[1])
    assert (same | (first[1] < second[0]) | (second[1] < first[0])).all()
