"""Planner node: goals that follow from answers of an upright cylinder, in any order of arrival."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore import SURVEYING
from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.steps import no_steps
from palpate.messages import encode, types
from palpate.messages.types import Contour, ContourGoal, GraspContacts, GraspGoal, ModelGoal, World
from palpate.nodes.planner import NODE, Params
from palpate.nodes.runtime.node import Deferred, NotReadyError
from palpate.nodes.runtime.testing import example, messages_on
from palpate.nodes.specs.objects import ObjectSpec, build_shape
from tests.messages.cases import cases
from tests.nodes.loop import ALONE, INFO, Published

RADIUS, TOP, TOUCHES = 0.03, 0.1, 20  # Of the cylinder, and what a contour of it takes
UNIFORM = Params(planner="uniform", settings={"count": 5})
SEVERAL = replace(ALONE, fingers=3)
FAST = replace(ALONE, robot=ROBOT_PRESETS["modern"].array)

Change = Callable[[Any, Any], Any]  # Goal and answer to what is answered instead


class Cylinder:
    """Answers every goal as an upright cylinder would, each finger after its own time."""

    def __init__(self, contacts: int = 6, **changes: Change) -> None:
        self.contacts, self._changes = contacts, changes
        self.clocks: dict[int, float] = {}

    def answer(self, topic: str, goal: Any) -> Published:
        kinds = {"/hand/goal": ("/hand/contacts", self.contacts_of)}
        kinds["/probe/goal"] = "/probe/traced", self.probe_of
        kinds["/contour/goal"] = "/contour/traced", self.contour_of
        if topic == "/model/goal":
            shape, coarse = ("/model/shape", self.model_of), ("/model/coarse", self.coarse_of)
            kinds[topic] = shape if goal.contours or goal.probes else coarse
        if topic not in kinds:
            return []
        where, made = kinds[topic]
        change = self._changes.get(where.rpartition("/")[0][1:], lambda goal, answer: answer)
        return [(where, change(goal, made(goal)))]

    def spend(self, goal: Any, seconds: float) -> float:
        begun = max(goal.not_before, self.clocks.get(goal.finger, 0.0))
        self.clocks[goal.finger] = begun + seconds
        return self.clocks[goal.finger]

    def left(self, goal: ContourGoal | types.ProbeGoal) -> int:
        """Touches that still end within the goal's limits, each after about a second."""
        now = max(goal.not_before, self.clocks.get(goal.finger, 0.0))
        left = TOUCHES if goal.not_after is None else int((goal.not_after - now) / 1.2)
        most = goal.most_touches if isinstance(goal, ContourGoal) else None
        return max(left if most is None else min(left, most), 0)

    def contacts_of(self, goal: GraspGoal) -> GraspContacts:
        turn = 2.0 * np.pi * (np.arange(self.contacts) + 0.1 * goal.number) / max(self.contacts, 1)
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(self.contacts)])
        height = 0.01 + 0.08 * ((7 * goal.number) % 11) / 11.0
        met = {"points": RADIUS * rim + [0.0, 0.0, height], "normals": rim}
        met |= {"fingers": np.arange(self.contacts, dtype=np.int32), "number": goal.number}
        return example(GraspContacts, **met, robot_time=8.0 * (goal.number + 1))

    def probe_of(self, goal: types.ProbeGoal) -> types.Probe:
        left = min(self.left(goal), 1)
        hit = "hit" if np.hypot(*goal.pose[:2]) < RADIUS else "miss"
        fields = {"outcome": hit, "touches": left, "robot_time": self.spend(goal, 2.0 * left)}
        fields |= {"point": np.array([*goal.pose[:2], TOP]), "normal": np.array([0.0, 0.0, 1.0])}
        return example(types.Probe, id=goal.id, finger=goal.finger, **fields)

    def contour_of(self, goal: ContourGoal) -> Contour:
        left = self.left(goal)
        status, count = ("budget", 0) if left < TOUCHES else ("closed", 90)
        turn = 2.0 * np.pi * np.arange(count) / 90
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
        points = Pose.from_array(goal.frame).to_outer(RADIUS * rim + [0.0, 0.0, goal.height])
        fields = {name: getattr(goal, name) for name in ("id", "finger", "frame", "height")}
        fields |= {"points": points, "normals": rim, "curvature": np.zeros(count), "status": status}
        fields |= {"contact_low": np.full(count, goal.height - 4e-3), "touches": min(left, TOUCHES)}
        fields |= {"contact_high": np.full(count, goal.height + 4e-3)}
        seconds = self.spend(goal, min(left / TOUCHES, 1.0) * (20.0 + goal.finger))
        return example(Contour, **fields, robot_time=seconds)

    def coarse_of(self, goal: ModelGoal) -> types.Superquadric:
        fitted = {"size": np.array([RADIUS, RADIUS, 0.5 * TOP]), "rank": 11, "residual": 1e-5}
        fitted |= {"exponents": np.array([0.1, 1.0]), "number": goal.number}
        fitted |= {"residuals": np.zeros(self.contacts * goal.closings)}
        pose = np.array([0.0, 0.0, 0.5 * TOP, 0.0, 0.0, 0.0, 1.0])
        return example(types.Superquadric, pose=pose, **fitted)

    def model_of(self, goal: ModelGoal) -> types.ShapeModel:
        taken = ("number", "contours", "probes", "touches", "robot_time")
        fitted = {name: getattr(goal, name) for name in taken}
        fitted |= {"vertices": np.zeros((3, 3)), "faces": np.zeros((1, 3), np.int32)}
        fitted |= {"uncertainty_height": np.array([0.0, TOP]), "uncertainty": np.full(2, 1e-5)}
        return example(types.ShapeModel, frame=IDENTITY_POSE, deviation=1e-5, **fitted)


