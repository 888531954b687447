"""The launcher's side: the machines of one graph, and nodes that are started there."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from palpate.launch.hosts.addresses import free_endpoints, key_file, own_address, read_host
from palpate.launch.processes.process_table import GRACE, HEARTBEAT, HOST_LOST
from palpate.messages.bus import FROM_HOSTS, Addresses, ControlClient, ControlMessage, SocketContext
from palpate.nodes.runtime.node import Wiring

HOST_PATIENCE = 10.0  # A machine has this long for its first answer, s


class RemoteHosts:
    """The other machines of one graph; none is asked for if all nodes are here.

    `run` is what the launcher is called there. Raises ValueError if there is no key.
    """

    def __init__(self, wirings: Sequence[Wiring], run: str) -> None:
        names = sorted({one.host for one in wirings if one.host})
        self._wires = SocketContext(str(key_file())) if names else None
        self._nodes = {
            name: {one.name: one.module for one in wirings if one.host == name} for name in names
        }
        self._here = [one.name for one in wirings if not one.host]
        self._ahead_ns: dict[str, int] = {}
        self._hosts: dict[str, RemoteHost] = {}
        for name in names:
            assert self._wires is not None
            address, port = read_host(name)
            self._hosts[name] = RemoteHost(self._wires, name, f"tcp://{address}:{port}", run)

    def __enter__(self) -> RemoteHosts:
        return self

    def __exit__(self, *_: object) -> None:
        if self._wires is not None:
            self._wires.destroy()

    @property
    def nodes(self) -> Mapping[str, RemoteHost]:
        """Name of each node that runs elsewhere, and where."""
        return {node: self._hosts[host] for host, nodes in self._nodes.items() for node in nodes}

    def reach(self, place: Addresses) -> Addresses:
        """The place with addresses that all machines can reach; as it is if all nodes are here.

        Raises ValueError if a machine gives no answer, or lends itself at an address not its own.
        """
        if not self._hosts:
            return place
        owns = {own_address(read_host(name)[0]) for name in self._hosts}
        if len(owns) > 1:
            raise ValueError(
                f"hosts {', '.join(self._hosts)} reach this machine at different addresses, "
                f"{', '.join(sorted(owns))}; they could not reach each other"
            )
        (own,) = owns
        endpoints, taps = (free_endpoints(own, self._here) for _ in range(2))
        for name, host in self._hosts.items():
            there, its_taps, ahead_ns = host.hello(self._nodes[name])
            endpoints |= there
            taps |= its_taps
            self._ahead_ns |= dict.fromkeys(self._nodes[name], ahead_ns)
        desk = free_endpoints(own, ("control", "tools"))
        return replace(
            place,
            endpoints=endpoints,
            taps=taps,
            control=desk["control"],
            tools=desk["tools"],
            key=str(key_file()),
        )

    def ahead_ns(self, name: str) -> int:
        """How far this machine's clock is ahead of that of a node's machine, ns."""
        return self._ahead_ns.get(name, 0)


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
        if word["kind"] in ("ended", "spawn_failed"):
            self._end(str(word["node"]), int(word.get("code", 1)))
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
