"""A hand with ideal or disturbed fingertips, and contacts of whatever it closes on."""

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.hand import Closing, Hand, close_hand, next_pose, search_pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.touch.pad import Calibration
from palpate.core.touch.pipeline import Fingertip, assemble

PLACES = [np.array([x, y]) for x, y in ((0.0, 0.0), (0.04, 0.0), (-0.04, 0.0), (0.0, 0.04))]


@pytest.fixture
def fingers_of(flat):
    """Fingertips of a hand, the palm last, with these effects."""

    def make(hand, *effects, seed=3):
        sheet = Calibration("time", flat.thickness, 1000.0, 0.2e3)
        return [
            assemble(Fingertip(flat, sheet, ROBOT_PRESETS["modern"], 100 + i, seed), effects)
            for i in range(hand.fingers + 1)
        ]

    return make


@pytest.fixture
def close(fingers_of):
    """One closing of a fresh hand about a shape."""

    def closed(shape, pose, hand, *effects, **more):
        fingers = fingers_of(hand, *effects)
        states = [one.begin() for one in fingers]
        platform, number = more.get("platform", -1.0), more.get("number", 0)
        when = Closing(number, 0.0, 0.0)
        return close_hand(shape, fingers, states, hand, pose, platform, when)[0]

    return closed


@pytest.fixture
def grasped(fingers_of):
    """At least so many contacts of a shape that stands on height 0, and their normals."""

    def collect(shape, wanted, *effects):
        hand = Hand()
        fingers = fingers_of(hand, *effects)
        states = tuple(one.begin() for one in fingers)
        points, normals, number = np.zeros((0, 3)), np.zeros((0, 3)), 0
        while len(points) < wanted:
            assert number < 40
            if len(points):
                pose: Floats | None = next_pose(hand, points, normals, 0.0)
            else:
                pose = search_pose(PLACES, number, 0.0)
            assert pose is not None
            when = Closing(number, 0.0, 0.0)
            grasp, states = close_hand(shape, fingers, states, hand, pose, 0.0, when)
            points = np.vstack([points, grasp.points])
            normals = np.vstack([normals, grasp.normals])
            number += 1
        return points, normals

    return collect
