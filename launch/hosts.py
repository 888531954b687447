"""Other machines: their addresses, the key, nodes that run there, and the agent that lends one.

Only the key file decides who may start processes: change nothing there without reading
docs/bus.md. Nodes end with the launcher's word, or when it has been silent for a while.
"""

from __future__ import annotations

import errno
import os
import random
import re
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import msgspec
import zmq

from palpate.launch.files.source_map import InputError
from palpate.launch.processes.fork_server import Interrupts
from palpate.launch.processes.process_table import ForkServer, RemoteHost
from palpate.launch.processes.registry import private_folder
from palpate.messages.bus import TO_HOSTS, Addresses, ControlMessage, ControlServer, SocketContext
from palpate.nodes.runtime.node import Wiring

PORTS, TRIED_PORTS = range(10_000, 32_768), 1000  # Of nodes; higher ones go to who connects
PORT = 7447  # Where a machine that lends itself listens, unless the user wants another
_HOST = re.compile(r"(\d{1,3}(?:\.\d{1,3}){3}|[a-z0-9][a-z0-9.-]*)(?::(\d{1,5}))?", re.IGNORECASE)
LAUNCHER_LOST = 6.0  # A launcher that has been silent for so long is gone, s
TURN_MS = 100


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


def key_file() -> Path:
    """The user's key."""
    config = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(config).expanduser() / "palpate" / "graph.key"


def own_address(towards: str) -> str:
    """The address by which another machine reaches this one; ValueError if there is no way."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((towards, PORT))
            return str(probe.getsockname()[0])
    except OSError as error:
        raise ValueError(f"host {towards} cannot be reached: {error.strerror or error}") from None


def read_host(text: str) -> tuple[str, int]:
    """Address and port of a machine, as ``192.168.1.5`` or ``lab2:7447``.

    Raises InputError if it is no such address.
    """
    found = _HOST.fullmatch(text)
    port = int(found[2] or PORT) if found else 0
    if found is None or not 0 < port < 1 << 16:
        raise InputError(f"host {text!r} must look like 192.168.1.5 or lab2:{PORT}")
    return found[1], port


def free_endpoints(address: str, names: Iterable[str]) -> dict[str, str]:
    """An endpoint for each name, at ports of this machine that are free now.

    None of those that the system gives to whoever connects: such a one may be taken before its node
    has bound it. Raises ValueError if the address is none of this machine's, or no port is free.
    """
    endpoints, ports = {}, iter(random.sample(PORTS, TRIED_PORTS))
    with ExitStack() as held:
        for name in names:
            one = held.enter_context(socket.socket())
            endpoints[name] = f"tcp://{address}:{_bound(one, address, ports)}"
    return endpoints


def _bound(one: socket.socket, address: str, ports: Iterator[int]) -> int:
    """The first port that is free, to which the socket is bound then."""
    for port in ports:
        try:
            one.bind((address, port))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise ValueError(
                    f"{address} is no address of this machine: {error.strerror}"
                ) from None
        else:
            return port
    raise ValueError(f"{address} has no free port: {TRIED_PORTS} of {PORTS} were tried")


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
