"""The other machines of one graph, and its addresses there: all of them tcp, and encrypted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from palpate.launch.hosts.addresses import free_endpoints, key_file, own_address, read_host
from palpate.launch.processes import RemoteHost
from palpate.messages.bus import Addresses, SocketContext
from palpate.nodes.runtime import Wiring


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
