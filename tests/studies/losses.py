"""What is lost: nothing among late starts, stalls, full queues and a death.

A million messages to three subscribers; the same with stalls alone over a plain PUB socket, which
loses nearly all; and what a recorder costs.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import zmq

from palpate.bench.table import Row, at_least, in_turns
from palpate.launch import EXPLORE, Display, find_scene, launch, perform, plan_run
from palpate.launch.files import SourceMapped
from palpate.messages import Header, encode, pack_frame
from palpate.messages.bus import QUEUE_DEPTH, MessageLog, Publisher, SendTimes, Subscriber
from palpate.messages.types import NodeStatus
from palpate.nodes import recorder
from palpate.nodes.runtime import Input, Watcher, Wiring, with_description
from palpate.tools.chaos import FloodParams
from tests.studies.hops import finished, ring_seconds, spawned
from tests.studies.stalling_node import SOURCE, TOPIC, StallingParams, subscriber
from tests.studies.toy_node import ToyParams, frame, token_ring, toy

MESSAGES, QUICK = 1_000_000, 20_000
STALLS, LONGEST = 3, 2.0  # A subscriber stands still so often, for so many s at most
RING_LAPS, RECORDER_TURNS = 3000, 5
_PATIENCE = 60.0
_DEADLINE_MS = 10_000


def reliability_rows(quick: bool) -> Iterator[Row]:
    """Losses among stalls, late starts and a death; without the bus; and what a recorder costs."""
    number = QUICK if quick else MESSAGES
    stalls = _stalls(random.Random(1), number)
    wrong, restarts = _disturbed(number, random.Random(1))
    title = f"{number} messages to 3, stalls, late start, {restarts} kill: lost or out of turn"
    yield Row(title, str(wrong), "0", wrong == 0 and restarts == 1)
    lost = lost_over_plain(number, stalls)
    yield Row("the same over a plain PUB socket, stalls alone: lost", str(lost), "> 0", lost > 0)
    laps = RING_LAPS // 3 if quick else RING_LAPS
    plain, recorded = _with_and_without(partial(_ring, laps), RECORDER_TURNS)
    ring = min(plain) / min(recorded)
    yield Row("rate with a recorder, ring of tokens without work", f"{ring:.2f}")
    plain, recorded = _with_and_without(_touches, 1 if quick else RECORDER_TURNS)
    ratio = max(recorded) / max(plain)
    yield at_least("rate with a recorder, touches of a sphere", ratio, 0.85, kind="time")


def _disturbed(number: int, rng: random.Random) -> tuple[int, int]:
    """Messages that were lost or came out of turn among three subscribers, and restarts."""
    source = Wiring(
        name=SOURCE,
        module="palpate.tools.chaos.fault_injection",
        params=FloodParams(messages=number),
        inputs=(),
        outputs={TOPIC: TOPIC},
        subscribers={},
    )
    first = number // 20
    subscribers = [
        subscriber("stalls", StallingParams(expects=number, stalls=_stalls(rng, number))),
        subscriber("late", StallingParams(expects=number, late=rng.uniform(0.0, 1.0))),
        subscriber("dies", StallingParams(expects=number, stalls=((2 * first, 1.0),))),
    ]
    graph = [source, *subscribers]
    watcher = _Killer("dies", first)
    ending = finished(launch(graph, ends="dies", watch=(), watcher=watcher), "the graph")
    counts = [ending.statuses[one.name].messages for one in subscribers]
    wrong = sum(number - one for one in counts) + ending.gaps
    if ending.reason != f"{number} received, 0 missing, 0 out of turn":
        wrong += 1
    return wrong, sum(ending.restarts.values())


def _stalls(rng: random.Random, number: int) -> tuple[tuple[int, float], ...]:
    return tuple((rng.randrange(number), rng.uniform(0.0, LONGEST)) for _ in range(STALLS))


def lost_over_plain(number: int, stalls: tuple[tuple[int, float], ...]) -> int:
    """Messages that are lost between a plain PUB socket and a subscriber that stalls."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder, zmq.Context() as context:
        endpoint = f"ipc://{Path(folder) / 'plain'}"
        with context.socket(zmq.PUB) as socket:
            socket.setsockopt(zmq.SNDHWM, QUEUE_DEPTH)
            socket.setsockopt(zmq.LINGER, 0)
            socket.bind(endpoint)
            with spawned(partial(_subscribe, endpoint, stalls)) as line:
                return number - _publish(socket, line, number)


def _subscribe(endpoint: str, stalls: tuple[tuple[int, float], ...], line: Connection) -> None:
    socket = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, QUEUE_DEPTH)
    socket.subscribe(b"")
    socket.connect(endpoint)
    left, received = dict(stalls), 0
    while socket.recv() != b"?":
        pass
    line.send("ready")
    while (frame := socket.recv()) != b".":
        if frame != b"?":
            time.sleep(left.pop(received, 0.0))
            received += 1
    line.send(received)


def _publish(socket: zmq.Socket[bytes], line: Connection, number: int) -> int:
    """Publish everything once the other subscribes; how much of it was received."""
    deadline = time.monotonic() + _PATIENCE

    def repeat(word: bytes, until: float, what: str) -> Any:
        while not line.poll(0.01):
            socket.send(word)
            if time.monotonic() > until:
                raise RuntimeError(f"the subscriber of the plain socket did not come {what}")
        return line.recv()

    repeat(b"?", deadline, "up")  # until a first message has arrived, nothing counts
    for seq in range(number):
        socket.send(pack_frame(TOPIC, Header(1, 0, seq, 0, 0.0, 0), b"x" * 20))
    received: int = repeat(b".", deadline + _PATIENCE, "to an end")
    return received


