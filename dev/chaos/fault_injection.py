"""Faults of a run, drawn from one seed, and their injection.

Also a node that floods the graph with messages that no node needs, and, as a program, a tool that
subscribes to all topics by the taps until it is stopped or killed.
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

ON_ONE_NODE, ON_SEVERAL_NODES, ENDING = (
    ("kill", "stop", "recorder", "full"),
    ("neighbours",),
    ("ctrl_c", "launcher"),
)
BESIDE = ("flood", "late")  # Other processes that disturb; no node is hit
FAULT_KINDS = (*ON_ONE_NODE, *ON_SEVERAL_NODES, *BESIDE, *ENDING)  # The program's help has them
PHASES = ("start", "grasp", "tracing", "models", "end")
RECORDER_NAME = "recorder"
# Topics of each phase; the second if a graph does not publish the first.
_MARKS = {
    "grasp": ("/hand/goal",),
    "tracing": ("/finger/goal",),
    "models": ("/model/goal", "/contour/traced"),
    "end": ("/plan/done", "/contour/traced"),
}
# Longest delay [s] of a fault after a message of its phase.
_MAX_DELAYS = {"start": 0.5, "grasp": 0.1, "tracing": 0.02, "models": 0.5, "end": 0.3}


@dataclass(frozen=True, slots=True, kw_only=True)
class InjectionSettings:
    """How faults are injected."""

    period: float = 5e-3  # [s] between two checks of the graph
    tap_depth: int = 10_000  # messages that a tap keeps for the injector; beyond it they are lost
    disk_room: int = 1000  # bytes that a recorder may still write when its disk becomes full


INJECTION = InjectionSettings()


class NodeRecovery(NamedTuple):
    """Recovery of a node from a fault."""

    kind: str  # Of the fault
    node: str
    phase: str
    seconds: float  # From the fault to the status that it runs again


@dataclass(slots=True)
class InjectionLog:
    """Faults of one run, and recoveries from them."""

    faults: list[Fault] = field(default_factory=list)  # Faults that were injected
    recoveries: list[NodeRecovery] = field(default_factory=list)  # Of nodes that had been running
    ended_by: str = ""  # Kind of the fault that ends the run, if it was injected
    session: int = 0  # Number of the session of its processes


class FaultInjector:
    """Injects faults into one run."""

    def __init__(
        self,
        process: subprocess.Popen[bytes],
        out: Path,
        faults: Iterable[Fault],
        settings: InjectionSettings = INJECTION,
    ) -> None:
        self.log = InjectionLog(session=process.pid)
        self._settings = settings
        self._process, self._out = process, out
        self._left = list(faults)
        self._due: list[tuple[float, Fault]] = []
        self._seen: dict[str, int] = {"": 0}
        # By node: its fault, the epoch in which it recovers, and the time of the fault [s].
        self._hits: dict[str, tuple[Fault, int, float]] = {}
        self._onlookers: list[subprocess.Popen[bytes]] = []

    def run(self, until: float) -> bool:
        """Inject faults until the run ends; false if it has not ended at a monotonic time [s]."""
        card = self._card(until)
        if card is None:
            return self._process.poll() is not None
        topics = {fault.topic for fault in self._left} - {""} | {STATUS_TOPIC}
        with ExitStack() as stack:
            context = stack.enter_context(zmq.Context())
            reader = TapReader(context, card.taps.values(), topics, depth=self._settings.tap_depth)
            stack.enter_context(closing(reader))
            stack.callback(self._end_onlookers)
            while self._process.poll() is None and time.monotonic() < until:
                reader.socket.poll(round(1e3 * self._settings.period))
                self._receive(reader)
                self._inject(card)
                self._stop_onlookers()
        return self._process.poll() is not None

    def _card(self, until: float) -> RunCard | None:
        while self._process.poll() is None and time.monotonic() < until:
            for card in running_graphs(self._out.parent):
                if card.pid == self._process.pid:
                    return card
            time.sleep(self._settings.period)
        return None

    def _receive(self, reader: TapReader) -> None:
        while (received := reader.receive()) is not None:
            topic, header, body = received
            if topic == STATUS_TOPIC:
                self._take_status(decode(NodeStatus, body), header.epoch)
            else:
                self._seen[topic] = max(header.seq, self._seen.get(topic, 0))

    def _take_status(self, status: NodeStatus, epoch: int) -> None:
        fault, after, when = self._hits.get(status.node, (None, 0, 0.0))
        if fault is None or status.state != "running" or epoch < after:
            return
        del self._hits[status.node]
        if fault.phase != "start":  # at the start it was not running, and waits for other nodes
            seconds = time.monotonic() - when
            self.log.recoveries.append(NodeRecovery(fault.kind, status.node, fault.phase, seconds))

    def _inject(self, card: RunCard) -> None:
        now = time.monotonic()
        for fault in [f for f in self._left if self._seen.get(f.topic, -1) >= f.seq]:
            self._left.remove(fault)
            self._due.append((now + fault.delay, fault))
        for due in [(when, fault) for when, fault in self._due if when <= now]:
            self._due.remove(due)
            if not self._inject_fault(card, due[1]):
                self._due.append((time.monotonic() + self._settings.period, due[1]))

    def _inject_fault(self, card: RunCard, fault: Fault) -> bool:
        """Inject a fault; false if its node does not run at the moment."""
        if fault.kind == "ctrl_c":
            os.killpg(self._process.pid, signal.SIGINT)
        elif fault.kind == "launcher":
            self._process.kill()
        elif fault.kind == "late":
            self._start_onlooker(card)
        elif fault.kind not in BESIDE and not self._hit_nodes(card, fault):
            return False
        if not fault.nodes and fault.kind not in BESIDE:
            self.log.ended_by = fault.kind
        self.log.faults.append(fault)
        return True

    def _hit_nodes(self, card: RunCard, fault: Fault) -> bool:
        try:
            nodes: Mapping[str, Mapping[str, int]] = request(card, "status")["nodes"]
        except ValueError:
            return False  # the graph is ending
        pids = {name: int(nodes[name]["pid"]) for name in fault.nodes}
        try:
            if not all(pid and os.getsid(pid) == self._process.pid for pid in pids.values()):
                return False
        except ProcessLookupError:
            return False
        for name, pid in pids.items():
            if fault.kind == "full":
                return _fill_disk(pid, self._out / RECORDING, self._settings.disk_room)
            os.kill(pid, signal.SIGSTOP if fault.kind == "stop" else signal.SIGKILL)
            self._hits[name] = fault, int(nodes[name]["restarts"]) + 1, time.monotonic()
        return True

    def _start_onlooker(self, card: RunCard) -> None:
        """Start a tool that subscribes by the taps."""
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


def _fill_disk(pid: int, recording: Path, room: int) -> bool:
    """Limit the growth of a recorder's last file to some bytes; false if there is no file yet."""
    part = parts_of(recording)[-1]
    if not part.exists():
        return False
    limit = part.stat().st_size + room
    try:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, limit))
    except ProcessLookupError:
        return False
    return True


