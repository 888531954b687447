"""Planner node: goals that follow from answers of an upright cylinder, in any order of arrival."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core.explore import FEATURE_SHARE
from palpate.core.poses import IDENTITY_POSE, split_pose, transform_points
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.messages import encode, types
from palpate.messages.types import Contour, ContourGoal, GraspContacts, GraspGoal, ModelGoal, World
from palpate.nodes import planner
from palpate.nodes.planner import NODE, Params
from palpate.nodes.runtime.node import NotReadyError
from palpate.nodes.runtime.testing import example
from palpate.nodes.specs.objects import ObjectSpec, build_shape
from palpate.nodes.specs.sensors import SensorSpec, info_of
from tests.messages.cases import cases
from tests.nodes.loop import Published, sent

RADIUS, TOP, TOUCHES = 0.03, 0.1, 20  # Of the cylinder, and what a contour of it takes
UNIFORM = Params(planner="uniform", settings={"count": 5})
ALONE = World(platform=0.0, reach=0.15, fingers=1, seed=0)
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
        told = {"outcome": hit, "touches": left, "robot_time": self.spend(goal, 2.0 * left)}
        told |= {"point": np.array([*goal.pose[:2], TOP]), "normal": np.array([0.0, 0.0, 1.0])}
        return example(types.Probe, id=goal.id, finger=goal.finger, **told)

    def contour_of(self, goal: ContourGoal) -> Contour:
        left = self.left(goal)
        status, count = ("budget", 0) if left < TOUCHES else ("closed", 90)
        turn = 2.0 * np.pi * np.arange(count) / 90
        rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
        points = transform_points(goal.frame, RADIUS * rim + [0.0, 0.0, goal.height])
        told = {name: getattr(goal, name) for name in ("id", "finger", "frame", "height")}
        told |= {"points": points, "normals": rim, "curvature": np.zeros(count), "status": status}
        told |= {"contact_low": np.full(count, goal.height - 4e-3), "touches": min(left, TOUCHES)}
        told |= {"contact_high": np.full(count, goal.height + 4e-3)}
        seconds = self.spend(goal, min(left / TOUCHES, 1.0) * (20.0 + goal.finger))
        return example(Contour, **told, robot_time=seconds)

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
    waiting: Published = [("/touch/info", info_of(SensorSpec(), noise=0.0)), ("/world", world)]
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
        for one in sent(outputs):
            published.append(one)
            answers = shape.answer(*one)
            waiting += answers
            if world.fingers > 1:
                waiting += [
                    ("/finger/clock", types.FingerClock(finger=m.finger, robot_time=m.robot_time))
                    for _, m in answers
                    if isinstance(m, Contour | types.Probe)
                ]
    return published


def of(published: Published, topic: str) -> list[Any]:
    return [message for received, message in published if received == topic]


def done_of(params: Params, *more: Any) -> Any:
    [done] = of(explored(params, *more), "/plan/done")
    return done


@cache
def uniform() -> Published:
    return explored(UNIFORM)


@cache
def predicted() -> Published:
    return explored(Params())


def test_hand_closes_then_coarse_model_then_top_then_slices():
    topics = [topic for topic, _ in uniform()]
    closings = topics.count("/hand/goal")
    assert topics[:closings] == ["/hand/goal"] * closings
    assert [goal.number for goal in of(uniform(), "/hand/goal")] == list(range(closings))
    assert topics[closings : closings + 2] == ["/model/goal", "/probe/goal"]
    coarse = uniform()[closings][1]
    assert (coarse.contours, coarse.probes, coarse.closings) == ((), (), closings)
    assert 6 * closings >= 60 > 6 * (closings - 1)
    probes = of(uniform(), "/probe/goal")  # of a flat top; the platform is never touched
    assert all(g.pose[2] > TOP for g in probes) and 5 <= len(probes) <= 13


def test_each_slice_is_followed_by_a_model_of_all_that_is_known():
    work = [topic for topic, _ in uniform() if topic in ("/contour/goal", "/model/goal")][1:]
    assert work[0] == "/contour/goal" and all(a != b for a, b in pairwise(work))
    models = of(uniform(), "/model/goal")
    assert [goal.number for goal in models] == list(range(1, len(models) + 1))
    assert [len(goal.contours) for goal in models] == list(range(len(models)))
    [done] = of(uniform(), "/plan/done")
    assert (done.number, len(done.contours)) == (models[-1].number + 1, 5)
    assert done.touches == 5 * TOUCHES + len(of(uniform(), "/probe/goal"))
    assert done.uncovered == 0.0 and not done.failed


def test_goals_are_numbered_through_and_carry_frame_and_time():
    goals = [goal for topic, goal in uniform() if topic in ("/contour/goal", "/probe/goal")]
    assert [goal.id for goal in goals] == list(range(len(goals)))
    times = [goal.not_before for goal in goals]
    assert times == sorted(times) and times[0] == 8.0 * len(of(uniform(), "/hand/goal"))
    contours = of(uniform(), "/contour/goal")
    assert len({goal.frame.tobytes() for goal in contours}) == 1
    assert all(goal.radius > RADIUS and goal.most_touches >= TOUCHES for goal in contours)
    heights = sorted(goal.height for goal in contours)
    assert np.diff(heights) == pytest.approx(np.full(4, heights[1] - heights[0]), abs=2e-3)


def test_object_is_sliced_along_the_axis_that_is_asked_for():
    params = Params(axis=(0.6, 0.0, 0.8), planner="uniform", settings={"count": 3})
    goals = of(explored(params), "/contour/goal")
    axes = np.stack([split_pose(goal.frame)[1][:, 2] for goal in goals])
    assert axes == pytest.approx(np.tile([0.6, 0.0, 0.8], (len(axes), 1)))


def test_level_top_sets_a_leaning_axis_upright():
    def aside(_: GraspGoal, contacts: GraspContacts) -> GraspContacts:
        """Its sections are level, and lie ever farther aside."""
        contacts.points[:, 0] += 0.6 * (contacts.points[:, 2] - 0.05)
        return contacts

    published = explored(UNIFORM, shape=Cylinder(hand=aside))
    axes = [split_pose(goal.frame)[1][:, 2] for goal in of(published, "/contour/goal")]
    first = split_pose(of(published, "/probe/goal")[0].pose)[1][:, 2]
    assert first[2] > -0.95  # along an axis that leans
    assert np.array_equal(axes, np.tile([0.0, 0.0, 1.0], (len(axes), 1)))


def test_contacts_without_a_solid_and_a_leaning_top_come_to_an_end():
    def leaning(_: GraspGoal, contacts: GraspContacts) -> GraspContacts:
        """Of a box that leans; they make no solid."""
        turn = np.pi / 2 * (np.arange(len(contacts.normals)) % 4)
        contacts.normals[:] = np.cos(turn)[:, None] * [np.cos(0.2), 0.0, -np.sin(0.2)]
        contacts.normals[:, 1] += np.sin(turn)
        return contacts

    face = np.array([np.sin(0.2), 0.0, np.cos(0.2)])
    shape = Cylinder(
        hand=leaning,
        probe=lambda _, probe: replace(probe, normal=face),
        model=lambda _, model: (
            replace(model, warnings=("coplanar points",))
            if isinstance(model, types.Superquadric)
            else model
        ),
    )
    published = explored(UNIFORM, shape=shape)
    probes = [goal.id for goal in of(published, "/probe/goal")]
    [done] = of(published, "/plan/done")
    assert len(probes) < 30 and set(done.probes) <= set(probes) and done.probes[0] == probes[0]


def test_search_ends_when_the_hand_closes_on_nothing():
    near = replace(ALONE, reach=0.08)
    published = explored(UNIFORM, near, Cylinder(contacts=0))
    assert len(of(published, "/hand/goal")) > 200  # everywhere within reach, twice
    [done] = of(published, "/plan/done")
    assert done.reason == "the hand closed on nothing within reach"
    assert (done.contours, done.reached, done.rms_bound_95) == ((), False, None)


def stuck(goal: ContourGoal, contour: Contour) -> Contour:
    """Contours in a band of it cannot be traced."""
    return replace(contour, status="stuck") if 0.06 < goal.height < 0.09 else contour


def endless(goal: ContourGoal, contour: Contour) -> Contour:
    """Contours in a band of it do not come around."""
    ends = {"status": "budget", "touches": goal.most_touches}
    return replace(contour, **ends) if 0.06 < goal.height < 0.09 else contour


def test_slice_that_fails_is_tried_nearby_and_told_of():
    published = explored(UNIFORM, shape=Cylinder(contour=stuck))
    tried = [goal.height for goal in of(published, "/contour/goal")]
    assert len([height for height in tried if 0.06 < height < 0.09]) == 2
    [done] = of(published, "/plan/done")
    assert len(done.contours) == 4 and done.failed and 0.03 < done.uncovered < 0.05
    around = done_of(UNIFORM, ALONE, Cylinder(contour=endless))
    assert around.arcs and around.failed


def test_contour_that_a_model_drops_is_traced_again():
    def dropping(goal: ModelGoal, model: Any) -> Any:
        dropped = {"dropped": goal.contours[1:2], "dropped_reasons": ("it crosses itself",)}
        return replace(model, **dropped) if len(goal.contours) > 1 else model

    published = explored(UNIFORM, shape=Cylinder(model=dropping))
    assert len(of(published, "/contour/goal")) == 6


def test_ends_of_a_general_solid_are_not_touched_apart():
    general = Cylinder(
        model=lambda goal, model: replace(model, method="general") if goal.contours else model
    )
    published = explored(UNIFORM, shape=general)
    modelled = [topic for topic, _ in published].index("/contour/goal")
    assert of(published, "/plan/done") and of(published[:modelled], "/probe/goal")
    assert not of(published[modelled:], "/probe/goal")


def test_sensor_that_fails_ends_the_exploration():
    faulty = Cylinder(
        probe=lambda _, probe: replace(probe, outcome="miss", fault="dead"),
        contour=lambda _, contour: replace(contour, status="stuck", fault="dead"),
    )
    published = explored(UNIFORM, shape=faulty)
    [done] = of(published, "/plan/done")
    assert done.reason.startswith("the sensor of finger 1 failed: ") and not done.reached
    assert len(of(published, "/probe/goal")) + len(of(published, "/contour/goal")) <= 3


def test_default_rule_covers_the_side_and_states_a_bound():
    [done] = of(predicted(), "/plan/done")
    tolerance = Params().tolerance
    assert done.reached and done.rms_bound_95 < tolerance
    assert done.largest_untouched <= FEATURE_SHARE * tolerance
    heights = sorted(goal.height for goal in of(predicted(), "/contour/goal"))
    assert max(np.diff(heights)) <= 8e-3 + FEATURE_SHARE * tolerance + 1e-9
    estimates = sorted(of(predicted(), "/plan/estimate"), key=lambda one: one.number)
    judged = [*of(predicted(), "/model/goal")[1:], done]
    assert [one.number for one in estimates] == [one.number for one in judged]
    assert [one.contours for one in estimates] == [len(one.contours) for one in judged]
    assert estimates[-1].rms_bound_95 == done.rms_bound_95


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
    hurried = of(explored(Params(most_seconds=90.0), FAST), "/hand/goal")
    assert 2 <= len(hurried) < len(of(uniform(), "/hand/goal"))
    done = done_of(Params(most_seconds=5.0), FAST)
    assert done.reason == "the hand closed on nothing within reach and robot time"


def test_more_touches_lie_between_later_models():
    published = explored(Params(planner="uniform", settings={"count": 25}))
    models = [goal.touches for goal in of(published, "/model/goal")][1:]
    early, late = np.diff(models[:6]), np.diff(models[-4:])
    assert early.max() <= 2 * TOUCHES and late.min() >= 2 * TOUCHES
    assert models[-1] > 0.9 * 25 * TOUCHES


def test_fingers_work_side_by_side_apart_from_each_other():
    goals = of(explored(Params(), SEVERAL), "/contour/goal")
    assert {goal.finger for goal in goals} == {1, 2, 3}
    assert sorted(goal.finger for goal in goals[:3]) == [1, 2, 3]
    heights = sorted(goal.height for goal in goals[:3])
    assert min(np.diff(heights)) > 1.5 * 0.016 - 1e-12


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


def test_slice_in_which_no_model_has_a_say_begins_while_one_is_made():
    topics = [topic for topic, _ in predicted()]
    work = [topic for topic in topics if topic in ("/contour/goal", "/model/goal")][1:]
    # The cover goes on beside its first models; whatever follows it waits for the last of them.
    assert work[:6] == ["/contour/goal", *2 * ["/model/goal", "/contour/goal"], "/model/goal"]
    models = [place for place, topic in enumerate(topics) if topic == "/model/goal"]
    assert [topics[place + 1] for place in models[1:3]] == ["/contour/goal"] * 2


LOST = """
from dataclasses import dataclass
from palpate.core.explore.planners import Height

