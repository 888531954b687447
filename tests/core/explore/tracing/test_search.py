import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.contour_path import (
    DEEP_TOUCH_DEPTH,
    MOST_TILT,
    TOUCH_DEPTH,
    UPRIGHT,
    Posture,
    ProcedureResult,
    SliceArc,
    SliceSpec,
    TouchCommand,
    resume,
)
from palpate.core.explore.tracing.search import (
    AZIMUTHS,
    LEAST_ARC,
    Target,
    next_posture,
    search_arc,
    search_first_arc,
)
from palpate.core.touch.pad import Pad


def first_arc(finger, shape, pad, height):
    """The start of a contour, and the number of touches that it took."""
    hand = finger(shape, pad)
    measured = []
    for _ in range(150):
        found = resume(lambda: search_first_arc(SliceSpec(pad, height), np.zeros(2), 0.1), measured)
        if isinstance(found, ProcedureResult):
            return found.result, len(measured)
        measured.append(hand.answer(found, height))
    raise AssertionError("begin does not end")


def test_one_touch_is_enough_where_the_side_is_upright(finger, flat, ball, box):
    for shape in (ball, box):
        start, touches = first_arc(finger, shape, flat, 0.0)
        assert touches == 1
        assert start.heading == 0.0


@pytest.mark.parametrize("share", [-0.9, -0.6, 0.6, 0.9])
def test_off_the_equator_the_pad_tilts_until_it_lies_against_the_surface(
    share, finger, flat, domed, ball
):
    for pad in (flat, domed):
        start, touches = first_arc(finger, ball, pad, 0.03 * share)
        assert len(start.arc.points) >= LEAST_ARC
        assert np.allclose(start.arc.points[:, 2], 0.03 * share, atol=1e-16)
        assert touches <= 7
        if not start.posture.frozen:
            assert abs(start.arc.slope) < 0.12
            assert start.posture.tilt == pytest.approx(math.asin(share), abs=0.12)


@pytest.mark.parametrize("share", [0.25, 0.33, -0.33])
def test_a_first_arc_that_is_touched_askew_is_touched_once_more_and_no_oftener(
    share, finger, domed, ball
):
    start, touches = first_arc(finger, ball, domed, 0.03 * share)
    assert touches == 2
    assert start.posture.tilt == pytest.approx(math.asin(share), abs=0.02)


def test_later_tilts_follow_the_slope_without_overshooting(finger, domed, ball):
    hand, tilts = finger(ball, domed), []
    measured = []
    while isinstance(
        aim := resume(
            lambda: search_first_arc(SliceSpec(domed, 0.018), np.zeros(2), 0.1), measured
        ),
        TouchCommand,
    ):
        tilts.append(aim.posture.tilt)
        measured.append(hand.answer(aim, 0.018))
    assert tilts == sorted(tilts)
    assert max(tilts) < math.asin(0.6)


def test_an_object_that_is_not_there_is_sought_from_every_side(finger, flat, ball):
    start, touches = first_arc(finger, ball, flat, 0.2)
    assert start == "no_contact"
    assert touches == len(AZIMUTHS)


def test_the_first_approach_comes_from_the_radius_and_goes_to_the_centre(flat):
    aim = resume(lambda: search_first_arc(SliceSpec(flat, 0.05), np.array([0.01, -0.02]), 0.1), ())
    assert np.allclose(aim.start(0.05)[:3], [0.11, -0.02, 0.05])
    assert aim.travel == pytest.approx(0.1)
    after = [
        resume(lambda: search_first_arc(SliceSpec(flat, 0.0), np.zeros(2), 0.1), [None] * n)
        for n in range(8)
    ]
    headings = [aim.heading for aim in after if isinstance(aim, TouchCommand)]
    assert headings == list(AZIMUTHS)


@pytest.mark.parametrize("above", [1e-3, 5e-3])
def test_one_touch_from_above_tells_that_the_object_ends_below_the_slice(
    above, finger, flat, domed, ball, box
):
    for pad in (flat, domed):
        for shape in (ball, box):
            found, touches = first_arc(finger, shape, pad, shape.size[2] + above)
            assert found == "pole"
            assert touches <= 20


def test_a_slice_below_everything_that_is_touched_is_occluded(finger, flat, ball):
    found, _ = first_arc(finger, ball, flat, -0.032)
    assert found == "occluded"


PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)


