from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import DOWN, compose, pose_of
from palpate.core.measure.robot_time import contact_seconds
from palpate.core.touch.cast import advanced, one_ray_each
from palpate.core.touch.pad import press
from palpate.core.touch.touch import Finger, Touch

MakeFinger = Callable[..., Finger]
MakeTouch = Callable[..., Touch]


def test_a_touch_holds_what_the_press_was(make_finger: MakeFinger, make_touch: MakeTouch) -> None:
    finger, touch = make_finger(), make_touch()
    end = press(touch.shape, finger.pad, touch.actual, touch.reach, touch.depth)
    one_ray_each(finger, touch)
    assert (touch.outcome, touch.advance) == ("hit", end.advance)
    assert np.array_equal(touch.compression, end.compression)
    assert np.array_equal(touch.indentation, end.indentation)
    assert np.array_equal(touch.actual, end.pose)


def test_pressure_is_the_force_of_each_taxel_over_its_area(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    finger, touch = make_finger(pitch=0.9e-3), make_touch()
    one_ray_each(finger, touch)
    force = touch.pressure * finger.pad.pitch**2
    assert np.allclose(force, finger.calibration.taxel_stiffness * touch.compression, rtol=1e-14)


def test_the_arm_believes_to_have_gone_as_far_as_it_went(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    finger = make_finger()
    elsewhere = pose_of(np.array([0.01, 0.02, 0.04]), DOWN)
    touch = make_touch(believed=elsewhere)
    one_ray_each(finger, touch)
    assert np.allclose(touch.believed[:3], elsewhere[:3] - [0.0, 0.0, touch.advance], atol=1e-16)
    assert np.array_equal(touch.believed[3:], elsewhere[3:])


def test_a_pose_advances_along_its_own_axis(rotations: Callable[[int], Floats]) -> None:
    for axes in rotations(5):
        pose = pose_of(np.array([0.1, -0.2, 0.3]), axes)
        way = np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 1.0])
        assert np.allclose(advanced(pose, 0.02)[:3], compose(pose, way)[:3], atol=1e-16)


def test_times_of_a_hit_add_up_to_that_of_the_move(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    finger, touch = make_finger(), make_touch(begun=5.0, previous=4.0)
    one_ray_each(finger, touch)
    robot = finger.robot
    assert touch.loading == pytest.approx(touch.depth / robot.approach)
    assert touch.dwell == robot.dwell
    assert touch.time == 5.0 + contact_seconds(robot, touch.advance)
    way_back = touch.advance / robot.retract + robot.overhead
    whole = touch.rest + touch.loading + touch.dwell + way_back
    assert whole == pytest.approx(touch.time - touch.previous, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "outcome"),
    [({"reach": 1e-3}, "miss"), ({"actual": pose_of(np.zeros(3), DOWN)}, "inside")],
)
def test_a_pad_that_met_nothing_rested_all_the_while(
    given: dict[str, object], outcome: str, make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    finger, touch = make_finger(), make_touch(begun=5.0, previous=4.0, **given)
    one_ray_each(finger, touch)
    assert touch.outcome == outcome
    assert (touch.loading, touch.dwell) == (0.0, 0.0)
    travel = touch.advance / finger.robot.approach
    assert touch.rest == pytest.approx(1.0 + travel + finger.robot.overhead)


def test_a_bottomed_pad_was_pressed_only_to_its_saturation(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    finger, touch = make_finger(), make_touch(depth=2.9e-3)
    one_ray_each(finger, touch)
    assert touch.outcome == "bottomed"
    assert touch.loading == pytest.approx(0.8 * 3e-3 / finger.robot.approach)
