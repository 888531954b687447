"""Launch a ring that never ends, one node of it on another machine."""

from __future__ import annotations

import sys
from dataclasses import replace

from palpate.launch.launcher import launch
from palpate.nodes.runtime import Watcher
from tests.studies.toy_node import ToyParams, toy


class Telling(Watcher):
    """Says when all nodes are up."""

    def ready(self, seconds: float) -> None:
        print("ready", flush=True)


relay = toy("relay", ToyParams(relay=True), upstream="source")


launch(
    [
        toy("source", ToyParams(burst=1, laps=10**9), upstream="relay"),
        replace(relay, host=sys.argv[1]),
    ],
    ends="source",
    watch=[],
    watcher=Telling(),
)
