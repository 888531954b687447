"""Put the bus to the test, and measure it: what is lost, what a message and a start cost."""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import zmq

from palpate.launch.bench_bare import bare_hop
from palpate.launch.bench_row import Row
from palpate.launch.bench_toy import Params, frame, toy
from palpate.launch.launcher import launch
from palpate.messages.bus.past import Past
from palpate.messages.bus.publisher import Publisher
from palpate.messages.bus.subscriber import Subscriber
from palpate.messages.bus.times import Times
from palpate.messages.codec import decode, encode, schema_hash
from palpate.messages.header import Header, pack_frame, split_frame
from palpate.messages.types import LogRecord, NodeStatus, TactileFrame
from palpate.nodes.wiring import Wiring

LAPS = 2000
_DEADLINE_MS = 10_000


def losses(quick: bool) -> Iterator[Row]:
    """Rows for each test of loss."""
    return (_loss_row(name, trial, 5 if quick else 100) for name, trial in TRIALS.items())


def hops(quick: bool) -> Iterator[Row]:
    """Rows for what a message costs."""
    yield _codec_row()
    yield from _hop_rows(500 if quick else LAPS)


def _loss_row(name: str, trial: Callable[[random.Random], int], repeats: int) -> Row:
    rng = random.Random(1)
    lost = sum(trial(rng) for _ in range(repeats))
    return Row(f"{name}, {repeats} times: messages lost", str(lost), "0", lost == 0)


def _random_starts(rng: random.Random) -> int:
    late = [0.2 * rng.random() for _ in range(3)]
    return _lost_in(
        [
            toy("source", Params(burst=200, late=late[0])),
            toy("relay", Params(relay=True, late=late[1]), hears="source"),
            toy("counter", Params(expects=200, late=late[2]), hears="relay"),
        ],
        expected=200,
        depth=1000,
    )


def _slow_listener(rng: random.Random) -> int:
    pair = [
        toy("source", Params(burst=300), listeners=("counter",)),
        toy("counter", Params(expects=300, work=2e-4 * rng.random()), hears="source"),
    ]
    return _lost_in(pair, expected=300, depth=2)


def _last_message(rng: random.Random) -> int:
    """The ending node has long finished while another still has a full queue."""
    work = 5e-4 + 5e-4 * rng.random()
    graph = [
        toy("source", Params(burst=200), listeners=("counter", "slow")),
        toy("counter", Params(expects=200), hears="source"),
        toy("slow", Params(work=work), hears="source"),
    ]
    return _lost_in(graph, expected=200, depth=1)


def _lost_in(graph: Sequence[Wiring], *, expected: int, depth: int) -> int:
    ending = launch(graph, ends="counter", hear=(), watcher=Quiet(), depth=depth)
    heard = [ending.statuses[one.name].messages for one in graph if one.inputs]
    if ending.status != "finished":
        raise RuntimeError(f"the graph {ending.status}: {ending.reason}")
    return ending.gaps + sum(expected - number for number in heard)


def _late_joiner(rng: random.Random) -> int:
    """A subscriber that comes when all has been said."""
    number = rng.randint(1, 50)
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder, zmq.Context() as context:
        endpoint = f"ipc://{Path(folder) / 'late'}"
        publisher = Publisher(
            context,
            endpoint,
            name="source",
            run=1,
            epoch=0,
            listeners={"/world": ("late",)},
            depth=2,
            drain=lambda: None,
            past=Past(Path(folder) / "past", ["/world"]),
            times=Times(Path(folder) / "times", "source", ["/world"]),
        )
        for touch in range(number):
            publisher.send("/world", encode(frame(touch)), robot_time=0.0, schema=0)
        subscriber = Subscriber(
            context,
            name="late",
            run=1,
            epoch=0,
            sources={"source": ["/world"]},
            endpoints={"source": endpoint},
            depth=number + 10,
        )
        try:
            return number - _hear_all(publisher, subscriber)
        finally:
            subscriber.close()
            publisher.close(0)


def _hear_all(publisher: Publisher, subscriber: Subscriber) -> int:
    heard = 0
    deadline = time.monotonic() + _DEADLINE_MS / 1000
    while not subscriber.in_step and time.monotonic() < deadline:
        publisher.socket.poll(1)
        publisher.serve()
        while subscriber.receive() is not None:
            heard += 1
    return heard


TRIALS: Mapping[str, Callable[[random.Random], int]] = {
    "random starts within 0.2 s": _random_starts,
    "slow listener, queue of 2": _slow_listener,
    "end with a full queue of 1": _last_message,
    "late joiner": _late_joiner,
}
"""Tests of loss; each makes its own choices with a generator, and returns what was lost."""


class Quiet:
    """A watcher that only keeps the times at which it heard something."""

    def __init__(self) -> None:
        self.times: list[float] = []
        """Seconds on the performance counter."""

    def ready(self, seconds: float) -> None:
        """Nothing to say."""

    def heard(self, topic: str, message: object) -> None:
        """Keep the time."""
        self.times.append(time.perf_counter())

    def log(self, record: LogRecord) -> None:
        """Nothing to say."""

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Nothing to say."""


def _codec_row(rounds: int = 300, batches: int = 10) -> Row:
    message, schema = frame(1), schema_hash(TactileFrame)

    def once() -> None:
        header = Header(1, 0, 7, time.monotonic_ns(), 0.1, schema)
        data = pack_frame("/touch/raw", header, encode(message))
        decode(TactileFrame, split_frame(data)[2])

    def batch() -> float:
        began = time.perf_counter()
        for _ in range(rounds):
            once()
        return (time.perf_counter() - began) / rounds * 1e6

    cost = min(batch() for _ in range(batches))
    name = "codec, checks and header, both sides, 16 x 16"
    return Row(name, f"{cost:.1f} us", "<= 30 us", cost <= 30.0)


def _hop_rows(laps: int, turns: int = 5) -> Iterator[Row]:
    """Hops of the full stack and of the bare sockets, in turn, so that both meet the same load."""
    for core, where in ((0, "one core"), (-1, "free cores")):
        full, bare = [], []
        for _ in range(turns):
            full.append(_full_hop(laps, core))
            bare.append(_bare_hop(laps, core))
        over = min(full) - min(bare)
        yield Row(f"one hop, bare sockets, {where}", f"{min(bare):.1f} us", "", True)
        yield Row(f"one hop, full stack, {where}", f"{min(full):.1f} us", "", True)
        yield Row(f"overhead of a hop, {where}", f"{over:.1f} us", "<= 30 us", over <= 30.0)
        if core < 0:
            rate = 1e6 / (4 * min(full))
            yield Row("touches of 4 hops", f"{rate:.0f} /s", ">= 300 /s", rate >= 300.0)


def _full_hop(laps: int, core: int) -> float:
    """Time of one hop between two nodes, us."""
    watcher = Quiet()
    ring = [
        toy("source", Params(burst=1, laps=laps, expects=laps, core=core), hears="relay"),
        toy("relay", Params(relay=True, core=core), hears="source"),
    ]
    ending = launch(ring, ends="source", hear=["/source/mark"], watcher=watcher)
    if ending.status != "finished":
        raise RuntimeError(f"the ring {ending.status}: {ending.reason}")
    first, last = watcher.times
    return (last - first) / (2 * (laps - 1)) * 1e6


def _bare_hop(laps: int, core: int) -> float:
    """Time of one hop of the same number of bytes over bare sockets, us."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        there, back = (f"ipc://{Path(folder) / name}" for name in "ab")
        return bare_hop(there, back, laps, core=core)