def explored(
    params: Params,
    world: World = ALONE,
    shape: Cylinder | None = None,
    order: random.Random | None = None,
) -> Published:
    """Everything that the planner publishes, each goal answered at once or in any order."""
    shape, state = shape or Cylinder(), NODE.start(params)[0]
    waiting: Published = [("/touch/info", INFO), ("/world", world)]
    published: Published = []
    while waiting:
        # Messages of one publisher on one topic keep their order; others may overtake.
        fronts: dict[tuple[str, int], int] = {}
        for i, (topic, message) in enumerate(waiting):
            fronts.setdefault((topic, getattr(message, "finger", 0)), i)
        place = order.choice(sorted(fronts.values())) if order and published else 0
        topic, message = waiting.pop(place)
        assert encode(message)
        state, outputs = NODE.inputs[topic][1](params, state, message)
        for goal_topic, made in outputs:
            goal = made.make(no_steps) if isinstance(made, Deferred) else made
            published.append((goal_topic, goal))
            answers = shape.answer(goal_topic, goal)
            waiting += answers
            for _, one in answers if world.fingers > 1 else ():
                if isinstance(one, Contour | types.Probe):
                    clock = types.FingerClock(finger=one.finger, robot_time=one.robot_time)
                    waiting.append(("/finger/clock", clock))
    return published


def done_of(params: Params, *more: Any) -> Any:
    [done] = messages_on(explored(params, *more), "/plan/done")
    return done


@cache
def uniform() -> Published:
    return explored(UNIFORM)


@cache
def predicted() -> Published:
    return explored(Params())


