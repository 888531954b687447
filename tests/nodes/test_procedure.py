"""The procedure node: moves become goals, findings messages, and refusals are told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.procedures import Findings, FingerMove, approach
from palpate.messages.types import (
    GraspContacts,
    ProcedureResult,
    SensorInfo,
    ShapeModel,
    SurfacePatch,
    TouchGoal,
    World,
)
from palpate.nodes.procedure import (
    Params,
    State,
    know_sensor,
    know_world,
    take_contacts,
    take_patch,
)
from palpate.nodes.runtime import Finished
from palpate.nodes.runtime.testing import example

HERE = __name__


def move(x: float = 0.0) -> FingerMove:
    return approach(np.array([x, 0.0, 0.05]), np.array([0.0, 0.0, 1.0]), 0.03, 0.0)


def two_at_once(setting: object, count: int = 1) -> Iterator[object]:
    """A procedure of one's own: pairs of touches, and where they were met."""
    met = []
    for number in range(count):
        met.append((yield (move(0.01 * number), move(-0.01 * number))))
    places = [one.pose[0] for pair in met for one in pair]
    return Findings(status="done", reason="touched", figures={"widest_m": max(places)})


def patch_of(goal: int, finger: int, x: float = 0.0) -> SurfacePatch:
    """What a finger met: nothing, at x."""
    pose = np.array([x, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0])
    told = {"pose": pose, "outcome": "miss", "kind": "miss", "robot_time": 1.0}
    image = np.zeros((16, 16))
    shapes = {"height": image, "mask": image > 0.0, "jet": np.zeros(0)}
    return replace(example(SurfacePatch), goal=goal, touch=0, finger=finger, **told, **shapes)


@pytest.fixture
def world() -> World:
    return World(platform=0.0, reach=0.1, fingers=2, seed=0)


def begun(world: World, info: SensorInfo, **params: object):
    own = Params(procedure=f"{HERE}:two_at_once", **params)
    state, nothing = know_world(own, State(), world)
    assert nothing == []
    return own, *know_sensor(own, state, info)


def test_moves_of_two_fingers_begin_together(world: World, info: SensorInfo):
    _, state, outputs = begun(world, info)
    goals = [goal for topic, goal in outputs if topic == "/finger/goal"]
    assert [goal.finger for goal in goals] == [1, 2] and state.under_way == 2
    assert all(isinstance(goal, TouchGoal) and goal.goal == 0 for goal in goals)


def test_it_goes_on_when_both_have_met_something_in_either_order(world, info):
    for order in ((1, 2), (2, 1)):
        params, state, _ = begun(world, info)
        state, outputs = take_patch(params, state, patch_of(goal=0, finger=order[0], x=0.01))
        assert outputs == []
        state, outputs = take_patch(params, state, patch_of(goal=0, finger=order[1], x=0.01))
        topics = [one[0] for one in outputs if not isinstance(one, Finished)]
        assert topics == ["/probe/traced"] * 2 + ["/procedure/result", "/model/shape"]
        result = outputs[2][1]
        assert isinstance(result, ProcedureResult) and result.touches == 2
        assert result.status == "done" and result.figures == {"widest_m": 0.01}
        model = outputs[3][1]
        assert isinstance(model, ShapeModel) and model.final and not len(model.faces)
        assert isinstance(outputs[-1], Finished)


def test_too_few_fingers_are_told_and_not_waited_for(info):
    alone = World(platform=0.0, reach=0.1, fingers=1, seed=0)
    _, _, outputs = begun(alone, info)
    result = outputs[0][1]
    assert (
        result.status == "unsuited"
        and "it needs 2 fingers at once, and there are 1" in result.reason
    )


def test_touches_that_are_not_allowed_end_it(world, info):
    params, state, _ = begun(world, info, most_touches=3, settings={"count": 5})
    for finger in (1, 2):
        state, outputs = take_patch(params, state, patch_of(goal=0, finger=finger, x=0.0))
    result = outputs[2][1]
    assert result.status == "incomplete" and result.reason == "3 touches were not enough"


def test_answers_that_nobody_asked_for_are_refused(world, info):
    params, state, _ = begun(world, info)
    with pytest.raises(ValueError, match="nobody asked for touch 0 of goal 7"):
        take_patch(params, state, patch_of(goal=7, finger=1, x=0.0))
    with pytest.raises(ValueError, match="nobody asked for closing"):
        take_contacts(params, state, example(GraspContacts))


def test_unknown_procedures_and_settings_are_refused():
    with pytest.raises(ValueError, match="there is no procedure 'planer'"):
        Params(procedure="planer")
    with pytest.raises(ValueError, match="has no setting 'contact'; it has contacts"):
        Params(procedure="containment", settings={"contact": 30})
