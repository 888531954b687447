"""Where each node of a graph is born: on this machine, or on another one."""

from __future__ import annotations

import time
from collections.abc import Mapping

from palpate.launch.hosts.host import Host
from palpate.launch.processes.nursery import Nursery


class Homes:
    """The nursery of this machine, and the hosts of those that are elsewhere.

    Parameters
    ----------
    nursery : Nursery
        Of this machine.
    away : mapping of str to Host
        Name of each node that runs elsewhere, and where.
    """

    def __init__(self, nursery: Nursery, away: Mapping[str, Host]) -> None:
        self._nursery, self._away = nursery, away
        self.hosts = list({host.name: host for host in away.values()}.values())
        """The other machines."""

    def bear(self, name: str, wiring: bytes, place: bytes) -> int:
        """Start the process of a node, and return its sentinel.

        Raises
        ------
        ChildProcessError
            If it cannot be started.
        """
        return (self._away.get(name) or self._nursery).bear(name, wiring, place)

    def exit_code(self, name: str) -> int:
        """Exit code of a process that has ended; negative for a signal."""
        return (self._away.get(name) or self._nursery).exit_code(name)

    def kill(self, name: str) -> None:
        """Kill a process at once."""
        (self._away.get(name) or self._nursery).kill(name)

    def pid(self, name: str) -> int:
        """Number of a node's process; 0 if it runs elsewhere."""
        return 0 if name in self._away else self._nursery.pid(name)

    def hear(self) -> None:
        """Take in what other machines say."""
        now = time.monotonic()
        for host in self.hosts:
            host.hear(now)

    def end(self) -> None:
        """End all processes."""
        for host in self.hosts:
            host.end()
        self._nursery.end()
