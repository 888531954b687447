"""What reliability is worth, and costs: a million messages among stalls and a death; plain PUB."""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import zmq

from palpate.launch.bench_bus import Quiet
from palpate.launch.bench_listener import SOURCE, TOPIC, Params, listener
from palpate.launch.bench_row import Row
from palpate.launch.bench_toy import Params as ToyParams
from palpate.launch.bench_toy import toy
from palpate.launch.chaos import flood
from palpate.launch.display import Silence
from palpate.launch.launch_path import EXPLORE
from palpate.launch.launcher import launch
from palpate.launch.located import Located
from palpate.launch.processes.server import no_script
from palpate.launch.run import perform, plan_run
from palpate.launch.scene import find_scene
from palpate.messages.bus.place import DEPTH
from palpate.messages.header import Header, pack_frame
from palpate.messages.types import NodeStatus
from palpate.nodes import recorder
from palpate.nodes.recording import with_description
from palpate.nodes.wiring import Input, Wiring

MESSAGES, QUICK = 1_000_000, 20_000
STALLS, LONGEST = 3, 2.0
"""A listener stands still so often, for so many s at most."""
LAPS, TURNS = 3000, 5
_PATIENCE = 60.0


def reliability(quick: bool) -> Iterator[Row]:
    """Losses among stalls, late starts and a death; without the bus; and what a recorder costs.

    Parameters
    ----------
    quick : bool
        Fewer messages and laps.
    """
    number = QUICK if quick else MESSAGES
    stalls = _stalls(random.Random(1), number)
    wrong, restarts = _disturbed(number, random.Random(1))
    said = f"{number} messages to 3, stalls, late start, {restarts} kill"
    yield Row(f"{said}: lost or out of turn", str(wrong), "0", wrong == 0 and restarts == 1)
    lost = plain(number, stalls)
    yield Row("the same over a plain PUB socket, stalls alone: lost", str(lost), "> 0", lost > 0)
    ring = recorded_rate(LAPS // 3 if quick else LAPS)
    yield Row("rate with a recorder, ring of tokens without work", f"{ring:.2f}", "", True)
    ratio = recorded_touches(1 if quick else TURNS)
    yield Row("rate with a recorder, touches of a sphere", f"{ratio:.2f}", ">= 0.85", ratio >= 0.85)


def _stalls(rng: random.Random, number: int) -> tuple[tuple[int, float], ...]:
    return tuple((rng.randrange(number), rng.uniform(0.0, LONGEST)) for _ in range(STALLS))


class _Killer(Quiet):
    """Kills a node once it has heard so many messages."""

    def __init__(self, name: str, number: int) -> None:
        super().__init__()
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


def _disturbed(number: int, rng: random.Random) -> tuple[int, int]:
    """Messages that were lost or came out of turn among three listeners, and restarts."""
    source = Wiring(
        name=SOURCE,
        module=flood.__name__,
        params=flood.Params(messages=number),
        inputs=(),
        outputs={TOPIC: TOPIC},
        listeners={},
    )
    first = number // 20
    listeners = [
        listener("stalls", Params(expects=number, stalls=_stalls(rng, number))),
        listener("late", Params(expects=number, late=rng.uniform(0.0, 1.0))),
        listener("dies", Params(expects=number, stalls=((2 * first, 1.0),))),
    ]
    watcher = _Killer("dies", first)
    graph = [source, *listeners]
    ending = launch(graph, ends="dies", hear=(), watcher=watcher)
    if ending.status != "finished":
        raise RuntimeError(f"the graph {ending.status}: {ending.reason}")
    heard = [ending.statuses[one.name].messages for one in listeners]
    wrong = sum(number - one for one in heard) + ending.gaps
    if ending.reason != f"{number} heard, 0 left out, 0 out of turn":
        wrong += 1
    return wrong, sum(ending.restarts.values())


def plain(number: int, stalls: tuple[tuple[int, float], ...]) -> int:
    """Messages that are lost between a plain PUB socket and a listener that stalls."""
    spawn = multiprocessing.get_context("forkserver")
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder, zmq.Context() as context:
        endpoint = f"ipc://{Path(folder) / 'plain'}"
        mine, yours = spawn.Pipe()
        hearer = spawn.Process(target=_hear, args=(endpoint, stalls, yours), daemon=True)
        with context.socket(zmq.PUB) as socket:
            socket.setsockopt(zmq.SNDHWM, DEPTH)
            socket.setsockopt(zmq.LINGER, 0)
            socket.bind(endpoint)
            try:
                with no_script():
                    hearer.start()
                return number - _say(socket, mine, number)
            finally:
                if hearer.pid is not None:
                    hearer.kill()
                    hearer.join()


def _say(socket: zmq.Socket[bytes], line: Any, number: int) -> int:
    """Say everything once the other hears; how much of it was heard."""
    deadline = time.monotonic() + _PATIENCE
    while not line.poll(0.01):  # until the other end has heard a first word, nothing counts
        socket.send(b"?")
        if time.monotonic() > deadline:
            raise RuntimeError("the listener of the plain socket did not come up")
    line.recv()
    for seq in range(number):
        socket.send(pack_frame(TOPIC, Header(1, 0, seq, 0, 0.0, 0), b"x" * 20))
    while not line.poll(0.01):
        socket.send(b".")
        if time.monotonic() > deadline + _PATIENCE:
            raise RuntimeError("the listener of the plain socket did not come to an end")
    heard: int = line.recv()
    return heard


def _hear(endpoint: str, stalls: tuple[tuple[int, float], ...], line: Any) -> None:
    socket = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.RCVHWM, DEPTH)
    socket.subscribe(b"")
    socket.connect(endpoint)
    left, heard = dict(stalls), 0
    while socket.recv() != b"?":
        pass
    line.send("heard")
    while (frame := socket.recv()) != b".":
        if frame != b"?":
            time.sleep(left.pop(heard, 0.0))
            heard += 1
    line.send(heard)


