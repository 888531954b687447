from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from palpate.core import ROBOT_PRESETS
from palpate.core.explore import FEATURE_SHARE
from palpate.core.poses import inverse_pose, split_pose, transform_points
from palpate.messages import derive
from palpate.messages.codec import encode
from palpate.messages.fields import MAX_ITEMS
from palpate.messages.types.model import ModelGoal, ShapeModel, Superquadric
from palpate.messages.types.motion import ContourGoal, GraspContacts, GraspGoal, Probe, ProbeGoal
from palpate.messages.types.world import World
from palpate.nodes import planner
from palpate.nodes.planner import Params

TOUCHES = 20
UNIFORM = Params(planner="uniform", settings={"count": 5})
Said = list[tuple[str, Any]]
Explored = Callable[..., Said]


def bodies_by_topic(published: Said) -> list[bytes]:
    """In their order on each topic, which alone is kept."""
    return [encode(message) for _, message in sorted(published, key=lambda one: one[0])]


def of(published: Said, topic: str) -> list[Any]:
    return [message for received, message in published if received == topic]


@pytest.fixture
def several(world: World) -> World:
    return World(platform=world.platform, reach=world.reach, fingers=3, seed=world.seed)


def test_it_grasps_then_asks_for_the_coarse_model_and_then_slices(explored: Explored, world: World):
    published = explored(UNIFORM, world)
    topics = [topic for topic, _ in published]
    closings = topics.count("/hand/goal")
    assert topics[:closings] == ["/hand/goal"] * closings
    assert [goal.number for goal in of(published, "/hand/goal")] == list(range(closings))
    assert topics[closings] == "/model/goal"
    coarse = published[closings][1]
    assert (coarse.contours, coarse.probes, coarse.closings) == ((), (), closings)
    assert 6 * closings >= 60 > 6 * (closings - 1)
    assert topics[closings + 1] == "/probe/goal"


def test_nothing_is_decided_before_the_model_of_what_is_known(explored: Explored, world: World):
    published = explored(UNIFORM, world)
    work = [topic for topic, _ in published if topic in ("/contour/goal", "/model/goal")][1:]
    assert work[0] == "/contour/goal"
    assert all(a != b for a, b in pairwise(work))
    numbers = [goal.number for goal in of(published, "/model/goal")]
    assert numbers == list(range(1, len(numbers) + 1))
    [done] = of(published, "/plan/done")
    assert (done.number, len(done.contours)) == (numbers[-1] + 1, 5)
    assert done.touches == 5 * TOUCHES + len(of(published, "/probe/goal"))
    assert done.uncovered == 0.0


def test_goals_are_numbered_through_and_carry_frame_and_time(explored: Explored, world: World):
    published = explored(UNIFORM, world)
    goals = [goal for topic, goal in published if topic in ("/contour/goal", "/probe/goal")]
    assert [goal.id for goal in goals] == list(range(len(goals)))
    times = [goal.not_before for goal in goals]
    assert times == sorted(times)
    assert times[0] == 8.0 * len(of(published, "/hand/goal"))
    frames = {goal.frame.tobytes() for goal in of(published, "/contour/goal")}
    assert len(frames) == 1


def test_a_flat_top_is_touched_five_times_and_the_platform_never(explored: Explored, world: World):
    published = explored(UNIFORM, world)
    probes = of(published, "/probe/goal")
    assert all(
        transform_points(inverse_pose(goal.pose), np.zeros((1, 3)))[0, 2] > 0.0 for goal in probes
    )
    assert 5 <= len(probes) <= 13


def test_the_object_is_sliced_along_the_axis_that_is_asked_for_whatever_its_top_tells(
    explored: Explored, world: World
):
    published = explored(
        Params(axis=(0.6, 0.0, 0.8), planner="uniform", settings={"count": 3}), world
    )
    axes = np.stack([split_pose(goal.frame)[1][:, 2] for goal in of(published, "/contour/goal")])
    assert axes == pytest.approx(np.tile([0.6, 0.0, 0.8], (len(axes), 1)))