def measured_of(slope, arc=0, above=0, below=9, rise=0.0):
    points, normals = np.zeros((arc, 3)), np.tile([1.0, 0.0, 0.0], (arc, 1))
    nearest = np.array([0.03, 0.0, rise])
    flat = np.zeros(arc)
    return SliceArc(points, normals, flat, flat, flat, slope, nearest, nearest, above, below)


def search(measured, posture=UPRIGHT):
    place: Floats = np.array([0.03, 0.0])
    return resume(
        lambda: search_arc(SliceSpec(PAD, 0.0), posture, Target(place, 0.0, 3e-3, 3e-3)), measured
    )


def test_an_arc_at_the_first_touch_ends_the_search():
    found = search([measured_of(0.0, arc=5)])
    assert isinstance(found, ProcedureResult)
    measured, posture = found.result
    assert measured is not None
    assert posture == UPRIGHT


def test_a_miss_ends_the_search_with_nothing():
    found = search([None])
    assert isinstance(found, ProcedureResult)
    assert found.result == (None, UPRIGHT)


@pytest.mark.parametrize("height", [0.014, 0.02, -0.02])
def test_a_pad_beside_the_slice_walks_to_it(height, finger, flat, ball):
    hand, target = finger(ball, flat), Target(np.array([0.03, 0.0]), 0.0, 14e-3, 30e-3)
    measured = []
    while True:
        found = resume(lambda: search_arc(SliceSpec(flat, height), UPRIGHT, target), measured)
        if isinstance(found, ProcedureResult):
            break
        assert len(measured) < 8
        measured.append(hand.answer(found, height))
    arc, posture = found.result
    assert len(arc.points) >= LEAST_ARC
    assert np.allclose(arc.points[:, 2], height, atol=1e-16)
    assert np.allclose(np.linalg.norm(arc.points, axis=1), 0.03, atol=10e-6)
    assert 0.3 < posture.tilt / math.asin(height / 0.03) < 1.2


def test_a_bridge_is_searched_with_deep_touches_until_one_feels_an_arc():
    bridged = measured_of(0.0, above=20, below=20)
    aim = search([bridged])
    assert aim.posture.depth == DEEP_TOUCH_DEPTH
    assert aim.posture.frozen
    found = search([bridged, None, measured_of(0.0, arc=3)])
    assert isinstance(found, ProcedureResult)
    assert found.result[1].frozen


def test_a_search_that_finds_nothing_says_so_and_is_shorter_after_three():
    bridged = measured_of(0.0, above=20, below=20)
    lengths = []
    for failed in range(5):
        measured = [bridged]
        posture = UPRIGHT._replace(failed_searches=failed)
        while not isinstance(found := search(measured, posture), ProcedureResult):
            measured.append(None)
        assert found.result == (bridged, posture._replace(failed_searches=failed + 1))
        lengths.append(len(measured) - 1)
    assert lengths == [9, 9, 9, 3, 3]


def test_a_frozen_stance_is_kept_while_it_works():
    frozen = Posture(0.3, 6e-3, DEEP_TOUCH_DEPTH, frozen=True)
    aim = search([], frozen)
    assert aim.posture == frozen
    found = search([measured_of(0.9, arc=4)], frozen)
    assert isinstance(found, ProcedureResult)
    assert found.result[1] == frozen
    again = search([measured_of(0.0)], frozen)
    assert again.posture.depth == TOUCH_DEPTH


@pytest.mark.parametrize("slope", [-50.0, 50.0])
def test_the_pad_is_never_tilted_beyond_its_limit(slope):
    posture = UPRIGHT._replace(tilt=-math.copysign(MOST_TILT, slope))
    assert abs(next_posture(posture, measured_of(slope)).tilt) == MOST_TILT
    aim = search([measured_of(slope, rise=0.02)])
    assert abs(aim.posture.tilt) <= MOST_TILT


def test_a_small_slope_leaves_the_tilt_alone_and_a_larger_one_is_followed_in_part():
    assert next_posture(UPRIGHT, measured_of(0.03)) == UPRIGHT
    tilted = next_posture(UPRIGHT, measured_of(0.5)).tilt
    assert -math.atan(0.5) < tilted < -0.5 * math.atan(0.5)
    frozen = UPRIGHT._replace(frozen=True)
    assert next_posture(frozen, measured_of(0.5)) == frozen
