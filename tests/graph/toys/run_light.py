"""Launch a node that says what its process has imported, from a process that starts afresh."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from palpate.launch.launcher import launch
from palpate.nodes.runtime import Watcher
from palpate.nodes.runtime.node import Input, Wiring
from tests.studies.toy_node import ToyParams, toy

sys.path.insert(0, str(Path(__file__).parent))


broken = Wiring(
    name="broken",
    module="palpate_toy_broken",
    params={"how": "tell"},
    inputs=(Input("source", "/source", "/in", "TactileFrame"),),
    outputs={"/out": "/broken"},
    subscribers={},
    nice=3,
    on_exit="stop",
)
before = dict(os.environ)
ending = launch(
    [toy("source", ToyParams(burst=5)), broken], ends="source", watch=(), watcher=Watcher()
)


print(ending.reason)


print(dict(os.environ) == before)
