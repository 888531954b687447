"""The other machines of one graph in the launcher, and nodes that are started there."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from palpate.launch.hosts.addresses import free_endpoints, key_file, own_address, read_host
from palpate.launch.processes.process_table import DEFAULT_HOST_SETTINGS, HostSettings
from palpate.messages.bus import FROM_HOSTS, Addresses, ControlClient, ControlMessage, SocketContext
from palpate.nodes.runtime.node import Wiring


class RemoteHosts:
    """The other machines of one graph; there are none if all nodes are here.

    `run`: name of the launcher on other machines. Raises ValueError if there is no key.
    """

    def __init__(
        self, wirings: Sequence[Wiring], run: str, settings: HostSettings = DEFAULT_HOST_SETTINGS
    ) -> None:
        names = sorted({wiring.host for wiring in wirings if wiring.host})
        self._wires = SocketContext(str(key_file())) if names else None
        self._nodes = {
            name: {node.name: node.module for node in wirings if node.host == name}
            for name in names
        }
        self._here = [wiring.name for wiring in wirings if not wiring.host]
        self._ahead_ns: dict[str, int] = {}
        self._hosts: dict[str, RemoteHost] = {}
        for name in names:
            assert self._wires is not None
            address, port = read_host(name)
            endpoint = f"tcp://{address}:{port}"
            self._hosts[name] = RemoteHost(self._wires, name, endpoint, run, settings)

    def __enter__(self) -> RemoteHosts:
        return self

    def __exit__(self, *_: object) -> None:
        if self._wires is not None:
            self._wires.destroy()

    @property
    def nodes(self) -> Mapping[str, RemoteHost]:
        """Machines of the nodes that run elsewhere, by name."""
        return {node: self._hosts[host] for host, nodes in self._nodes.items() for node in nodes}

    def reach(self, place: Addresses) -> Addresses:
        """`place` with addresses that all machines can reach; unchanged if all nodes are here.

        Raises ValueError if a machine gives no answer, or listens at an address that is not its
        own.
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
        """How far this machine's clock is ahead of that of a node's machine [ns]."""
        return self._ahead_ns.get(name, 0)


class RemoteHost:
    """The connection to the agent of another machine, which starts and ends nodes there.

    `wires`: context with the key. `name`: address and port, as in the launch file. `endpoint`: the
    same for a socket. `run`: name of the launcher there.
    """

    def __init__(
        self,
        wires: SocketContext,
        name: str,
        endpoint: str,
        run: str,
        settings: HostSettings = DEFAULT_HOST_SETTINGS,
    ) -> None:
        self.name = name  # address and port
        self._settings = settings
        self.line = ControlClient(wires.context, endpoint, name=run, accepts=FROM_HOSTS)
        self._ends: dict[str, tuple[int, int]] = {}
        self._codes: dict[str, int] = {}
        self._last = time.monotonic()
        self._next_beat = 0.0
        self._lost = False

    def hello(self, nodes: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str], int]:
        """Endpoints and taps of nodes that will run there, and how far its clock is behind [ns].

        `nodes`: modules by name. Raises ValueError if the machine gives no answer.
        """
        asked = time.monotonic_ns()
        self.line.send("hello", names=list(nodes), modules=list(nodes.values()))
        if not self.line.socket.poll(int(1000 * self._settings.answer_time)):
            raise ValueError(
                f"host {self.name} gives no answer: palpate host must run there, with the same key"
            )
        word = self.line.receive()
        answered = time.monotonic_ns()
        assert word is not None
        self._last = time.monotonic()
        return word["endpoints"], word["taps"], (asked + answered) // 2 - word["ns"]

    def spawn(self, name: str, wiring: bytes, place: bytes) -> int:
        """Start a node; returns its sentinel. Raises ChildProcessError if the machine is lost."""
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
        """0: its process is on another machine."""
        return 0

    def kill(self, name: str) -> None:
        """Kill a node at once."""
        self.line.send("kill", node=name)

    def receive(self, now: float) -> None:
        """Take the reports of the machine, and send signs of life."""
        while (word := self.line.receive()) is not None:
            self._last = now
            self._take(word)
        if now >= self._next_beat:
            self._next_beat = now + self._settings.heartbeat_period
            self.line.send("alive")
        if now - self._last > self._settings.silence_limit and not self._lost:
            self._lose()

    def end(self) -> None:
        """End all nodes there, and wait for that."""
        self.line.send("end")
        deadline = time.monotonic() + self._settings.exit_time + 1.0
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
