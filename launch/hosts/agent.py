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
from palpate.launch.processes.process_table import DEFAULT_HOST_SETTINGS, ForkServer, HostSettings
from palpate.launch.processes.registry import private_folder
from palpate.messages.bus import TO_HOSTS, Addresses, ControlMessage, ControlServer, SocketContext


class HostedRun:
    """The nodes of one launcher on this machine.

    `word`: the launcher's greeting, with names and modules of the nodes. `now`: monotonic time [s].
    `key`: file of the key.
    """

    def __init__(self, address: str, key: str, word: ControlMessage, now: float) -> None:
        self.last = now  # monotonic time of its last word [s]
        self.sentinels: dict[int, str] = {}  # running nodes by the sentinels of their processes
        self._address, self._key = address, key
        self._kept = ExitStack()
        self._folder = self._kept.enter_context(private_folder(None))
        modules = [str(name) for name in word["modules"]]
        self._server = self._kept.enter_context(ForkServer(modules))
        self._names = [str(name) for name in word["names"]]

    def hello(self) -> ControlMessage:
        """Endpoints of the nodes that will run here, and this machine's clock."""
        return {
            "kind": "hello",
            "ns": time.monotonic_ns(),
            "endpoints": free_endpoints(self._address, self._names),
            "taps": free_endpoints(self._address, self._names),
        }

    def spawn(self, word: ControlMessage) -> ControlMessage | None:
        """Start a node with files of this machine; returns an answer if it cannot be started."""
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
        """The answer for a node that has ended."""
        name = self.sentinels.pop(sentinel)
        return {"kind": "ended", "node": name, "code": self._server.exit_code(name)}

    def close(self) -> None:
        """End all its nodes, and remove its files."""
        self._kept.close()


def run_host_agent(address: str, port: int, key: Path, echo: Callable[[str], None]) -> None:
    """Run nodes for launchers with the key in a file until Ctrl-C; `echo` prints a line.

    Raises ValueError if the key cannot be used, or the address is taken or not one of this machine.
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
    """The runs that other launchers have on this machine.

    The nodes of a launcher that is silent for longer than `silence_limit` [s] are ended.
    """

    def __init__(
        self,
        line: ControlServer,
        address: str,
        key: str,
        echo: Callable[[str], None],
        settings: HostSettings = DEFAULT_HOST_SETTINGS,
    ) -> None:
        self._line, self._address, self._key, self._echo = line, address, key, echo
        self._silence_limit = settings.silence_limit
        self._guests: dict[str, HostedRun] = {}

    def turn(self, timeout_ms: int = 100) -> None:
        """Wait for words of launchers or the end of nodes, and handle them."""
        poller = zmq.Poller()
        poller.register(self._line.socket, zmq.POLLIN)
        for guest in self._guests.values():
            for sentinel in guest.sentinels:
                poller.register(sentinel, zmq.POLLIN)
        ended = {who for who, _ in poller.poll(timeout_ms) if isinstance(who, int)}
        for name, guest in self._guests.items():
            for sentinel in ended & set(guest.sentinels):
                self._line.send(name, **guest.bury(sentinel))
        while self._receive():
            pass
        for name, guest in list(self._guests.items()):
            if time.monotonic() - guest.last > self._silence_limit:
                self._dismiss(name, "is gone; its nodes are ended")

    def close(self) -> None:
        """End all nodes."""
        for name in list(self._guests):
            self._dismiss(name, "was ended: this machine no longer runs nodes")

    def _receive(self) -> bool:
        """Handle one word; errors in it are printed. Returns False if no word came."""
        try:
            received = self._line.receive()
            if received is None:
                return False
            self._handle(*received)
        except (ValueError, msgspec.MsgspecError) as error:
            self._echo(f"a launcher of another version, or none: {error}")
        return True

    def _handle(self, name: str, word: ControlMessage) -> None:
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
                self._dismiss(name, "has ended")

    def _dismiss(self, name: str, why: str) -> None:
        self._guests.pop(name).close()
        self._line.send(name, "closed")
        self._echo(f"{name} {why}")