def test_hand_closes_then_coarse_model_then_top_then_numbered_slices():
    topics = [topic for topic, _ in uniform()]
    closings = topics.count("/hand/goal")
    assert topics[: closings + 2] == ["/hand/goal"] * closings + ["/model/goal", "/probe/goal"]
    assert [goal.number for goal in messages_on(uniform(), "/hand/goal")] == list(range(closings))
    coarse = uniform()[closings][1]
    assert (coarse.contours, coarse.probes, coarse.closings) == ((), (), closings)
    assert 6 * closings >= 60 > 6 * (closings - 1)
    probes = messages_on(uniform(), "/probe/goal")  # of a flat top; the platform is never touched
    assert all(g.pose[2] > TOP for g in probes) and 5 <= len(probes) <= 13
    work = [topic for topic in topics if topic in ("/contour/goal", "/model/goal")][1:]
    assert work[0] == "/contour/goal" and all(a != b for a, b in pairwise(work))
    goals = [goal for topic, goal in uniform() if topic in ("/contour/goal", "/probe/goal")]
    assert [goal.id for goal in goals] == list(range(len(goals)))
    times = [goal.not_before for goal in goals]
    assert times == sorted(times) and times[0] == 8.0 * len(messages_on(uniform(), "/hand/goal"))
    contours = messages_on(uniform(), "/contour/goal")
    assert len({goal.frame.tobytes() for goal in contours}) == 1
    assert all(goal.radius > RADIUS and goal.most_touches >= TOUCHES for goal in contours)
    heights = sorted(goal.height for goal in contours)
    assert np.diff(heights) == pytest.approx(np.full(4, heights[1] - heights[0]), abs=2e-3)
    models, [done] = messages_on(uniform(), "/model/goal"), messages_on(uniform(), "/plan/done")
    assert [goal.number for goal in [*models, done]] == list(range(1, len(models) + 2))
    assert [len(goal.contours) for goal in [*models, done]] == [*range(len(models)), 5]
    assert done.touches == 5 * TOUCHES + len(messages_on(uniform(), "/probe/goal"))
    assert done.uncovered == 0.0 and not done.failed


def axes_of(published: Published) -> Floats:
    frames = [goal.frame for goal in messages_on(published, "/contour/goal")]
    return np.stack([Pose.from_array(frame).axes[:, 2] for frame in frames])


def test_slicing_axis_is_given_or_that_of_a_level_top():
    params = Params(axis=(0.6, 0.0, 0.8), planner="uniform", settings={"count": 3})
    axes = axes_of(explored(params))
    assert axes == pytest.approx(np.tile([0.6, 0.0, 0.8], (len(axes), 1)))

    def aside(_: GraspGoal, contacts: GraspContacts) -> GraspContacts:
        """Its sections are level, and lie ever farther aside."""
        contacts.points[:, 0] += 0.6 * (contacts.points[:, 2] - 0.05)
        return contacts

    published = explored(UNIFORM, shape=Cylinder(hand=aside))
    first = Pose.from_array(messages_on(published, "/probe/goal")[0].pose).axes[:, 2]
    assert first[2] > -0.95  # along an axis that leans
    assert (axes_of(published) == [0.0, 0.0, 1.0]).all()


def test_contacts_without_a_solid_and_a_leaning_top_come_to_an_end():
    def leaning(_: GraspGoal, contacts: GraspContacts) -> GraspContacts:
        """Of a box that leans; they make no solid."""
        turn = np.pi / 2 * (np.arange(len(contacts.normals)) % 4)
        contacts.normals[:] = np.cos(turn)[:, None] * [np.cos(0.2), 0.0, -np.sin(0.2)]
        contacts.normals[:, 1] += np.sin(turn)
        return contacts

    face, warnings = np.array([np.sin(0.2), 0.0, np.cos(0.2)]), {"warnings": ("coplanar points",)}
    shape = Cylinder(
        hand=leaning,
        probe=lambda _, probe: replace(probe, normal=face),
        model=lambda goal, model: model if goal.probes else replace(model, **warnings),
    )
    published = explored(UNIFORM, shape=shape)
    probes, [done] = messages_on(published, "/probe/goal"), messages_on(published, "/plan/done")
    ids = [goal.id for goal in probes]
    assert len(ids) < 30 and set(done.probes) <= set(ids) and done.probes[0] == ids[0]


