"""Puts faults into a graph that runs, from outside, and takes the time until nodes are back."""

from __future__ import annotations

import os
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import zmq

from palpate.launch.chaos.faults import BESIDE, Fault
from palpate.launch.looking.ask import ask
from palpate.launch.processes.register import Card, running
from palpate.launch.run_dir import RECORDING
from palpate.messages.bus.tap import STATUS, TapReader
from palpate.messages.codec import decode
from palpate.messages.recording.parts import parts_of
from palpate.messages.types import NodeStatus

TURN_MS = 5
DEPTH = 10_000
"""Messages of a tap that may wait for the injector."""
ROOM = 1000
"""Bytes that a recorder may still write when its disk becomes full."""
ONLOOKER = "palpate.launch.chaos.onlooker"


class Back(NamedTuple):
    """A node that came back."""

    kind: str
    """What it was hit by."""
    node: str
    """Its name."""
    phase: str
    """When that was."""
    seconds: float
    """Time from the blow to its word that it runs again, s."""


@dataclass(slots=True)
class Injected:
    """What was done to one run."""

    faults: list[Fault] = field(default_factory=list)
    """Those that found somebody to hit."""
    back: list[Back] = field(default_factory=list)
    """Nodes that were hit while the graph ran, and came back."""
    ended_by: str = ""
    """Kind of the fault that was to end the run, if it was still running."""
    session: int = 0
    """Number of the session of its processes."""


@dataclass(slots=True)
class _Blow:
    fault: Fault
    epoch: int
    when: float


class Injector:
    """Puts its faults into one run.

    Parameters
    ----------
    process : Popen
        The launcher, in a session of its own.
    out : Path
        The run directory.
    faults : iterable of Fault
        What to do.
    """

    def __init__(
        self, process: subprocess.Popen[bytes], out: Path, faults: Iterable[Fault]
    ) -> None:
        self.done = Injected(session=process.pid)
        """What was done so far."""
        self._process, self._out = process, out
        self._left = list(faults)
        self._due: list[tuple[float, Fault]] = []
        self._seen: dict[str, int] = {"": 0}
        self._blows: dict[str, _Blow] = {}
        self._onlookers: list[subprocess.Popen[bytes]] = []

    def run(self, until: float) -> bool:
        """Work until the run has ended; false if it has not ended by then, s monotonic."""
        card = self._card(until)
        if card is None:
            return self._process.poll() is not None
        topics = {fault.moment.topic for fault in self._left} - {""}
        with ExitStack() as kept:
            context = kept.enter_context(zmq.Context())
            reader = TapReader(context, card.taps.values(), {*topics, STATUS}, depth=DEPTH)
            kept.enter_context(closing(reader))
            kept.callback(self._send_away)
            while self._process.poll() is None and time.monotonic() < until:
                reader.socket.poll(TURN_MS)
                self._hear(reader)
                self._inject(card)
                self._stop_onlookers()
        return self._process.poll() is not None

    def _card(self, until: float) -> Card | None:
        while self._process.poll() is None and time.monotonic() < until:
            for card in running(self._out.parent):
                if card.pid == self._process.pid:
                    return card
            time.sleep(TURN_MS / 1000)
        return None

    def _hear(self, reader: TapReader) -> None:
        while (heard := reader.receive()) is not None:
            topic, header, body = heard
            if topic == STATUS:
                self._hear_status(decode(NodeStatus, body), header.epoch)
            else:
                self._seen[topic] = max(header.seq, self._seen.get(topic, 0))

    def _hear_status(self, status: NodeStatus, epoch: int) -> None:
        blow = self._blows.get(status.node)
        if blow is None or status.state != "running" or epoch < blow.epoch:
            return
        del self._blows[status.node]
        fault = blow.fault
        if fault.moment.phase != "start":  # else it was not up, and waits for the others
            seconds = time.monotonic() - blow.when
            self.done.back.append(Back(fault.kind, status.node, fault.moment.phase, seconds))

    def _inject(self, card: Card) -> None:
        now = time.monotonic()
        for fault in [one for one in self._left if self._has_come(one)]:
            self._left.remove(fault)
            self._due.append((now + fault.moment.delay, fault))
        for due in [one for one in self._due if one[0] <= now]:
            self._due.remove(due)
            if not self._strike(card, due[1]):
                self._due.append((time.monotonic() + TURN_MS / 1000, due[1]))

    def _has_come(self, fault: Fault) -> bool:
        return self._seen.get(fault.moment.topic, -1) >= fault.moment.seq

    def _strike(self, card: Card, fault: Fault) -> bool:
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

    def _strike_nodes(self, card: Card, fault: Fault) -> bool:
        try:
            nodes: Mapping[str, Mapping[str, int]] = ask(card, "status")["nodes"]
        except ValueError:
            return False  # it is ending: there is nobody left to be hit
        pids = {name: int(nodes[name]["pid"]) for name in fault.whom}
        if not all(pid and _is_of(pid, self._process.pid) for pid in pids.values()):
            return False
        for name, pid in pids.items():
            if fault.kind == "full":
                return _fill(pid, self._out / RECORDING)
            os.kill(pid, signal.SIGSTOP if fault.kind == "stop" else signal.SIGKILL)
            epoch = int(nodes[name]["restarts"]) + 1
            self._blows[name] = _Blow(fault, epoch, time.monotonic())
        return True

    def _look_on(self, card: Card) -> None:
        """Have a tool join."""
        command = [sys.executable, "-m", ONLOOKER, *card.taps.values(), "--", STATUS, *card.topics]
        onlooker = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self._onlookers.append(onlooker)

    def _stop_onlookers(self) -> None:
        """Stop the tools that have heard something."""
        for onlooker in self._onlookers:
            assert onlooker.stdout is not None
            if select.select([onlooker.stdout], [], [], 0.0)[0]:
                onlooker.send_signal(signal.SIGSTOP)

    def _send_away(self) -> None:
        for onlooker in self._onlookers:
            onlooker.kill()
            onlooker.communicate()


def _is_of(pid: int, session: int) -> bool:
    try:
        return os.getsid(pid) == session
    except ProcessLookupError:
        return False


def _fill(pid: int, recording: Path) -> bool:
    """Leave no more room for the last file of a recorder; false if it has none yet."""
    part = parts_of(recording)[-1]
    if not part.exists():
        return False
    room = part.stat().st_size + ROOM
    try:
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (room, room))
    except ProcessLookupError:
        return False
    return True
