"""Other machines: their addresses in launch files, and the processes that are started there."""

from __future__ import annotations

import os
import re
import socket
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from palpate.launch.files import InputError
from palpate.launch.processes import RemoteHost
from palpate.messages.bus import Addresses, SocketContext
from palpate.nodes.runtime import Wiring

PORT = 7447  # Where a machine that lends itself listens, unless the user says otherwise
_HOST = re.compile(r"(\d{1,3}(?:\.\d{1,3}){3}|[a-z0-9][a-z0-9.-]*)(?::(\d{1,5}))?", re.IGNORECASE)


class RemoteHosts:
    """The other machines of one graph; none is asked for if all nodes are here.

    Parameters
    ----------
    wirings : sequence of Wiring
        The nodes.
    run : str
        What the launcher is called by the other machines.

    Raises
    ------
    ValueError
        If there is no key, or a machine gives no answer.
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
    def homes(self) -> Mapping[str, RemoteHost]:
        """Name of each node that runs elsewhere, and where."""
        return {node: self._hosts[host] for host, nodes in self._nodes.items() for node in nodes}

    def reach(self, place: Addresses) -> Addresses:
        """The place with addresses that all machines can reach; as it is if all nodes are here.

        Raises
        ------
        ValueError
            If a machine gives no answer, or lends itself at an address that is not its own.
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
        here = free_endpoints(own, [f"n {name}" for name in self._here])
        taps_here = free_endpoints(own, [f"t {name}" for name in self._here])
        endpoints = {name: here[f"n {name}"] for name in self._here}
        taps = {name: taps_here[f"t {name}"] for name in self._here}
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
    """The address by which another machine reaches this one.

    Raises
    ------
    ValueError
        If there is no way to it.
    """
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((towards, PORT))
            return str(probe.getsockname()[0])
    except OSError as error:
        raise ValueError(f"host {towards} cannot be reached: {error.strerror or error}") from None


def read_host(text: str) -> tuple[str, int]:
    """Address and port of a machine, as ``192.168.1.5`` or ``lab2:7447``.

    Raises
    ------
    InputError
        If it is no such address.
    """
    found = _HOST.fullmatch(text)
    port = int(found[2] or PORT) if found else 0
    if found is None or not 0 < port < 1 << 16:
        raise InputError(f"host {text!r} must look like 192.168.1.5 or lab2:{PORT}")
    return found[1], port


def free_endpoints(address: str, names: Iterable[str]) -> dict[str, str]:
    """An endpoint for each name, at ports of this machine that are free now.

    Raises
    ------
    ValueError
        If the address is none of this machine's.
    """
    endpoints = {}
    with ExitStack() as held:
        for name in names:
            one = held.enter_context(socket.socket())
            try:
                one.bind((address, 0))
            except OSError as error:
                raise ValueError(
                    f"{address} is no address of this machine: {error.strerror}"
                ) from None
            endpoints[name] = f"tcp://{address}:{one.getsockname()[1]}"
    return endpoints
