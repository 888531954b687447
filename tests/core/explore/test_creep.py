from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from palpate.core.explore.aim import DEEP_PRESS
from palpate.core.explore.creep import STEEPEST, WAYS, creeping
from palpate.core.explore.cut import Cut
from palpate.core.frames import split_pose
from palpate.core.touch.pad import Pad

ENDS = np.array([[0.03, -0.004, 0.0], [0.03, 0.004, 0.0]])
"""Of a hollow in a wall that looks along x."""


def walls(angle: float) -> Any:
    """Normals of two walls that lead into it, so steep."""
    return np.array([[math.cos(angle), side * math.sin(angle), 0.0] for side in (1.0, -1.0)])


def leading_edge(pad: Pad, aim: Any, number: int) -> Any:
    """Where the pad's edge comes that is set into the hollow, (2,), m."""
    place, axes = split_pose(aim.start(0.0))
    edge = place + (1.0 if number == 0 else -1.0) * 7.5e-3 * axes[:, 0]
    return edge[:2] + aim.standoff * axes[:2, 2]


def test_each_way_is_tried_at_both_ends_with_the_deepest_press(flat: Pad) -> None:
    aims = creeping(Cut(flat, 0.0), ENDS, walls(0.7))
    assert len(aims) == 2 * len(WAYS)
    assert {aim.stance.depth for aim in aims} == {DEEP_PRESS}
    assert flat.saturation * flat.thickness > DEEP_PRESS


def test_an_edge_comes_down_the_wall_beyond_its_last_felt_point(flat: Pad) -> None:
    first, last = creeping(Cut(flat, 0.0), ENDS, walls(0.7))[:2]
    for number, aim, side in ((0, first, 1.0), (1, last, -1.0)):
        assert aim.heading == pytest.approx(side * 0.9 * 0.7)
        beyond = leading_edge(flat, aim, number) - ENDS[number, :2]
        assert np.linalg.norm(beyond) == pytest.approx(0.22 * 15e-3)
        into = np.array([-math.sin(0.7), side * math.cos(0.7)])
        assert beyond @ into == pytest.approx(0.22 * 15e-3)


def test_the_pads_body_stays_outside_the_hollow(flat: Pad) -> None:
    for number, aim in enumerate(creeping(Cut(flat, 0.0), ENDS, walls(0.7))[:2]):
        edge, middle = leading_edge(flat, aim, number), aim.place
        assert middle[0] > edge[0]
        assert abs(middle[1]) > abs(edge[1])


def test_corners_come_first_where_the_pad_is_tilted(flat: Pad) -> None:
    for aim, way in zip(creeping(Cut(flat, 0.0), ENDS, walls(0.7))[::2], WAYS, strict=True):
        assert aim.stance.tilt == way.tilt
        assert aim.stance.shift == pytest.approx(7e-3 * float(np.sign(way.tilt)))


def test_no_edge_is_set_beyond_the_middle_of_a_narrow_gap(flat: Pad) -> None:
    narrow = 0.25 * ENDS + 0.75 * ENDS.mean(axis=0)
    for number, aim in enumerate(creeping(Cut(flat, 0.0), narrow, walls(0.0))[:2]):
        assert leading_edge(flat, aim, number)[1] == pytest.approx(0.0, abs=1e-12)


def test_a_pad_is_never_turned_along_the_chord(flat: Pad) -> None:
    first = creeping(Cut(flat, 0.0), ENDS, walls(3.0))[0]
    assert first.heading == pytest.approx(STEEPEST)


@pytest.mark.parametrize("scale", [0.3, 3.0])
def test_lengths_go_by_the_width_of_the_array(scale: float, flat: Pad) -> None:
    pad = Pad(16, 16, scale * flat.pitch, flat.thickness, 0.0, flat.saturation)
    one = creeping(Cut(flat, 0.0), ENDS, walls(0.5))[0]
    other = creeping(Cut(pad, 0.0), scale * ENDS, walls(0.5))[0]
    assert np.allclose(other.place, scale * one.place)
    assert other.standoff == pytest.approx(scale * one.standoff)
