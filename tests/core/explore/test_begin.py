from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from palpate.core.explore.aim import Aim
from palpate.core.explore.begin import AZIMUTHS, NoArc, Start, begin
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.routine import Done, resume
from palpate.core.explore.seek import LEAST_ARC
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.pad import Pad


def first_arc(finger: Any, shape: Shape, pad: Pad, height: float) -> tuple[Start | NoArc, int]:
    """The start of a contour, and the number of touches that it took."""
    hand = finger(shape, pad)
    felt: list[Felt | None] = []
    for _ in range(150):
        found = resume(lambda: begin(Cut(pad, height), np.zeros(2), 0.1), felt)
        if isinstance(found, Done):
            return found.result, len(felt)
        felt.append(hand.answer(found, height))
    raise AssertionError("begin does not end")


def test_one_touch_is_enough_where_the_side_is_upright(
    finger: Any, flat: Pad, ball: Superquadric, box: Superquadric
) -> None:
    for shape in (ball, box):
        start, touches = first_arc(finger, shape, flat, 0.0)
        assert touches == 1
        assert isinstance(start, Start)
        assert start.heading == 0.0


@pytest.mark.parametrize("share", [-0.9, -0.6, 0.6, 0.9])
def test_off_the_equator_the_pad_tilts_until_it_lies_against_the_surface(
    share: float, finger: Any, flat: Pad, domed: Pad, ball: Superquadric
) -> None:
    for pad in (flat, domed):
        start, touches = first_arc(finger, ball, pad, 0.03 * share)
        assert isinstance(start, Start)
        assert len(start.felt.points) >= LEAST_ARC
        assert np.allclose(start.felt.points[:, 2], 0.03 * share, atol=1e-16)
        assert touches <= 7
        if not start.stance.frozen:
            assert abs(start.felt.slope) < 0.12
            assert start.stance.tilt == pytest.approx(math.asin(share), abs=0.12)


@pytest.mark.parametrize("share", [0.25, 0.33, -0.33])
def test_a_first_arc_that_is_felt_askew_is_felt_once_more_and_no_oftener(
    share: float, finger: Any, domed: Pad, ball: Superquadric
) -> None:
    start, touches = first_arc(finger, ball, domed, 0.03 * share)
    assert touches == 2
    assert isinstance(start, Start)
    assert start.stance.tilt == pytest.approx(math.asin(share), abs=0.02)


def test_later_tilts_follow_the_slope_without_overshooting(
    finger: Any, domed: Pad, ball: Superquadric
) -> None:
    hand, tilts = finger(ball, domed), []
    felt: list[Felt | None] = []
    while isinstance(aim := resume(lambda: begin(Cut(domed, 0.018), np.zeros(2), 0.1), felt), Aim):
        tilts.append(aim.stance.tilt)
        felt.append(hand.answer(aim, 0.018))
    assert tilts == sorted(tilts)
    assert max(tilts) < math.asin(0.6)


def test_an_object_that_is_not_there_is_sought_from_every_side(
    finger: Any, flat: Pad, ball: Superquadric
) -> None:
    start, touches = first_arc(finger, ball, flat, 0.2)
    assert start == "no_contact"
    assert touches == len(AZIMUTHS)


def test_the_first_approach_comes_from_the_radius_and_goes_to_the_centre(
    flat: Pad,
) -> None:
    aim = resume(lambda: begin(Cut(flat, 0.05), np.array([0.01, -0.02]), 0.1), ())
    assert isinstance(aim, Aim)
    assert np.allclose(aim.start(0.05)[:3], [0.11, -0.02, 0.05])
    assert aim.travel == pytest.approx(0.1)
    after = [resume(lambda: begin(Cut(flat, 0.0), np.zeros(2), 0.1), [None] * n) for n in range(8)]
    headings = [aim.heading for aim in after if isinstance(aim, Aim)]
    assert headings == list(AZIMUTHS)


@pytest.mark.parametrize("above", [1e-3, 5e-3])
def test_one_touch_from_above_tells_that_the_object_ends_below_the_slice(
    above: float, finger: Any, flat: Pad, domed: Pad, ball: Superquadric, box: Superquadric
) -> None:
    for pad in (flat, domed):
        for shape in (ball, box):
            found, touches = first_arc(finger, shape, pad, shape.size[2] + above)
            assert found == "pole"
            assert touches <= 20


def test_a_slice_below_everything_that_is_felt_is_occluded(
    finger: Any, flat: Pad, ball: Superquadric
) -> None:
    found, _ = first_arc(finger, ball, flat, -0.032)
    assert found == "occluded"
