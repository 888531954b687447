"""What a node does when it is started again: it replays its journal, and goes on.

It receives everything once more from its publishers, but in whatever order they answer; the
journal says in which order it had handled them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from palpate.messages.bus import Consumed, NodeSockets, Received
from palpate.nodes.runtime.node import Finished
from palpate.nodes.runtime.work import NodeWork, Outgoing, Promise

OutgoingSequence = Sequence[Outgoing | Promise | Finished]
Publish = Callable[[Iterable[Outgoing | Promise | Finished]], None]


def replay(
    work: NodeWork,  # The node
    before: Sequence[Consumed],  # What it had handled
    station: NodeSockets,  # Its sockets
    *,
    publish: Publish,  # Sends what it publishes
    turn: Callable[[], bool],  # Waits for a moment, obeys the launcher, and says whether to go on
    beat: Callable[[], None],  # Gives a sign of life
) -> OutgoingSequence:
    """Do once more what an earlier start of the node has done, unheard but by who lacks it.

    Returns
    -------
    sequence
        What it died over: it may have been making something that takes long, which is still to be
        made and sent, with all that it published after that.
    """
    order, owed = JournalOrder(before), list[Outgoing | Promise | Finished]()
    while order.replaying and turn():
        while (come := station.receive()) is not None:
            order.put(come)
        while order.replaying and (arrival := order.take()) is not None:
            owed = _republish(work.replay(arrival), station, publish)
            beat()
    station.give_back(order.rest())
    return owed


def _republish(
    published: OutgoingSequence, station: NodeSockets, publish: Publish
) -> list[Outgoing | Promise | Finished]:
    """Publish it once more; returns what takes long and had not been, and all after it."""
    for place, one in enumerate(published):
        if isinstance(one, Promise) and not station.publisher.was_published(one.topic):
            return list(published[place:])
        publish([one])
    return []


def unpublished(
    published: Iterable[Outgoing | Finished],  # What a node publishes at its start
    counts: Mapping[str, int],  # Messages that it had published on each topic
) -> Iterator[Outgoing | Finished]:
    """What of it an earlier start had not come to publish."""
    had = dict(counts)
    for one in published:
        if isinstance(one, Outgoing) and had[one.topic]:
            had[one.topic] -= 1
        else:
            yield one


class JournalOrder:
    """Puts arrivals into the order of a journal."""

    def __init__(
        self,
        before: Sequence[Consumed],  # What earlier starts of the node have consumed
    ) -> None:
        self._before = deque(before)
        self._come: dict[tuple[str, str], deque[Received]] = {}

    @property
    def replaying(self) -> bool:
        """Whether something is still to be handled that had been handled before."""
        return bool(self._before)

    def put(self, arrival: Received) -> None:
        """Take note of what has arrived."""
        self._come.setdefault((arrival.publisher, arrival.topic), deque()).append(arrival)

    def take(self) -> Received | None:
        """What was handled next, if it has come.

        Raises ValueError if a publisher sends something else than it had sent before.
        """
        wanted = self._before[0]
        come = self._come.get((wanted.publisher, wanted.topic))
        if not come:
            return None
        arrival = come.popleft()
        if arrival.header.seq != wanted.seq:
            raise ValueError(
                f"{wanted.topic} {wanted.seq} of {wanted.publisher} must come next, as before; "
                f"got {arrival.header.seq}"
            )
        self._before.popleft()
        return arrival

    def rest(self) -> list[Received]:
        """What has come beyond the journal: each publisher's in its order."""
        return [arrival for come in self._come.values() for arrival in come]
