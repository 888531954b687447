from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest

from palpate.launch.bag.diff import compare
from palpate.launch.cli import main as cli
from palpate.launch.graph import Entry, Graph
from palpate.launch.located import InputError
from palpate.launch.override import read_settings
from palpate.launch.replay.again import replay
from palpate.launch.replay.comparison import TopicComparison
from palpate.messages.recording.reader import open_recording
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.composed import run_composed
from palpate.nodes.node import Node, Outputs
from palpate.nodes.object import ObjectSpec, PoseSpec, SuperquadricSpec
from palpate.nodes.recording import with_description

Lines = list[str]
KINDS = ["simulator", "filter", "curvature", "tracer", "planner", "reconstructor", "evaluator"]


class Deaf:
    """A watcher that does not listen."""

    def ready(self, seconds: float) -> None: ...

    def heard(self, topic: str, message: object) -> None: ...

    def log(self, record: LogRecord) -> None: ...

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None: ...


def explore(path: Path, contact: float = 50e-6) -> Path:
    """Recording of a whole exploration of a ball: one contour, and a probe or two."""
    ball = ObjectSpec(
        superquadric=SuperquadricSpec(size=(0.03,) * 3, exponents=(1.0, 1.0)),
        pose=PoseSpec(position=(0.0, 0.0, 0.03)),
    )
    params = {
        "simulator": {"object": msgspec.to_builtins(ball, builtin_types=(bytes,))},
        "filter": {"contact": contact},
        "planner": {"planner": "uniform", "settings": {"count": 1}, "most_touches": 22},
        "recorder": {"path": str(path)},
    }
    entries = tuple(Entry(name=kind, params=params.get(kind, {})) for kind in [*KINDS, "recorder"])
    wirings = with_description(Graph(entries, ends="evaluator").wirings(), {})
    ending = run_composed(wirings, ends="evaluator", hear=(), watcher=Deaf())
    assert ending.status == "finished", ending.reason
    return path


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return explore(tmp_path_factory.mktemp("explored") / "topics.mcap")


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
    lines: Lines = []

    assert replay(explored, KINDS, lines.append) == 0
    assert all(": identical, " in line for line in lines)


@pytest.mark.slow
def test_all_nodes_together_say_what_a_run_with_that_parameter_says(
    explored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: dict[str, list[bytes]] = {}
    take = TopicComparison.said

    def keep(comparison: TopicComparison, body: bytes) -> None:
        said.setdefault(comparison.topic, []).append(body)
        take(comparison, body)

    monkeypatch.setattr(TopicComparison, "said", keep)
    settings = read_settings(["filter.contact=300e-6"])
    assert replay(explored, KINDS, lambda line: None, settings=settings) == 0

    run: dict[str, list[bytes]] = {}
    other = explore(tmp_path / "topics.mcap", contact=300e-6)
    for kept in open_recording(other).messages():
        run.setdefault(kept.topic, []).append(kept.body)
    assert said == run
    assert compare(explored, other).topics["/contour/traced"].differ == 1


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


def test_the_verb_takes_the_folder_of_a_run_and_parameters(
    explored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    verb = ["replay", str(explored.parent), "--nodes", "filter, curvature"]

    assert cli.run([*verb, "--set", "filter.order=auto"]) == 0
    assert capsys.readouterr().out.count(": identical, ") == 2
    assert cli.run([*verb, "--set", "filter.order=none", "--set", "filter.contact=100e-6"]) == 0
    assert "\n/touch/image  mask " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("filter.order=median-frist", "filter.order is 'median-frist'; expected one of auto, "),
        ("filter.oder=median", "unknown key 'oder' in filter; did you mean 'order'?"),
        ("planner.most_touches=9", "'planner' is not among the nodes to run again: filter; add"),
    ],
)
def test_a_setting_that_cannot_be_used_is_refused_in_one_sentence(
    setting: str, words: str, explored: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["replay", str(explored), "--nodes", "filter", "--set", setting]) == 2

    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"palpate: --set {setting}: {words}")
    assert err.count("\n") == 1


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
