"""The agent that lends this machine to graphs that are launched elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import msgspec
import zmq

from palpate.launch.hosts.addresses import free_endpoints
from palpate.launch.processes.fork_server import Interrupts
from palpate.launch.processes.process_table import ForkServer
from palpate.launch.processes.registry import private_folder
from palpate.messages.bus import TO_HOSTS, Addresses, ControlMessage, ControlServer, SocketContext

LAUNCHER_LOST = 6.0  # A launcher that has been silent for so long is gone, s
TURN_MS = 100


class HostedRun:
    """One launcher's nodes on this machine, whose greeting names them and their modules.

    `now` is monotonic time, s; `key` is the file of the key.
    """

    def __init__(self, address: str, key: str, word: ControlMessage, now: float) -> None:
        self.last = now  # Monotonic time of its last word, s
        self.sentinels: dict[int, str] = {}  # Nodes that run, by what wakes when they end
        self._address, self._key = address, key
        self._kept = ExitStack()
        self._folder = self._kept.enter_context(private_folder(None))
        modules = [str(name) for name in word["modules"]]
        self._server = self._kept.enter_context(ForkServer(modules))
        self._names = [str(name) for name in word["names"]]

    def hello(self) -> ControlMessage:
        """Where the nodes that are to run here will be found, and this machine's clock."""
        return {
            "kind": "hello",
            "ns": time.monotonic_ns(),
            "endpoints": free_endpoints(self._address, self._names),
            "taps": free_endpoints(self._address, self._names),
        }

    def spawn(self, word: ControlMessage) -> ControlMessage | None:
        """Start a node; its files are this machine's. An answer tells that it cannot be."""
        name = str(word["node"])
        place = msgspec.msgpack.decode(word["place"], type=Addresses)
        number = self._names.index(name)
        own = replace(
            place,
            key=self._key,
            journals={name: str(self._folder / f"j{number}")},
            times={name: str(self._folder / f"s{number}")},
            pasts={name: str(self._folder / f"p{number}")},
        )
        try:
            packed = msgspec.msgpack.encode(own)
            self.sentinels[self._server.spawn(name, word["wiring"], packed)] = name
        except ChildProcessError as error:
            return {"kind": "spawn_failed", "node": name, "text": str(error)}
        return None

    def kill(self, word: ControlMessage) -> None:
        """Kill a node."""
        if word["node"] in self.sentinels.values():
            self._server.kill(str(word["node"]))

    def bury(self, sentinel: int) -> ControlMessage:
        """A node has ended."""
        name = self.sentinels.pop(sentinel)
        return {"kind": "ended", "node": name, "code": self._server.exit_code(name)}

    def close(self) -> None:
        """End all its nodes, and leave nothing behind."""
        self._kept.close()


def run_host_agent(address: str, port: int, key: Path, echo: Callable[[str], None]) -> None:
    """Lend this machine until Ctrl-C to whoever has the key in a file; `echo` prints a line.

    Raises ValueError if the key cannot be used, or the address is taken or not this machine's.
    """
    wires = SocketContext(str(key))
    try:
        line = ControlServer(wires.context, f"tcp://{address}:{port}", accepts=TO_HOSTS)
    except zmq.ZMQError as error:
        wires.destroy()
        raise ValueError(f"{address}:{port} cannot be listened at: {error}") from None
    echo(f"{address}:{port} runs nodes for whoever has {key}; Ctrl-C ends it")
    agent = HostAgent(line, address, str(key), echo)
    try:
        with Interrupts() as interrupts:
            while not interrupts.came:
                agent.turn()
    finally:
        agent.close()
        line.close()
        wires.close()


class HostAgent:
    """The guests of one machine, whose launchers speak on a line."""

    def __init__(
        self, line: ControlServer, address: str, key: str, echo: Callable[[str], None]
    ) -> None:
        self._line, self._address, self._key, self._echo = line, address, key, echo
        self._guests: dict[str, HostedRun] = {}

    def turn(self) -> None:
        """Wait for something to happen, and see to it."""
        poller = zmq.Poller()
        poller.register(self._line.socket, zmq.POLLIN)
        for guest in self._guests.values():
            for sentinel in guest.sentinels:
                poller.register(sentinel, zmq.POLLIN)
        ended = {who for who, _ in poller.poll(TURN_MS) if isinstance(who, int)}
        for name, guest in self._guests.items():
            for sentinel in ended & set(guest.sentinels):
                self._line.send(name, **guest.bury(sentinel))
        while self._receive():
            pass
        for name, guest in list(self._guests.items()):
            if time.monotonic() - guest.last > LAUNCHER_LOST:
                self._part(name, "is gone; its nodes are ended")

    def close(self) -> None:
        """End everybody's nodes."""
        for name in list(self._guests):
            self._part(name, "told to end")

    def _receive(self) -> bool:
        """Take one word; what cannot be done is told, and hurts nobody else. False if none came."""
        try:
            received = self._line.receive()
            if received is None:
                return False
            self._obey(*received)
        except (ValueError, msgspec.MsgspecError) as error:
            self._echo(f"a launcher of another version, or none: {error}")
        return True

    def _obey(self, name: str, word: ControlMessage) -> None:
        now = time.monotonic()
        if word["kind"] == "hello":
            if name not in self._guests:
                self._guests[name] = HostedRun(self._address, self._key, word, now)
            self._echo(f"{name}: {', '.join(word['names'])}")
            self._line.send(name, **self._guests[name].hello())
        guest = self._guests.get(name)
        if guest is None:
            return
        guest.last = now
        match word["kind"]:
            case "spawn":
                if (failure := guest.spawn(word)) is not None:
                    self._line.send(name, **failure)
            case "kill":
                guest.kill(word)
            case "alive":
                self._line.send(name, "alive")
            case "end":
                self._part(name, "has ended")

    def _part(self, name: str, why: str) -> None:
        self._guests.pop(name).close()
        self._line.send(name, "closed")
        self._echo(f"{name} {why}")
