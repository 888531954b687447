"""Launch a ring of two nodes and a sink that never ends, and say how it ended."""

from __future__ import annotations

import sys
from pathlib import Path

from palpate.launch.launcher import launch
from palpate.nodes.runtime import Watcher
from palpate.nodes.runtime.node import Input, Wiring
from tests.studies.toy_node import ToyParams, toy

# Without a guard: no node may run the script once more.
folder = Path(sys.argv[1])
work = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0


sys.path.insert(0, str(Path(__file__).parent))


sink = Wiring(
    name="sink",
    module="palpate_toy_sink",
    params={"path": str(folder / "lines.txt")},
    inputs=(Input("relay", "/relay", "/relay", "TactileFrame"),),
    outputs={},
    subscribers={},
)


print("launching", flush=True)


ending = launch(
    [
        toy("source", ToyParams(burst=1, laps=10**9), upstream="relay"),
        toy("relay", ToyParams(relay=True, work=work), upstream="source"),
        sink,
    ],
    ends="source",
    watch=["/source/mark"],
    watcher=Watcher(),
    work_dir=folder,
)


print(ending.status, "-", ending.reason, flush=True)
