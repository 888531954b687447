from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core import ROBOT_PRESETS
from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, pose_of, split_pose, transform_points
from palpate.messages.codec import encode
from palpate.messages.types.motion import (
    Contour,
    ContourGoal,
    FingerClock,
    Probe,
    ProbeGoal,
    TouchGoal,
)
from palpate.messages.types.world import SensorInfo, World
from palpate.nodes import curvature, filter, simulator, tracer
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.tracer import Params, State, know_sensor, know_world, take_goal, take_patch


def contour_goal(**changes: Any) -> ContourGoal:
    fields: dict[str, Any] = {
        "id": 0,
        "finger": 1,
        "frame": IDENTITY_POSE,
        "height": 0.03,
        "centre": np.zeros(2),
        "radius": 0.1,
        "not_before": 0.0,
    }
    return ContourGoal(**{**fields, **changes})


def probe_goal(**changes: Any) -> ProbeGoal:
    fields: dict[str, Any] = {
        "id": 1,
        "finger": 1,
        "pose": pose_of(np.array([0.0, 0.0, 0.1]), FACING_DOWN),
        "reach": 0.1,
        "not_before": 0.0,
    }
    return ProbeGoal(**{**fields, **changes})


@pytest.fixture
def ready(info: SensorInfo) -> State:
    state, _ = know_sensor(Params(), State(), info)
    return state


class Finger:
    """The sensing nodes, one behind the other, as plain calls."""

    def __init__(self, spec: ObjectSpec, info: SensorInfo) -> None:
        self.params = simulator.Params(object=spec)
        self.state, _ = simulator.start(self.params)
        self.received, _ = filter.calibrate(filter.Params(), None, info)
        self.felt, _ = curvature.know_sensor(curvature.Params(), None, info)

    def touch(self, goal: TouchGoal) -> Any:
        self.state, [(_, frame)] = simulator.touch(self.params, self.state, goal)  # type: ignore
        _, [(_, image)] = filter.take_frame(filter.Params(), self.received, frame)  # type: ignore
        _, [(_, patch)] = curvature.on_image(curvature.Params(), self.felt, image)  # type: ignore
        return patch


@pytest.fixture
def finger(ball: ObjectSpec, info: SensorInfo) -> Finger:
    return Finger(ball, info)


def followed(state: State, outputs: Any, finger: Finger, **params: Any) -> Iterator[Any]:
    """Everything that the tracer says until it asks for no more touches."""
    while outputs:
        published = dict(outputs)
        yield from (message for topic, message in outputs if topic != "/finger/goal")
        if "/finger/goal" not in published:
            return
        patch = finger.touch(published["/finger/goal"])
        state, outputs = take_patch(Params(**params), state, patch)


def test_a_contour_of_a_ball_closes_on_the_ball(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, contour_goal(height=0.04))
    [contour] = followed(state, outputs, finger)
    assert isinstance(contour, Contour)
    assert encode(contour)
    assert contour.status == "closed"
    assert np.abs(contour.points[:, 2] - 0.04).max() < 1e-12
    off = np.linalg.norm(contour.points - [0, 0, 0.03], axis=1) - 0.03
    # Linear interpolation between rows stands off by pitch^2 / (8 R) = 4.2 um.
    assert np.abs(off).max() < 6e-6
    outward = (contour.points - [0, 0, 0.03]) / 0.03
    assert np.abs(contour.normals - outward).max() < 0.01
    assert contour.touches <= 30


