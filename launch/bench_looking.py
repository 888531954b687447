"""What a tool costs the graph that it looks at: nothing may hang on how fast it is."""

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

from palpate.launch.bench_row import Row
from palpate.launch.bench_toy import Params, toy
from palpate.launch.launcher import launch
from palpate.launch.looking.hearing import Hearing
from palpate.launch.looking.topics import Topic
from palpate.launch.processes.register import Card, running
from palpate.messages.bus.tap import STATUS
from palpate.messages.codec import decode
from palpate.messages.types import NodeStatus

TURNS = 9
BEATS = 6
"""Words of a node over which a rate is taken, four a second."""
LEAST = 0.9
"""Share of its rate that a graph must keep."""
_DEADLINE = 30.0
_SCRIPT = "import sys; from palpate.launch.bench_looking import turn; turn(sys.argv[1])"


def rows(turns: int = TURNS) -> list[Row]:
    """How fast a ring of two nodes turns while a tool hears all that one of them says.

    Parameters
    ----------
    turns : int
        How often each rate is taken. A share is the median of those in each turn, for the machine's
        other work comes and goes.
    """
    alone, beside, stopped = [], [], []
    with _ring() as (card, folder):
        for _ in range(turns):
            alone.append(_rate(card))
            with _echo(folder) as echo:
                beside.append(_rate(card))
                echo.send_signal(signal.SIGSTOP)
                stopped.append(_rate(card))
        alone.append(_rate(card))
    kept, cost = _share(stopped, alone), _share(beside, alone)
    return [
        Row("a ring of two nodes turns, nobody looking", f"{median(alone):.0f} /s", "", True),
        Row("topic echo of all its messages: share of that rate", f"{cost:.2f}", "", True),
        Row(
            "a stopped topic echo: share of that rate", f"{kept:.2f}", f">= {LEAST}", kept >= LEAST
        ),
    ]


def _share(rates: Sequence[float], alone: Sequence[float]) -> float:
    """Median share of each rate in those before and after it with nobody looking."""
    return median(
        2.0 * rate / (before + after)
        for rate, (before, after) in zip(rates, pairwise(alone), strict=True)
    )


def turn(folder: str) -> None:
    """Launch a ring of two nodes that turns until it is interrupted."""
    from palpate.launch.bench_bus import Quiet

    launch(
        [
            toy("source", Params(burst=1, laps=10**12), hears="relay"),
            toy("relay", Params(relay=True), hears="source"),
        ],
        ends="source",
        hear=(),
        watcher=Quiet(),
        name="ring",
        work_dir=Path(folder),
    )


@contextmanager
def _ring() -> Iterator[tuple[Card, Path]]:
    with (
        tempfile.TemporaryDirectory(prefix="palpate-") as folder,
        subprocess.Popen([sys.executable, "-c", _SCRIPT, folder]) as process,
    ):
        try:
            yield _card(Path(folder), process), Path(folder)
        finally:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_DEADLINE)
            process.kill()


def _card(folder: Path, process: subprocess.Popen[bytes]) -> Card:
    deadline = time.monotonic() + _DEADLINE
    while not (cards := running(folder)):
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError("the ring did not start")
        time.sleep(0.05)
    return cards[0]


@contextmanager
def _echo(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``topic echo``, once it hears something, with an output that is read no further."""
    with subprocess.Popen(
        [sys.executable, "-m", "palpate", "topic", "echo", "/relay", "--field", "touch", "--csv"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "XDG_RUNTIME_DIR": str(folder)},
    ) as process:
        try:
            assert process.stdout is not None
            if not process.stdout.readline():
                raise RuntimeError("topic echo heard nothing")
            yield process
        finally:
            process.kill()


def _rate(card: Card) -> float:
    """Turns a second by the source's own count, which costs it nothing."""
    beats: list[tuple[int, int]] = []
    with Hearing(card, [Topic(STATUS, NodeStatus.__name__, ("source",), ())]) as hearing:
        for batch in hearing.batches(_DEADLINE):
            for heard in batch:
                beats.append((heard.header.sent_ns, decode(NodeStatus, heard.body).messages))
            if len(beats) >= BEATS:
                break
    if len(beats) < BEATS:
        raise RuntimeError("the ring says nothing of itself")
    return 1e9 * (beats[-1][1] - beats[0][1]) / (beats[-1][0] - beats[0][0])
