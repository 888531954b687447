"""The processes of a graph while it runs: born, watched for hanging, and started again."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import msgspec

from palpate.launch.hosts.homes import Homes
from palpate.launch.processes.desk import Desk
from palpate.launch.processes.nursery import how_it_ended
from palpate.launch.processes.pulse import Pulse, busy
from palpate.launch.processes.restarts import Restarts
from palpate.messages.bus.place import Place
from palpate.nodes.wiring import Wiring


class Ward:
    """The processes of one graph.

    Parameters
    ----------
    wirings : sequence of Wiring
        The nodes.
    place : Place
        The addresses of the run.
    homes, desk
        Where processes are born, and what wakes when they end.
    ahead_ns : function
        How far this machine's clock is ahead of that of a node's machine, ns.
    """

    def __init__(
        self,
        wirings: Sequence[Wiring],
        place: Place,
        homes: Homes,
        desk: Desk,
        ahead_ns: Callable[[str], int],
    ) -> None:
        self.wirings = {wiring.name: wiring for wiring in wirings}
        """The nodes by name."""
        self.restarts = Restarts({one.name: one.on_exit for one in wirings})
        """What has died so far."""
        self._place, self._homes, self._desk = place, homes, desk
        self._ahead_ns = ahead_ns
        self._pulse = Pulse({one.name: one.longest for one in wirings})
        self._hung: dict[str, float] = {}
        self._living: dict[int, str] = {}

    @property
    def living(self) -> list[str]:
        """Names of the nodes whose processes have not ended."""
        return list(self._living.values())

    def pid(self, name: str) -> int:
        """Number of the process of a node."""
        return self._homes.pid(name)

    def bear(self, name: str, *, going: bool = False) -> None:
        """Start the process of a node, again if the graph is going.

        Raises
        ------
        ChildProcessError
            If it cannot be started.
        """
        epoch, ahead_ns = self.restarts.counts[name], self._ahead_ns(name)
        place = replace(self._place, epoch=epoch, going=going, ahead_ns=ahead_ns)
        packed = msgspec.msgpack.encode(place)
        sentinel = self._homes.bear(name, _sealed(self.wirings[name]), packed)
        self._living[sentinel] = name
        self._pulse.begin(name, time.monotonic())
        self._desk.watch(sentinel)

    def bury(self, sentinel: int) -> tuple[str, int]:
        """Name and exit code of the node whose process has ended."""
        self._desk.unwatch(sentinel)
        name = self._living.pop(sentinel)
        self._pulse.forget(name)
        return name, self._homes.exit_code(name)

    def how_it_died(self, name: str, code: int, failed: str | None) -> str:
        """How a node died, as the rest of a sentence; what it said it failed of, if it did."""
        silence = self._hung.pop(name, None)
        if silence is not None:
            return f"hung: it gave no sign of life for {silence:.1f} s"
        return how_it_ended(code) if failed is None else f"failed while {failed}"

    def sign(self, name: str, kind: str) -> None:
        """A node has said a word of a kind to the launcher."""
        if kind in ("bye", "failed"):
            self._pulse.forget(name)
        elif name in self.living:
            does = busy(self._homes.pid(name))
            self._pulse.sign(name, time.monotonic(), 0.0 if does is None else does.used)

    def let_begin(self) -> None:
        """All nodes begin: that may take its time, and signs of life count from the next on."""
        for name in self.living:
            self._pulse.begin(name, time.monotonic())

    def see_to_hung(self, now: float) -> None:
        """Kill what hangs: it is then buried as others are."""
        pids = {name: self._homes.pid(name) for name in self.living}
        for name, silence in self._pulse.hung(now, pids).items():
            self._hung[name] = silence
            self._pulse.forget(name)
            self._homes.kill(name)


def _sealed(wiring: Wiring) -> bytes:
    """A wiring in bytes, its parameters once more so: only the node knows their type."""
    return msgspec.msgpack.encode(replace(wiring, params=msgspec.msgpack.encode(wiring.params)))