def test_a_contour_in_a_tilted_frame_is_traced_in_it(ready: State, finger: Finger):
    half = np.radians(20.0) / 2
    frame = np.array([0.0, 0.0, 0.03, np.sin(half), 0.0, 0.0, np.cos(half)])
    state, outputs = take_goal(Params(), ready, contour_goal(frame=frame, height=0.01))
    [contour] = followed(state, outputs, finger)
    assert contour.status == "closed"
    normal = np.array([0.0, -np.sin(2 * half), np.cos(2 * half)])
    assert np.abs((contour.points - [0, 0, 0.03]) @ normal - 0.01).max() < 1e-12


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.6, 0.64, 0.48)])
def test_a_frame_that_is_turned_with_the_object_changes_no_touch(
    axis: tuple[float, float, float], ready: State, info: SensorInfo
):
    half = np.radians(25.0) / 2
    turn = np.concatenate([np.sin(half) * np.array(axis), [np.cos(half)]])
    frame = np.concatenate([[0.03, -0.02, 0.11], turn])
    shape = SuperquadricSpec(size=(0.03, 0.02, 0.04), exponents=(0.3, 0.6))
    contours = []
    for pose in (IDENTITY_POSE, frame):
        where = PoseSpec(position=tuple(pose[:3].tolist()), rotation=tuple(pose[3:].tolist()))
        finger = Finger(ObjectSpec(superquadric=shape, pose=where), info)
        state, outputs = take_goal(Params(), ready, contour_goal(frame=pose, height=0.008))
        contours += followed(state, outputs, finger)
    aligned, turned = contours
    assert aligned.status == turned.status == "closed"
    assert aligned.touches == turned.touches
    assert np.allclose(transform_points(frame, aligned.points), turned.points, rtol=0, atol=1e-9)
    axes = split_pose(frame)[1]
    assert np.allclose(aligned.normals @ axes.T, turned.normals, rtol=0, atol=1e-6)
    assert np.allclose(aligned.contact_low, turned.contact_low, rtol=0, atol=1e-9)
    assert np.allclose(aligned.contact_high, turned.contact_high, rtol=0, atol=1e-9)


def test_a_contour_tells_how_far_up_and_down_it_was_touched(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, contour_goal(height=0.035))
    [contour] = followed(state, outputs, finger)
    assert contour.contact_low.shape == contour.contact_high.shape == (len(contour.points),)
    assert (contour.contact_low <= 0.035).all()
    assert (contour.contact_high >= 0.035).all()
    assert np.median(contour.contact_high - contour.contact_low) > 4e-3


def test_touches_are_counted_from_0_without_gaps(ready: State, finger: Finger):
    numbers = []
    state, outputs = take_goal(Params(), ready, contour_goal())
    while "/finger/goal" in dict(outputs):  # type: ignore[arg-type]
        goal = dict(outputs)["/finger/goal"]  # type: ignore[arg-type]
        numbers.append(goal.touch)
        state, outputs = take_patch(Params(), state, finger.touch(goal))
    [(_, contour)] = outputs  # type: ignore[misc]
    assert numbers == list(range(contour.touches))


def test_a_slice_above_the_object_has_no_contact(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, contour_goal(height=0.1))
    [contour] = followed(state, outputs, finger)
    assert (contour.status, len(contour.points)) == ("no_contact", 0)


def test_a_contour_is_given_up_when_its_touches_are_spent(ready: State, finger: Finger):
    params = Params(most_touches=10)
    state, outputs = take_goal(params, ready, contour_goal())
    [contour] = followed(state, outputs, finger, most_touches=10)
    assert contour.status == "budget"
    assert contour.touches <= 11


def test_a_probe_finds_the_top(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, probe_goal())
    [probe] = followed(state, outputs, finger)
    assert isinstance(probe, Probe)
    assert (probe.id, probe.outcome, probe.touches) == (1, "hit", 1)
    # The taxels nearest to the pole lie half a pitch beside it, both ways.
    assert probe.point[2] == pytest.approx(0.06 - 0.5e-3**2 / 0.03, abs=1e-7)
    assert probe.normal == pytest.approx([0, 0, 1], abs=1e-6)


def test_a_probe_beside_the_object_reports_the_end_of_its_reach(ready: State, finger: Finger):
    goal = probe_goal(pose=pose_of(np.array([0.2, 0.0, 0.1]), FACING_DOWN))
    state, outputs = take_goal(Params(), ready, goal)
    [probe] = followed(state, outputs, finger)
    assert probe.outcome == "miss"
    assert probe.point == pytest.approx([0.2, 0.0, 0.0], abs=1e-12)


def test_goals_wait_for_each_other(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, probe_goal())
    state, nothing = take_goal(Params(), state, contour_goal())
    assert nothing == []
    probe, contour = followed(state, outputs, finger)
    assert (probe.id, contour.status) == (1, "closed")


def test_the_same_patch_twice_gives_the_same_answer(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, contour_goal())
    for _ in range(6):
        patch = finger.touch(dict(outputs)["/finger/goal"])  # type: ignore[arg-type]
        again = take_patch(Params(), state, patch)[1]
        state, outputs = take_patch(Params(), state, patch)
        assert [encode(m) for _, m in again] == [encode(m) for _, m in outputs]  # type: ignore


