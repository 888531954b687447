import numpy as np
import pytest

from palpate.core.rebuild.general.prediction import DistanceErrors, FootErrors, open_factors

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
    factors = open_factors(np.array([0.0, 4e-3, 8e-3, 0.1, 1.0]))
    assert factors == pytest.approx([1.0, 2.0, 3.0, 3.5, 3.5])


def test_an_underside_may_lean_however_well_its_walls_go_on():
    foot = FootErrors(5e-3, 0.0)
    assert foot.at(np.array([0.0, 5e-3])) == pytest.approx([0.0, 0.0])
    assert foot.bounds(np.zeros(1), np.array([20e-3])) == pytest.approx([1e-3])


def test_below_the_lowest_touches_errors_grow_as_the_square_of_the_way_down():
    foot = FootErrors(4e-3, 8e-4)
    assert foot.at(np.array([4e-3, 2e-3, 0.0])) == pytest.approx([0.0, 2e-4, 8e-4])
    assert foot.bounds(np.array([0.0]), np.zeros(1)) == pytest.approx([2e-3])
