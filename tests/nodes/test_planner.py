from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.frames import IDENTITY, inverse, transform
from palpate.messages.codec import encode
from palpate.messages.types import (
    Contour,
    ContourGoal,
    FingerClock,
    GraspContacts,
    GraspGoal,
    ModelGoal,
    Probe,
    ProbeGoal,
    SensorInfo,
    ShapeModel,
    Superquadric,
    World,
)
from palpate.nodes.planner import NODE, Params
from palpate.nodes.planner_state import State

RADIUS, TOP = 0.03, 0.1
TOUCHES = 20
UNIFORM = Params(planner="uniform", settings={"count": 5})
Said = list[tuple[str, Any]]


class Cylinder:
    """Answers every goal as an upright cylinder would, each finger after its own time."""

    def __init__(self, status: Callable[[ContourGoal], str] = lambda goal: "closed") -> None:
        self.status = status
        self.clocks: dict[int, float] = {}
        self.contacts = 6

    def answers(self, topic: str, goal: Any) -> Said:
        if topic == "/hand/goal":
            return [("/hand/contacts", self.contacts_of(goal))]
        if topic == "/probe/goal":
            return [("/probe/traced", self.probe_of(goal))]
        if topic == "/contour/goal":
            return [("/contour/traced", self.contour_of(goal))]
        if topic == "/model/goal":
            return [self.model_of(goal)]
        return []

    def spend(self, goal: Any, seconds: float) -> float:
        begun = max(goal.not_before, self.clocks.get(goal.finger, 0.0))
        self.clocks[goal.finger] = begun + seconds
        return self.clocks[goal.finger]

    def contacts_of(self, goal: GraspGoal) -> GraspContacts:
        turn = 2.0 * np.pi * (np.arange(self.contacts) + 0.1 * goal.number) / max(self.contacts, 1)
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(self.contacts)])
        height = 0.01 + 0.08 * ((7 * goal.number) % 11) / 11.0
        return GraspContacts(
            number=goal.number,
            points=RADIUS * rim + [0.0, 0.0, height],
            normals=rim,
            fingers=np.arange(self.contacts, dtype=np.int32),
            missed=0,
            blocked=0,
            move=np.array([0.0, 0.0, 0.0, 0.0, -1.0]),
            robot_time=8.0 * (goal.number + 1),
        )

    def probe_of(self, goal: ProbeGoal) -> Probe:
        at = goal.pose[:2]
        hit = bool(np.hypot(*at) < RADIUS)
        return Probe(
            id=goal.id,
            finger=goal.finger,
            outcome="hit" if hit else "miss",
            point=np.array([*at, TOP]),
            normal=np.array([0.0, 0.0, 1.0]),
            touches=1,
            robot_time=self.spend(goal, 2.0),
        )

    def contour_of(self, goal: ContourGoal) -> Contour:
        status: Any = self.status(goal)
        count = 90 if status in ("closed", "occluded") else 0
        turn = 2.0 * np.pi * np.arange(count) / 90
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
        return Contour(
            id=goal.id,
            finger=goal.finger,
            frame=goal.frame,
            height=goal.height,
            points=transform(goal.frame, RADIUS * rim + [0.0, 0.0, goal.height]),
            normals=rim,
            curvature=np.zeros(count),
            felt_low=np.full(count, goal.height - 4e-3),
            felt_high=np.full(count, goal.height + 4e-3),
            status=status,
            gap_starts=np.zeros((0, 3)),
            gap_ends=np.zeros((0, 3)),
            gap_whys=(),
            touches=TOUCHES,
            robot_time=self.spend(goal, 20.0 + goal.finger),
        )

    def model_of(self, goal: ModelGoal) -> tuple[str, Any]:
        if not goal.contours:
            return "/model/coarse", Superquadric(
                number=goal.number,
                size=np.array([RADIUS, RADIUS, 0.5 * TOP]),
                exponents=np.array([0.1, 1.0]),
                pose=np.array([0.0, 0.0, 0.5 * TOP, 0.0, 0.0, 0.0, 1.0]),
                taper=np.zeros(2),
                bend=0.0,
                bend_direction=0.0,
                doubts=(),
                residual=1e-5,
                residuals=np.zeros(self.contacts * goal.closings),
                rank=11,
            )
        return "/model/shape", ShapeModel(
            number=goal.number,
            contours=goal.contours,
            probes=goal.probes,
            dropped=(),
            dropped_why=(),
            control=np.zeros((0, 0, 0, 3)),
            undeformed=np.zeros((0, 0, 0, 3)),
            knots_columns=np.zeros(0),
            knots_rows=np.zeros(0),
            knots_layers=np.zeros(0),
            vertices=np.zeros((3, 3)),
            faces=np.zeros((1, 3), np.int32),
            frame=IDENTITY,
            deviation=1e-5,
            uncertainty_height=np.array([0.0, TOP]),
            uncertainty=np.full(2, 1e-5),
            health={},
            touches=goal.touches,
            robot_time=goal.robot_time,
            final=False,
        )


