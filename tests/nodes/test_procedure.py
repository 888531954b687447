"""Procedure node: moves become goals, findings messages, and refusals are told."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.explore.grasp import Hand
from palpate.core.poses import Pose
from palpate.core.procedures import Findings, FingerMove, HandMove, approach
from palpate.messages.types import GraspContacts, SurfacePatch, World
from palpate.nodes.procedure import NODE, Params
from palpate.nodes.runtime.node import Finished
from palpate.nodes.runtime.testing import drive, example, messages_on
from tests.messages.cases import cases
from tests.nodes.loop import INFO

HERE = __name__
TWO = World(platform=0.0, reach=0.1, fingers=2, seed=0)


def move(x: float = 0.0) -> FingerMove:
    return approach(np.array([x, 0.0, 0.05]), np.array([0.0, 0.0, 1.0]), 0.03, 0.0)


def two_at_once(setting: object, count: int = 1) -> Iterator[object]:
    """A procedure of one's own: pairs of touches, and where they were met."""
    met = []
    for number in range(count):
        met.append((yield (move(0.01 * number), move(-0.01 * number))))
    places = [one.pose.position[0] for pair in met for one in pair]
    return Findings(status="done", reason="touched", figures={"widest_m": max(places)})


def closings(setting: object) -> Iterator[object]:
    """A procedure of one's own: the hand closes twice."""
    hand, met = Hand(fingers=3, opening=0.1, reach=0.09), []
    for height in (0.05, 0.04):
        met.append((yield HandMove(hand, Pose(np.array([0.0, 0.0, height]), np.eye(3)))))
    counts = {"contacts": float(sum(len(one.points) for one in met))}
    return Findings(status="done", reason="closed", figures=counts)


def patch_of(goal: int, finger: int, x: float = 0.0) -> tuple[str, SurfacePatch]:
    """What a finger met: nothing, at x."""
    fields = {"outcome": "miss", "kind": "miss", "robot_time": 1.0 + finger}
    fields |= {"pose": np.array([x, 0.0, 0.05, 0, 0, 0, 1.0]), "height": np.zeros((16, 16))}
    fields |= {"mask": np.zeros((16, 16), bool), "goal": goal, "finger": finger}
    return "/touch/patch", example(SurfacePatch, **fields)


def published(*more: Any, world: World = TWO, **params: Any) -> list[Any]:
    own = {"procedure": f"{HERE}:two_at_once", **params}
    return drive(NODE, [("/world", world), ("/touch/info", INFO), *more], own)


def test_moves_of_two_fingers_begin_together_and_the_hand_closes_again():
    first, second = messages_on(published(), "/finger/goal")
    for finger, goal in ((1, first), (2, second)):
        assert (goal.finger, goal.goal, goal.touch) == (finger, 0, 0)
    assert np.array_equal(first.pose, move().pose.array) and first.reach == move().reach
    later = published(patch_of(0, 1), patch_of(0, 2), settings={"count": 2})
    goals = messages_on(later, "/finger/goal")[2:]
    assert [(goal.goal, goal.not_before) for goal in goals] == [(1, 3.0)] * 2
    assert goals[1].pose[0] == pytest.approx(-0.01)
    fields = {"robot_time": 4.0, "points": np.ones((2, 3))}
    contacts = [("/hand/contacts", example(GraspContacts, number=n, **fields)) for n in range(2)]
    outputs = published(*contacts, procedure=f"{HERE}:closings")
    first, second = messages_on(outputs, "/hand/goal")
    assert (first.number, first.fingers, first.opening, first.reach) == (0, 3, 0.1, 0.09)
    assert (second.number, second.pose[2], second.not_before) == (1, 0.04, 4.0)
    [result] = messages_on(outputs, "/procedure/result")
    assert (result.figures, result.contacts, result.touches) == ({"contacts": 4.0}, 4, 0)


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_procedure_goes_on_when_all_have_met_something(order: tuple[int, int]):
    first, second = (patch_of(0, finger, 0.01) for finger in order)
    assert len(published(first)) == 2
    outputs = published(first, second)[2:]
    topics = [first[0] for first in outputs if not isinstance(first, Finished)]
    assert topics == ["/probe/traced"] * 2 + ["/procedure/result", "/model/shape"]
    [result], [model] = messages_on(outputs, topics[2]), messages_on(outputs, topics[3])
    assert (result.status, result.reason, result.touches) == ("done", "touched", 2)
    assert result.figures == {"widest_m": 0.01} and result.robot_time == 3.0
    assert model.final and not len(model.faces) and model.method == "procedure"
    assert isinstance(outputs[-1], Finished)
    assert len({probe.id for probe in messages_on(outputs, "/probe/traced")}) == 2


def test_too_few_fingers_or_touches_end_it_and_unknown_settings_are_refused():
    [result] = messages_on(published(world=replace(TWO, fingers=1)), "/procedure/result")
    assert result.status == "unsuited"
    assert "it needs 2 fingers at once, and there are 1" in result.reason
    patches = [patch_of(0, 1), patch_of(0, 2)]
    outputs = published(*patches, most_touches=3, settings={"count": 5})
    [result] = messages_on(outputs, "/procedure/result")
    assert (result.status, result.reason) == ("incomplete", "3 touches were not enough")
    with pytest.raises(ValueError, match="there is no procedure 'planer'"):
        Params(procedure="planer")
    with pytest.raises(ValueError, match="has no setting 'contact'; it has contacts"):
        Params(procedure="containment", settings={"contact": 30})


@cases(
    "answer, words",
    (patch_of(7, 1), "unexpected touch 0 of goal 7"),
    (patch_of(0, 3), "unexpected touch 0 of goal 0"),
    (("/hand/contacts", example(GraspContacts)), "unexpected closing 0"),
)
def test_answer_that_was_not_asked_for_is_refused(answer: Any, words: str):
    with pytest.raises(ValueError, match=words):
        published(answer)
