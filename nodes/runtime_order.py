"""The order in which a node was handed its messages before it was killed.

A node that starts again hears everything once more from its publishers, but in whatever order
they answer. Its journal says in which order it had handled them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from palpate.messages.bus.journal import Consumed
from palpate.messages.bus.subscriber import Arrival


class Order:
    """Puts arrivals into the order of a journal.

    Parameters
    ----------
    before : sequence of Consumed
        What earlier starts of the node have consumed.
    """

    def __init__(self, before: Sequence[Consumed]) -> None:
        self._before = deque(before)
        self._come: dict[tuple[str, str], deque[Arrival]] = {}

    @property
    def rehearsing(self) -> bool:
        """Whether something is still to be handled that had been handled before."""
        return bool(self._before)

    def put(self, arrival: Arrival) -> None:
        """Take note of what has arrived."""
        self._come.setdefault((arrival.publisher, arrival.topic), deque()).append(arrival)

    def take(self) -> Arrival | None:
        """What was handled next, if it has come.

        Raises
        ------
        ValueError
            If a publisher sends something else than it had sent before.
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

    def rest(self) -> list[Arrival]:
        """What has come beyond the journal: each publisher's in its order."""
        return [arrival for come in self._come.values() for arrival in come]
