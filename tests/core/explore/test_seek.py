from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.aim import DEEP_PRESS, MOST_TILT, PRESS, UPRIGHT, Aim, Stance
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.routine import Done, resume
from palpate.core.explore.seek import LEAST_ARC, Target, seek, settled
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.pad import Pad

Found = tuple[Felt | None, Stance]


PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)


def felt_of(slope: float, arc: int = 0, above: int = 0, below: int = 9, rise: float = 0.0) -> Felt:
    points, normals = np.zeros((arc, 3)), np.tile([1.0, 0.0, 0.0], (arc, 1))
    nearest = np.array([0.03, 0.0, rise])
    flat = np.zeros(arc)
    return Felt(points, normals, flat, flat, flat, slope, nearest, nearest, above, below)


def search(felt: list[Felt | None], stance: Stance = UPRIGHT) -> Aim | Done[Found]:
    place: Floats = np.array([0.03, 0.0])
    return resume(lambda: seek(Cut(PAD, 0.0), stance, Target(place, 0.0, 3e-3, 3e-3)), felt)


def test_an_arc_at_the_first_touch_ends_the_search() -> None:
    found = search([felt_of(0.0, arc=5)])
    assert isinstance(found, Done)
    felt, stance = found.result
    assert felt is not None
    assert stance == UPRIGHT


def test_a_miss_ends_the_search_with_nothing() -> None:
    found = search([None])
    assert isinstance(found, Done)
    assert found.result == (None, UPRIGHT)


@pytest.mark.parametrize("height", [0.014, 0.02, -0.02])
def test_a_pad_beside_the_slice_walks_to_it(
    height: float, finger: Any, flat: Pad, ball: Superquadric
) -> None:
    hand, target = finger(ball, flat), Target(np.array([0.03, 0.0]), 0.0, 14e-3, 30e-3)
    felt: list[Felt | None] = []
    while True:
        found = resume(lambda: seek(Cut(flat, height), UPRIGHT, target), felt)
        if isinstance(found, Done):
            break
        assert len(felt) < 8
        felt.append(hand.answer(found, height))
    arc, stance = found.result
    assert arc is not None
    assert len(arc.points) >= LEAST_ARC
    assert np.allclose(arc.points[:, 2], height, atol=1e-16)
    assert np.allclose(np.linalg.norm(arc.points, axis=1), 0.03, atol=10e-6)
    assert 0.3 < stance.tilt / math.asin(height / 0.03) < 1.2


def test_a_bridge_is_searched_with_deep_touches_until_one_feels_an_arc() -> None:
    bridged = felt_of(0.0, above=20, below=20)
    aim = search([bridged])
    assert isinstance(aim, Aim)
    assert aim.stance.depth == DEEP_PRESS
    assert aim.stance.frozen
    found = search([bridged, None, felt_of(0.0, arc=3)])
    assert isinstance(found, Done)
    assert found.result[1].frozen


def test_a_search_that_finds_nothing_says_so_and_is_shorter_after_three() -> None:
    bridged = felt_of(0.0, above=20, below=20)
    lengths = []
    for failed in range(5):
        felt: list[Felt | None] = [bridged]
        stance = UPRIGHT._replace(failed_searches=failed)
        while not isinstance(found := search(felt, stance), Done):
            felt.append(None)
        assert found.result == (bridged, stance._replace(failed_searches=failed + 1))
        lengths.append(len(felt) - 1)
    assert lengths == [9, 9, 9, 3, 3]


def test_a_frozen_stance_is_kept_while_it_works() -> None:
    frozen = Stance(0.3, 6e-3, DEEP_PRESS, frozen=True)
    aim = search([], frozen)
    assert isinstance(aim, Aim)
    assert aim.stance == frozen
    found = search([felt_of(0.9, arc=4)], frozen)
    assert isinstance(found, Done)
    assert found.result[1] == frozen
    again = search([felt_of(0.0)], frozen)
    assert isinstance(again, Aim)
    assert again.stance.depth == PRESS


@pytest.mark.parametrize("slope", [-50.0, 50.0])
def test_the_pad_is_never_tilted_beyond_its_limit(slope: float) -> None:
    stance = UPRIGHT._replace(tilt=-math.copysign(MOST_TILT, slope))
    assert abs(settled(stance, felt_of(slope)).tilt) == MOST_TILT
    aim = search([felt_of(slope, rise=0.02)])
    assert isinstance(aim, Aim)
    assert abs(aim.stance.tilt) <= MOST_TILT


def test_a_small_slope_leaves_the_tilt_alone_and_a_larger_one_is_followed_in_part() -> None:
    assert settled(UPRIGHT, felt_of(0.03)) == UPRIGHT
    tilted = settled(UPRIGHT, felt_of(0.5)).tilt
    assert -math.atan(0.5) < tilted < -0.5 * math.atan(0.5)
    frozen = UPRIGHT._replace(frozen=True)
    assert settled(frozen, felt_of(0.5)) == frozen