@cases(
    "ended, uncovered",
    ({"status": "stuck"}, 0.04),
    ({"status": "budget", "touches": 99}, 0.0),  # it does not come around
)
def test_slice_that_fails_is_tried_nearby_and_told_of(ended: dict[str, Any], uncovered: float):
    def ending(goal: ContourGoal, contour: Contour) -> Contour:
        return replace(contour, **ended) if 0.06 < goal.height < 0.09 else contour

    published = explored(UNIFORM, shape=Cylinder(contour=ending))
    goals = messages_on(published, "/contour/goal")
    tried = {goal.id for goal in goals if 0.06 < goal.height < 0.09}
    [done] = messages_on(published, "/plan/done")
    assert len(done.contours) == 4 and set(done.arcs) == tried and len(tried) == 2
    assert done.failed and done.uncovered == pytest.approx(uncovered, abs=0.01)


def test_contour_that_a_model_drops_is_traced_again_and_models_become_rarer():
    def dropping(goal: ModelGoal, model: Any) -> Any:
        dropped = {"dropped": goal.contours[1:2], "dropped_reasons": ("it crosses itself",)}
        return replace(model, **dropped) if len(goal.contours) > 1 else model

    published = explored(UNIFORM, shape=Cylinder(model=dropping))
    assert len(messages_on(published, "/contour/goal")) == 6
    published = explored(Params(planner="uniform", settings={"count": 25}))
    models = [goal.touches for goal in messages_on(published, "/model/goal")][1:]
    early, late = np.diff(models[:6]), np.diff(models[-4:])
    assert early.max() <= 2 * TOUCHES and late.min() >= 2 * TOUCHES
    assert models[-1] > 0.9 * 25 * TOUCHES


def test_models_are_asked_of_single_touches_that_hit_and_told_of_misses():
    solid = {"cylinder": {"radius": RADIUS, "height": TOP}, "pose": {"position": [0, 0, 0.05]}}
    vertices, faces = build_shape(msgspec.convert(solid, ObjectSpec)).mesh(2)
    fields = {"vertices": vertices, "faces": faces, "method": "general"}
    names = ("vertex_errors", "vertex_bounds", "vertex_distances")
    fields |= {name: np.full(len(vertices), 2e-3) for name in names}
    outcomes = {1: "miss", 2: "inside", 3: "hit", 4: "bottomed"}
    shape = Cylinder(
        probe=lambda goal, probe: replace(probe, outcome=outcomes.get(goal.id, "hit")),
        model=lambda goal, model: replace(model, **fields) if goal.contours else model,
    )
    published = explored(Params(planner="touches", most_touches=30), shape=shape)
    goals, [done] = messages_on(published, "/probe/goal"), messages_on(published, "/plan/done")
    assert goals[2].reach == pytest.approx(goals[1].reach + 15e-3)  # the same, from farther off
    assert done.missed == (1,) and done.contours == (0,) and done.general
    assert done.probes == tuple(goal.id for goal in goals if goal.id not in (1, 2))
    assert done.findings["error_bound"] > 0.0 and "untraced_height" not in done.findings


def test_default_rule_covers_the_side_beside_its_models_and_states_a_bound():
    [done] = messages_on(predicted(), "/plan/done")
    tolerance = Params().tolerance
    assert done.reached and done.rms_bound_95 < tolerance
    assert done.largest_untouched <= SURVEYING.feature_ratio * tolerance
    heights = sorted(goal.height for goal in messages_on(predicted(), "/contour/goal"))
    assert max(np.diff(heights)) <= 8e-3 + SURVEYING.feature_ratio * tolerance + 1e-9
    estimates = sorted(messages_on(predicted(), "/plan/estimate"), key=lambda one: one.number)
    judged = [*messages_on(predicted(), "/model/goal")[1:], done]
    assert [one.number for one in estimates] == [one.number for one in judged]
    assert [one.contours for one in estimates] == [len(one.contours) for one in judged]
    assert estimates[-1].rms_bound_95 == done.rms_bound_95
    topics = [topic for topic, _ in predicted()]
    work = [topic for topic in topics if topic in ("/contour/goal", "/model/goal")][1:]
    # The cover goes on beside its first models; whatever follows it waits for the last of them.
    assert work[:6] == ["/contour/goal", *2 * ["/model/goal", "/contour/goal"], "/model/goal"]
    models = [place for place, topic in enumerate(topics) if topic == "/model/goal"]
    assert [topics[place + 1] for place in models[1:3]] == ["/contour/goal"] * 2