class Fault(NamedTuple):
    """A fault and its time."""

    kind: str  # One of `FAULT_KINDS`
    nodes: tuple[str, ...]  # That it hits; empty if it hits the launcher or no node
    phase: str  # One of `PHASES`
    topic: str  # Of the message that it follows; empty for the launch itself
    seq: int  # Number of that message
    delay: float  # [s] after that message

    def __str__(self) -> str:
        when = f"{self.topic} {self.seq}" if self.topic else "the launch"
        nodes = f" {' and '.join(self.nodes)}" if self.nodes else ""
        return f"{self.kind}{nodes} {self.delay:.3f} s after {when}"


class GraphFacts(NamedTuple):
    """A graph, as a run without faults shows it."""

    nodes: tuple[str, ...]  # Names
    pairs: tuple[tuple[str, str], ...]  # Subscriber and publisher
    counts: Mapping[str, int]  # Number of messages by topic


def draw_faults(
    seed: int, facts: GraphFacts, kinds: Sequence[str], number: int, max_per_node: int = 3
) -> tuple[Fault, ...]:
    """Draw the faults of a run: `number` of them in any order, or one that ends it.

    Consecutive seeds cover all nodes in all phases. `max_per_node`: with more faults on a node
    within 10 s the launcher would give up.
    """
    rng = random.Random(f"palpate chaos {seed}")
    ending = [kind for kind in kinds if kind in ENDING]
    lasting = [kind for kind in kinds if kind not in ENDING]
    if ending and (not lasting or seed % len(kinds) < len(ending)):
        kind = ending[seed % len(ending)]
        phase = PHASES[seed // len(ending) % len(PHASES)]
        return (Fault(kind, (), *_moment(rng, phase, facts)),)
    places = list(product(facts.nodes, PHASES))
    random.Random(0).shuffle(places)
    faults: list[Fault] = []
    hits: Counter[str] = Counter()
    first = seed * number
    for i, kind in enumerate(islice(cycle(lasting), first % len(lasting), None)):
        if len(faults) == number or i > 10 * number:
            break
        name, phase = places[(first + i) % len(places)]
        nodes = _nodes_hit(rng, kind, name, facts)
        is_second_flood = kind == "flood" and any(fault.kind == kind for fault in faults)
        if not is_second_flood and all(hits[node] < max_per_node for node in nodes):
            hits.update(nodes)
            faults.append(Fault(kind, nodes, *_moment(rng, phase, facts)))
    return tuple(faults)


def _moment(rng: random.Random, phase: str, facts: GraphFacts) -> tuple[str, str, int, float]:
    """Phase, topic, number of the message, and delay of a fault."""
    delay = rng.uniform(0.0, _MAX_DELAYS[phase])
    for mark in _MARKS.get(phase, ()):
        topics = sorted(topic for topic in facts.counts if topic.endswith(mark))
        if topics:
            topic = rng.choice(topics)
            last = facts.counts[topic] - 1
            return phase, topic, last if phase == "end" else rng.randint(0, last), delay
    return phase, "", 0, delay


def _nodes_hit(rng: random.Random, kind: str, name: str, facts: GraphFacts) -> tuple[str, ...]:
    if kind in ("recorder", "full"):
        return (RECORDER_NAME,)
    if kind == "neighbours":
        return rng.choice([pair for pair in facts.pairs if name in pair] or facts.pairs)
    return () if kind in BESIDE else (name,)


class FloodParams(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the launch file may set."""

    messages: int = 100_000  # Number of messages


def _flood(params: FloodParams) -> Iterator[Timed]:
    return (Timed(0.0, "/flood", Clock(time=1e-3 * number)) for number in range(params.messages))


def listen_to_taps(taps: list[str], topics: list[str]) -> None:
    """Receive all messages of topics; print a line after the first."""
    with zmq.Context() as context:
        reader = TapReader(context, taps, topics)
        has_received = False
        while reader.socket.poll():
            if reader.receive() is not None and not has_received:
                print("received", flush=True)
                has_received = True


SOURCE = Source(params=FloodParams, outputs=lambda params: {"/flood": Clock}, open=_flood)


if __name__ == "__main__":
    between = sys.argv.index("--")
    listen_to_taps(sys.argv[1:between], sys.argv[between + 1 :])
