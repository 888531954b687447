"""The arm's errors of pose, its backlash and its compliance."""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.core.arrays import Floats
from palpate.core.poses import Pose, rotations_from_vectors
from tests.core.touch.touches import above, applied, finger, stage, touch

TOUCHES, WIDTH = 2000, 0.2e-3
TURNS = rotations_from_vectors(np.random.default_rng(5).normal(size=(5, 3)))
START = Pose(np.array([0.1, -0.2, 0.3]), TURNS[0])


def errors(touches: int, seed: int = 7, **parameters: float) -> Floats:
    """Shift [m] and rotation vector [rad] of many touches in the pad's frame, (n, 6)."""
    made, result = stage("pose_error", finger(seed=seed), **parameters), []
    axes = Rotation.from_matrix(START.axes).inv()
    for number in range(touches):
        contact = touch(number, believed=START, actual=START)
        made.apply(contact, None)
        turn = (axes * Rotation.from_matrix(contact.actual.axes)).as_rotvec()
        result.append([*axes.apply(contact.actual.position - START.position), *turn])
        assert contact.believed is START
        assert np.allclose(contact.actual.axes.T @ contact.actual.axes, np.eye(3), atol=2e-15)
    return np.array(result)


def test_pose_errors_are_white_with_the_given_deviations():
    result = errors(TOUCHES, sigma=0.2e-3, rotation=0.1)
    scaled = result / np.repeat([0.2e-3, math.radians(0.1)], 3)
    assert (np.abs(scaled.mean(axis=0)) < 5 / np.sqrt(TOUCHES)).all()
    covariance, later = scaled.T @ scaled / TOUCHES, scaled[1:].T @ scaled[:-1] / TOUCHES
    assert (np.abs(np.diag(covariance) - 1.0) < 5 * np.sqrt(2 / TOUCHES)).all()
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 5 / np.sqrt(TOUCHES)
    assert np.abs(later).max() < 5 / np.sqrt(TOUCHES)


def test_large_turns_are_rotations_by_the_drawn_vector():
    # The draws do not depend on the strength, so a large turn is a multiple of a small one.
    small, large = errors(50, rotation=0.01), errors(50, rotation=10.0)
    assert np.allclose(large[:, 3:], 1000 * small[:, 3:], rtol=1e-9, atol=0.0)
    assert np.allclose(large[:, :3], small[:, :3], rtol=1e-10, atol=1e-16)


def test_bias_stays_in_a_run_and_changes_no_other_draw():
    alone = errors(5, sigma=0.0, rotation=0.0, bias=1e-3)
    assert np.allclose(alone, alone[0], atol=1e-15)
    difference = errors(20, bias=1e-3) - errors(20)
    assert np.allclose(difference, alone[0], atol=1e-15)
    runs = np.ravel([errors(1, seed, sigma=0.0, bias=1e-3)[0, :3] for seed in range(300)])
    assert abs(runs.mean()) < 5e-3 / np.sqrt(runs.size)
    assert abs(runs.var() / 1e-6 - 1.0) < 5 * np.sqrt(2 / runs.size)


def followed(places: Floats) -> Floats:
    """Where the pad starts if the arm goes to each of these places in turn, (n, 3)."""
    made, result = stage("arm_backlash", width=WIDTH), []
    state = made.state
    for number, place in enumerate(places):
        start = Pose(place, above(0.0).axes)
        contact = touch(number, believed=start, actual=start)
        state = made.apply(contact, state)
        assert np.array_equal(contact.believed.array, start.array) and np.array_equal(
            contact.actual.axes, start.axes
        )
        assert np.array_equal(contact.actual.position, state)
        result.append(contact.actual.position)
    return np.array(result)


def test_backlash_is_hysteresis_loop_of_its_width():
    forth = np.linspace(0.0, 1e-3, 101)
    places = np.zeros((303, 3))
    places[:, 1] = np.concatenate([forth, forth[::-1], forth])
    rising, falling, again = np.split(followed(places)[:, 1], 3)
    # From the middle of the play the pad waits for half of it, then follows half behind; turned
    # back, it waits for all of it.
    assert np.allclose(rising, np.maximum(forth - WIDTH / 2, 0.0), atol=1e-18)
    assert np.allclose(falling, np.minimum(forth[::-1] + WIDTH / 2, rising[-1]), atol=1e-18)
    assert np.allclose(again, np.maximum(forth - WIDTH / 2, falling[-1]), atol=1e-18)


def test_backlash_is_independent_on_each_axis():
    corners = np.array([[0.0, 0, 0], [1, 0, -1], [0.95, 1, -1], [0.2, 0.6, 0], [-1, 0.6, 1]]) * 1e-3
    result = followed(corners)
    assert np.allclose(result[1:3] * 1e3, [[0.9, 0, -0.9], [0.9, 0.9, -0.9]], atol=1e-15)
    steps = np.arange(401) / 100
    slow = np.column_stack([np.interp(steps, np.arange(5), axis) for axis in corners.T])
    assert np.allclose(followed(slow)[::100], result, atol=1e-15)
    places = np.random.default_rng(3).normal(0.0, 0.3e-3, (300, 3))
    assert np.abs(followed(places) - places).max() <= WIDTH / 2 + 1e-18


def test_believed_pose_is_too_deep_by_force_over_stiffness():
    tip, field = finger(pitch=0.8e-3), np.full((16, 16), 1e-4)
    for axes in TURNS:
        end = Pose(np.array([0.01, 0.02, 0.03]), axes)
        for stiffness in (1e3, 1e4, 1e8):
            contact = touch(field=field, pressure=5e7 * field, believed=end, actual=end)
            applied("arm_compliance", contact, tip, stiffness=stiffness)
            bent = 5e3 * (16 * 0.8e-3) ** 2 / stiffness
            moved = contact.believed.position - end.position
            assert np.allclose(moved, bent * axes[:, 2], atol=1e-16)
            assert np.array_equal(contact.believed.axes, end.axes) and np.array_equal(
                contact.actual.array, end.array
            )
