from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest

from palpate.launch.graph import Entry, Graph
from palpate.launch.located import InputError
from palpate.launch.override import read_settings
from palpate.launch.replay.again import replay
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.composed import run_composed
from palpate.nodes.node import Node, Outputs
from palpate.nodes.object import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.recording import with_description

Lines = list[str]


class Deaf:
    """A watcher that does not listen."""

    def ready(self, seconds: float) -> None: ...

    def heard(self, topic: str, message: object) -> None: ...

    def log(self, record: LogRecord) -> None: ...

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None: ...


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recording of a whole exploration of a ball: one contour, and a probe or two."""
    path = tmp_path_factory.mktemp("explored") / "topics.mcap"
    ball = ObjectSpec(
        superquadric=SuperquadricSpec(size=(0.03,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(0.0, 0.0, 0.03)),
    )
    params = {
        "simulator": {"object": msgspec.to_builtins(ball, builtin_types=(bytes,))},
        "planner": {"planner": "uniform", "settings": {"count": 1}, "most_touches": 22},
        "recorder": {"path": str(path)},
    }
    kinds = ["simulator", "filter", "curvature", "tracer", "planner", "reconstructor"]
    entries = tuple(
        Entry(name=kind, params=params.get(kind, {})) for kind in [*kinds, "evaluator", "recorder"]
    )
    wirings = with_description(Graph(entries, ends="evaluator").wirings())
    ending = run_composed(wirings, ends="evaluator", hear=(), watcher=Deaf())
    assert ending.status == "finished", ending.reason
    return path


def test_the_nodes_of_a_real_run_say_the_same_again(explored: Path) -> None:
    lines: Lines = []

    code = replay(explored, (), lines.append)

    assert code == 0
    names = [line.partition(":")[0] for line in lines]
    assert names == ["filter", "curvature", "evaluator"]
    assert all(": identical, " in line for line in lines)


@pytest.mark.parametrize("name", ["simulator", "tracer", "planner"])
def test_nodes_of_a_composed_run_that_hear_several_say_the_same_again(
    name: str, explored: Path
) -> None:
    lines: Lines = []

    assert replay(explored, [name], lines.append) == 0
    assert lines[0].startswith(f"{name}: identical, ")


def test_nodes_that_hear_each_other_say_the_same_again(explored: Path) -> None:
    names = ["simulator", "filter", "curvature", "tracer", "planner", "reconstructor", "evaluator"]
    lines: Lines = []

    assert replay(explored, names, lines.append) == 0
    assert all(": identical, " in line for line in lines)


def test_curvature_hears_what_the_filter_says_with_its_new_parameter(explored: Path) -> None:
    settings = read_settings(["filter.order=median-first"])
    lines: Lines = []

    assert replay(explored, ["filter", "curvature"], lines.append, settings=settings) == 0
    assert lines[1].startswith("curvature: differs, /touch/patch ")
    fields = {tuple(line.split()[:2]) for line in lines[3:]}
    assert ("/touch/image", "compression") in fields
    assert ("/touch/patch", "k1") in fields
    assert ("/touch/patch", "pose[0:3]") not in fields  # where the arm was does not depend on it


def test_a_parameter_of_a_node_that_is_not_run_again_is_refused(explored: Path) -> None:
    lines: Lines = []

    with pytest.raises(InputError, match="'filter' is not among the nodes to run again: curvature"):
        replay(explored, ["curvature"], lines.append, settings=read_settings(["filter.order=none"]))
    assert lines == []


def test_a_changed_filter_is_found_out(explored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.nodes import filter as filtering

    inputs = dict(filtering.NODE.inputs)
    cls, handler = inputs["/touch/raw"]

    def off_by_a_bit(params: Any, state: Any, message: Any) -> tuple[Any, Outputs]:
        state, outputs = handler(params, state, message)
        [(topic, image)] = outputs  # type: ignore[misc]
        image.compression.flat[100] *= 1 + 2**-52
        return state, [(topic, image)]

    inputs["/touch/raw"] = (cls, off_by_a_bit)
    changed = Node(
        params=filtering.NODE.params,
        start=filtering.NODE.start,
        inputs=inputs,
        outputs=filtering.NODE.outputs,
        needs=filtering.NODE.needs,
    )
    monkeypatch.setattr(filtering, "NODE", changed)
    lines: Lines = []

    assert replay(explored, ["filter"], lines.append) == 1
    assert lines[0].startswith("filter: differs, /touch/image ")
    assert " compression[6, 4]: recorded " in lines[0]