def test_contacts_that_tell_nothing_and_a_top_that_leans_come_to_an_end(
    explored: Explored, cylinder: Any, world: World
):
    lean = 0.2

    class Leaning(cylinder):
        """A box that leans, of which the contacts make no solid."""

        def contacts_of(self, goal: GraspGoal) -> GraspContacts:
            found = super().contacts_of(goal)
            turn = np.pi / 2 * (np.arange(len(found.normals)) % 4)
            across = np.stack([np.cos(lean), 0.0 * lean, -np.sin(lean)])
            found.normals[:] = np.cos(turn)[:, None] * across
            found.normals[:, 1] += np.sin(turn)
            return found

        def probe_of(self, goal: ProbeGoal) -> Probe:
            found = super().probe_of(goal)
            found.normal[:] = np.sin(lean), 0.0, np.cos(lean)
            return found

        def model_of(self, goal: ModelGoal) -> tuple[str, Any]:
            topic, model = super().model_of(goal)
            if isinstance(model, Superquadric):
                fields = {name: getattr(model, name) for name in model.__dataclass_fields__}
                model = Superquadric(**{**fields, "warnings": ("coplanar points",)})
            return topic, model

    published = explored(UNIFORM, world, Leaning())
    assert len(of(published, "/probe/goal")) < 30
    probes = [goal.id for goal in of(published, "/probe/goal")]
    [done] = of(published, "/plan/done")
    assert set(done.probes) <= set(probes) and done.probes[0] == probes[0]


def test_a_level_top_sets_an_axis_upright_that_contacts_made_lean(
    explored: Explored, cylinder: Any, world: World
):
    class Oblique(cylinder):
        """Its sections are level, and lie ever farther aside."""

        def contacts_of(self, goal: GraspGoal) -> GraspContacts:
            found = super().contacts_of(goal)
            found.points[:, 0] += 0.6 * (found.points[:, 2] - 0.05)
            return found

    published = explored(UNIFORM, world, Oblique())
    axes = np.stack([split_pose(goal.frame)[1][:, 2] for goal in of(published, "/contour/goal")])
    probes = np.stack([split_pose(goal.pose)[1][:, 2] for goal in of(published, "/probe/goal")])
    assert probes[0, 2] > -0.95  # along an axis that leans
    assert np.array_equal(axes, np.tile([0.0, 0.0, 1.0], (len(axes), 1)))


def test_it_ends_when_the_hand_closes_on_nothing(explored: Explored, cylinder: Any, world: World):
    shape = cylinder()
    shape.contacts = 0
    published = explored(UNIFORM, world, shape)
    assert len(of(published, "/hand/goal")) > 800  # everywhere within reach, twice
    [done] = of(published, "/plan/done")
    assert done.reason == "the hand closed on nothing within reach"
    assert (done.contours, done.reached, done.rms_bound_95) == ((), False, None)


def test_a_slice_that_fails_is_tried_again_nearby_and_told_of(
    explored: Explored, cylinder: Any, world: World
):
    def stuck(goal: ContourGoal) -> str:
        return "stuck" if 0.06 < goal.height < 0.09 else "closed"

    published = explored(UNIFORM, world, cylinder(stuck))
    tried = [goal.height for goal in of(published, "/contour/goal")]
    assert len([height for height in tried if 0.06 < height < 0.09]) == 2
    [done] = of(published, "/plan/done")
    assert len(done.contours) == 4 and done.failed
    assert 0.03 < done.uncovered < 0.05


def test_the_default_rule_covers_the_side_and_states_a_bound(explored: Explored, world: World):
    published = explored(Params(), world)
    [done] = of(published, "/plan/done")
    assert done.reached
    assert done.rms_bound_95 < Params().tolerance
    assert done.largest_untouched <= FEATURE_SHARE * Params().tolerance
    heights = sorted(goal.height for goal in of(published, "/contour/goal"))
    assert max(np.diff(heights)) <= 8e-3 + FEATURE_SHARE * Params().tolerance + 1e-9


