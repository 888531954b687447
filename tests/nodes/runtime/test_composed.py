from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from palpate.nodes.runtime.composed import run_composed
from palpate.nodes.runtime.node import Wiring
from palpate.nodes.specs.objects import ObjectSpec
from tests.studies.toy_node import ToyParams, toy

Exploration = Callable[..., tuple[Wiring, ...]]


def test_the_loop_closes_and_ends(ball: ObjectSpec, exploration: Exploration, ears: Any):
    wirings = exploration(ball, 3)
    watch = ("/score", "/model/shape", "/contour/traced")
    ending = run_composed(wirings, ends="evaluator", watch=watch, watcher=ears)
    assert (ending.status, ending.gaps, ending.duplicates) == ("finished", 0, 0)
    assert [contour.status for contour in ears.of("/contour/traced")] == ["closed"] * 3
    score = ears.of("/score")[-1]
    assert score.final
    assert score.watertight
    assert score.genus == 0
    # Three contours of a ball feel nearly all of it.
    assert score.chamfer < 2e-4 * score.size
    assert score.sampling_floor > 0.0


def test_a_node_that_raises_ends_the_graph_with_its_words(
    ball: ObjectSpec, exploration: Exploration, ears: Any, monkeypatch: pytest.MonkeyPatch
):
    def fail(*_: object, **__: object) -> None:
        raise ValueError("a taxel came off")

    monkeypatch.setattr("palpate.nodes.filter.clean", fail)
    ending = run_composed(exploration(ball, 1), ends="evaluator", watch=(), watcher=ears)
    assert ending.status == "died"
    assert "filter handling /touch/raw 0" in ending.reason
    assert "a taxel came off" in ending.reason
    line = fail.__code__.co_firstlineno + 1
    assert ending.reason.endswith(f"test_composed.py:{line} in fail)")


def test_a_graph_that_falls_quiet_has_stalled(
    ball: ObjectSpec, exploration: Exploration, ears: Any
):
    wirings = [one for one in exploration(ball, 1) if one.name != "tracer"]
    ending = run_composed(wirings, ends="evaluator", watch=(), watcher=ears)
    assert (ending.status, ending.reason) == (
        "stalled",
        "all is quiet, and evaluator has not finished",
    )


def test_what_each_node_published_and_handled_is_counted(ears: Any):
    wirings = [
        toy("source", ToyParams(burst=5), subscribers=("counter",)),
        toy("counter", ToyParams(expects=5), upstream="source"),
    ]
    ending = run_composed(wirings, ends="counter", watch=(), watcher=ears)
    assert ending.status == "finished"
    for name, messages, sent in (("source", 0, 5), ("counter", 5, 0)):
        found = ending.statuses[name]
        assert (found.node, found.messages, found.sent) == (name, messages, sent)
        assert (found.gaps, found.duplicates) == (0, 0)
        assert 0.0 < sum(found.steps.values()) <= found.cpu
        assert set(found.steps) == {name}
