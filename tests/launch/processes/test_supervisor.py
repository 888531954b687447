from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from palpate.launch.processes.node_status import NodeStatusTable
from palpate.launch.processes.supervisor import ToolServer


def test_a_tool_is_told_of_every_node_and_of_the_process_of_those_that_live():
    asked: list[Any] = [("tool", {"kind": "status"}), None]
    told: list[dict[str, Any]] = []
    line = SimpleNamespace(receive=lambda: asked.pop(0), send=lambda _, **word: told.append(word))
    processes = SimpleNamespace(
        wirings={"a": None, "b": None},
        living=["b"],
        pid=lambda name: 7,
        restarts=SimpleNamespace(counts={"a": 2, "b": 0}),
    )
    server: Any = ToolServer
    server(line, None, processes, NodeStatusTable(["a", "b"])).serve()
    [status] = told
    assert status["kind"] == "status" and status["for_s"] >= 0.0
    assert {name: (one["pid"], one["restarts"]) for name, one in status["nodes"].items()} == {
        "a": (0, 2),
        "b": (7, 0),
    }