def _ring(laps: int, recorded: bool) -> float:
    """Time of a ring of two nodes, s."""
    graph = token_ring(laps)
    if not recorded:
        return ring_seconds(graph)
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        names = ("source", "relay")
        kept = Wiring(
            name="recorder",
            module=recorder.__name__,
            params=recorder.Params(path=str(Path(folder) / "topics.mcap")),
            inputs=tuple(Input(name, f"/{name}", f"/{name}", "TactileFrame") for name in names),
            outputs={},
            subscribers={},
        )
        return ring_seconds(list(with_description([*graph, kept], {})))


def _with_and_without(call: Callable[[bool], float], turns: int) -> Iterable[list[float]]:
    """What a call gives without a recorder and with one, measured in turns."""
    return in_turns({kept: partial(call, kept) for kept in (False, True)}, turns).values()


def _touches(recorded: bool) -> float:
    """Touches a second of an exploration."""
    scene = SourceMapped(str(find_scene("sphere")), "bench")
    args = {"scene": scene, "record": SourceMapped(recorded, "bench")}
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        plan = plan_run(EXPLORE, args, {}, name="sphere", out=Path(folder) / "run")
        done = perform(plan, composed=False, display=Display())
    finished(done.ending, "the exploration")
    return float(done.summary["touches_per_s"])


class _Killer(Watcher):
    """Kills a node once it has received so many messages."""

    def __init__(self, name: str, number: int) -> None:
        self._name, self._number = name, number
        self._done = False

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Look whether it is time."""
        status = statuses.get(self._name)
        if self._done or status is None or status.messages < self._number:
            return
        for child in multiprocessing.active_children():
            if child.name == self._name and child.pid:
                os.kill(child.pid, signal.SIGKILL)
                self._done = True


def loss_rows(quick: bool) -> Iterator[Row]:
    """Rows for each test of loss."""
    repeats = 5 if quick else 100
    for name, trial in LOSS_TRIALS.items():
        rng = random.Random(1)
        lost = sum(trial(rng) for _ in range(repeats))
        yield Row(f"{name}, {repeats} times: messages lost", str(lost), "0", lost == 0)


def _random_starts(rng: random.Random) -> int:
    late = [0.2 * rng.random() for _ in range(3)]
    graph = [
        toy("source", ToyParams(burst=200, late=late[0])),
        toy("relay", ToyParams(relay=True, late=late[1]), upstream="source"),
        toy("counter", ToyParams(expects=200, late=late[2]), upstream="relay"),
    ]
    return _lost_in(graph, expected=200, depth=1000)


def _slow_subscriber(rng: random.Random) -> int:
    pair = [
        toy("source", ToyParams(burst=300), subscribers=("counter",)),
        toy("counter", ToyParams(expects=300, work=2e-4 * rng.random()), upstream="source"),
    ]
    return _lost_in(pair, expected=300, depth=2)


def _last_message(rng: random.Random) -> int:
    """The ending node has long finished while another still has a full queue."""
    graph = [
        toy("source", ToyParams(burst=200), subscribers=("counter", "slow")),
        toy("counter", ToyParams(expects=200), upstream="source"),
        toy("slow", ToyParams(work=5e-4 + 5e-4 * rng.random()), upstream="source"),
    ]
    return _lost_in(graph, expected=200, depth=1)


def _lost_in(graph: Sequence[Wiring], *, expected: int, depth: int) -> int:
    ending = launch(graph, ends="counter", watch=(), watcher=Watcher(), depth=depth)
    finished(ending, "the graph")
    counts = [ending.statuses[one.name].messages for one in graph if one.inputs]
    return ending.gaps + sum(expected - number for number in counts)


def _late_joiner(rng: random.Random) -> int:
    """A subscriber that comes when all has been published."""
    number = rng.randint(1, 50)
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder, zmq.Context() as context:
        endpoint = f"ipc://{Path(folder) / 'late'}"
        publisher = Publisher(
            context,
            endpoint,
            name="source",
            run=1,
            epoch=0,
            subscribers={"/world": ("late",)},
            depth=2,
            drain=lambda: None,
            past=MessageLog(Path(folder) / "past", ["/world"]),
            times=SendTimes(Path(folder) / "times", "source", ["/world"]),
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
        received, deadline = 0, time.monotonic() + _DEADLINE_MS / 1000
        try:
            while not subscriber.in_step and time.monotonic() < deadline:
                publisher.socket.poll(1)
                publisher.serve()
                while subscriber.receive() is not None:
                    received += 1
            return number - received
        finally:
            subscriber.close()
            publisher.close(0)


# Tests of loss; each makes its own choices with a generator, and returns what was lost.
LOSS_TRIALS: Mapping[str, Callable[[random.Random], int]] = {
    "random starts within 0.2 s": _random_starts,
    "slow subscriber, queue of 2": _slow_subscriber,
    "end with a full queue of 1": _last_message,
    "late joiner": _late_joiner,
}
