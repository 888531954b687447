"""How long seven nodes take to be ready, beside seven fresh interpreters with the same imports.

Each launch is a process of its own that goes the way of ``palpate run``, up to the moment at which
all nodes are ready. This module imports nothing heavy: what it would import is what it measures.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from palpate.bench.table import Row, at_most
from palpate.nodes.runtime import Watcher

MOST = 0.2  # Of the time of fresh interpreters
_DEADLINE = 60.0
ROOT = Path(__file__).parents[2]  # Where a new process begins, and finds this module
_FRESH = "import {modules}\nprint('ready', flush=True)"


class Started(NamedTuple):
    """One launch."""

    modules: tuple[str, ...]  # Of its nodes
    checked: float  # From the wish to run until the graph was checked, s
    ready: float  # From the launch until all nodes were ready, s


class _Enough(Exception):
    """All nodes are ready."""


def start_rows(quick: bool, turns: int = 7) -> Iterator[Row]:
    """Rows of the table; of each time the least of some turns, which others' load disturbs least.

    The server wakes while the graph is checked. What that takes from the check is counted apart:
    it is next to nothing where a second core is free, and most of the import where none is.
    """
    woken, not_woken, fresh = [], [], []
    for _ in range(2 if quick else turns):
        woken.append(_in_new_process(early=True))
        fresh.append(seconds_of_fresh(woken[-1].modules))
        not_woken.append(_in_new_process(early=False))
    ready, alone = (min(one.ready for one in many) for many in (woken, not_woken))
    delay = min(one.checked for one in woken) - min(one.checked for one in not_woken)
    for name, seconds in (
        ("seven fresh interpreters", min(fresh)),
        ("seven nodes ready, from the launch on", ready),
        ("check of the graph, longer for the server waking", delay),
        ("seven nodes ready, had the server not been woken before", alone),
    ):
        yield Row(name, f"{1e3 * seconds:.0f} ms")
    yield at_most(
        "seven nodes ready, over seven fresh interpreters", ready / min(fresh), MOST, kind="time"
    )
    both = (ready + max(delay, 0.0)) / min(fresh)
    yield at_most("the same, with what the check lost to the server", both, MOST, kind="time")


def start_once(*, early: bool) -> Started:
    """Check the graph that explores, launch it without its recorder, and end when it is ready.

    In a new process, in which nothing heavy was imported. `early`: wake the server before the graph
    is checked, as ``palpate run`` does.
    """
    began = time.perf_counter()
    from palpate.launch import EXPLORE

    if early:
        from palpate.launch import prestart_fork_server

        prestart_fork_server(EXPLORE)
    from palpate.launch import launch, plan_run
    from palpate.launch.files import SourceMapped

    plan = plan_run(EXPLORE, {"record": SourceMapped(False, "")}, {}, name="start")
    checked = time.perf_counter() - began
    watcher = _UntilReady()
    try:
        launch(plan.wirings, ends=plan.ends, watch=(), watcher=watcher)
    except _Enough:
        modules = tuple(wiring.module for wiring in plan.wirings)
        return Started(modules, checked, watcher.seconds)
    raise RuntimeError("the graph ended before its nodes were ready")


def seconds_of_fresh(modules: Sequence[str]) -> float:
    """Time until an interpreter for each module, all started at once, has imported it."""
    from palpate.launch.processes import NODE_ENVIRONMENT, preloaded_modules

    environment = {**os.environ, **NODE_ENVIRONMENT}
    started: list[subprocess.Popen[str]] = []
    began = time.perf_counter()
    try:
        for module in modules:
            script = _FRESH.format(modules=", ".join(preloaded_modules([module])))
            command = [sys.executable, "-c", script]
            started.append(
                subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
            )
        lines = [one.stdout.readline() if one.stdout else "" for one in started]
        took = time.perf_counter() - began
    finally:
        for one in started:
            one.kill()
            one.communicate()
    if lines != ["ready\n"] * len(modules):
        raise RuntimeError("a fresh interpreter could not import its node")
    return took


class _UntilReady(Watcher):
    """Has seen enough when all nodes are ready."""

    seconds = 0.0

    def ready(self, seconds: float) -> None:
        self.seconds = seconds
        raise _Enough


def _in_new_process(*, early: bool) -> Started:
    start = f"print(json.dumps(start_once(early={early})))"
    script = f"import json; from tests.studies.starts import start_once; {start}"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_DEADLINE, cwd=ROOT)
    if done.returncode != 0:
        raise RuntimeError(f"the launch failed: {done.stderr.strip()[-500:]}")
    modules, checked, ready = json.loads(done.stdout)
    return Started(tuple(modules), checked, ready)