@cases(
    "budget, world, words",
    ({"most_touches": 90}, ALONE, "the budget is spent: 90 of 90 touches"),
    ({"most_touches": 110}, SEVERAL, "the budget is spent: 110 of 110 touches"),
    ({"most_seconds": 150.0}, ALONE, "150 s of robot time"),
)
def test_budget_is_kept_and_nearly_spent(budget: dict[str, Any], world: World, words: str):
    done = done_of(Params(**budget), world)
    assert done.reason.startswith("the budget is spent") and words in done.reason
    spent, (most,) = done.touches if "most_touches" in budget else done.robot_time, budget.values()
    assert 0.9 * most <= spent <= most and done.reached is False
    if world is ALONE:  # they were cut short, and say nothing of the object
        assert done.arcs and not done.failed and not set(done.arcs) & set(done.contours)


def test_hand_leaves_robot_time_for_contours():
    hurried = messages_on(explored(Params(most_seconds=90.0), FAST), "/hand/goal")
    assert 2 <= len(hurried) < len(messages_on(uniform(), "/hand/goal"))
    done = done_of(Params(most_seconds=5.0), FAST)
    assert done.reason == "the hand closed on nothing within reach and robot time"
    assert (done.contours, done.reached, done.rms_bound_95) == ((), False, None)


@cases(
    "params, world",
    (UNIFORM, ALONE),
    (Params(), SEVERAL),
    pytest.param(Params(), ALONE, marks=pytest.mark.slow),
)
def test_order_of_arrival_changes_nothing(params: Params, world: World):
    def bodies(order: random.Random | None) -> list[bytes]:
        """In their order on each topic, which alone is kept."""
        published = sorted(explored(params, world, order=order), key=lambda one: one[0])
        return [encode(message) for _, message in published]

    expected = bodies(None)
    assert all(bodies(random.Random(seed)) == expected for seed in range(2))


@cases(
    "params, words",
    ({"most_touches": 0}, "most_touches"),
    ({"most_seconds": 0.0}, "most_seconds"),
    ({"tolerance": 0.0}, "tolerance"),
    ({"planner": "best"}, "there is no planner 'best'; there are predicted, touches, uniform"),
    ({"settings": {"contours": 5}}, "has no contours; it has cover"),
    ({"axis": [0.0, 0.0, 0.0]}, "axis must have a length, got"),
    ({"axis": [1.0, 0.0]}, "length 3"),
)
def test_parameters_that_cannot_be_are_refused(params: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(params, Params)


def test_demand_that_cannot_be_met_is_refused():
    words = "tolerance is 1e-06 m; it must be at least the resolution of the sensor, 1e-05 m"
    with pytest.raises(ValueError, match=words):
        explored(Params(tolerance=1e-6))
    state = NODE.start(Params())[0]
    with pytest.raises(NotReadyError, match="does not know its sensor yet"):
        NODE.check_set(Params(), state)
    for topic, message in (("/touch/info", INFO), ("/world", ALONE)):
        state, _ = NODE.inputs[topic][1](Params(), state, message)
    state = replace(state, known=replace(state.known, touches=9, seconds=8.0))
    NODE.check_set(Params(most_touches=9, most_seconds=8.0), state)
    for params, words in (
        (Params(most_touches=8), "most_touches is 8; 9 touches are made already"),
        (Params(most_seconds=7.0), r"most_seconds is 7 s; 8\.0 s have passed already"),
        (Params(tolerance=9e-6), "tolerance is 9e-06 m"),
    ):
        with pytest.raises(ValueError, match=words):
            NODE.check_set(params, state)
