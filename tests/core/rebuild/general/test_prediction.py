import numpy as np
import pytest

from palpate.core.rebuild.general.solid import (
    DistanceErrors,
    FootErrors,
    open_factors,
    protrusions,
)

NEAR = np.array([0.0, 1e-3, 2.5e-3])
ERRORS = DistanceErrors(
    np.array([0.0, 2e-3, 4e-3]), np.array([1e-5, 3e-5, 9e-5]), np.array([2e-5, 5e-5, 2e-4]), 5e-5
)


def test_errors_follow_the_checked_distances_and_grow_with_the_distance_beyond():
    assert ERRORS.at(np.array([2e-3, 3e-3])) == pytest.approx([3e-5, 6e-5])
    assert ERRORS.at(np.array([4e-3]), upper=True) == pytest.approx([2e-4])
    assert ERRORS.at(np.array([14e-3])) == pytest.approx([9e-5 + 5e-3])


def test_where_nothing_was_checked_the_error_is_half_the_distance():
    none = DistanceErrors(np.zeros(0), np.zeros(0), np.zeros(0), 0.0)
    assert none.at(NEAR) == pytest.approx(0.5 * NEAR)


def test_bounds_grow_with_the_distance_from_touch_and_not_without_end():
    factors = open_factors(np.array([0.0, 2.5e-3, 5e-3, 0.1, 1.0]))
    assert factors == pytest.approx([1.0, 2.0, 3.0, 4.5, 4.5])


def test_an_underside_may_lean_however_well_its_walls_go_on():
    foot = FootErrors(5e-3, 0.0)
    assert foot.at(np.array([0.0, 5e-3])) == pytest.approx([0.0, 0.0])
    assert foot.bounds(np.zeros(1), np.array([20e-3])) == pytest.approx([1e-3])


def test_below_the_lowest_touches_errors_grow_as_the_square_of_the_way_down():
    foot = FootErrors(4e-3, 8e-4)
    assert foot.at(np.array([4e-3, 2e-3, 0.0])) == pytest.approx([0.0, 2e-4, 8e-4])
    assert foot.bounds(np.array([0.0]), np.zeros(1)) == pytest.approx([2e-3])


def test_what_reaches_beyond_all_that_was_touched_is_found():
    touched = np.random.default_rng(0).normal(size=(4000, 3))
    touched *= 0.03 / np.linalg.norm(touched, axis=1)[:, None]
    places = np.array([[0.0, 0.0, 0.02], [0.0, 0.035, 0.0], [0.05, 0.0, 0.0]])
    assert protrusions(touched, places) == pytest.approx([0.0, 5e-3, 2e-2], abs=2e-4)
    assert protrusions(touched[:2], places) == pytest.approx(np.zeros(3))


def test_points_in_a_plane_or_on_a_line_have_a_hull_too():
    plane = np.indices((9, 9, 1)).reshape(3, -1).T * 5e-3
    above = np.array([[0.02, 0.02, 4e-3]])
    assert protrusions(plane, above) == pytest.approx([4e-3], abs=1e-5)
    assert protrusions(plane[:9], above)[0] > 3e-3
