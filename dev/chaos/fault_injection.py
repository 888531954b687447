"""Which faults a run meets, all drawn from one seed, and how they are put into it.

Beside the graph: a node that floods it with what nobody needs, and, as a program, a tool that
subscribes to everything by the taps until it is stopped or killed.
"""

from __future__ import annotations

import os
import random
import resource
import select
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from itertools import cycle, islice, product
from pathlib import Path
from typing import NamedTuple

import zmq
from msgspec import Struct

from palpate.launch.processes.registry import RunCard, running_graphs
from palpate.launch.run_directory import RECORDING
from palpate.messages import decode
from palpate.messages.bus import STATUS_TOPIC, TapReader
from palpate.messages.recording import parts_of
from palpate.messages.types import Clock, NodeStatus
from palpate.nodes.runtime.node import Source, Timed
from palpate.tools.introspection.requests import request

TURN_MS = 5
INJECTOR_DEPTH = 10_000  # Messages of a tap that may wait for the injector
DISK_ROOM = 1000  # Bytes that a recorder may still write when its disk becomes full
ONE, SEVERAL, ENDING = ("kill", "stop", "recorder", "full"), ("neighbours",), ("ctrl_c", "launcher")
BESIDE = ("flood", "late")
# kill: kill -9 of a node; stop: SIGSTOP; recorder: kill -9 of it; full: no more room for its file;
# neighbours: kill -9 of two nodes of which one feeds the other; flood: a source of 100,000 messages
# beside the others; late: a tool that joins late and is stopped; ctrl_c: SIGINT to all processes;
# launcher: kill -9 of it.
FAULT_KINDS = (*ONE, *SEVERAL, *BESIDE, *ENDING)
PHASES = ("start", "grasp", "tracing", "models", "end")
RECORDER_NAME = "recorder"
MAX_PER_NODE = 3  # Faults that one node meets in a run: more within 10 s would be a storm
# What is published in each phase; the second where a graph publishes nothing of the first.
_MARKS = {
    "grasp": ("/hand/goal",),
    "tracing": ("/finger/goal",),
    "models": ("/model/goal", "/contour/traced"),
    "end": ("/plan/done", "/contour/traced"),
}
# A fault follows what was published by at most so many s.
_LONGEST = {"start": 0.5, "grasp": 0.1, "tracing": 0.02, "models": 0.5, "end": 0.3}


class NodeRecovery(NamedTuple):
    """A node that came back."""

    kind: str  # What it was hit by
    node: str  # Its name
    phase: str  # When that was
    seconds: float  # Time from the blow to its status that it runs again, s


@dataclass(slots=True)
class InjectionLog:
    """What was done to one run."""

    faults: list[Fault] = field(default_factory=list)  # Those that found somebody to hit
    back: list[NodeRecovery] = field(default_factory=list)  # Were hit while the graph ran
    ended_by: str = ""  # Kind of the fault that was to end the run, if it was still running
    session: int = 0  # Number of the session of its processes


