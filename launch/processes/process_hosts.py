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
# How often each side gives a sign of life, and after how long without one the other is lost, s.
HEARTBEAT, HOST_LOST = 0.5, 6.0


class ProcessHosts:
    """The nursery of this machine, and the hosts of those that are elsewhere.

    Parameters
    ----------
    nursery : Nursery
        Of this machine.
    away : mapping of str to Host
        Name of each node that runs elsewhere, and where.
    """

    def __init__(self, nursery: ForkServer, away: Mapping[str, RemoteHost]) -> None:
        self._nursery, self._away = nursery, away
        self.hosts = list({host.name: host for host in away.values()}.values())
        """The other machines."""

    def spawn(self, name: str, wiring: bytes, place: bytes) -> int:
        """Start the process of a node, and return its sentinel.

        Raises
        ------
        ChildProcessError
            If it cannot be started.
        """
        return (self._away.get(name) or self._nursery).spawn(name, wiring, place)

    def exit_code(self, name: str) -> int:
        """Exit code of a process that has ended; negative for a signal."""
        return (self._away.get(name) or self._nursery).exit_code(name)

    def kill(self, name: str) -> None:
        """Kill a process at once."""
        (self._away.get(name) or self._nursery).kill(name)

    def pid(self, name: str) -> int:
        """Number of a node's process; 0 if it runs elsewhere."""
        return 0 if name in self._away else self._nursery.pid(name)

    def receive(self) -> None:
        """Take in what other machines say."""
        now = time.monotonic()
        for host in self.hosts:
            host.receive(now)

    def end(self) -> None:
        """End all processes."""
        for host in self.hosts:
            host.end()
        self._nursery.end()


class ForkServer:
    """The processes of one graph; none of them is left when its ``with`` block ends.

    Parameters
    ----------
    modules : iterable of str
        Modules of the nodes that will be born.
    """

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

        Raises
        ------
        ChildProcessError
            If the process cannot be started.
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
    """The line to one machine that lends itself; nodes are born and die there.

    Parameters
    ----------
    wires : Wires
        Locked with the key.
    name : str
        Address and port, as the launch file has it.
    endpoint : str
        The same for a socket.
    run : str
        What the launcher is called there.
    """

    def __init__(self, wires: SocketContext, name: str, endpoint: str, run: str) -> None:
        self.name = name
        """Address and port."""
        self.line = ControlClient(wires.context, endpoint, name=run, accepts=FROM_HOSTS)
        """The line to it."""
        self._ends: dict[str, tuple[int, int]] = {}
        self._codes: dict[str, int] = {}
        self._heard = time.monotonic()
        self._next_beat = 0.0
        self._lost = False

    def hello(self, nodes: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str], int]:
        """Endpoints and taps of the nodes that will run there, and how far its clock is behind, ns.

        Parameters
        ----------
        nodes : mapping of str to str
            Their names and modules.

        Raises
        ------
        ValueError
            If it gives no answer.
        """
        asked = time.monotonic_ns()
        self.line.send("hello", names=list(nodes), modules=list(nodes.values()))
        if not self.line.socket.poll(int(1000 * HOST_PATIENCE)):
            raise ValueError(
                f"host {self.name} gives no answer: palpate host must run there, with the same key"
            )
        word = self.line.receive()
        heard = time.monotonic_ns()
        assert word is not None
        self._heard = time.monotonic()
        return word["endpoints"], word["taps"], (asked + heard) // 2 - word["ns"]

    def spawn(self, name: str, wiring: bytes, place: bytes) -> int:
        """Have a node started; returns what wakes when it ends.

        Raises
        ------
        ChildProcessError
            If the machine is lost.
        """
        if self._lost:
            raise ChildProcessError(f"{name} cannot be started: host {self.name} is lost")
        self._close(name)
        self._ends[name] = os.pipe()
        self.line.send("spawn", node=name, wiring=wiring, place=place)
        return self._ends[name][0]

    def exit_code(self, name: str) -> int:
        """Exit code of a node that has ended; negative for a signal."""
        return self._codes.get(name, 1)

    def kill(self, name: str) -> None:
        """Have a node killed at once."""
        self.line.send("kill", node=name)

    def receive(self, now: float) -> None:
        """Take in what the machine says, and give a sign of life."""
        while (word := self.line.receive()) is not None:
            self._heard = now
            self._take(word)
        if now >= self._next_beat:
            self._next_beat = now + HEARTBEAT
            self.line.send("alive")
        if now - self._heard > HOST_LOST and not self._lost:
            self._lost = True
            for name in self._ends:
                self._end(name, 1)

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