@pytest.mark.parametrize(
    ("budget", "words"),
    [({"most_touches": 90}, "90 touches"), ({"most_seconds": 150.0}, "150 s of robot time")],
)
def test_a_budget_ends_it_and_is_kept(explored: Explored, world: World, budget: Any, words: str):
    params = Params(**budget)
    [done] = of(explored(params, world), "/plan/done")
    assert done.reason.startswith("the budget is spent")
    assert words in done.reason
    assert done.reached is False
    spent, most = (
        (done.touches, budget["most_touches"])
        if "most_touches" in budget
        else (done.robot_time, budget["most_seconds"])
    )
    assert 0.9 * most <= spent <= most
    assert done.arcs and not done.failed  # they were cut short, and say nothing of the object
    assert not set(done.arcs) & set(done.contours)


def test_a_contour_that_takes_more_touches_than_a_way_around_has_failed(
    explored: Explored, cylinder: Any, world: World
):
    class Endless(cylinder):
        def contour_of(self, goal: ContourGoal) -> Any:
            found = super().contour_of(goal)
            if 0.06 < goal.height < 0.09:
                found = replace(found, status="budget", touches=goal.most_touches)
            return found

    [done] = of(explored(UNIFORM, world, Endless()), "/plan/done")
    assert done.arcs and done.failed


def test_the_more_was_touched_the_more_is_touched_between_two_models(
    explored: Explored, world: World
):
    params = Params(planner="uniform", settings={"count": 40})
    models = [goal.touches for goal in of(explored(params, world), "/model/goal")][1:]
    early, late = np.diff(models[:6]), np.diff(models[-4:])
    assert early.max() <= 2 * TOUCHES and late.min() >= 2 * TOUCHES
    assert models[-1] > 0.9 * 40 * TOUCHES  # and whoever stops has a model of all there is


def test_several_fingers_share_what_touches_are_left(explored: Explored, several: World):
    published = explored(Params(most_touches=110), several)
    [done] = of(published, "/plan/done")
    assert 0.9 * 110 <= done.touches <= 110
    assert done.reason == "the budget is spent: 110 of 110 touches"


def test_the_hand_leaves_robot_time_for_contours(explored: Explored, world: World):
    all_the_time = len(of(explored(UNIFORM, world), "/hand/goal"))
    fast = replace(world, robot=ROBOT_PRESETS["modern"].array)
    hurried = of(explored(Params(most_seconds=90.0), fast), "/hand/goal")
    assert 2 <= len(hurried) < all_the_time
    [done] = of(explored(Params(most_seconds=5.0), fast), "/plan/done")
    assert done.reason == "the hand closed on nothing within reach and robot time"


def test_fingers_work_side_by_side_apart_from_each_other(explored: Explored, several: World):
    published = explored(Params(), several)
    goals = of(published, "/contour/goal")
    assert {goal.finger for goal in goals} == {1, 2, 3}
    first = goals[:3]
    assert sorted(goal.finger for goal in first) == [1, 2, 3]
    heights = sorted(goal.height for goal in first)
    assert min(np.diff(heights)) > 1.5 * 0.016 - 1e-12
    [done] = of(published, "/plan/done")
    assert done.reached


def test_the_order_in_which_fingers_arrive_changes_nothing(explored: Explored, several: World):
    def bodies(order: random.Random | None) -> list[bytes]:
        return bodies_by_topic(explored(Params(), several, order=order))

    expected = bodies(None)
    for seed in range(6):
        assert bodies(random.Random(seed)) == expected


@pytest.mark.parametrize("params", [Params(), UNIFORM], ids=["predicted", "uniform"])
def test_a_late_model_changes_nothing(explored: Explored, world: World, params: Params):
    def bodies(order: random.Random | None) -> list[bytes]:
        return bodies_by_topic(explored(params, world, order=order))

    expected = bodies(None)
    for seed in range(12):
        assert bodies(random.Random(seed)) == expected


