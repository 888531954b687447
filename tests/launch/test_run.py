from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.launch.display import Silence
from palpate.launch.located import InputError, Located
from palpate.launch.override import read_settings
from palpate.launch.run import Run, perform, plan_run
from palpate.messages.types import Contour, Score, ShapeModel
from palpate.nodes.node import Finished, Node

MakeNode = Callable[..., str]
Write = Callable[[str, str], Path]

LAUNCH = """
args: {seed: 5, maker: t.maker}
nodes:
  maker: {kind: $(maker)}
  judge: {kind: t.judge}
ends: judge
"""


@pytest.fixture
def launch_file(
    make_node: MakeNode,
    write: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    tetrahedron: ShapeModel,
    contour: Contour,
    score: Score,
) -> Path:
    """A graph of two nodes: one makes a contour and a model, the other scores it and ends."""
    monkeypatch.chdir(tmp_path)
    make_node("t.maker")
    make_node("t.judge")
    import sys

    params = sys.modules["t.maker"].NODE.params
    outputs = {"/contour/traced": Contour, "/model/shape": ShapeModel}
    says = [("/contour/traced", contour), ("/model/shape", tetrahedron)]

    def judge(_: Any, state: Any, message: ShapeModel) -> tuple[Any, list[Any]]:
        return state, [("/score", score), Finished("scored")]

    def fail(*_: Any) -> tuple[Any, list[Any]]:
        raise ValueError("the finger fell off")

    maker = Node(params=params, start=lambda _: (None, says), inputs={}, outputs=outputs)
    make_node("t.maker", value=maker)
    make_node("t.broken", value=dataclasses.replace(maker, start=fail))
    make_node(
        "t.judge",
        value=Node(
            params=params,
            start=lambda _: (None, []),
            inputs={"/model/shape": (ShapeModel, judge)},
            outputs={"/score": Score},
        ),
    )
    return write("f.yaml", LAUNCH)


def start(path: Path, **args: object) -> Run:
    located = {name: Located(value, name) for name, value in args.items()}
    plan = plan_run(path, located, {}, name="toy", out=Path("here"))
    assert not Path("here").exists()
    return perform(plan, composed=True, display=Silence())


def test_a_run_leaves_its_results_in_its_directory(launch_file: Path) -> None:
    run = start(launch_file)

    assert run.exit_code == 0
    names = {path.name for path in run.folder.iterdir()}
    assert names == {
        "launch.yaml", "log.jsonl", "mesh.glb", "mesh.ply", "mesh.stl", "model.npz",
        "summary.json",
    }  # fmt: skip
    summary = json.loads((run.folder / "summary.json").read_text())
    assert summary == run.summary
    assert (summary["status"], summary["reason"], summary["seed"]) == ("finished", "scored", 5)
    assert (summary["contours"], summary["touches"]) == (1, 30)
    assert summary["chamfer_m"] == 0.0003
    assert set(summary["nodes"]) == {"maker", "judge"}
    assert run.model is not None
    np.testing.assert_array_equal(run.model.vertices.shape, (4, 3))
    assert "mesh.stl" in run.text


def test_the_resolved_launch_file_says_what_was_run(launch_file: Path) -> None:
    run = start(launch_file)

    text = (run.folder / "launch.yaml").read_text()
    assert "kind: t.maker" in text
    assert "ends: judge" in text
    assert "$(" not in text


def test_a_node_that_fails_ends_the_run_with_3_and_its_name(launch_file: Path) -> None:
    run = start(launch_file, maker="t.broken")

    assert run.exit_code == 3
    assert "maker" in run.summary["reason"]
    assert "the finger fell off" in run.summary["reason"]
    assert run.summary["chamfer_m"] is None


def test_a_plan_that_is_refused_leaves_no_trace(launch_file: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())

    with pytest.raises(InputError, match="there is no node 'makre'; did you mean 'maker'"):
        plan_run(launch_file, {}, read_settings(["makre.x=1"]), name="toy")

    assert sorted(tmp_path.iterdir()) == before
