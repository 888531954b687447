"""Hearing a running graph by its taps: copies that may be lost, but never hold anybody up."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import zmq

from palpate.launch.looking.topics import OWN, Topic, taps_of
from palpate.launch.processes.interrupts import until_ctrl_c
from palpate.launch.processes.register import Card, running
from palpate.messages.bus.tap import TapReader
from palpate.messages.bus.wires import Wires
from palpate.messages.header import Header

DEPTH = 1000
"""Most copies that wait for the tool, of each node."""
TICK = 0.1
"""A tool gets to do something else this often, s."""
LOOK = 0.5
"""Whether the graph still runs is looked at this often, s."""
_BATCH = 256
"""Most copies that are taken from one node before it is another's turn."""


class Heard(NamedTuple):
    """One copy of a message."""

    topic: str
    publisher: str
    """Name of the node that sent it."""
    header: Header
    body: bytes
    lost: int
    """Messages of this publisher and topic that were sent since the last copy, and not heard."""
    came_ns: int
    """Monotonic clock when the tool took it, ns."""


class Order:
    """The order of one publisher's messages on one topic, of which some are missing.

    Parameters
    ----------
    anew : bool
        Whether a publisher that is started again counts from 0 once more. Otherwise it goes on
        counting, after it has said again what it had said: that is no news.
    """

    def __init__(self, *, anew: bool) -> None:
        self._anew = anew
        self._epoch, self._seq = -1, -1

    def place(self, header: Header) -> int | None:
        """How many messages are missing before this one; None if it is no news."""
        if header.epoch < self._epoch:
            return None
        if self._seq < 0 or (self._anew and header.epoch > self._epoch):
            self._seq = header.seq - 1
        self._epoch = header.epoch
        if header.seq <= self._seq:
            return None
        missing, self._seq = header.seq - self._seq - 1, header.seq
        return missing


class Hearing:
    """Open ears at the taps of a running graph.

    Parameters
    ----------
    card : Card
        The running graph.
    topics : iterable of Topic
        What to hear.
    """

    def __init__(self, card: Card, topics: Iterable[Topic]) -> None:
        self._card = card
        self._run = int(card.run, 16)
        self._wires = Wires(card.key)
        self._kept = ExitStack()
        self._ends: Callable[[], bool] = lambda: False
        self._poller = zmq.Poller()
        self._readers: dict[zmq.Socket[bytes], tuple[str, TapReader]] = {}
        self._orders: dict[tuple[str, str], Order] = {}
        for node, names in taps_of(card, topics).items():
            reader = TapReader(self._wires.context, [card.taps[node]], names, DEPTH)
            self._readers[reader.socket] = node, reader
            self._poller.register(reader.socket, zmq.POLLIN)
            for name in names:
                self._orders[node, name] = Order(anew=name in OWN)

    def __enter__(self) -> Hearing:
        self._ends = self._kept.enter_context(until_ctrl_c())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._kept.close()
        for _, reader in self._readers.values():
            reader.close()
        self._wires.close()

    def batches(self, duration: float | None = None) -> Iterator[list[Heard]]:
        """What has come, some ten times a second or as it comes; ends with the graph, or Ctrl-C.

        Parameters
        ----------
        duration : float, optional
            Ends after this long, s.

        Raises
        ------
        ValueError
            If what arrives is not a frame.
        """
        now = time.monotonic()
        until = None if duration is None else now + duration
        look = now + LOOK
        while (until is None or now < until) and not self._ends():
            left = TICK if until is None else min(TICK, until - now)
            yield self.take(left)
            now = time.monotonic()
            if now >= look:
                look = now + LOOK
                if not still_runs(self._card):
                    yield from iter(lambda: self.take(0.0), [])
                    return

    def take(self, patience: float) -> list[Heard]:
        """What has come by now, or comes within the patience, s; no more than some of it."""
        heard = []
        for socket, _ in self._poller.poll(round(patience * 1000)):
            node, reader = self._readers[socket]
            for _ in range(_BATCH):
                frame = reader.receive()
                if frame is None:
                    break
                one = self._place(node, *frame)
                if one is not None:
                    heard.append(one)
        return heard

    def _place(self, node: str, topic: str, header: Header, body: bytes) -> Heard | None:
        order = self._orders.get((node, topic))
        if order is None or header.run != self._run:
            return None
        lost = order.place(header)
        if lost is None:
            return None
        return Heard(topic, node, header, body, lost, time.monotonic_ns())


def still_runs(card: Card) -> bool:
    """Whether a graph still runs; on one machine its sockets lie where its card does."""
    local = card.tools.startswith("ipc://")
    home = Path(card.tools.removeprefix("ipc://")).parent.parent if local else None
    return any(one.run == card.run for one in running(home))
