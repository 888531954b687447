from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.messages.codec import encode
from palpate.messages.types import PlanDone, ShapeModel
from palpate.nodes.composed import run_composed
from palpate.nodes.object import ObjectSpec
from palpate.nodes.reconstructor import NODE, Params
from palpate.nodes.wiring import Wiring

Exploration = Callable[[ObjectSpec, int], tuple[Wiring, ...]]


@pytest.fixture(scope="module")
def heard() -> list[tuple[str, Any]]:
    """What a reconstructor hears of a ball with two contours, in one order that happened."""
    return []


@pytest.fixture
def inputs(ball: ObjectSpec, exploration: Exploration, ears: Any, heard: list[Any]) -> list[Any]:
    if not heard:
        wirings = exploration(ball, 2)
        ending = run_composed(wirings, ends="evaluator", hear=tuple(NODE.inputs), watcher=ears)
        assert ending.status == "finished", ending.reason
        heard.extend(ears.messages)
    return list(heard)


def models(messages: list[tuple[str, Any]]) -> list[ShapeModel]:
    """What the node says to these messages, in this order."""
    state, _ = NODE.start(Params())
    said: list[ShapeModel] = []
    for topic, message in messages:
        state, outputs = NODE.inputs[topic][1](Params(), state, message)
        said += [model for _, model in outputs]  # type: ignore[misc]
    return said


def test_each_goal_gets_one_model_of_exactly_its_set(inputs: list[Any]) -> None:
    goals = [m for t, m in inputs if t in ("/model/goal", "/plan/done")]
    said = models(inputs)
    assert [model.number for model in said] == [goal.number for goal in goals]
    assert [model.contours for model in said] == [goal.contours for goal in goals]
    assert [model.final for model in said] == [False, False, True]


def test_a_model_can_be_sent_and_is_closed(inputs: list[Any]) -> None:
    last = models(inputs)[-1]
    assert encode(last)
    edges = np.sort(last.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_goals_before_their_touches_wait_for_them(inputs: list[Any]) -> None:
    info = [one for one in inputs if one[0] in ("/world", "/touch/info")]
    goals = [one for one in inputs if one[0] in ("/model/goal", "/plan/done")]
    rest = [one for one in inputs if one[0] not in NODE.needs and one not in goals]
    early = models(info + goals + rest)
    assert [encode(one) for one in early] == [encode(one) for one in models(inputs)]


def test_touches_after_everything_else_complete_the_sets(inputs: list[Any]) -> None:
    patches = [one for one in inputs if one[0] == "/touch/patch"]
    before = [one for one in inputs if one[0] != "/touch/patch"]
    late = models(before + patches)
    assert [encode(one) for one in late] == [encode(one) for one in models(inputs)]


def test_a_set_that_lacks_a_touch_is_not_fitted(inputs: list[Any]) -> None:
    last = max(i for i, (topic, _) in enumerate(inputs) if topic == "/touch/patch")
    assert len(models(inputs[:last] + inputs[last + 1 :])) == 2


def test_nothing_to_rebuild_gives_an_empty_model() -> None:
    done = PlanDone(
        number=1,
        contours=(),
        probes=(),
        touches=19,
        robot_time=30.0,
        reason="nothing was felt from above",
        within=None,
        bound=None,
        unfelt=None,
        uncovered=0.0,
    )
    [model] = models([("/plan/done", done)])
    assert (len(model.vertices), model.final, model.touches) == (0, True, 19)
    assert encode(model)
