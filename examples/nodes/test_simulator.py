"""The simulator by itself: a goal of the finger in, a frame of its array out."""

import numpy as np

from palpate.messages.types import TactileFrame, TouchGoal
from palpate.nodes import simulator
from palpate.testing import drive, example, messages_on

BALL = {"sphere": {"radius": 0.03}, "pose": {"position": [0.0, 0.0, 0.03]}}


def touch(depth: float) -> TactileFrame:
    pose = np.array([0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0])  # position, then quaternion x, y, z, w
    goal = example(TouchGoal, finger=1, pose=pose, reach=0.1, depth=depth)
    published = drive(simulator.NODE, [("/finger/goal", goal)], {"object": BALL})
    [frame] = messages_on(published, "/touch/raw")
    return frame


def test_pad_is_compressed_by_the_depth_of_the_goal():
    for depth in (0.5e-3, 1.0e-3):
        frame = touch(depth)
        assert frame.outcome == "hit"
        # The ball is 60 mm high; the pad's face ends below its top by the depth.
        assert abs(frame.pose[2] - (0.06 - depth)) < 30e-6


def test_echo_returns_sooner_where_the_pad_is_compressed():
    times = touch(1.0e-3).array
    assert times.shape == (16, 16)
    middle, corner = times[7:9, 7:9].mean(), times[0, 0]
    assert abs((corner - middle) - 2 * 1.0e-3 / 1000.0) < 0.1e-6  # there and back at 1,000 m/s
