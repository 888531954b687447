"""The processes of a running graph: started, watched for hanging, and restarted.

They are forked from a server (`fork_server`) that has already imported their modules, or started on
another machine; nodes share no state. A node sends signs of life from its own loop, so that a
handler that never ends is detected. The time that a handler may take is a parameter of the node,
in processor time: on a busy machine no node seems to hang.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from multiprocessing.connection import wait
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec

from palpate.launch.processes.fork_server import start_fork_server, without_main_module
from palpate.launch.processes.node_status import LauncherSockets
from palpate.messages.bus import Addresses
from palpate.nodes.runtime.loop import enter_process
from palpate.nodes.runtime.node import OnExit, Wiring

OUT_OF_MEMORY = "was killed by the system for want of memory"
_CONTEXT = multiprocessing.get_context("forkserver")


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSettings:
    """Times of processes that are ended, and of the connection to other machines."""

    exit_time: float = 2.5  # after which a process that was asked to end is killed [s]
    answer_time: float = 10.0  # that another machine has for its first answer [s]
    heartbeat_period: float = 0.5  # between signs of life of launcher and other machines [s]
    silence_limit: float = 6.0  # after which launcher or machine considers the other lost [s]


DEFAULT_HOST_SETTINGS = HostSettings()


class ProcessTable:
    """The processes of one graph.

    `ahead_ns` returns how far this machine's clock is ahead of that of a node's machine [ns].
    """

    def __init__(
        self,
        wirings: Sequence[Wiring],
        place: Addresses,
        hosts: ProcessHosts,
        sockets: LauncherSockets,
        ahead_ns: Callable[[str], int],
    ) -> None:
        self.wirings = {wiring.name: wiring for wiring in wirings}  # by name
        self.restarts = RestartPolicy({wiring.name: wiring.on_exit for wiring in wirings})
        self._addresses, self._hosts, self._sockets = place, hosts, sockets
        self._ahead_ns = ahead_ns
        self._watchdog = Watchdog({wiring.name: wiring.handler_timeout for wiring in wirings})
        self._kills = KilledNodes(place.journals)
        self._hung: dict[str, float] = {}
        self._living: dict[int, str] = {}

    @property
    def living(self) -> list[str]:
        """Names of the nodes with running processes."""
        return list(self._living.values())

    def pid(self, name: str) -> int:
        """Number of the process of a node."""
        return self._hosts.of(name).pid(name)

    def spawn(self, name: str, *, going: bool = False) -> None:
        """Start the process of a node; `going`: the graph is running already.

        Raises ChildProcessError if it cannot be started.
        """
        epoch, ahead_ns = self.restarts.counts[name], self._ahead_ns(name)
        place = replace(self._addresses, epoch=epoch, going=going, ahead_ns=ahead_ns)
        packed = msgspec.msgpack.encode(place)
        wiring = self.wirings[name]
        # The parameters are encoded separately: only the node knows their type.
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
        """How a node died, as the rest of a sentence; `failed`: the failure that it reported."""
        silence = self._hung.pop(name, None)
        if silence is not None:
            return f"hung: it gave no sign of life for {silence:.1f} s"
        if failed is not None:
            return f"failed while {failed}"
        if code == -signal.SIGKILL and self._kills.for_memory(name, time.monotonic()):
            return f"{OUT_OF_MEMORY}: explore a smaller object, or with fewer touches"
        return exit_text(code)

    def sign(self, name: str, kind: str) -> None:
        """Take note of a node's report to the launcher."""
        if kind in ("exiting", "failed"):
            self._watchdog.forget(name)
        elif name in self.living:
            process = process_state(self._hosts.of(name).pid(name))
            self._watchdog.sign(name, time.monotonic(), 0.0 if process is None else process.used)

    def let_begin(self) -> None:
        """Take note that all nodes begin: the watchdog waits for their next signs of life."""
        for name in self.living:
            self._watchdog.begin(name, time.monotonic())

    def kill_hung(self, now: float) -> None:
        """Kill the processes that hang."""
        pids = {name: self._hosts.of(name).pid(name) for name in self.living}
        for name, silence in self._watchdog.hung(now, pids).items():
            self._hung[name] = silence
            self._watchdog.forget(name)
            self._hosts.of(name).kill(name)


class KilledNodes:
    """Decides which killed nodes were killed by the system for want of memory.

    The system counts processes that it kills for memory, but may hide this in a container. Then a
    node that ran for at least `min_work_time` [s] and came no further than at its last death, by
    the journal of the messages that it consumed, is taken for killed for memory.
    """

    def __init__(self, journals: Mapping[str, str], min_work_time: float = 2.0) -> None:
        self._journals, self._min_work_time = journals, min_work_time
        self._counted = memory_kills()
        self._begun: dict[str, float] = {}
        self._places: dict[str, int] = {}

    def begun(self, name: str, now: float) -> None:
        """Take note of the start of a node, at monotonic time `now` [s]."""
        self._begun[name] = now

    def _journalled(self, name: str) -> int:
        """Size of a node's journal [bytes], which shows its progress; 0 if unknown."""
        try:
            return os.stat(self._journals.get(name, "")).st_size
        except OSError:  # on another machine
            return 0

    def for_memory(self, name: str, now: float) -> bool:
        """Whether a node that was killed was probably killed for memory."""
        counted, place = memory_kills(), self._journalled(name)
        worked = now - self._begun.get(name, now) >= self._min_work_time
        stuck = 0 < place == self._places.get(name) and worked
        known = counted > self._counted or stuck
        self._counted, self._places[name] = counted, place
        return known


def memory_kills() -> int:
    """Number of processes that the system has killed for want of memory; 0 if unknown."""
    try:
        with open("/proc/vmstat", encoding="ascii") as file:
            counts = (line.split() for line in file)
            return next((int(number) for name, number in counts if name == "oom_kill"), 0)
    except (OSError, ValueError):
        return 0


