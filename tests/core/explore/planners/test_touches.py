"""Single touches: where they can be made, which is made, and when it is over."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from palpate.core.explore.planners import (
    ALL_REACHED,
    Height,
    Stop,
    Touch,
    Touches,
    Wait,
    WrongChoiceError,
    check_choice,
)
from palpate.core.explore.planners.coverage import estimate_error
from palpate.core.explore.planners.surface import ObservedSurface, Progress, pad_gaps
from palpate.core.explore.planners.touches import has_settled
from palpate.core.geometry.meshes import close_rings
from palpate.core.poses import pose_of, split_pose
from palpate.core.shapes import Mesh
from palpate.core.shapes.tessellations import icosphere
from palpate.core.touch import Pad

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=6e-3, dome=0.0, saturation=0.5)
RADIUS, MIDDLE = 0.03, np.array([0.0, 0.0, 0.05])


@pytest.fixture
def ball_of(observation):
    """What is known of a ball over a platform, by errors and distances as functions of places."""

    def known(errors=lambda at: 0.0, distances=lambda at: 1e-3, observed=None, **changes):
        directions, faces = icosphere(4)
        places = MIDDLE + RADIUS * directions
        each = np.array([errors(at) for at in places])
        fields = {
            "mesh": Mesh(places, faces),
            "errors": each,
            "bounds": 1.6 * each,
            "distances": np.array([distances(at) for at in places]),
            "pad": PAD,
            "platform": 0.0,
            "reach": 0.12,
            "refused": np.zeros((0, 3)),
        } | changes
        surface = ObservedSurface(**fields)
        return observation(surface=surface, general=True, tolerance=2e-4, **(observed or {}))

    return known


def towards(side):
    """Errors of 1 mm within 12 mm of one side of the ball."""
    place = MIDDLE + RADIUS * np.asarray(side, float)
    return lambda at: 1e-3 if np.linalg.norm(at - place) < 12e-3 else 1e-5


@pytest.mark.parametrize("side", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_the_next_touch_goes_where_the_error_is(ball_of, side):
    choice = Touches().next(ball_of(towards(side)))
    assert isinstance(choice, Touch)
    position, axes = split_pose(choice.pose)
    assert axes[:, 2] @ np.array(side) < -0.6
    hit = MIDDLE + RADIUS * np.array(side)
    assert np.linalg.norm(choice.target - hit) < 13e-3
    assert 3e-3 < np.linalg.norm(position - MIDDLE) - RADIUS < 25e-3


def test_no_finger_meets_the_pedestal_on_which_the_object_stands(ball_of):
    low = ball_of(towards((0, 0, -1)), platform=0.022)  # on all of it that lies lower
    rim = RADIUS * np.sqrt(1.0 - ((MIDDLE[2] - 0.022) / RADIUS) ** 2)
    turn, depth = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 60), np.linspace(0.0, 0.03, 60))
    pedestal = [rim * np.cos(turn), rim * np.sin(turn), 0.022 - depth]
    assert low.surface.offers
    for offer in low.surface.offers:
        position, axes = split_pose(offer.pose)
        away = (np.stack(pedestal, axis=-1) - position) @ axes
        assert not ((np.abs(away[..., :2]) < 8e-3).all(axis=-1) & (away[..., 2] < 0.0)).any()


def test_what_faces_down_beside_the_pedestal_is_touched_from_below(ball_of):
    choice = Touches().next(ball_of(towards((0.8, 0.0, -0.6)), platform=MIDDLE[2] - RADIUS))
    assert isinstance(choice, Touch)
    assert split_pose(choice.pose)[1][2, 2] > 0.3
    assert choice.target[2] < MIDDLE[2]


def test_what_was_touched_in_vain_is_not_touched_again(ball_of):
    errors = towards((1, 0, 0))
    first = Touches().next(ball_of(errors))
    place = MIDDLE + RADIUS * np.array([1.0, 0.0, 0.0])
    around = icosphere(2)[0] * 10e-3 + place
    refused = np.concatenate([place[None], around, first.target[None]])
    again = Touches().next(ball_of(errors, refused=refused))
    assert isinstance(again, Stop) or np.linalg.norm(again.target - first.target) > 5e-3


def test_what_lies_far_from_touch_is_touched_though_the_error_is_within_tolerance(ball_of):
    away = lambda at: 12e-3 if at[0] > 0.8 * RADIUS else 1e-3  # noqa: E731
    far = ball_of(lambda at: 1e-5, away)
    choice = Touches().next(far)
    assert isinstance(choice, Touch)
    assert "nothing near to it was touched" in choice.reason
    assert choice.target[0] > 0.5 * RADIUS
    assert not estimate_error(far).reached


def test_it_is_over_when_all_is_known(ball_of):
    known = ball_of(lambda at: 1e-5)
    choice = Touches().next(known)
    assert isinstance(choice, Stop)
    assert choice.reason == ALL_REACHED
    estimate = estimate_error(known)
    assert estimate.reached
    assert estimate.rms_bound_95 == pytest.approx(1.6e-5)


def test_an_opening_that_a_pad_spanned_is_known_to_be_unknown(ball_of):
    top = MIDDLE + [0.0, 0.0, RADIUS]
    mouth = top + 1e-3 * np.array([[x, y, 0.0] for x in (-2, 0, 2) for y in (-2, 0, 2)])
    away = lambda at: 3e-3 if np.linalg.norm(at - top) < 5e-3 else 1e-3  # noqa: E731
    known = ball_of(lambda at: 1e-5, away, openings=mouth)
    choice, estimate = Touches().next(known), estimate_error(known)
    assert isinstance(choice, Stop)
    assert [one.name for one in estimate.verdict.failed] == ["error bound", "unentered hole"]
    assert estimate.findings.unentered_hole == pytest.approx(6e-3, rel=0.1)
    assert estimate.rms_bound_95 > 1e-4  # what it may hide counts
    assert np.linalg.norm(estimate.open_area.places[0] - top) < 5e-3
    touched = ball_of(lambda at: 1e-5, openings=mouth)  # since then, all of it
    assert estimate_error(touched).reached


def test_the_underside_counts_though_nobody_can_touch_it(ball_of):
    lying = ball_of(lambda at: 1e-2 if at[2] < 0.0205 else 1e-5, platform=MIDDLE[2] - RADIUS)
    choice = Touches().next(lying)
    assert isinstance(choice, Stop)
    failed = {one.name: one for one in estimate_error(lying).verdict.failed}
    assert set(failed) == {"error bound", "underside error"}
    assert failed["underside error"].value > 1e-3 > failed["underside error"].limit


def test_a_pad_reaches_all_of_a_ball_and_rests_on_the_rim_of_a_hollow():
    directions = icosphere(5)[0]
    gaps = pad_gaps(PAD, 0.05 * directions, 0.05 * directions[:9], directions[:9])
    assert gaps == pytest.approx(np.zeros(9), abs=1e-12)
    turn, away = np.meshgrid(np.linspace(0.0, 6.0, 12), [2e-3, 4e-3, 6e-3, 7.99e-3])
    rings = away * np.cos(turn), away * np.sin(turn), -np.sqrt(0.1**2 - away**2)
    hollow = np.stack(rings, axis=-1).reshape(-1, 3)
    bottom, up = np.array([[0.0, 0.0, -0.1]]), np.array([[0.0, 0.0, 1.0]])
    sag = 0.1 - np.sqrt(0.1**2 - 8e-3**2)
    assert pad_gaps(PAD, hollow, bottom, up) == pytest.approx([sag], rel=0.02)
    domed = replace(PAD, dome=10.0)  # as round as the hollow
    assert pad_gaps(domed, hollow, bottom, up) == pytest.approx([0.0], abs=0.02 * sag)


def test_what_the_solid_lacks_counts_though_it_is_no_place_of_it(ball_of):
    surface = ball_of(lambda at: 1e-4).surface
    whole = replace(surface, missing=3e-3).rms_bound_95
    assert whole == pytest.approx(np.hypot(surface.rms_bound_95, 3e-3))


@pytest.mark.parametrize(("under", "goes_on"), [(0.3e-3, True), (3e-3, False)])
def test_touches_make_up_for_what_none_can_reach_where_that_leaves_room(ball_of, under, goes_on):
    def errors(at):
        return under if at[2] < 0.024 else 1.2e-4  # whose bound is 0.19 of 0.2 mm

    surface = ball_of(errors, platform=0.024).surface
    none = np.zeros((0, 3))
    limit, share = surface.touchable_limit(none, 2e-4), surface.touchable_bound(none)
    assert surface.rms_bound_95 > 2e-4 > share
    assert (share > limit) == goes_on
    if goes_on:  # with the touchable part at that limit, the whole is within tolerance
        rest = surface.rms_bound_95**2 - share**2 * surface._touchable(none).mean()
        whole = rest + limit**2 * surface._touchable(none).mean()
        assert whole == pytest.approx(2e-4**2)
    assert isinstance(Touches().next(ball_of(errors, platform=0.024)), Touch) == goes_on


def test_what_a_crease_may_hide_counts_though_no_pad_reaches_it(observation):
    turn, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 96)[:-1], np.linspace(0.01, 0.09, 81))
    radius = 0.01 + 0.5 * np.abs(height - 0.05)  # an hourglass
    rings = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=-1)
    places, faces = close_rings(np.array([0.0, 0.0, 0.01]), rings, np.array([0.0, 0.0, 0.09]))
    waist = np.abs(places[:, 2] - 0.05)
    known = ObservedSurface(
        mesh=Mesh(places, faces),
        errors=np.full(len(places), 1e-5),
        bounds=np.full(len(places), 2e-5),
        distances=np.where(waist < 4e-3, 4e-3 - waist, 0.5e-3),
        pad=PAD,
        platform=None,
        reach=0.12,
        refused=np.zeros((0, 3)),
    )
    creased = known.creased
    assert (np.abs(known.places.points[creased, 2] - 0.05) < 4e-3).all()
    assert 0.01 < creased.mean() < 0.2
    assert known.bound_of(creased) > 0.35e-3 > 2e-5 > 0.9 * known.touchable_bound(np.zeros((0, 3)))
    seen = observation(surface=known, general=True, tolerance=1e-4)
    choice = Touches().next(seen)
    assert isinstance(choice, Stop)
    failed = {one.name for one in estimate_error(seen).verdict.failed}
    assert failed == {"error bound", "crease error"}


def test_without_a_solid_a_slice_comes_first(observation):
    choice = Touches().next(observation())
    assert isinstance(choice, Height)
    assert isinstance(Touches().next(observation(busy_heights=(0.04,))), Wait)


def progress_of(bounds, each=10, opened=0.0):
    return [Progress(each * (i + 1), bound, opened) for i, bound in enumerate(bounds)]


def test_touches_that_change_nothing_are_the_last():
    assert not has_settled([])
    assert not has_settled(progress_of([3e-3, 2e-3, 1e-3]))
    assert not has_settled(progress_of([3e-3, 2e-3, 1e-3, 1e-3]))
    assert has_settled(progress_of([3e-3, 2e-3, 1e-3, 1e-3, 1e-3, 1e-3]))
    falling = progress_of([3e-3, 2e-3, 1e-3, 0.9e-3, 0.8e-3, 0.7e-3])
    assert not has_settled(falling)


def test_touches_end_where_the_error_goes_up_and_down_but_never_below_what_it_was():
    swaying = [3e-3, 2e-3, 1e-3, *([1.4e-3, 1e-3] * 12)]
    assert not has_settled(progress_of(swaying[:10]))
    assert has_settled(progress_of(swaying))
    assert not has_settled(progress_of([*swaying, 0.8e-3]))
    opened = progress_of(swaying)[:-1]
    assert not has_settled([one._replace(open=0.5) for one in opened] + progress_of(swaying)[-1:])


def test_touches_go_on_while_less_stays_open():
    steady = [Progress(10 * (i + 1), 1e-3, 0.2 - 0.03 * i) for i in range(6)]
    assert not has_settled(steady)


def test_exploration_ends_when_it_has_settled(ball_of):
    earlier = tuple(progress_of([5e-4] * 8))
    known = ball_of(lambda at: 3.2e-4, earlier=earlier, touches=90)
    choice = Touches().next(known)
    assert isinstance(choice, Stop)
    assert "no longer lower the error" in choice.reason
    assert not estimate_error(known).reached


@dataclass(frozen=True)
class Says:
    """A planner with one answer."""

    choice: Any

    def next(self, observation):
        return self.choice


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (MIDDLE, r"must begin outside the object, got \(0, 0, 0\.05\) m"),
        (
            MIDDLE + [0.2, 0.0, 0.0],
            r"must begin within 0\.12 m of the axis, got \(0\.2, 0, 0\.05\)",
        ),
        (MIDDLE * -4.0, r"must begin no lower than 0\.12 m below the platform, got -0\.2 m"),
    ],
)
def test_a_touch_that_no_finger_can_make_is_refused(ball_of, place, words):
    asked = Touch(pose_of(place, np.eye(3)), 0.01, MIDDLE, "")
    with pytest.raises(WrongChoiceError, match=words):
        check_choice(Says(asked), ball_of())
    free = asked._replace(pose=pose_of(MIDDLE + [0.1, 0.0, 0.0], np.eye(3)))
    assert check_choice(Says(free), ball_of()) is free