def recorded_rate(laps: int) -> float:
    """Rate of a ring of two nodes with a recorder, over that without one; measured in turns."""
    times: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(TURNS):
        for recorded in (False, True):
            times[recorded].append(_ring(laps, recorded=recorded))
    return min(times[False]) / min(times[True])


def recorded_touches(turns: int) -> float:
    """Touches a second of an exploration with a recorder, over those without; in turns."""
    rates: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(turns):
        for recorded in (False, True):
            rates[recorded].append(_touches(recorded=recorded))
    return max(rates[True]) / max(rates[False])


def _touches(*, recorded: bool) -> float:
    scene = Located(str(find_scene("sphere")), "bench")
    args = {"scene": scene, "record": Located(recorded, "bench")}
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        plan = plan_run(EXPLORE, args, {}, name="sphere", out=Path(folder) / "run")
        done = perform(plan, composed=False, display=Silence())
    if done.ending.status != "finished":
        raise RuntimeError(f"the exploration {done.ending.status}: {done.ending.reason}")
    return float(done.summary["touches_per_s"])


def _ring(laps: int, *, recorded: bool) -> float:
    """Time between the first and the last mark of a ring, s."""
    watcher = Quiet()
    graph = [
        toy("source", ToyParams(burst=1, laps=laps, expects=laps), hears="relay"),
        toy("relay", ToyParams(relay=True), hears="source"),
    ]
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        if recorded:
            graph = _with_recorder(graph, Path(folder))
        ending = launch(graph, ends="source", hear=["/source/mark"], watcher=watcher)
    if ending.status != "finished":
        raise RuntimeError(f"the ring {ending.status}: {ending.reason}")
    first, last = watcher.times
    return last - first


def _with_recorder(graph: list[Wiring], folder: Path) -> list[Wiring]:
    kept = Wiring(
        name="recorder",
        module=recorder.__name__,
        params=recorder.Params(path=str(folder / "topics.mcap")),
        inputs=tuple(
            Input(name, f"/{name}", f"/{name}", "TactileFrame") for name in ("source", "relay")
        ),
        outputs={},
        listeners={},
    )
    return list(with_description([*graph, kept], {}))
