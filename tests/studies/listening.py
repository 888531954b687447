"""What a tool that listens to a running graph takes from it.

A ring of two nodes turns while nobody looks, while a tool subscribes to all that one publishes, and
while that tool stands still.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from statistics import median

from palpate.bench.table import Row, at_least, figure
from palpate.launch import launch
from palpate.launch.processes import RunCard, running_graphs
from palpate.messages import decode
from palpate.messages.bus import STATUS_TOPIC
from palpate.messages.types import NodeStatus
from palpate.nodes.runtime import Watcher
from palpate.tools.introspection import TapSubscription, Topic
from tests.studies.toy_node import token_ring

ROOT = Path(__file__).parents[2]  # Where a new process begins, and finds this module
TURNS = 9
STATUSES = 6  # Status messages of a node over which a rate is taken, four a second
LEAST_RATE_KEPT = 0.9  # Share of its rate that a graph must keep
_DEADLINE = 30.0
_SCRIPT = "import sys; from tests.studies.listening import launch_ring; launch_ring(sys.argv[1])"


def introspection_rows(quick: bool, turns: int = TURNS) -> Iterator[Row]:
    """How fast a ring of two nodes turns while a tool subscribes to all that one publishes.

    A share is the median of those in each turn, for the machine's other work comes and goes.
    """
    alone, beside, stopped = [], [], []
    with _ring() as (card, folder):
        for _ in range(2 if quick else turns):
            alone.append(_rate(card))
            with _topic_echo(folder) as echo:
                beside.append(_rate(card))
                echo.send_signal(signal.SIGSTOP)
                stopped.append(_rate(card))
        alone.append(_rate(card))
    yield Row("a ring of two nodes turns, nobody looking", f"{median(alone):.0f} /s")
    title = "topic echo of all its messages: share of that rate"
    yield figure(title, _share(beside, alone), kind="time")
    title = "a stopped topic echo: share of that rate"
    yield at_least(title, _share(stopped, alone), LEAST_RATE_KEPT, kind="time")


@contextmanager
def _ring() -> Iterator[tuple[RunCard, Path]]:
    with (
        tempfile.TemporaryDirectory(prefix="palpate-") as folder,
        subprocess.Popen([sys.executable, "-c", _SCRIPT, folder], cwd=ROOT) as process,
    ):
        try:
            deadline = time.monotonic() + _DEADLINE
            while not (cards := running_graphs(Path(folder))):
                if process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError("the ring did not start")
                time.sleep(0.05)
            yield cards[0], Path(folder)
        finally:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_DEADLINE)
            process.kill()


def _rate(card: RunCard) -> float:
    """Turns a second by the source's own count, which costs it nothing."""
    beats: list[tuple[int, int]] = []
    with TapSubscription(card, [Topic(STATUS_TOPIC, NodeStatus.__name__, ("source",), ())]) as tap:
        for batch in tap.batches(_DEADLINE):
            for one in batch:
                beats.append((one.header.sent_ns, decode(NodeStatus, one.body).messages))
            if len(beats) >= STATUSES:
                break
    if len(beats) < STATUSES:
        raise RuntimeError("the ring publishes no status")
    return 1e9 * (beats[-1][1] - beats[0][1]) / (beats[-1][0] - beats[0][0])


@contextmanager
def _topic_echo(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``topic echo``, once it receives something, with an output that is read no further."""
    with subprocess.Popen(
        [sys.executable, "-m", "palpate", "topic", "echo", "/relay", "--field", "touch", "--csv"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "XDG_RUNTIME_DIR": str(folder)},
    ) as process:
        try:
            assert process.stdout is not None
            if not process.stdout.readline():
                raise RuntimeError("topic echo received nothing")
            yield process
        finally:
            process.kill()


def _share(rates: Sequence[float], alone: Sequence[float]) -> float:
    """Median share of each rate in those before and after it with nobody looking."""
    return median(
        2.0 * rate / (before + after)
        for rate, (before, after) in zip(rates, pairwise(alone), strict=True)
    )


def launch_ring(folder: str) -> None:
    """Launch a ring of two nodes that turns until it is interrupted."""
    watcher, place = Watcher(), Path(folder)
    ring = token_ring(10**12)
    launch(ring, ends="source", watch=(), watcher=watcher, name="ring", work_dir=place)
