"""What whole graphs share: one warm fork server, toy nodes, signals to nodes, finished runs."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import psutil
import pytest

import palpate as package
from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launcher import launch as launch_launch
from palpate.launch.node_kinds import list_kinds
from palpate.launch.processes.fork_server import start_fork_server
from palpate.launch.processes.registry import RunCard
from palpate.launch.progress import Display
from palpate.launch.run import Run, perform, plan_run
from palpate.messages import decode
from palpate.messages.bus import STATUS_TOPIC
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.runtime.composed import Ending, Watcher
from palpate.nodes.runtime.node import Input, Wiring
from palpate.tools.cli import command_line
from palpate.tools.introspection.topics import TapSubscription, Topic

TOYS = Path(__file__).parent / "toys"
WITHIN = 60.0  # A deadline that only something broken misses [s]
sys.path.insert(0, str(TOYS))  # for nodes: processes that are started later inherit it

from palpate_toy import wiring  # noqa: E402


@pytest.fixture(scope="session", autouse=True)
def _machine() -> Iterator[None]:
    """A home, a terminal and a run-time folder of the tests' own, and one warm fork server.

    The first graph of a process decides what its fork server imports. Here it is all kinds of
    nodes, once; otherwise every node of every graph would import numpy and scipy for itself.
    """
    with tempfile.TemporaryDirectory(prefix="g") as home, pytest.MonkeyPatch.context() as patch:
        for name in ("HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
            patch.setenv(name, home)
        for name in ("PALPATE_GRAPH", "FORCE_COLOR", "COLUMNS"):
            patch.delenv(name, raising=False)
        patch.setenv("TERM", "dumb")
        before = filter(None, [os.environ.get("PYTHONPATH")])  # "" is the current folder
        path = [str(TOYS), str(Path(package.__file__).parents[1]), *before]
        patch.setenv("PYTHONPATH", os.pathsep.join(path))
        start_fork_server(f"palpate.nodes.{kind}" for kind in list_kinds())
        yield


class Done(NamedTuple):
    """What a command has left."""

    code: int
    out: str
    err: str


def palpate(*words: object, folder: Path = TOYS) -> Done:
    """A command of the command line, called in this process, whose fork server is warm."""
    out, err, path = StringIO(), StringIO(), [*sys.path]
    with chdir(folder), redirect_stdout(out), redirect_stderr(err):
        code = command_line.run([str(word) for word in words])
    sys.path[:] = path
    return Done(code, out.getvalue(), err.getvalue())


def started(*words: object, folder: Path = TOYS, **more: Any) -> subprocess.Popen[str]:
    """A command in a process of its own, or with a ``.py`` first a script of the toys."""
    script = [str(TOYS / str(words[0]))] if str(words[0]).endswith(".py") else ["-m", "palpate"]
    rest = [str(word) for word in words[len(script) == 1 :]]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, *script, *rest], cwd=folder, **{**pipes, **more})


def wait_for(what: Callable[[], Any]) -> Any:
    """The first true value of a function that is asked again and again."""
    deadline = time.monotonic() + WITHIN
    while not (result := what()):
        assert time.monotonic() < deadline, "it did not happen"
        time.sleep(0.01)
    return result


def handled(card: RunCard, node: str, count: str = "messages") -> int:
    """Messages that a node of a running graph has handled or sent so far, by its next status."""
    with TapSubscription(card, [Topic(STATUS_TOPIC, "NodeStatus", (node,), ())]) as taps:
        received = taps.take(WITHIN)
    return getattr(decode(NodeStatus, received[-1].body), count) if received else 0


class Recorder(Watcher):
    """A watcher that keeps all that it receives."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self.messages: list[tuple[str, Any]] = []
        self.lines: list[LogRecord] = []
        self.ticks = 0

    def ready(self, seconds: float) -> None:
        self.seconds.append(seconds)

    def received(self, topic: str, message: Any) -> None:
        self.messages.append((topic, message))

    def log(self, record: LogRecord) -> None:
        self.lines.append(record)

    def tick(self, statuses: Any) -> None:
        self.ticks += 1

    def warnings(self) -> list[str]:
        return [one.text for one in self.lines if one.level == "warning"]

    def touches(self) -> list[int]:
        return [message.touch for _, message in self.messages]


@pytest.fixture
def watcher() -> Recorder:
    return Recorder()


@pytest.fixture
def run(watcher: Recorder, runtime: Path) -> Callable[..., Ending]:
    """Launches a graph that ends with its last node, and sees that nothing of it is left."""

    def do(wirings: Sequence[Wiring], ends: str = "", **more: Any) -> Ending:
        options = {"watch": (), "watcher": watcher, **more}
        try:
            return launch_launch(wirings, ends=ends or wirings[-1].name, **options)
        finally:
            assert multiprocessing.active_children() == []
            assert list(runtime.iterdir()) == []

    return do


def broken(how: str, upstream: str = "source", **more: object) -> Wiring:
    options = {"on_exit": "stop", **more}
    return wiring("broken", "palpate_toy_broken", {"how": how}, upstream, **options)


def sink(path: Path, upstream: str = "source", **params: object) -> Wiring:
    topic = f"/{upstream}"
    inputs = (Input(upstream, topic, topic, "TactileFrame"),)
    options = {"path": str(path), **params}
    return wiring("sink", "palpate_toy_sink", options, inputs=inputs, outputs={})


class Harm(threading.Thread):
    """Sends signals to the processes of nodes, one after the other; any node if not named."""

    def __init__(self, names: Iterable[str], signal_: int = signal.SIGKILL, seed: int = 0) -> None:
        super().__init__(daemon=True)
        self._names, self._signal = list(names), signal_
        self._rng = random.Random(seed)
        self.count = 0
        self.start()

    def run(self) -> None:
        for name in self._names:
            time.sleep(self._rng.uniform(0.05, 0.4))
            alive = wait_for(lambda name=name: nodes_alive(name))
            os.kill(self._rng.choice(alive), self._signal)
            self.count += 1


def nodes_alive(name: str = "") -> list[int]:
    """Processes of the graph of this process, of one node if it is named."""
    children = sorted(multiprocessing.active_children(), key=lambda one: one.name)
    return [one.pid or 0 for one in children if name in ("", one.name)]


def finished(
    file: Path, out: Path, args: dict[str, Any], settings: dict[str, Any], *, composed: bool
) -> Run:
    """A run that came to its end without a gap."""
    mapped = [
        {key: SourceMapped(value, key) for key, value in one.items()} for one in (args, settings)
    ]
    plan = plan_run(file, *mapped, name=out.name, out=out)
    done = perform(plan, composed=composed, display=Display())
    assert (done.ending.status, done.ending.gaps) == ("finished", 0), done.ending.reason
    return done


FINGERS = TOYS / "fingers.yaml"
# The cheapest exploration that ends with a solid.
FEW = {"planner.planner": "uniform", "planner.most_touches": 24, "reconstructor.quality": "draft"}


@pytest.fixture(scope="session")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Path]:
    """Folders of explorations by the toy planner in one process, by number of fingers."""

    @cache
    def of(fingers: int) -> Path:
        out = tmp_path_factory.mktemp("toy") / "run"
        run = finished(FINGERS, out, {"fingers": fingers}, {}, composed=True)
        assert run.ending.duplicates == 0
        return out

    return of


def in_group(group: int) -> list[psutil.Process]:
    """The living processes of a group."""
    processes = []
    for process in psutil.process_iter(["status"]):
        with suppress(ProcessLookupError):
            if os.getpgid(process.pid) == group and process.info["status"] != psutil.STATUS_ZOMBIE:
                processes.append(process)
    return processes
