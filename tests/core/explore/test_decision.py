"""What follows from what is known of an upright cylinder: no node, no message, no socket."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core import explore
from palpate.core.explore import grasp, planners, probing
from palpate.core.poses import FACING_DOWN, Pose
from tests.core.explore.planners.sides import Says
from tests.core.explore.test_survey import SETUP, cone

RADIUS, TOP = 0.03, 0.1  # [m]
TURN = 2.0 * math.pi * np.arange(90) / 90
RIM = np.column_stack([np.cos(TURN), np.sin(TURN), np.zeros(90)])
UP = np.array([0.0, 0.0, 1.0])
FRAME = grasp.ObjectFrame(Pose(np.zeros(3), np.eye(3)), 0.0, TOP, RADIUS, "given", 0.0, 0.0, 0.0)
ABOVE = Pose(np.array([0.0, 0.0, 0.12]), FACING_DOWN)
SEARCH = probing.ProbeCommand(ABOVE, 0.05, "search", TOP * UP)
SURVEY = explore.Survey(
    frame=FRAME,
    low=0.0,
    high=TOP,
    low_deviation=0.0,
    high_deviation=0.0,
    standing=True,
    reached=(0.01, 0.09),
).with_end_touch("upper", probing.ProbeResult(SEARCH, "hit", TOP * UP, UP))
DEMAND = explore.Demand(2e-4, 0.02, most_touches=math.inf, most_seconds=math.inf)
RULE = planners.Uniform(count=5)
SINGLE = explore.SingleTouch(planners.Touch(ABOVE, 0.05, TOP * UP, "why not"))


def exploration(fingers: int = 1, **changes: Any) -> explore.Exploration:
    """What is known at the beginning, or as far as `changes` say."""
    idle = dict.fromkeys(range(1, fingers + 1), explore.Finger())
    return explore.Exploration(**({"setup": SETUP, "fingers": idle} | changes))


def acted(
    known: explore.Exploration, demand: explore.Demand = DEMAND, rule: planners.Planner = RULE
) -> tuple[explore.Exploration, list[explore.Goal]]:
    """What is known after the goals that follow, and these."""
    goals = explore.goals(known, demand, rule)
    for goal in goals:
        known = known.after(goal)
    return known, goals


def finished(
    known: explore.Exploration, finger: int, robot_time: float, **changes: Any
) -> explore.Exploration:
    """With the result of a finger that has traced its slice, or touched."""
    task = known.fingers[finger].task
    traced = cone(task.height, number=task.number)
    is_slice = isinstance(task.work, explore.TraceSlice)
    measured = traced if is_slice else explore.ProbedPoint("hit", TOP * UP, UP)
    fields = {"touches": 20 if is_slice else 1, "fault": "none", "measured": measured} | changes
    result = explore.Result(robot_time=robot_time, **fields)
    return known.with_finger(finger, known.fingers[finger]._replace(result=result))


def taken_up(known: explore.Exploration) -> explore.Exploration:
    return explore.with_result(known, known.next_finger, DEMAND.feature)


def modelled(known: explore.Exploration, **changes: Any) -> explore.Exploration:
    usual = {"surface": None, "general": False}
    none = explore.ModelUncertainty()
    return explore.with_model(known, frozenset(), none, **(usual | changes))


def test_hand_closes_until_it_has_touched_enough_or_looked_everywhere():
    known, [closing] = acted(exploration())
    assert isinstance(closing, explore.CloseHand) and known.hand.last is closing
    touched = explore.with_contacts(known, RADIUS * RIM + 0.05 * UP, RIM, seconds=8.0)
    assert touched.hand.grips == 1 and acted(touched)[1] == [explore.MakeModel()]
    known, nothing = exploration(setup=SETUP._replace(reach=0.08)), np.zeros((0, 3))
    known, _ = acted(known)
    for _ in range(1000):
        known, [goal] = acted(explore.with_contacts(known, nothing, nothing, seconds=1.0))
        if isinstance(goal, explore.Done):
            break
    assert goal == explore.Done("the hand closed on nothing within reach")


def test_one_finger_looks_for_the_end_before_there_are_slices():
    known, [task] = acted(exploration(3, survey=replace(SURVEY, ends={})))
    assert isinstance(task, explore.Task) and task.max_touches == 1
    assert isinstance(task.work, explore.TouchEnd) and task.work.end == "upper"
    assert acted(known)[1] == []
    _, slices = acted(taken_up(finished(known, 1, 2.0)))
    assert [task.finger for task in slices] == [1, 2, 3]
    assert all(isinstance(task.work, explore.TraceSlice) for task in slices)
    every = exploration(survey=replace(SURVEY, ends={}), model=explore.ModelStatus(general=True))
    [task] = acted(every)[1]  # a general solid has no ends to be touched
    assert isinstance(task.work, explore.TraceSlice)


def test_finished_contour_is_followed_by_a_model_and_the_next_slice():
    known, [first] = acted(exploration(survey=SURVEY))
    known, [model, second] = acted(taken_up(finished(known, 1, 25.0)))
    assert model == explore.MakeModel() and known.model.is_pending
    assert (second.number, second.start) == (first.number + 1, 25.0)
    assert abs(second.height - first.height) > 0.01
    assert known.surveyed.contours == (first.number,) and known.touches == 20
    known = finished(known, 1, 50.0)  # its result waits while the model is in the making
    assert known.next_finger is None and acted(known)[1] == []
    assert modelled(known).next_finger == 1


@pytest.mark.parametrize(
    ("results", "clocks", "first"),
    [
        ({}, {}, None),
        ({1: 5.0}, {2: 4.0}, None),
        ({1: 5.0}, {2: 5.5}, 1),
        ({1: 5.0, 2: 4.0}, {}, 2),
        ({2: 5.0}, {}, None),  # the clock of finger 1 is not known
        ({1: 5.0, 2: 5.0}, {}, 1),
        ({2: 5.0}, {1: 5.0}, None),  # finger 1 may still end at 5 s, and comes first then
        ({2: 5.0}, {1: 6.0, 3: 5.0}, 2),
    ],
)
def test_earliest_result_is_taken_up_when_none_can_be_earlier(results, clocks, first):
    known, tasks = acted(exploration(3, survey=SURVEY))
    assert len(tasks) == 3
    for finger, clock in ({3: 9.0} | clocks).items():
        known = known.with_finger(finger, known.fingers[finger]._replace(clock=clock))
    for finger, robot_time in results.items():
        known = finished(known, finger, robot_time)
    assert known.next_finger == first


@pytest.mark.parametrize(
    ("changes", "demand", "reason"),
    [
        ({"touches": 20}, {"most_touches": 20}, "the budget is spent: 20 of 20 touches"),
        ({"seconds": 9.0}, {"most_seconds": 9}, "the budget is spent: 9 of 9 s of robot time"),
        ({"is_cut": True}, {"most_touches": 20}, "the budget is spent: 0 of 20 touches"),
        ({"broken": "it fell off"}, {}, "it fell off"),
        ({"goals": 4}, {}, "a model can list no more contours and single touches"),
    ],
)
def test_exploration_is_done_when_nothing_more_can_be_touched(changes, demand, reason):
    setup = SETUP._replace(goals=explore.GoalSettings(max_goals=4))
    known = exploration(survey=SURVEY, **({"setup": setup} | changes))
    assert acted(known, DEMAND._replace(**demand))[1] == [explore.Done(reason)]


def test_task_without_a_limit_leaves_no_touches_to_others_once_there_is_one():
    known, tasks = acted(exploration(2, survey=SURVEY))
    assert [task.max_touches for task in tasks] == [math.inf, math.inf]
    known = taken_up(finished(finished(known, 1, 5.0), 2, 6.0))
    limited = DEMAND._replace(most_touches=500)
    assert acted(known, limited)[1] == [explore.MakeModel()]
    [*_, task] = acted(taken_up(known), limited)[1]
    assert task.max_touches == 40  # twice what a contour took, for there are two fingers


def test_sensor_is_given_up_after_one_contour_or_three_touches():
    known, _ = acted(exploration(survey=SURVEY))
    broken = taken_up(finished(known, 1, 25.0, fault="dead")).broken
    assert broken.startswith("the sensor of finger 1 failed: ")
    known, faults = exploration(survey=SURVEY, retry=SINGLE), []
    for i in range(3):
        known, _ = acted(replace(known, retry=SINGLE))
        known = taken_up(finished(known, 1, float(i), fault="frozen"))
        faults.append(bool(known.broken))
    assert faults == [False, False, True]


def test_touch_that_began_inside_is_begun_twice_from_farther_off():
    known, away = exploration(survey=SURVEY, retry=SINGLE), []
    inside = explore.ProbedPoint("inside", TOP * UP, UP)
    while known.retry is not None:
        known, [task] = acted(known)
        away.append((float(task.work.touch.pose.position[2]), task.work.touch.reach))
        known = taken_up(finished(known, 1, 1.0, measured=inside))
    assert np.array(away) == pytest.approx(np.array([[0.12, 0.05], [0.135, 0.065], [0.15, 0.08]]))
    assert known.probes == () and known.refused == pytest.approx(TOP * UP[None])
    for outcome, point, probes, refused in (
        ("hit", TOP * UP, (0,), 0),
        ("hit", 0.09 * UP, (0,), 1),
        ("miss", TOP * UP, (), 1),
    ):
        known, _ = acted(exploration(survey=SURVEY, retry=SINGLE))
        known = taken_up(finished(known, 1, 1.0, measured=explore.ProbedPoint(outcome, point, UP)))
        assert (known.probes, len(known.refused), len(known.targets)) == (probes, refused, 1)
        assert modelled(known).targets == ()


def test_answer_that_cannot_be_acted_on_ends_with_what_there_is():
    known = exploration(survey=SURVEY, touches=20)
    [done] = acted(known, rule=Says(planners.Height(5.0, "why not")))[1]
    words = "the planner Says gave an invalid answer: a height must lie"
    assert isinstance(done, explore.Done) and done.reason.startswith(words)
    with pytest.raises(ValueError, match="nothing is under way, and the planner neither stops"):
        acted(known, DEMAND._replace(most_touches=20), Says(planners.Height(0.05, "why not")))


def test_after_a_turn_the_hand_closes_then_a_model_tells_how_it_lies():
    known = exploration(survey=SURVEY, hand=explore.HandContacts(closings=7, fit=None))
    upside_down = Pose(np.array([0.0, 0.0, TOP]), FACING_DOWN)
    known = known.after(explore.TurnObject(upside_down))
    assert acted(known)[1] == []  # the hand is still at it
    known = explore.with_turned(known, 60.0)
    known, [closing] = acted(known)
    assert isinstance(closing, explore.CloseHand) and known.hand.closings == 7
    assert known.lying == explore.Lying(1, None) and known.seconds == 60.0
    met = TOP * np.repeat(UP[None], 48, axis=0) + RADIUS * RIM[:48]
    known = explore.with_contacts(known, met, RIM[:48], 70.0)
    known, goals = acted(known)
    assert goals == [explore.MakeModel()] and acted(known)[1] == []
    told = modelled(known, general=True, lying=explore.Lying(1, upside_down))
    assert told.lying.pose is upside_down and not told.model.is_pending
    lost = explore.Lying(1, None, fault="its contacts fit nowhere")
    known = modelled(known, general=True, lying=lost)
    known, [closing] = acted(known)  # the hand closes more often
    assert isinstance(closing, explore.CloseHand)
    known = explore.with_contacts(known, met, RIM[:48], 80.0)
    known, goals = acted(known)
    assert goals == [explore.MakeModel()]
    known = modelled(known, general=True, lying=lost)
    assert acted(known)[1] == [explore.Done("its contacts fit nowhere")]


def test_targets_of_single_touches_turn_with_the_object():
    pose = Pose(np.array([0.01, 0.0, TOP]), FACING_DOWN)
    known = replace(exploration(survey=SURVEY), lying=explore.Lying(1, pose))
    known = known.after(explore.Task(0, 1, 0.0, TOP, 1.0, math.inf, SINGLE))
    result = explore.Result(5.0, 1, "none", explore.ProbedPoint("hit", TOP * UP, UP))
    known = known.with_finger(1, known.fingers[1]._replace(result=result))
    known = explore.with_result(known, 1, 1e-3)
    assert known.singles[0].target == pytest.approx(pose.to_local(TOP * UP))
    assert known.aimed[0] == pytest.approx(TOP * UP)
    turned_back = replace(known, lying=explore.Lying())
    assert turned_back.aimed[0] == pytest.approx(pose.to_local(TOP * UP))
