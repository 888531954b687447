"""Repetition of the work of an earlier start of a node."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from palpate.messages import bus
from palpate.nodes.runtime.node import Finished
from palpate.nodes.runtime.work import Outgoing


def unpublished(
    published: Iterable[Outgoing | Finished], counts: Mapping[str, int]
) -> Iterator[Outgoing | Finished]:
    """First outputs of a node without those that an earlier start published, `counts` by topic."""
    left = dict(counts)
    for output in published:
        if isinstance(output, Outgoing) and left[output.topic]:
            left[output.topic] -= 1
        else:
            yield output


class JournalOrder:
    """Puts messages into the order in which earlier starts of the node consumed them."""

    def __init__(self, before: Sequence[bus.Consumed]) -> None:
        self._before = deque(before)
        self._arrived: dict[tuple[str, str], deque[bus.Received]] = {}

    @property
    def replaying(self) -> bool:
        """Whether messages of the journal are still to be handled."""
        return bool(self._before)

    def put(self, arrival: bus.Received) -> None:
        """Add a message that has arrived."""
        self._arrived.setdefault((arrival.publisher, arrival.topic), deque()).append(arrival)

    def take(self) -> bus.Received | None:
        """The next message of the journal, if it has arrived; ValueError if it is another one."""
        consumed = self._before[0]
        arrived = self._arrived.get((consumed.publisher, consumed.topic))
        if not arrived:
            return None
        arrival = arrived.popleft()
        if arrival.header.seq != consumed.seq:
            raise ValueError(
                f"{consumed.topic} {consumed.seq} of {consumed.publisher} must come next, as "
                f"before; got {arrival.header.seq}"
            )
        self._before.popleft()
        return arrival

    def rest(self) -> list[bus.Received]:
        """Messages after the journal, of each publisher in their order."""
        return [arrival for arrived in self._arrived.values() for arrival in arrived]


class OutsideMessages:
    """Messages that tools request of a node, which keep their numbers after its death.

    Raises OSError if its file, beside the journal, cannot be read or written.
    """

    def __init__(self, journal: Path) -> None:
        self._log = bus.ParameterLog(journal, "o")
        messages = [msgspec.json.decode(x, type=bus.OutsideMessage) for x in self._log.before]
        self._earlier = {(message.topic, message.seq): message for message in messages}

    @property
    def left(self) -> bool:
        """Whether messages of an earlier start are still to be published again."""
        return bool(self._earlier)

    def note(self, parcel: Outgoing, seq: int) -> None:
        """Write a message before it is published, with its number on the topic."""
        message = bus.OutsideMessage(parcel.topic, seq, parcel.body, parcel.schema)
        self._log.note(msgspec.json.encode(message))

    def due(self, count: Callable[[str], int]) -> Iterator[Outgoing]:
        """Messages that are next on their topics; `count` returns numbers of published messages."""
        for topic in dict.fromkeys(topic for topic, _ in self._earlier):
            while (message := self._earlier.pop((topic, count(topic)), None)) is not None:
                yield Outgoing(topic, message.body, 0.0, message.schema, outside=True)

    def close(self) -> None:
        """Close the file."""
        self._log.close()
