"""The processes of a graph while it runs: started, watched for hanging, started again.

They are forked here from a server (`fork_server`) that has already imported what they need, or
started on another machine; nodes share no state. A node gives signs of life from its own loop, so
that a handler that never ends is seen. How long one may take is the node's parameter, in processor
time: a busy machine makes no node hang.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import wait
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec

from palpate.launch.processes.fork_server import start_fork_server, without_main_module
from palpate.launch.processes.node_status import LauncherSockets
from palpate.messages.bus import Addresses
from palpate.nodes.runtime.loop import enter_process
from palpate.nodes.runtime.node import OnExit, Wiring

MAX_RESTARTS, RESTART_WINDOW = 3, 10.0  # Starts of a node within so many s: more is a storm
OUT_OF_MEMORY = "was killed by the system for want of memory"
MIN_WORK = 2.0  # A node that is killed sooner was killed by somebody, not for memory, s
SILENCE_LIMIT = 1.2  # Signs of life come four a second; a node without one so long is looked at, s
LAUNCHER_GAP = 0.5  # If the launcher had not run for so long, nobody is blamed for silence, s
GRACE = 2.5  # A process that is asked to end is killed after this long, s
_CONTEXT = multiprocessing.get_context("forkserver")
HEARTBEAT, HOST_LOST = 0.5, 6.0  # How often each side shows life, and when the other is lost, s


class ProcessTable:
    """The processes of one graph.

    `ahead_ns` tells how far this machine's clock is ahead of that of a node's machine, ns.
    """

    def __init__(
        self,
        wirings: Sequence[Wiring],
        place: Addresses,
        hosts: ProcessHosts,
        sockets: LauncherSockets,
        ahead_ns: Callable[[str], int],
    ) -> None:
        self.wirings = {wiring.name: wiring for wiring in wirings}  # The nodes by name
        # What has died so far.
        self.restarts = RestartPolicy({one.name: one.on_exit for one in wirings})
        self._addresses, self._hosts, self._sockets = place, hosts, sockets
        self._ahead_ns = ahead_ns
        self._watchdog = Watchdog({one.name: one.handler_timeout for one in wirings})
        self._kills = KilledNodes(place.journals)
        self._hung: dict[str, float] = {}
        self._living: dict[int, str] = {}

    @property
    def living(self) -> list[str]:
        """Names of the nodes whose processes have not ended."""
        return list(self._living.values())

    def pid(self, name: str) -> int:
        """Number of the process of a node."""
        return self._hosts.of(name).pid(name)

    def spawn(self, name: str, *, going: bool = False) -> None:
        """Start the process of a node, again if the graph is going.

        Raises ChildProcessError if it cannot be started.
        """
        epoch, ahead_ns = self.restarts.counts[name], self._ahead_ns(name)
        place = replace(self._addresses, epoch=epoch, going=going, ahead_ns=ahead_ns)
        packed = msgspec.msgpack.encode(place)
        wiring = self.wirings[name]
        # Its parameters in bytes once more: only the node knows their type.
        seat = replace(wiring, params=msgspec.msgpack.encode(wiring.params))
        sentinel = self._hosts.of(name).spawn(name, msgspec.msgpack.encode(seat), packed)
        self._living[sentinel] = name
        self._watchdog.begin(name, time.monotonic())
        self._kills.begun(name, time.monotonic())
        self._sockets.watch(sentinel)

    def bury(self, sentinel: int) -> tuple[str, int]:
        """Name and exit code of the node whose process has ended."""
        self._sockets.unwatch(sentinel)
        name = self._living.pop(sentinel)
        self._watchdog.forget(name)
        return name, self._hosts.of(name).exit_code(name)

    def how_it_died(self, name: str, code: int, failed: str | None) -> str:
        """How a node died, as the rest of a sentence; what it failed of, if it told."""
        silence = self._hung.pop(name, None)
        if silence is not None:
            return f"hung: it gave no sign of life for {silence:.1f} s"
        if failed is not None:
            return f"failed while {failed}"
        if code == -signal.SIGKILL and self._kills.for_memory(name, time.monotonic()):
            return f"{OUT_OF_MEMORY}: explore a smaller object, or with fewer touches"
        return exit_text(code)

    def sign(self, name: str, kind: str) -> None:
        """A node has reported something of a kind to the launcher."""
        if kind in ("exiting", "failed"):
            self._watchdog.forget(name)
        elif name in self.living:
            process = process_state(self._hosts.of(name).pid(name))
            self._watchdog.sign(name, time.monotonic(), 0.0 if process is None else process.used)

    def let_begin(self) -> None:
        """All nodes begin: that may take its time, and signs of life count from the next on."""
        for name in self.living:
            self._watchdog.begin(name, time.monotonic())

    def see_to_hung(self, now: float) -> None:
        """Kill what hangs: it is then buried as others are."""
        pids = {name: self._hosts.of(name).pid(name) for name in self.living}
        for name, silence in self._watchdog.hung(now, pids).items():
            self._hung[name] = silence
            self._watchdog.forget(name)
            self._hosts.of(name).kill(name)


class KilledNodes:
    """Which of the nodes that were killed were so by the system, for want of memory.

    The system counts whom it kills for memory; in a container it may not tell. Then a node that
    worked for a while and came no further than at its last death, by the journal of what it
    consumed, has met the same end.
    """

    def __init__(self, journals: Mapping[str, str]) -> None:
        self._journals = journals
        self._counted = memory_kills()
        self._begun: dict[str, float] = {}
        self._places: dict[str, int] = {}

    def begun(self, name: str, now: float) -> None:
        """A node was started; monotonic time, s."""
        self._begun[name] = now

    def _journalled(self, name: str) -> int:
        """Bytes of its journal: how far it came."""
        try:
            return os.stat(self._journals.get(name, "")).st_size
        except OSError:  # on another machine
            return 0

    def for_memory(self, name: str, now: float) -> bool:
        """Whether a node that was killed was so for memory, as far as can be told."""
        counted, place = memory_kills(), self._journalled(name)
        worked = now - self._begun.get(name, now) >= MIN_WORK
        stuck = 0 < place == self._places.get(name) and worked
        known = counted > self._counted or stuck
        self._counted, self._places[name] = counted, place
        return known


def memory_kills() -> int:
    """How many processes this system has killed for want of memory; 0 where it does not tell."""
    try:
        with open("/proc/vmstat", encoding="ascii") as file:
            counts = (line.split() for line in file)
            return next((int(number) for name, number in counts if name == "oom_kill"), 0)
    except (OSError, ValueError):
        return 0


class RestartPolicy:
    """What nodes have died of so far, and what is done about it."""

    def __init__(self, on_exit: Mapping[str, OnExit]) -> None:
        self.counts = dict.fromkeys(on_exit, 0)  # How often each node has been started again
        self._on_exit = on_exit
        self._failed_while: dict[str, str] = {}
        self._when: dict[str, deque[float]] = {name: deque(maxlen=MAX_RESTARTS) for name in on_exit}

    def refusal(self, name: str, how: str, failed: bool, now: float) -> str | None:
        """Why a node that died may not be started again, in a sentence; None if it may.

        `how` is the rest of a sentence that begins with its name; `failed` is whether it reported
        that itself; `now` is monotonic time, s.
        """
        if self._on_exit[name] == "stop":
            return f"{name} {how}"
        if failed or how.startswith(OUT_OF_MEMORY):
            if self._failed_while.get(name) == how:
                return f"{name} {how}; so it did when it was started again"
            self._failed_while[name] = how
        when = self._when[name]
        if len(when) == MAX_RESTARTS and now - when[0] < RESTART_WINDOW:
            return (
                f"{name} {how}, after it had been started again {MAX_RESTARTS} times "
                f"in {RESTART_WINDOW:g} s"
            )
        when.append(now)
        self.counts[name] += 1
        return None


class ProcessState(NamedTuple):
    """What a process is doing, as the system has it."""

    state: str  # R: it runs, or waits for the processor; T: it is stopped; others: it waits
    used: float  # Processor time so far, s


class _Heartbeat(NamedTuple):
    when: float
    used: float
    begun: bool


class Watchdog:
    """The signs of life of nodes, by name with the longest time that a handler may take, s."""

    def __init__(self, handler_timeout: Mapping[str, float]) -> None:
        self._handler_timeout = handler_timeout
        self._signs: dict[str, _Heartbeat] = {}
        self._looked = 0.0

    def sign(self, name: str, now: float, used: float) -> None:
        """A node has given a sign of life, when it had used so much processor time, s."""
        self._signs[name] = _Heartbeat(now, used, True)

    def begin(self, name: str, now: float) -> None:
        """A node begins: until its next sign, which may take a while, it must not be stopped."""
        self._signs[name] = _Heartbeat(now, 0.0, False)

    def forget(self, name: str) -> None:
        """A node has died, or has taken its leave: nothing more is expected of it."""
        self._signs.pop(name, None)

    def hung(self, now: float, pids: Mapping[str, int]) -> dict[str, float]:
        """Names of the nodes that hang, with the time since their last sign, s."""
        if now - self._looked > LAUNCHER_GAP:
            self._signs = {name: sign._replace(when=now) for name, sign in self._signs.items()}
        self._looked = now
        return {
            name: now - sign.when
            for name, sign in self._signs.items()
            if now - sign.when > SILENCE_LIMIT
            and self._hangs(name, now, sign, process_state(pids[name]))
        }

    def _hangs(self, name: str, now: float, sign: _Heartbeat, process: ProcessState | None) -> bool:
        if process is not None and process.state in "Tt":
            return True
        if not sign.begun:
            return False
        silence, handler_timeout = now - sign.when, max(self._handler_timeout[name], SILENCE_LIMIT)
        if process is not None and process.state == "R":
            return process.used - sign.used > handler_timeout
        return silence > handler_timeout


def process_state(pid: int) -> ProcessState | None:
    """What a process is doing; None where the system does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return ProcessState(fields[0], (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK"))


class NodeHost(Protocol):
    """Another machine on which processes of nodes run."""

    @property
    def name(self) -> str:
        """Its address and port."""

    def spawn(self, name: str, wiring: bytes, place: bytes) -> int:
        """Start a process; returns what wakes when it ends. Raises ChildProcessError."""

    def exit_code(self, name: str) -> int:
        """Exit code of a process that has ended; negative for a signal."""

    def pid(self, name: str) -> int:
        """Number of the process of a node, if it means anything here, else 0."""

    def kill(self, name: str) -> None:
        """Kill a process at once."""

    def receive(self, now: float) -> None:
        """Take in what the machine reports."""

    def end(self) -> None:
        """End all its processes."""


class ProcessHosts:
    """The fork server of this machine, and the hosts of the nodes that are elsewhere, by name."""

    def __init__(self, server: ForkServer, away: Mapping[str, NodeHost]) -> None:
        self._server, self._away = server, away
        # The other machines.
        self.hosts = list({host.name: host for host in away.values()}.values())

    def of(self, name: str) -> ForkServer | NodeHost:
        """Where the process of a node is started, and ended."""
        return self._away.get(name) or self._server

    def receive(self) -> None:
        """Take in what other machines report."""
        now = time.monotonic()
        for host in self.hosts:
            host.receive(now)

    def end(self) -> None:
        """End all processes."""
        for host in self.hosts:
            host.end()
        self._server.end()


class ForkServer:
    """The processes of one graph; none of them is left when its ``with`` block ends."""

    def __init__(self, modules: Iterable[str]) -> None:
        self._modules = tuple(modules)
        self._children: dict[str, multiprocessing.context.ForkServerProcess] = {}

    def __enter__(self) -> ForkServer:
        start_fork_server(self._modules)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def spawn(self, name: str, wiring: bytes, place: bytes) -> int:
        """Start the process of a node, and return its sentinel.

        Raises ChildProcessError if it cannot be started.
        """
        child = _CONTEXT.Process(target=enter_process, args=(wiring, place), name=name, daemon=True)
        try:
            with without_main_module():
                child.start()
        except (OSError, EOFError) as error:
            reason = str(error) or type(error).__name__
            raise ChildProcessError(f"the process of {name} cannot be started: {reason}") from None
        self._children[name] = child
        return child.sentinel

    def exit_code(self, name: str) -> int:
        """Exit code of a process that has ended; negative for a signal."""
        child = self._children[name]
        child.join()
        return child.exitcode or 0

    def kill(self, name: str) -> None:
        """Kill a process at once."""
        self._children[name].kill()

    def pid(self, name: str) -> int:
        """Number of the process of a node."""
        return self._children[name].pid or 0

    def end(self) -> None:
        """End all processes: they are asked, and killed if they take too long."""
        living = [child for child in self._children.values() if child.exitcode is None]
        for child in living:
            child.terminate()
        deadline = time.monotonic() + GRACE
        while living and (left := deadline - time.monotonic()) > 0:
            wait([child.sentinel for child in living], left)
            living = [child for child in living if child.exitcode is None]
        for child in living:
            child.kill()
        for child in self._children.values():
            child.join()


def exit_text(code: int) -> str:
    """Exit code of a process in words."""
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended by itself with exit code {code}"