class FaultInjector:
    """Puts its faults into one run."""

    def __init__(
        self, process: subprocess.Popen[bytes], out: Path, faults: Iterable[Fault]
    ) -> None:
        self.done = InjectionLog(session=process.pid)  # What was done so far
        self._process, self._out = process, out
        self._left = list(faults)
        self._due: list[tuple[float, Fault]] = []
        self._seen: dict[str, int] = {"": 0}
        # By node: its fault, the epoch in which it comes back, and when it was hit, s.
        self._blows: dict[str, tuple[Fault, int, float]] = {}
        self._onlookers: list[subprocess.Popen[bytes]] = []

    def run(self, until: float) -> bool:
        """Work until the run has ended; false if it has not ended by then, s monotonic."""
        card = self._card(until)
        if card is None:
            return self._process.poll() is not None
        topics = {fault.topic for fault in self._left} - {""} | {STATUS_TOPIC}
        with ExitStack() as kept:
            context = kept.enter_context(zmq.Context())
            reader = TapReader(context, card.taps.values(), topics, depth=INJECTOR_DEPTH)
            kept.enter_context(closing(reader))
            kept.callback(self._end_onlookers)
            while self._process.poll() is None and time.monotonic() < until:
                reader.socket.poll(TURN_MS)
                self._receive(reader)
                self._inject(card)
                self._stop_onlookers()
        return self._process.poll() is not None

    def _card(self, until: float) -> RunCard | None:
        while self._process.poll() is None and time.monotonic() < until:
            for card in running_graphs(self._out.parent):
                if card.pid == self._process.pid:
                    return card
            time.sleep(TURN_MS / 1000)
        return None

    def _receive(self, reader: TapReader) -> None:
        while (received := reader.receive()) is not None:
            topic, header, body = received
            if topic == STATUS_TOPIC:
                self._take_status(decode(NodeStatus, body), header.epoch)
            else:
                self._seen[topic] = max(header.seq, self._seen.get(topic, 0))

    def _take_status(self, status: NodeStatus, epoch: int) -> None:
        fault, after, when = self._blows.get(status.node, (None, 0, 0.0))
        if fault is None or status.state != "running" or epoch < after:
            return
        del self._blows[status.node]
        if fault.phase != "start":  # else it was not up, and waits for the others
            seconds = time.monotonic() - when
            self.done.back.append(NodeRecovery(fault.kind, status.node, fault.phase, seconds))

    def _inject(self, card: RunCard) -> None:
        now = time.monotonic()
        for fault in [one for one in self._left if self._seen.get(one.topic, -1) >= one.seq]:
            self._left.remove(fault)
            self._due.append((now + fault.delay, fault))
        for due in [one for one in self._due if one[0] <= now]:
            self._due.remove(due)
            if not self._strike(card, due[1]):
                self._due.append((time.monotonic() + TURN_MS / 1000, due[1]))

    def _strike(self, card: RunCard, fault: Fault) -> bool:
        """Put a fault in; false if who is to be hit is just not there."""
        if fault.kind == "ctrl_c":
            os.killpg(self._process.pid, signal.SIGINT)
        elif fault.kind == "launcher":
            self._process.kill()
        elif fault.kind == "late":
            self._look_on(card)
        elif fault.kind not in BESIDE and not self._strike_nodes(card, fault):
            return False
        if not fault.whom and fault.kind not in BESIDE:
            self.done.ended_by = fault.kind
        self.done.faults.append(fault)
        return True

    def _strike_nodes(self, card: RunCard, fault: Fault) -> bool:
        try:
            nodes: Mapping[str, Mapping[str, int]] = request(card, "status")["nodes"]
        except ValueError:
            return False  # it is ending: there is nobody left to be hit
        pids = {name: int(nodes[name]["pid"]) for name in fault.whom}
        try:
            if not all(pid and os.getsid(pid) == self._process.pid for pid in pids.values()):
                return False
        except ProcessLookupError:
            return False
        for name, pid in pids.items():
            if fault.kind == "full":
                return _fill(pid, self._out / RECORDING)
            os.kill(pid, signal.SIGSTOP if fault.kind == "stop" else signal.SIGKILL)
            self._blows[name] = fault, int(nodes[name]["restarts"]) + 1, time.monotonic()
        return True

    def _look_on(self, card: RunCard) -> None:
        """Have a tool join."""
        names = [*card.taps.values(), "--", STATUS_TOPIC, *card.topics]
        command, quiet = [sys.executable, "-P", "-m", __name__, *names], subprocess.DEVNULL
        self._onlookers.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=quiet))

    def _stop_onlookers(self) -> None:
        """Stop the tools that have received something."""
        for onlooker in self._onlookers:
            assert onlooker.stdout is not None
            if select.select([onlooker.stdout], [], [], 0.0)[0]:
                onlooker.send_signal(signal.SIGSTOP)

    def _end_onlookers(self) -> None:
        for onlooker in self._onlookers:
            onlooker.kill()
            onlooker.communicate()


def _fill(pid: int, recording: Path) -> bool:
    """Leave no more room for the last file of a recorder; false if it has none yet."""
    part = parts_of(recording)[-1]
    if not part.exists():
        return False
    room = part.stat().st_size + DISK_ROOM
    try:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (room, room))
    except ProcessLookupError:
        return False
    return True