def explored(
    params: Params,
    info: SensorInfo,
    world: World,
    shape: Cylinder,
    order: random.Random | None = None,
) -> Said:
    """Everything that the planner says, each goal answered at once or in any order."""
    state, _ = NODE.start(params)
    said: Said = []
    waiting: Said = [("/touch/info", info), ("/world", world)]
    while waiting:
        # Messages of one publisher on one topic keep their order; others may overtake.
        fronts: dict[tuple[str, int], int] = {}
        for i, (topic, message) in enumerate(waiting):
            fronts.setdefault((topic, getattr(message, "finger", 0)), i)
        place = order.choice(sorted(fronts.values())) if order and state.world else 0
        topic, message = waiting.pop(place)
        state, outputs = NODE.inputs[topic][1](params, state, message)
        assert encode(message)
        for one in outputs:
            said.append(one)
            answers = shape.answers(*one)
            waiting += answers
            if world.fingers > 1:
                waiting += [
                    ("/finger/clock", FingerClock(finger=m.finger, robot_time=m.robot_time))
                    for _, m in answers
                    if isinstance(m, (Contour, Probe))
                ]
    assert isinstance(state, State)
    return said


def of(said: Said, topic: str) -> list[Any]:
    return [message for heard, message in said if heard == topic]


@pytest.fixture
def several(world: World) -> World:
    return World(platform=world.platform, reach=world.reach, fingers=3, seed=world.seed)


def test_it_grasps_then_asks_for_the_coarse_model_and_then_slices(
    info: SensorInfo, world: World
) -> None:
    said = explored(UNIFORM, info, world, Cylinder())
    topics = [topic for topic, _ in said]
    closings = topics.count("/hand/goal")
    assert topics[:closings] == ["/hand/goal"] * closings
    assert [goal.number for goal in of(said, "/hand/goal")] == list(range(closings))
    assert topics[closings] == "/model/goal"
    coarse = said[closings][1]
    assert (coarse.contours, coarse.probes, coarse.closings) == ((), (), closings)
    assert 6 * closings >= 60 > 6 * (closings - 1)
    assert topics[closings + 1] == "/probe/goal"


def test_nothing_is_decided_before_the_model_of_what_is_known(
    info: SensorInfo, world: World
) -> None:
    said = explored(UNIFORM, info, world, Cylinder())
    work = [topic for topic, _ in said if topic in ("/contour/goal", "/model/goal")][1:]
    assert work[0] == "/contour/goal"
    assert all(a != b for a, b in pairwise(work))
    numbers = [goal.number for goal in of(said, "/model/goal")]
    assert numbers == list(range(1, len(numbers) + 1))
    [done] = of(said, "/plan/done")
    assert (done.number, len(done.contours)) == (numbers[-1] + 1, 5)
    assert done.touches == 5 * TOUCHES + len(of(said, "/probe/goal"))
    assert done.uncovered == 0.0


def test_goals_are_numbered_through_and_carry_frame_and_time(
    info: SensorInfo, world: World
) -> None:
    said = explored(UNIFORM, info, world, Cylinder())
    goals = [goal for topic, goal in said if topic in ("/contour/goal", "/probe/goal")]
    assert [goal.id for goal in goals] == list(range(len(goals)))
    times = [goal.not_before for goal in goals]
    assert times == sorted(times)
    assert times[0] == 8.0 * len(of(said, "/hand/goal"))
    frames = {goal.frame.tobytes() for goal in of(said, "/contour/goal")}
    assert len(frames) == 1


def test_a_flat_top_is_touched_five_times_and_the_platform_never(
    info: SensorInfo, world: World
) -> None:
    said = explored(UNIFORM, info, world, Cylinder())
    probes = of(said, "/probe/goal")
    assert all(transform(inverse(goal.pose), np.zeros((1, 3)))[0, 2] > 0.0 for goal in probes)
    assert 5 <= len(probes) <= 13


