"""Tracer node: contours and single touches, with simulator, filter and curvature as plain calls."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from palpate.core.poses import FACING_DOWN, IDENTITY_POSE, Pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.messages import encode, types
from palpate.messages.types import ContourGoal, ProbeGoal, SurfacePatch, World
from palpate.nodes import simulator, tracer
from palpate.nodes.runtime.testing import drive, example, messages_on
from palpate.nodes.simulator import Params
from palpate.nodes.specs.objects import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.specs.sensors import PadSpec, SensorSpec
from tests.nodes.loop import ALONE, INFO, Published, ball_spec, touching

BALL = ball_spec()
MIDDLE = np.array([0.0, 0.0, 0.03])
DOWN = Pose(np.array([0.0, 0.0, 0.1]), FACING_DOWN).array


def contour_goal(**changes: Any) -> ContourGoal:
    fields = {"finger": 1, "frame": IDENTITY_POSE, "height": 0.03, "radius": 0.1}
    return example(ContourGoal, **{**fields, **changes})


def probe_goal(**changes: Any) -> ProbeGoal:
    return example(ProbeGoal, **{"id": 1, "finger": 1, "pose": DOWN, "reach": 0.1, **changes})


def publish(goal: ContourGoal | ProbeGoal, **simulated: Any) -> Published:
    """All that follows from a goal at fresh nodes."""
    topic = "/contour/goal" if isinstance(goal, ContourGoal) else "/probe/goal"
    return touching([(topic, goal)], Params(**{"object": BALL, **simulated}))


def traced(goal: ContourGoal | ProbeGoal, **simulated: Any) -> Any:
    *_, (topic, message) = publish(goal, **simulated)
    assert topic in ("/contour/traced", "/probe/traced")
    return message


@cache
def equator() -> Published:
    return publish(contour_goal())


def test_contour_of_a_ball_closes_on_the_ball():
    contour = traced(contour_goal(height=0.04))
    assert encode(contour) and contour.status == "closed" and contour.touches <= 30
    assert np.abs(contour.points[:, 2] - 0.04).max() < 1e-12
    off = np.linalg.norm(contour.points - MIDDLE, axis=1) - 0.03
    # Linear interpolation between rows stands off by pitch^2 / (8 R) = 4.2 um.
    assert np.abs(off).max() < 6e-6
    assert np.abs(contour.normals - (contour.points - MIDDLE) / 0.03).max() < 0.01
    assert contour.curvature == pytest.approx(np.full(len(contour.points), 1 / 0.03), rel=0.02)
    counts = {len(contour.contact_low), len(contour.contact_high), len(contour.points)}
    assert len(counts) == 1
    assert (contour.contact_low <= 0.04).all() and (contour.contact_high >= 0.04).all()
    assert np.median(contour.contact_high - contour.contact_low) > 4e-3


def test_touches_are_counted_through_and_turn_around_the_object():
    goals, [contour] = (messages_on(equator(), one) for one in ("/finger/goal", "/contour/traced"))
    assert [goal.touch for goal in goals] == list(range(contour.touches))
    frames = messages_on(equator(), "/touch/raw")
    assert contour.robot_time == max(frame.robot_time for frame in frames)
    assert all(goal.direction == pytest.approx([0.0, 0.0, 1.0]) for goal in goals)
    waits = [goal.not_before for goal in goals]
    assert waits == sorted(waits)


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.6, 0.64, 0.48)])
def test_frame_turned_with_the_object_changes_no_touch(axis: tuple[float, float, float]):
    half = np.radians(25.0) / 2
    turn = np.concatenate([np.sin(half) * np.array(axis), [np.cos(half)]])
    frame = np.concatenate([[0.03, -0.02, 0.11], turn])
    solid = SuperquadricSpec(size=(0.03, 0.02, 0.04), exponents=(0.3, 0.6))
    aligned, turned = (
        traced(
            contour_goal(frame=pose, height=0.008),
            object=ObjectSpec(
                superquadric=solid,
                pose=PoseSpec(position=tuple(pose[:3].tolist()), rotation=tuple(pose[3:].tolist())),
            ),
        )
        for pose in (IDENTITY_POSE, frame)
    )
    assert aligned.status == turned.status == "closed" and aligned.touches == turned.touches
    axes = Pose.from_array(frame).axes
    for first, second, off in (
        (Pose.from_array(frame).to_outer(aligned.points), turned.points, 1e-9),
        (aligned.normals @ axes.T, turned.normals, 1e-6),
        (aligned.contact_low, turned.contact_low, 1e-9),
        (aligned.contact_high, turned.contact_high, 1e-9),
    ):
        assert np.allclose(first, second, rtol=0, atol=off)


def test_contour_ends_within_touches_and_robot_time_of_its_goal():
    for most in (0, 7):
        cut = traced(contour_goal(most_touches=most))
        assert (cut.status, cut.touches) == ("budget", most)
    goal = ("/contour/goal", contour_goal(most_touches=20))
    *_, (_, contour) = touching([goal], Params(object=BALL), most_touches=10)
    assert contour.status == "budget" and 10 <= contour.touches <= 11
    for seconds in (16.0, 20.0):
        cut = traced(contour_goal(radius=0.06, not_after=seconds))
        assert cut.status == "budget" and 0.7 * seconds < cut.robot_time < seconds
    late = traced(probe_goal(not_after=3.0))
    assert (late.touches, late.outcome, late.robot_time) == (0, "miss", 0.0)
    assert traced(probe_goal(not_after=30.0)).touches == 1


def test_gap_between_touches_saves_some_of_them():
    [dense] = messages_on(equator(), "/contour/traced")
    sparse = traced(contour_goal(gap=4e-3))
    assert sparse.status == "closed" and sparse.touches < 0.85 * dense.touches
    step = np.linalg.norm(np.diff(sparse.points, axis=0), axis=1).max()
    assert 2e-3 < step < 2.1e-3 + 1.6 * 4e-3


def test_probe_finds_the_top_or_the_end_of_its_reach():
    probe = traced(probe_goal())
    assert (probe.id, probe.outcome, probe.touches) == (1, "hit", 1) and encode(probe)
    # The taxels nearest to the pole lie half a pitch beside it, both ways.
    assert probe.point[2] == pytest.approx(0.06 - 0.5e-3**2 / 0.03, abs=1e-7)
    assert probe.normal == pytest.approx([0, 0, 1], abs=1e-6)
    beside = traced(probe_goal(pose=Pose(np.array([0.2, 0.0, 0.1]), FACING_DOWN).array))
    assert beside.outcome == "miss" and beside.point == pytest.approx([0.2, 0.0, 0.0], abs=1e-12)


def test_fingers_have_clocks_and_errors_of_their_own():
    params = Params(object=BALL, effects={"pose_error": {}}, fingers=2)
    begun = drive(simulator.NODE, params=params)  # the first finger's tells of sensor and world
    goals = [("/contour/goal", contour_goal(finger=number, radius=0.05)) for number in (1, 2)]
    [first] = messages_on(touching(goals[:1], params), "/contour/traced")
    published = touching([*begun, goals[1]], structs.replace(params, finger=2))
    [second] = messages_on(published, "/contour/traced")
    assert [first.finger, second.finger] == [1, 2]
    assert second.robot_time == pytest.approx(first.robot_time, rel=0.2)
    assert first.points[0] != pytest.approx(second.points[0], abs=1e-6)
    clocks = messages_on(published, "/finger/clock")
    assert [clock.finger for clock in clocks] == [2] * second.touches
    assert clocks[-1].robot_time == second.robot_time


@pytest.mark.parametrize(
    ("width", "domed", "exponent"),
    [(0.005, True, 1.0), (0.04, False, 0.1), *(
        pytest.param(width, domed, exponent, marks=pytest.mark.slow)
        for width, domed, exponent in ((0.005, False, 0.1), (0.04, True, 1.0), (0.04, True, 0.1))
    )],
)  # fmt: skip
def test_narrowest_and_widest_array_close_contours(width: float, domed: bool, exponent: float):
    sensor = SensorSpec(pitch=width / 15, pad=PadSpec(radius=width if domed else None))
    solid = SuperquadricSpec(size=(0.035, 0.03, 0.04), exponents=(exponent, exponent))
    goal = contour_goal(height=0.01, radius=0.07)
    assert traced(goal, object=ObjectSpec(superquadric=solid), sensor=sensor).status == "closed"


@pytest.mark.parametrize("effects", [{"transport": {"duplicate": 0.5, "drop": 0.3}}, {"creep": {}}])
def test_lossy_link_and_lazy_pad_do_not_stop_the_loop(effects: dict[str, Any]):
    assert traced(contour_goal(radius=0.05), effects=effects).status == "closed"


def test_filter_saves_a_contour_from_impulses():
    salty = Params(object=BALL, effects={"salt_and_pepper": {"rate": 0.02}})
    errors = []
    for order in ("auto", "none"):
        goal = ("/contour/goal", contour_goal(radius=0.05))
        [contour] = messages_on(touching([goal], salty, order=order), "/contour/traced")
        off = np.linalg.norm(contour.points - MIDDLE, axis=1) - 0.03
        errors.append(np.sqrt(np.mean(off**2)))
    assert errors[0] < 0.1 * errors[1]


def asked(world: World, *more: tuple[str, Any], **params: Any) -> list[Any]:
    """The touches and results that the tracer by itself publishes."""
    told = [("/world", world), ("/touch/info", INFO), *more]
    return [message for _, message in drive(tracer.NODE, told, params)]


def patch(touch: int = 0, goal: int = 0, **changes: Any) -> tuple[str, SurfacePatch]:
    """What a touch measured: nothing."""
    empty = {"height": np.zeros((16, 16)), "mask": np.zeros((16, 16), bool), "pose": DOWN}
    fields = {"finger": 1, "outcome": "miss", "kind": "miss", "robot_time": 1.0, **empty}
    return "/touch/patch", example(SurfacePatch, touch=touch, goal=goal, **{**fields, **changes})


def test_goals_wait_for_each_other_and_touches_inside_are_repeated():
    goals = [("/probe/goal", probe_goal(id=7)), ("/contour/goal", contour_goal(not_before=0.5))]
    assert [one.goal for one in asked(ALONE, *goals)] == [7]
    touch, probe, begun = asked(ALONE, *goals, patch(goal=7))
    assert (touch.goal, probe.id, begun.goal, begun.touch) == (7, 7, 0, 0)
    assert (touch.not_before, begun.not_before) == (0.0, 1.0)
    goal, inside = ("/contour/goal", contour_goal()), {"outcome": "inside"}
    first, second, third = asked(ALONE, goal, patch(**inside), patch(1))
    away = [float(np.hypot(*one.pose[:2])) for one in (first, second, third)]
    assert 0.01 < away[1] - away[0] < 0.02 and second.touch == 1
    assert second.direction == pytest.approx(first.direction)


@pytest.mark.parametrize(("most", "kind"), [(3, "invalid"), (1, "invalid"), (2, "miss")])
def test_frames_without_a_surface_end_a_contour(most: int, kind: str):
    patches = [patch(n, kind=kind, fault="dead", outcome="hit") for n in range(most)]
    outputs = asked(ALONE, ("/contour/goal", contour_goal()), *patches, most_faults=most)
    assert isinstance(outputs[-1], types.TouchGoal) == (kind == "miss")
    if kind == "invalid":
        ended = outputs[-1]
        assert (ended.status, ended.fault, ended.touches) == ("stuck", "dead", most)
    probed = asked(ALONE, ("/probe/goal", probe_goal(id=0)), patch(kind=kind, fault="dead"))
    assert probed[-1].fault == ("dead" if kind == "invalid" else "none")


@pytest.mark.parametrize("order", [0, 1])
def test_patch_that_was_not_asked_for_is_refused(order: int):
    wrong = [patch(goal=1), patch(goal=1)] if order else [patch(touch=1, goal=1)]
    with pytest.raises(ValueError, match=f"unexpected touch {1 - order} of goal 1"):
        asked(ALONE, ("/probe/goal", probe_goal()), *wrong)


def test_goal_for_another_finger_is_left_to_it_and_for_none_refused():
    several = replace(ALONE, fingers=2, robot=ROBOT_PRESETS["modern"].array)
    for goal in (("/contour/goal", contour_goal(finger=2)), ("/probe/goal", probe_goal(finger=2))):
        assert asked(several, goal) == []
        [touch] = asked(several, goal, finger=2)
        assert touch.finger == 2
    for finger, most in ((0, 1), (2, 1), (3, 2)):
        words = f"goal 0 is for finger {finger}; .* are 1 to {most}"
        with pytest.raises(ValueError, match=words):
            asked(replace(ALONE, fingers=most), ("/contour/goal", contour_goal(finger=finger)))
