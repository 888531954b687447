from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.probing.face import FOOT
from palpate.core.explore.probing.known import Probed, Probing
from palpate.core.explore.probing.summit import LEAN, MOST, uphill
from palpate.core.frames import DOWN, pose_of

WIDTH = 0.016


def _touch(place: tuple[float, float], height: float, lean: float = 0.0) -> Probed:
    """A touch of a surface that falls towards x."""
    aim = np.array([*place, height])
    normal: Floats = np.array([math.sin(lean), 0.0, math.cos(lean)])
    return Probed(Probing(pose_of(aim, DOWN), 0.03, "search", aim), "hit", aim, normal)


def test_a_leaning_surface_is_climbed_by_as_much_as_a_pad_feels() -> None:
    touch = _touch((0.01, 0.002), 0.04, lean=0.3)
    place = uphill([touch], [touch], WIDTH)
    assert place is not None
    assert place == pytest.approx([0.01 - FOOT * WIDTH, 0.002])


@pytest.mark.parametrize("lean", [0.0, 0.9 * LEAN])
def test_a_level_surface_is_not_climbed(lean: float) -> None:
    touch = _touch((0.0, 0.0), 0.04, lean)
    assert uphill([touch], [touch], WIDTH) is None


def test_the_highest_touch_tells_the_way() -> None:
    low, high = _touch((0.03, 0.0), 0.03, lean=0.5), _touch((0.0, 0.0), 0.04)
    assert uphill([low, high], [low, high], WIDTH) is None


def test_no_place_is_tried_twice_even_if_it_met_nothing() -> None:
    touch = _touch((0.01, 0.0), 0.04, lean=0.3)
    missed = _touch((0.01 - FOOT * WIDTH, 0.001), 0.04)._replace(outcome="miss")
    assert uphill([touch], [touch, missed], WIDTH) is None


def test_nobody_climbs_for_ever() -> None:
    touches = [_touch((-0.1 * k, 0.0), 0.04 + 0.01 * k, lean=0.3) for k in range(MOST)]
    assert uphill(touches[:-1], touches[:-1], WIDTH) is not None
    assert uphill(touches, touches, WIDTH) is None
