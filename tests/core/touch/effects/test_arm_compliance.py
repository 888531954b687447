import numpy as np
import pytest

from palpate.core.poses import pose_of, split_pose
from palpate.core.touch.effects.arm import ArmCompliance
from palpate.core.touch.pipeline import assemble


def test_the_believed_pose_is_too_deep_by_force_over_stiffness(make_finger, make_touch, rotations):
    finger = make_finger(pitch=0.8e-3)
    stage = ArmCompliance(stiffness=10e3).prepare(finger)
    for axes in rotations(5):
        end = pose_of(np.array([0.01, 0.02, 0.03]), axes)
        touch = make_touch(field=np.full((16, 16), 1e-4), believed=end, actual=end)
        touch.pressure = np.full((16, 16), 5e3)
        stage.apply(touch, None)
        force = 5e3 * (16 * 0.8e-3) ** 2
        moved = split_pose(touch.believed)[0] - end[:3]
        assert np.allclose(moved, force / 10e3 * axes[:, 2], atol=1e-17)
        assert np.array_equal(touch.believed[3:], end[3:])
        assert np.array_equal(touch.actual, end)


def test_the_touch_is_as_with_a_stiff_arm_but_for_what_is_believed(make_finger, make_touch):
    finger = make_finger()
    touches = []
    for effects in ([], [ArmCompliance()]):
        pipeline, touch = assemble(finger, effects), make_touch()
        pipeline.simulate(touch, pipeline.begin())
        touches.append(touch)
    stiff, soft = touches
    assert np.array_equal(stiff.reading, soft.reading)
    assert np.array_equal(stiff.actual, soft.actual)
    # A ball of radius R pressed by d on springs: F = k_A pi R d^2, on a grid nearly so.
    force = finger.stiffness * np.pi * 0.03 * 1e-3**2
    bent = stiff.believed[2] - soft.believed[2]  # the pad looks down
    assert bent == pytest.approx(force / 20e3, rel=0.02)


def test_a_stiffer_arm_bends_less_in_proportion(make_finger, make_touch, dent):
    bent = []
    for stiffness in (1e3, 1e4, 1e8):
        touch = make_touch(field=dent)
        before = touch.believed[2]
        ArmCompliance(stiffness=stiffness).prepare(make_finger()).apply(touch, None)
        bent.append(before - touch.believed[2])
    assert bent[0] == pytest.approx(10 * bent[1])
    assert 0.0 < bent[2] < 1e-6