def test_a_patch_that_nobody_asked_for_is_refused(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, probe_goal())
    patch = finger.touch(dict(outputs)["/finger/goal"])  # type: ignore[arg-type]
    state, _ = take_patch(Params(), state, patch)
    with pytest.raises(ValueError, match="nobody asked for touch 0 of goal 1"):
        take_patch(Params(), state, patch)


def test_a_touch_that_starts_inside_is_repeated_from_farther_away(ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, contour_goal(radius=0.025))
    first = dict(outputs)["/finger/goal"]  # type: ignore[arg-type]
    patch = finger.touch(first)
    assert patch.outcome == "inside"
    _, [(_, second)] = take_patch(Params(), state, patch)  # type: ignore[misc]
    moved = np.linalg.norm(second.pose[:2]) - np.linalg.norm(first.pose[:2])
    assert moved == pytest.approx(tracer.BACK_OFF * 15e-3)


@pytest.mark.parametrize("over", [1e-3, 5e-3])
def test_a_slice_over_the_pole_tells_so(over: float, ready: State, finger: Finger):
    state, outputs = take_goal(Params(), ready, contour_goal(height=0.06 + over))
    [contour] = followed(state, outputs, finger)
    assert (contour.status, len(contour.points)) == ("pole", 0)


TWO = World(platform=0.0, reach=0.15, fingers=2, seed=0)


def test_a_goal_for_another_finger_is_left_to_it(ready: State):
    state, _ = know_world(Params(), ready, TWO)
    for goal in (contour_goal(finger=2), probe_goal(finger=2)):
        assert take_goal(Params(), state, goal) == (state, [])
        assert dict(take_goal(Params(finger=2), state, goal)[1]).keys() == {"/finger/goal"}  # type: ignore[arg-type]


@pytest.mark.parametrize(("finger", "most"), [(0, 1), (2, 1), (3, 2)])
def test_a_goal_for_a_finger_that_is_not_there_is_refused(finger: int, most: int, ready: State):
    state = ready if most == 1 else know_world(Params(), ready, TWO)[0]
    with pytest.raises(ValueError, match=f"goal 0 is for finger {finger}; .* are 1 to {most}"):
        take_goal(Params(), state, contour_goal(finger=finger))


def test_where_there_are_several_fingers_each_touch_tells_the_time(ready: State, finger: Finger):
    state, _ = know_world(Params(), ready, TWO)
    state, outputs = take_goal(Params(), state, probe_goal())
    patch = finger.touch(dict(outputs)["/finger/goal"])  # type: ignore[arg-type]
    published = dict(take_patch(Params(), state, patch)[1])  # type: ignore[arg-type]
    clock = published["/finger/clock"]
    assert isinstance(clock, FingerClock)
    assert (clock.finger, clock.robot_time) == (1, patch.robot_time)
    assert published["/probe/traced"].robot_time == patch.robot_time


def traced(ready: State, finger: Finger, goal: ContourGoal | ProbeGoal) -> Any:
    [found] = followed(*take_goal(Params(), ready, goal), finger)
    return found


def test_a_contour_takes_no_more_touches_than_its_goal_allows(ready: State, finger: Finger):
    whole = traced(ready, finger, contour_goal())
    assert whole.status == "closed"
    for most in (0, 7):
        cut = traced(ready, finger, contour_goal(most_touches=most))
        assert (cut.status, cut.touches) == ("budget", most)


def test_no_touch_ends_later_than_its_goal_allows(ready: State, world: World, finger: Finger):
    robot = ROBOT_PRESETS["modern"].array
    timed, _ = know_world(Params(), ready, replace(world, robot=robot))
    for most in (16.0, 20.0):
        cut = traced(timed, finger, contour_goal(radius=0.06, not_after=most))
        assert cut.status == "budget"
        assert 0.7 * most < cut.robot_time < most
        finger.state = replace(finger.state, clock=0.0)
    late = traced(timed, finger, probe_goal(not_after=3.0))
    assert (late.touches, late.outcome, late.robot_time) == (0, "miss", 0.0)
    assert traced(timed, finger, probe_goal(not_after=30.0)).touches == 1


def test_a_gap_between_touches_saves_some_of_them(ready: State, finger: Finger):
    dense = traced(ready, finger, contour_goal())
    sparse = traced(ready, finger, contour_goal(gap=4e-3))
    assert sparse.status == "closed"
    assert sparse.touches < 0.85 * dense.touches
    step = np.linalg.norm(np.diff(sparse.points, axis=0), axis=1).max()
    assert 2e-3 < step < 2.1e-3 + 1.6 * 4e-3