def test_it_ends_when_the_hand_closes_on_nothing(info: SensorInfo, world: World) -> None:
    shape = Cylinder()
    shape.contacts = 0
    said = explored(UNIFORM, info, world, shape)
    assert len(of(said, "/hand/goal")) > 800  # everywhere within reach, twice
    [done] = of(said, "/plan/done")
    assert done.reason == "the hand closed on nothing within reach"
    assert (done.contours, done.within, done.bound) == ((), None, None)


def test_a_slice_that_fails_is_tried_again_nearby_and_told_of(
    info: SensorInfo, world: World
) -> None:
    def stuck(goal: ContourGoal) -> str:
        return "stuck" if 0.06 < goal.height < 0.09 else "closed"

    said = explored(UNIFORM, info, world, Cylinder(stuck))
    tried = [goal.height for goal in of(said, "/contour/goal")]
    assert len([height for height in tried if 0.06 < height < 0.09]) == 2
    [done] = of(said, "/plan/done")
    assert len(done.contours) == 4
    assert 0.03 < done.uncovered < 0.05


def test_the_default_rule_covers_the_side_and_states_a_bound(
    info: SensorInfo, world: World
) -> None:
    said = explored(Params(), info, world, Cylinder())
    [done] = of(said, "/plan/done")
    assert done.within
    assert done.bound < Params().tolerance
    assert done.unfelt <= Params().feature
    heights = sorted(goal.height for goal in of(said, "/contour/goal"))
    assert max(np.diff(heights)) <= 8e-3 + Params().feature + 1e-9


@pytest.mark.parametrize(
    ("budget", "words"),
    [({"most_touches": 90}, "90 touches"), ({"most_seconds": 150.0}, "150 s of robot time")],
)
def test_a_budget_ends_it_and_is_kept(
    info: SensorInfo, world: World, budget: Any, words: str
) -> None:
    params = Params(**budget)
    [done] = of(explored(params, info, world, Cylinder()), "/plan/done")
    assert done.reason.startswith("the budget is spent")
    assert words in done.reason
    assert done.within is False
    assert done.touches <= budget.get("most_touches", 10_000)


def test_fingers_work_side_by_side_apart_from_each_other(info: SensorInfo, several: World) -> None:
    said = explored(Params(), info, several, Cylinder())
    goals = of(said, "/contour/goal")
    assert {goal.finger for goal in goals} == {1, 2, 3}
    first = goals[:3]
    assert sorted(goal.finger for goal in first) == [1, 2, 3]
    heights = sorted(goal.height for goal in first)
    assert min(np.diff(heights)) > 1.5 * 0.016 - 1e-12
    [done] = of(said, "/plan/done")
    assert done.within


def test_the_order_in_which_fingers_are_heard_changes_nothing(
    info: SensorInfo, several: World
) -> None:
    def bodies(order: random.Random | None) -> list[bytes]:
        said = explored(Params(), info, several, Cylinder(), order)
        return [encode(message) for _, message in said]

    expected = bodies(None)
    for seed in range(6):
        assert bodies(random.Random(seed)) == expected


def test_a_tolerance_that_the_sensor_cannot_tell_is_refused(info: SensorInfo, world: World) -> None:
    with pytest.raises(ValueError, match="tolerance is 1e-06 m; it must be at least what the sen"):
        explored(Params(tolerance=1e-6), info, world, Cylinder())


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"most_touches": 0}, "most_touches"),
        ({"most_seconds": 0.0}, "most_seconds"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"planner": "best"}, "there is no planner 'best'; there are predicted, uniform"),
        ({"planner": "uniform", "settings": {"count": 0}}, "count is 0; expected 1 to 200"),
        ({"settings": {"contours": 5}}, "has no contours; it has cover"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(params: Any, words: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(params, Params)


def test_a_model_that_drops_a_contour_has_its_slice_traced_again(
    info: SensorInfo, world: World
) -> None:
    class Dropping(Cylinder):
        def model_of(self, goal: ModelGoal) -> tuple[str, Any]:
            topic, model = super().model_of(goal)
            if isinstance(model, ShapeModel) and len(goal.contours) > 1:
                dropped = goal.contours[1:2]
                fields = {name: getattr(model, name) for name in model.__dataclass_fields__}
                model = ShapeModel(
                    **{**fields, "dropped": dropped, "dropped_why": ("it crosses itself",)}
                )
            return topic, model

    said = explored(UNIFORM, info, world, Dropping())
    heights = [goal.height for goal in of(said, "/contour/goal")]
    assert len(heights) == 6  # the one that was dropped, once more
