import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.core.poses import pose_of
from palpate.core.touch.effects.arm import PoseError

TOUCHES = 4000


@pytest.fixture
def start(rotations):
    return pose_of(np.array([0.1, -0.2, 0.3]), rotations(1)[0])


@pytest.fixture
def errors(make_finger, make_touch, start):
    """Shift, m, and rotation vector, rad, of many touches in the pad's frame, (n, 6)."""

    def collect(effect, touches=TOUCHES, **finger):
        stage, found = effect.prepare(make_finger(**finger)), []
        axes = Rotation.from_quat(start[3:])
        for number in range(touches):
            touch = make_touch(number, believed=start, actual=start)
            stage.apply(touch, stage.state)
            shift = axes.inv().apply(touch.actual[:3] - start[:3])
            turn = (axes.inv() * Rotation.from_quat(touch.actual[3:])).as_rotvec()
            found.append([*shift, *turn])
        return np.array(found)

    return collect


def test_each_axis_has_the_asked_deviation_and_no_mean(errors):
    found = errors(PoseError(sigma=0.2e-3, rotation=0.1))
    sigma = np.repeat([0.2e-3, math.radians(0.1)], 3)
    assert (np.abs(found.mean(axis=0)) < 5 * sigma / np.sqrt(TOUCHES)).all()
    assert (np.abs(found.var(axis=0) / sigma**2 - 1.0) < 5 * np.sqrt(2 / TOUCHES)).all()


def test_neither_axes_nor_touches_are_correlated(errors):
    found = errors(PoseError(sigma=0.2e-3, rotation=0.1))
    scaled = found / np.repeat([0.2e-3, math.radians(0.1)], 3)
    across = scaled.T @ scaled / TOUCHES - np.diag(scaled.var(axis=0))
    later = scaled[1:].T @ scaled[:-1] / TOUCHES
    assert np.abs(across - np.diag(np.diag(across))).max() < 5 / np.sqrt(TOUCHES)
    assert np.abs(later).max() < 5 / np.sqrt(TOUCHES)


def test_large_turns_are_rotations_by_the_drawn_vector(errors, make_finger):
    # The draws do not depend on the strength, so a large turn is a multiple of a small one.
    small = errors(PoseError(rotation=0.01), 50)
    large = errors(PoseError(rotation=10.0), 50)
    assert np.allclose(large[:, 3:], 1000 * small[:, 3:], rtol=1e-9, atol=0.0)
    assert np.allclose(large[:, :3], small[:, :3], rtol=1e-10, atol=1e-16)


def test_arm_does_not_know_and_poses_stay_of_unit_length(make_finger, make_touch, start):
    stage = PoseError(rotation=10.0).prepare(make_finger())
    for number in range(20):
        touch = make_touch(number, believed=start, actual=start)
        stage.apply(touch, None)
        assert np.array_equal(touch.believed, start)
        assert abs(np.linalg.norm(touch.actual[3:]) - 1.0) < 4e-16


def test_a_bias_is_the_same_in_every_touch_and_another_in_every_run(errors):
    effect = PoseError(sigma=0.0, rotation=0.0, bias=1e-3)
    found = errors(effect, 5)
    assert np.allclose(found, found[0], atol=1e-16)
    runs = np.array([errors(effect, 1, seed=seed)[0, :3] for seed in range(300)]).ravel()
    assert abs(runs.mean()) < 5e-3 / np.sqrt(runs.size)
    assert abs(runs.var() / 1e-6 - 1.0) < 5 * np.sqrt(2 / runs.size)


def test_a_bias_does_not_change_the_other_draws(errors):
    biased, unbiased = errors(PoseError(bias=1e-3), 20), errors(PoseError(), 20)
    differences = (biased - unbiased)[:, :3]
    assert np.allclose(differences, differences[0], atol=1e-15)
    assert np.allclose(biased[:, 3:], unbiased[:, 3:], atol=1e-15)