class RestartPolicy:
    """Decides whether a dead node is restarted: at most `max_restarts` times in `window` [s]."""

    def __init__(
        self, on_exit: Mapping[str, OnExit], max_restarts: int = 3, window: float = 10.0
    ) -> None:
        self.counts = dict.fromkeys(on_exit, 0)  # number of restarts of each node
        self._on_exit, self._max_restarts, self._window = on_exit, max_restarts, window
        self._failed_while: dict[str, str] = {}
        self._when: dict[str, deque[float]] = {name: deque(maxlen=max_restarts) for name in on_exit}

    def refusal(self, name: str, how: str, failed: bool, now: float) -> str | None:
        """The reason not to restart a node that died, as a sentence; None if it may be restarted.

        `how`: the rest of a sentence that begins with its name. `failed`: it reported a failure.
        `now`: monotonic time [s].
        """
        if self._on_exit[name] == "stop":
            return f"{name} {how}"
        if failed or how.startswith(OUT_OF_MEMORY):
            if self._failed_while.get(name) == how:
                return f"{name} {how}; so it did when it was started again"
            self._failed_while[name] = how
        when = self._when[name]
        if len(when) == self._max_restarts and now - when[0] < self._window:
            return (
                f"{name} {how}, after it had been started again {self._max_restarts} times "
                f"in {self._window:g} s"
            )
        when.append(now)
        self.counts[name] += 1
        return None


class ProcessState(NamedTuple):
    """State of a process in the system."""

    state: str  # R: it runs, or waits for the processor; T: it is stopped; others: it waits
    used: float  # processor time so far [s]


class _Heartbeat(NamedTuple):
    when: float  # monotonic time [s]
    used: float  # processor time of the node so far [s]
    begun: bool  # False until the node's first sign


class Watchdog:
    """Finds nodes that hang by their signs of life, which a node sends four times a second.

    `handler_timeout`: by name, the processor time that a handler may take [s]. A node is examined
    after a silence of `silence_limit` [s]. If the launcher itself did not run for `launcher_gap`
    [s], the silences of all nodes are counted from now on.
    """

    def __init__(
        self,
        handler_timeout: Mapping[str, float],
        silence_limit: float = 1.2,
        launcher_gap: float = 0.5,
    ) -> None:
        self._handler_timeout = handler_timeout
        self._silence_limit, self._launcher_gap = silence_limit, launcher_gap
        self._signs: dict[str, _Heartbeat] = {}
        self._last_check = 0.0

    def sign(self, name: str, now: float, used: float) -> None:
        """Take a sign of life of a node with `used` processor time [s]."""
        self._signs[name] = _Heartbeat(now, used, True)

    def begin(self, name: str, now: float) -> None:
        """Take note that a node begins: until its next sign it hangs only if it is stopped."""
        self._signs[name] = _Heartbeat(now, 0.0, False)

    def forget(self, name: str) -> None:
        """Expect no more signs of a node, which has died or exits."""
        self._signs.pop(name, None)

    def hung(self, now: float, pids: Mapping[str, int]) -> dict[str, float]:
        """Nodes that hang, with the time since their last sign [s]."""
        if now - self._last_check > self._launcher_gap:
            self._signs = {name: sign._replace(when=now) for name, sign in self._signs.items()}
        self._last_check = now
        return {
            name: now - sign.when
            for name, sign in self._signs.items()
            if now - sign.when > self._silence_limit
            and self._hangs(name, now, sign, process_state(pids[name]))
        }

    def _hangs(self, name: str, now: float, sign: _Heartbeat, process: ProcessState | None) -> bool:
        if process is not None and process.state in "Tt":
            return True
        if not sign.begun:
            return False
        silence = now - sign.when
        handler_timeout = max(self._handler_timeout[name], self._silence_limit)
        if process is not None and process.state == "R":
            return process.used - sign.used > handler_timeout
        return silence > handler_timeout


def process_state(pid: int) -> ProcessState | None:
    """State of a process; None if the system does not show it."""
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
        """Start a process; returns its sentinel. Raises ChildProcessError."""

    def exit_code(self, name: str) -> int:
        """Exit code of a process that has ended; negative for a signal."""

    def pid(self, name: str) -> int:
        """Number of the process of a node on this machine, else 0."""

    def kill(self, name: str) -> None:
        """Kill a process at once."""

    def receive(self, now: float) -> None:
        """Take the reports of the machine."""

    def end(self) -> None:
        """End all its processes."""


class ProcessHosts:
    """The fork server of this machine, and the other machines by the names of their nodes."""

    def __init__(self, server: ForkServer, away: Mapping[str, NodeHost]) -> None:
        self._server, self._away = server, away
        self.hosts = list({host.name: host for host in away.values()}.values())

    def of(self, name: str) -> ForkServer | NodeHost:
        """The fork server or machine of a node's process."""
        return self._away.get(name) or self._server

    def receive(self) -> None:
        """Take the reports of other machines."""
        now = time.monotonic()
        for host in self.hosts:
            host.receive(now)

    def end(self) -> None:
        """End all processes."""
        for host in self.hosts:
            host.end()
        self._server.end()


class ForkServer:
    """The processes of one graph, all of which have ended after its ``with`` block."""

    def __init__(
        self, modules: Iterable[str], settings: HostSettings = DEFAULT_HOST_SETTINGS
    ) -> None:
        self._modules, self._settings = tuple(modules), settings
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
        """End all processes: they are asked to end, and later killed."""
        living = [child for child in self._children.values() if child.exitcode is None]
        for child in living:
            child.terminate()
        deadline = time.monotonic() + self._settings.exit_time
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
