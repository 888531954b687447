"""What a message costs: the codec, and a hop compared with one over bare sockets.

Both are measured in turns, so that they meet the same load of the machine.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import zmq

from palpate.bench.table import Row, at_least, at_most, best_seconds, figure, in_turns
from palpate.bench.toy_node import frame, settle, token_ring
from palpate.launch.launcher import launch
from palpate.launch.processes.fork_server import without_main_module
from palpate.messages import Header, decode, encode, pack_frame, schema_hash, split_frame
from palpate.messages.bus import SocketContext, bind
from palpate.messages.types import TactileFrame
from palpate.nodes.runtime.composed import Ending, Watcher
from palpate.nodes.runtime.node import Wiring

CORES = ((0, "one core"), (-1, "free cores"))


@dataclass(frozen=True, slots=True, kw_only=True)
class BusSettings:
    """How a message is measured, and what is demanded."""

    n_laps: int = 2000  # round trips between two nodes
    n_turns: int = 5  # measurements of the full stack and of bare sockets
    n_messages: int = 300  # of a batch that is encoded and decoded
    n_batches: int = 10
    max_codec_time: float = 30.0  # [us] to encode and decode a message
    max_overhead: float = 30.0  # [us] time of a hop minus that over bare sockets
    min_touch_rate: float = 300.0  # [1/s] touches, each of four hops


QUICK_BUS = BusSettings(n_laps=500)


def hop_rows(quick: bool) -> Iterator[Row]:
    """Rows for what a message costs; fewer laps if quick."""
    settings = QUICK_BUS if quick else BusSettings()
    yield _codec_row(settings)
    yield from _full_and_bare(settings)


def _codec_row(settings: BusSettings) -> Row:
    message, schema = frame(1), schema_hash(TactileFrame)

    def batch() -> None:
        for _ in range(settings.n_messages):
            header = Header(1, 0, 7, time.monotonic_ns(), 0.1, schema)
            data = pack_frame("/touch/raw", header, encode(message))
            decode(TactileFrame, split_frame(data)[2])

    cost = 1e6 * best_seconds(batch, settings.n_batches) / settings.n_messages
    title = "codec, checks and header, both sides, 16 x 16"
    return at_most(title, cost, settings.max_codec_time, ".1f", " us")


def _full_and_bare(settings: BusSettings) -> Iterator[Row]:
    laps = settings.n_laps
    for core, where in CORES:
        calls = {"full": partial(_hop, laps, core), "bare": partial(_bare_hop, laps, core)}
        times = in_turns(calls, settings.n_turns)
        full, bare = min(times["full"]), min(times["bare"])
        for name, repeats in (("bare sockets", times["bare"]), ("full stack", times["full"])):
            yield figure(f"one hop, {name}, {where}", min(repeats), ".1f", " us", repeats=repeats)
        title, most = f"overhead of a hop, {where}", settings.max_overhead
        yield at_most(title, full - bare, most, ".1f", " us")
        if core < 0:
            rate, least = 1e6 / (4 * full), settings.min_touch_rate
            yield at_least("touches of 4 hops", rate, least, ".0f", " /s")


def ring_seconds(graph: Sequence[Wiring]) -> float:
    """Time [s] between the first and the last mark of a ring, as the second of `ring_times`."""
    return ring_times(graph)[1]


def ring_times(graph: Sequence[Wiring]) -> tuple[float, float]:
    """Launch a ring: times [s] until it is up, and between its first and its last mark.

    Raises RuntimeError if it does not finish.
    """
    watcher = _Times()
    finished(launch(graph, ends="source", watch=["/source/mark"], watcher=watcher), "the ring")
    first, last = watcher.times
    return watcher.start, last - first


def finished(ending: Ending, what: str) -> Ending:
    """The ending of a graph that finished; raises RuntimeError if it did not."""
    if ending.status != "finished":
        raise RuntimeError(f"{what} {ending.status}: {ending.reason}")
    return ending


class _Times(Watcher):
    """Keeps the time of the start and the times at which messages arrive [s]."""

    def __init__(self) -> None:
        self.times: list[float] = []
        self.start = 0.0

    def ready(self, seconds: float) -> None:
        self.start = seconds

    def received(self, topic: str, message: object) -> None:
        self.times.append(time.perf_counter())


def _hop(laps: int, core: int) -> float:
    """Time of one hop between two nodes [us]."""
    return 1e6 * ring_seconds(token_ring(laps, core)) / (2 * (laps - 1))


def _bare_hop(laps: int, core: int) -> float:
    """Time of one hop of as many bytes over bare local sockets [us]."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        there, back = (f"ipc://{Path(folder) / name}" for name in "ab")
        return bare_hop(there, back, laps, core=core)


def bare_hop(
    there: str, back: str, laps: int, *, core: int = -1, key: str = "", timeout: float = 20.0
) -> float:
    """Time of one hop of a frame of 16 by 16 taxels between two processes [us].

    `there` and `back`: endpoints. `laps`: how often it goes there and back. `core`: on which both
    run; -1 leaves them free. `key`: file of a key that locks the sockets; empty for open ones.
    `timeout` [s]: of all laps. Raises RuntimeError if it is exceeded.
    """
    ends = (there, back, laps, core, key)
    with spawned(partial(_send_back, *ends), partial(_ping, *ends)) as mine:
        if not mine.poll(timeout):
            raise RuntimeError("the bare sockets did not answer")
        seconds: float = mine.recv()
    return seconds / (2 * laps) * 1e6


@contextmanager
def spawned(*calls: Callable[[Connection], object]) -> Iterator[Connection]:
    """Run calls in processes that are killed at the end; each gets the other end of this pipe."""
    spawn = multiprocessing.get_context("forkserver")
    mine, yours = spawn.Pipe()
    processes = [spawn.Process(target=call, args=(yours,), daemon=True) for call in calls]
    try:
        with without_main_module():
            for process in processes:
                process.start()
        yours.close()
        yield mine
    finally:
        for process in processes:
            if process.pid is not None:
                process.kill()
                process.join()
        mine.close()


def _send_back(there: str, back: str, laps: int, core: int, key: str, line: Connection) -> None:
    wires = SocketContext(key)
    out, into = _pair(wires, back, there, key)
    settle(core)
    for _ in range(laps):
        out.send(into.recv())
    into.close(0)
    out.close(1000)  # the last answer is still to leave
    wires.close()


def _ping(there: str, back: str, laps: int, core: int, key: str, line: Connection) -> None:
    wires = SocketContext(key)
    out, into = _pair(wires, there, back, key)
    settle(core)
    data = pack_frame("/touch/raw", Header(1, 0, 0, 0, 0.0, 0), encode(frame(0)))
    began = time.perf_counter()
    for _ in range(laps):
        out.send(data)
        into.recv()
    line.send(time.perf_counter() - began)


def _pair(wires: SocketContext, endpoint: str, other: str, key: str) -> tuple[Any, Any]:
    out, into = wires.context.socket(zmq.XPUB), wires.context.socket(zmq.SUB)
    if key:
        bind(out, endpoint)
    else:
        out.bind(endpoint)
    into.subscribe(b"")
    into.connect(other)
    out.recv()  # The other's subscription: from here on nothing is lost.
    return out, into
