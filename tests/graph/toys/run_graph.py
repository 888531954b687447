"""Launch a graph from a process that starts afresh, and print how it ended.

``ring FOLDER WORK``: two nodes and a sink that never end; ``away HOST``: the same ring, one node on
another machine; ``light``: a node that says what its process has imported; ``missing``: a graph of
modules that are not there, and then another.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

from palpate_toy import toy, wiring

from palpate.launch.launcher import launch
from palpate.nodes.runtime.composed import Watcher

mode, *words = sys.argv[1:]
SOURCE = toy("source", upstream="relay", burst=1, laps=10**9)


class Telling(Watcher):
    """Says when all nodes are up."""

    def ready(self, seconds: float) -> None:
        print("ready", flush=True)


# Without a guard: no node may run the script once more.
print("launching", flush=True)
if mode == "ring":
    folder = Path(words[0])
    relay = toy("relay", upstream="source", relay=True, work=float(words[1]))
    path = {"path": str(folder / "lines.txt")}
    sink = wiring("sink", "palpate_toy_sink", path, "relay", outputs={})
    sink = replace(sink, inputs=(replace(sink.inputs[0], local="/relay"),))
    graph, options = [SOURCE, relay, sink], {"watch": ["/source/mark"], "work_dir": folder}
elif mode == "away":
    relay = toy("relay", upstream="source", relay=True)
    graph, options = [SOURCE, replace(relay, host=words[0])], {"watch": []}
else:
    graph, options = [toy("source", burst=5)], {"watch": []}
if mode == "light":
    broken = wiring("broken", "palpate_toy_broken", {"how": "tell"}, "source")
    graph.append(replace(broken, nice=3, on_exit="stop"))
if mode == "missing":
    from palpate.launch.processes.fork_server import start_fork_server

    start_fork_server(["palpate.nodes.nothing", "palpate.nodes.filter"])
    lost = wiring("lost", "palpate.nodes.nothing", {}, outputs={})
    ending = launch([*graph, lost], ends="lost", watch=(), watcher=Watcher())
    print(ending.status, "-", ending.reason, flush=True)
    graph.append(toy("counter", upstream="source", expects=5))
before = dict(os.environ)
ending = launch(
    graph, ends=graph[-1 if mode == "missing" else 0].name, watcher=Telling(), **options
)
print(ending.status, "-", ending.reason, flush=True)
print("the environment is unchanged:", dict(os.environ) == before)
