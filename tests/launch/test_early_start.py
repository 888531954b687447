from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from palpate.launch.early_start import named_modules
from palpate.launch.launch_path import EXPLORE


def test_the_modules_of_the_shipped_graph_are_known_without_reading_it_whole() -> None:
    names = [name.removeprefix("palpate.nodes.") for name in named_modules(EXPLORE)]
    assert names[0] == "simulator"
    assert set(names) == {
        "simulator",
        "filter",
        "curvature",
        "tracer",
        "planner",
        "reconstructor",
        "evaluator",
        "recorder",
    }


@pytest.mark.parametrize(
    ("text", "modules"),
    [
        ("nodes: {a: {kind: filter}, b: {kind: my_lab.b}, tracer: }", "filter my_lab.b tracer"),
        ("nodes: {filter: {kind: 3}}", "filter"),
        ("nodes: [filter]", ""),
        ("ends: filter", ""),
        ("nodes: {filter", ""),
    ],
)
def test_a_fault_is_left_to_be_told_later(tmp_path: Path, text: str, modules: str) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(text)
    names = [name if "." in name else f"palpate.nodes.{name}" for name in modules.split()]
    assert named_modules(path) == tuple(names)


def test_nothing_is_known_of_a_launch_file_in_python_or_of_none(tmp_path: Path) -> None:
    path = tmp_path / "graph.py"
    path.write_text("raise SystemExit")
    assert named_modules(path) == named_modules(tmp_path / "none.yaml") == ()


def test_nothing_heavy_is_imported_before_the_server_is_woken() -> None:
    script = "import palpate.launch.early_start, sys; print({'numpy', 'zmq'} & set(sys.modules))"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=True)
    assert done.stdout == "set()\n"