def test_a_slice_in_which_no_model_has_a_say_is_begun_while_one_is_made(
    explored: Explored, world: World
):
    topics = [topic for topic, _ in explored(Params(), world)]
    work = [topic for topic in topics if topic in ("/contour/goal", "/model/goal")][1:]
    # The cover goes on beside its first models; whatever follows it waits for the last of them.
    assert work[:6] == ["/contour/goal", *2 * ["/model/goal", "/contour/goal"], "/model/goal"]
    at = [place for place, topic in enumerate(topics) if topic in work[:2]]
    beside = [topics[one + 1] for one in at if topics[one] == "/model/goal"][1:3]
    assert beside == ["/contour/goal", "/contour/goal"]


LOST = """
from dataclasses import dataclass
from palpate.core.explore.planners import Height, Stop

@dataclass(frozen=True)
class Lost:
    def next(self, observation):
        known = len(observation.slices)
        return Height(0.03 + 0.01 * known if known < 3 else 5.0, "why not")
"""


def test_an_answer_that_nobody_can_act_on_ends_it_with_what_there_is(
    explored: Explored, world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "lost_planner.py").write_text(LOST)
    monkeypatch.syspath_prepend(tmp_path)
    [done] = of(explored(Params(planner="lost_planner:Lost"), world), "/plan/done")
    assert len(done.contours) == 3
    assert done.reason.startswith("the planner Lost gave no answer to act on: a height must lie")
    assert not done.reached


def test_ends_of_a_general_solid_are_not_touched_apart(
    explored: Explored, cylinder: Any, world: World
):
    class General(cylinder):
        """A cylinder of which no slices tell."""

        def model_of(self, goal: ModelGoal) -> tuple[str, Any]:
            topic, model = super().model_of(goal)
            if isinstance(model, ShapeModel):
                model = derive(ShapeModel, model, method="general")
            return topic, model

    published = explored(UNIFORM, world, General())
    modelled = [topic for topic, _ in published].index("/contour/goal")
    assert of(published, "/plan/done")
    assert of(published[:modelled], "/probe/goal")
    assert not of(published[modelled:], "/probe/goal")


def test_it_ends_before_there_are_more_goals_than_a_model_can_list(
    explored: Explored, world: World, monkeypatch: pytest.MonkeyPatch
):
    assert planner.MOST_GOALS < MAX_ITEMS
    monkeypatch.setattr(planner, "MOST_GOALS", 4)
    [done] = of(explored(UNIFORM, world), "/plan/done")
    assert done.reason == "a model can list no more contours and single touches"
    assert len(done.contours) < 5


def test_a_tolerance_that_the_sensor_cannot_tell_is_refused(explored: Explored, world: World):
    with pytest.raises(ValueError, match="tolerance is 1e-06 m; it must be at least what the sen"):
        explored(Params(tolerance=1e-6), world)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"most_touches": 0}, "most_touches"),
        ({"most_seconds": 0.0}, "most_seconds"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"planner": "best"}, "there is no planner 'best'; there are predicted, touches, uniform"),
        ({"planner": "uniform", "settings": {"count": 0}}, "count is 0; expected 1 to 1000"),
        ({"settings": {"contours": 5}}, "has no contours; it has cover"),
        ({"axis": [0.0, 0.0, 0.0]}, "axis must have a length, got"),
        ({"axis": [1.0, 0.0]}, "length 3"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(params: Any, words: str):
    with pytest.raises(msgspec.ValidationError, match=words):
        msgspec.convert(params, Params)


def test_a_model_that_drops_a_contour_has_its_slice_traced_again(
    explored: Explored, cylinder: Any, world: World
):
    class Dropping(cylinder):
        def model_of(self, goal: ModelGoal) -> tuple[str, Any]:
            topic, model = super().model_of(goal)
            if isinstance(model, ShapeModel) and len(goal.contours) > 1:
                dropped = goal.contours[1:2]
                fields = {name: getattr(model, name) for name in model.__dataclass_fields__}
                model = ShapeModel(
                    **{**fields, "dropped": dropped, "dropped_reasons": ("it crosses itself",)}
                )
            return topic, model

    published = explored(UNIFORM, world, Dropping())
    heights = [goal.height for goal in of(published, "/contour/goal")]
    assert len(heights) == 6  # the one that was dropped, once more
