"""Where the process of each node is started and ended: forked here, or on another machine.

Here they are forked from a server (`fork_server`) that has already imported what they need. Nodes
share no state.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterable, Mapping
from multiprocessing.connection import wait

from palpate.launch.processes.fork_server import start_fork_server, without_main_module
from palpate.messages.bus import FROM_HOSTS, ControlClient, ControlMessage, SocketContext
from palpate.nodes.runtime import enter_process

GRACE = 2.5  # A process that is asked to end is killed after this long, s
_CONTEXT = multiprocessing.get_context("forkserver")
HOST_PATIENCE = 10.0  # A machine has this long for its first answer, s
HEARTBEAT, HOST_LOST = 0.5, 6.0  # How often each side shows life, and when the other is lost, s


class ProcessHosts:
    """The fork server of this machine, and the hosts of the nodes that are elsewhere, by name."""

    def __init__(self, server: ForkServer, away: Mapping[str, RemoteHost]) -> None:
        self._server, self._away = server, away
        # The other machines.
        self.hosts = list({host.name: host for host in away.values()}.values())

    def of(self, name: str) -> ForkServer | RemoteHost:
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


class RemoteHost:
    """The line to one machine that lends itself; nodes are started and ended there.

    `wires` are locked with the key, `name` is address and port as the launch file has it,
    `endpoint` the same for a socket, and `run` what the launcher is called there.
    """

    def __init__(self, wires: SocketContext, name: str, endpoint: str, run: str) -> None:
        self.name = name  # Address and port
        # The line to it.
        self.line = ControlClient(wires.context, endpoint, name=run, accepts=FROM_HOSTS)
        self._ends: dict[str, tuple[int, int]] = {}
        self._codes: dict[str, int] = {}
        self._last = time.monotonic()
        self._next_beat = 0.0
        self._lost = False

    def hello(self, nodes: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str], int]:
        """Endpoints and taps of nodes that will run there, and how far its clock is behind, ns.

        The nodes are given by name and module. Raises ValueError if the machine gives no answer.
        """
        asked = time.monotonic_ns()
        self.line.send("hello", names=list(nodes), modules=list(nodes.values()))
        if not self.line.socket.poll(int(1000 * HOST_PATIENCE)):
            raise ValueError(
                f"host {self.name} gives no answer: palpate host must run there, with the same key"
            )
        word = self.line.receive()
        answered = time.monotonic_ns()
        assert word is not None
        self._last = time.monotonic()
        return word["endpoints"], word["taps"], (asked + answered) // 2 - word["ns"]

    def spawn(self, name: str, wiring: bytes, place: bytes) -> int:
        """Have a node started; returns what wakes when it ends. ChildProcessError if it is lost."""
        if self._lost:
            raise ChildProcessError(f"{name} cannot be started: host {self.name} is lost")
        self._close(name)
        self._ends[name] = os.pipe()
        self.line.send("spawn", node=name, wiring=wiring, place=place)
        return self._ends[name][0]

    def exit_code(self, name: str) -> int:
        """Exit code of a node that has ended; negative for a signal."""
        return self._codes.get(name, 1)

    def pid(self, name: str) -> int:
        """0: the number of its process means nothing here."""
        return 0

    def kill(self, name: str) -> None:
        """Have a node killed at once."""
        self.line.send("kill", node=name)

    def receive(self, now: float) -> None:
        """Take in what the machine reports, and give a sign of life."""
        while (word := self.line.receive()) is not None:
            self._last = now
            self._take(word)
        if now >= self._next_beat:
            self._next_beat = now + HEARTBEAT
            self.line.send("alive")
        if now - self._last > HOST_LOST and not self._lost:
            self._lose()

    def end(self) -> None:
        """Have all nodes there ended, and wait for that."""
        self.line.send("end")
        deadline = time.monotonic() + GRACE + 1.0
        while not self._lost and time.monotonic() < deadline:
            if self.line.socket.poll(50):
                word = self.line.receive()
                if word is not None and word["kind"] == "closed":
                    break
        for name in list(self._ends):
            self._close(name)
        self.line.close()

    def _take(self, word: ControlMessage) -> None:
        if word["kind"] == "ended":
            self._end(str(word["node"]), int(word["code"]))
        elif word["kind"] == "spawn_failed":
            self._end(str(word["node"]), 1)
        elif word["kind"] == "closed":
            self._lose()

    def _lose(self) -> None:
        self._lost = True
        for name in self._ends:
            self._end(name, 1)

    def _end(self, name: str, code: int) -> None:
        self._codes[name] = code
        _, writing = self._ends.get(name, (-1, -1))
        if writing >= 0:
            os.close(writing)
            self._ends[name] = self._ends[name][0], -1

    def _close(self, name: str) -> None:
        for end in self._ends.pop(name, ()):
            if end >= 0:
                os.close(end)