class Fault(NamedTuple):
    """One fault, and when it is put in."""

    kind: str  # One of `FAULT_KINDS`
    whom: tuple[str, ...]  # The nodes that it hits; none for one that hits the launcher, or nobody
    phase: str  # One of `PHASES`
    topic: str  # Topic by which the moment is known; empty for the launch itself
    seq: int  # The message of that topic with which it comes
    delay: float  # Time after it, s

    def __str__(self) -> str:
        when = f"{self.topic} {self.seq}" if self.topic else "the launch"
        whom = f" {' and '.join(self.whom)}" if self.whom else ""
        return f"{self.kind}{whom} {self.delay:.3f} s after {when}"


class GraphFacts(NamedTuple):
    """What an undisturbed run has shown of a graph."""

    nodes: tuple[str, ...]  # Names of its nodes
    pairs: tuple[tuple[str, str], ...]  # Nodes of which one feeds the other
    counts: Mapping[str, int]  # Messages by topic


def draw_faults(
    seed: int, known: GraphFacts, kinds: Sequence[str], number: int
) -> tuple[Fault, ...]:
    """Faults of one run, in no order: so many, or the one that is to end it.

    Runs with seeds that follow each other go through every node in every phase.
    """
    rng = random.Random(f"palpate chaos {seed}")
    ending = [kind for kind in kinds if kind in ENDING]
    lasting = [kind for kind in kinds if kind not in ENDING]
    if ending and (not lasting or seed % len(kinds) < len(ending)):
        kind = ending[seed % len(ending)]
        phase = PHASES[seed // len(ending) % len(PHASES)]
        return (Fault(kind, (), *_moment(rng, phase, known)),)
    places = list(product(known.nodes, PHASES))
    random.Random(0).shuffle(places)
    faults: list[Fault] = []
    hit: Counter[str] = Counter()
    first = seed * number
    for place, kind in enumerate(islice(cycle(lasting), first % len(lasting), None)):
        if len(faults) == number or place > 10 * number:
            break
        name, phase = places[(first + place) % len(places)]
        whom = _whom(rng, kind, name, known)
        again = kind == "flood" and any(one.kind == kind for one in faults)
        if not again and all(hit[one] < MAX_PER_NODE for one in whom):
            hit.update(whom)
            faults.append(Fault(kind, whom, *_moment(rng, phase, known)))
    return tuple(faults)


def _moment(rng: random.Random, phase: str, known: GraphFacts) -> tuple[str, str, int, float]:
    delay = rng.uniform(0.0, _LONGEST[phase])
    for mark in _MARKS.get(phase, ()):
        topics = sorted(topic for topic in known.counts if topic.endswith(mark))
        if topics:
            topic = rng.choice(topics)
            last = known.counts[topic] - 1
            return phase, topic, last if phase == "end" else rng.randint(0, last), delay
    return phase, "", 0, delay


def _whom(rng: random.Random, kind: str, name: str, known: GraphFacts) -> tuple[str, ...]:
    if kind in ("recorder", "full"):
        return (RECORDER_NAME,)
    if kind == "neighbours":
        return rng.choice([pair for pair in known.pairs if name in pair] or known.pairs)
    return () if kind in BESIDE else (name,)


class FloodParams(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    messages: int = 100_000  # How much it publishes


def _flood(params: FloodParams) -> Iterator[Timed]:
    return (Timed(0.0, "/flood", Clock(time=1e-3 * number)) for number in range(params.messages))


def listen_to_taps(taps: list[str], topics: list[str]) -> None:
    """Receive all that is published; print one line as soon as something has come."""
    with zmq.Context() as context:
        reader = TapReader(context, taps, topics)
        told = False
        while reader.socket.poll():
            if reader.receive() is not None and not told:
                print("received", flush=True)
                told = True


SOURCE = Source(params=FloodParams, outputs=lambda params: {"/flood": Clock}, open=_flood)


if __name__ == "__main__":
    between = sys.argv.index("--")
    listen_to_taps(sys.argv[1:between], sys.argv[between + 1 :])