@dataclass(frozen=True)
class Lost:
    def next(self, observation):
        known = len(observation.slices)
        return Height(0.03 + 0.01 * known if known < 3 else 5.0, "why not")
"""


def test_answer_that_cannot_be_acted_on_ends_with_what_there_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "lost_planner.py").write_text(LOST)
    monkeypatch.syspath_prepend(tmp_path)
    done = done_of(Params(planner="lost_planner:Lost"))
    assert len(done.contours) == 3 and not done.reached
    assert done.reason.startswith("the planner Lost gave no answer to act on: a height must lie")


SINGLE = """
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from palpate.core.poses import Pose, pad_rotation
from palpate.core.explore.planners import Height, Stop, Touch

@dataclass(frozen=True)
class Single:
    single_touches: ClassVar[bool] = True

    def next(self, observation):
        if observation.surface is None:
            return Height(0.05, "the first solid")
        number = observation.budget.touches - 20
        pose = Pose(np.array([0.1, 0.0, 0.01 * number]), pad_rotation(0.0, 0.0))
        touch = Touch(pose, 0.15, np.array([0.03, 0.0, 0.01 * number]), "why not")
        return touch if number < 6 else Stop("all touched")
"""


def test_single_touches_miss_hit_or_begin_farther_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "single_planner.py").write_text(SINGLE)
    monkeypatch.syspath_prepend(tmp_path)
    outcomes = iter(["hit", "miss", "inside", "inside", "inside", "hit"])
    solid = {"cylinder": {"radius": RADIUS, "height": TOP}, "pose": {"position": [0, 0, 0.05]}}
    vertices, faces = build_shape(msgspec.convert(solid, ObjectSpec)).mesh(2)
    told = {"vertices": vertices, "faces": faces, "method": "general"}
    names = ("vertex_errors", "vertex_bounds", "vertex_distances")
    told |= {name: np.full(len(vertices), 1e-3) for name in names}
    shape = Cylinder(
        probe=lambda goal, probe: replace(probe, outcome=next(outcomes)),
        model=lambda goal, model: replace(model, **told) if goal.contours else model,
    )
    published = explored(Params(planner="single_planner:Single"), shape=shape)
    goals = of(published, "/probe/goal")
    away = [float(goal.pose[0]) for goal in goals]
    assert away == pytest.approx([0.1, 0.1, 0.1, 0.115, 0.13, 0.1])
    assert [goal.reach for goal in goals] == pytest.approx([0.15, 0.15, 0.15, 0.165, 0.18, 0.15])
    [done] = of(published, "/plan/done")
    assert (done.probes, done.missed, done.contours, done.touches) == ((1, 6), (2,), (0,), 26)
    assert done.reason.startswith("all touched") and len(of(published, "/contour/goal")) == 1


def test_exploration_ends_before_a_model_can_list_no_more(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(planner, "MOST_GOALS", 4)
    done = done_of(UNIFORM)
    assert done.reason == "a model can list no more contours and single touches"
    assert len(done.contours) < 5


@cases(
    "params, words",
    ({"most_touches": 0}, "most_touches"),
    ({"most_seconds": 0.0}, "most_seconds"),
    ({"tolerance": 0.0}, "tolerance"),
    ({"planner": "best"}, "there is no planner 'best'; there are predicted, touches, uniform"),
    ({"planner": "uniform", "settings": {"count": 0}}, "count is 0; expected 1 to 1000"),
    ({"settings": {"contours": 5}}, "has no contours; it has cover"),
    ({"axis": [0.0, 0.0, 0.0]}, "axis must have a length, got"),
    ({"axis": [1.0, 0.0]}, "length 3"),
)
def test_parameters_that_cannot_be_are_refused(params: dict[str, Any], words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(params, Params)


def test_demand_that_cannot_be_met_is_refused():
    words = "tolerance is 1e-06 m; it must be at least what the sensor can tell, 1e-05 m"
    with pytest.raises(ValueError, match=words):
        explored(Params(tolerance=1e-6))
    state = NODE.start(Params())[0]
    with pytest.raises(NotReadyError, match="does not know its sensor yet"):
        NODE.check_set(Params(), state)
    info = info_of(SensorSpec(), noise=0.0)
    state = replace(NODE.inputs["/touch/info"][1](Params(), state, info)[0], touches=9, clock=8.0)
    NODE.check_set(Params(most_touches=9, most_seconds=8.0), state)
    for params, told in (
        (Params(most_touches=8), "most_touches is 8; 9 touches are made already"),
        (Params(most_seconds=7.0), r"most_seconds is 7 s; 8\.0 s have passed already"),
        (Params(tolerance=9e-6), "tolerance is 9e-06 m"),
    ):
        with pytest.raises(ValueError, match=told):
            NODE.check_set(params, state)
