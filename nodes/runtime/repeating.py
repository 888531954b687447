"""What an earlier start of a node has done, and is gone through once more."""

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
    """What of a node's first outputs an earlier start, which published so many, did not come to."""
    had = dict(counts)
    for one in published:
        if isinstance(one, Outgoing) and had[one.topic]:
            had[one.topic] -= 1
        else:
            yield one


class JournalOrder:
    """Puts arrivals into the order in which earlier starts of the node have consumed them."""

    def __init__(self, before: Sequence[bus.Consumed]) -> None:
        self._before = deque(before)
        self._come: dict[tuple[str, str], deque[bus.Received]] = {}

    @property
    def replaying(self) -> bool:
        """Whether something is still to be handled that had been handled before."""
        return bool(self._before)

    def put(self, arrival: bus.Received) -> None:
        """Take note of what has arrived."""
        self._come.setdefault((arrival.publisher, arrival.topic), deque()).append(arrival)

    def take(self) -> bus.Received | None:
        """What was handled next, if it has come; ValueError if it is not what was sent before."""
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

    def rest(self) -> list[bus.Received]:
        """What has come beyond the journal: each publisher's in its order."""
        return [arrival for come in self._come.values() for arrival in come]


class OutsideMessages:
    """What tools have a node publish, beyond its death: each has its number on its topic again.

    Raises OSError if its file, beside the journal, cannot be read or written.
    """

    def __init__(self, journal: Path) -> None:
        self._log = bus.ParameterLog(journal, "o")
        had = [msgspec.json.decode(one, type=bus.OutsideMessage) for one in self._log.before]
        self._had = {(one.topic, one.seq): one for one in had}

    @property
    def left(self) -> bool:
        """Whether an earlier start had published something that has not been again."""
        return bool(self._had)

    def note(self, parcel: Outgoing, seq: int) -> None:
        """Put down what is about to be published, with its number on the topic."""
        message = bus.OutsideMessage(parcel.topic, seq, parcel.body, parcel.schema)
        self._log.note(msgspec.json.encode(message))

    def due(self, count: Callable[[str], int]) -> Iterator[Outgoing]:
        """What comes next on its topic, of which `count` messages have been published."""
        for topic in dict.fromkeys(topic for topic, _ in self._had):
            while (one := self._had.pop((topic, count(topic)), None)) is not None:
                yield Outgoing(topic, one.body, 0.0, one.schema, outside=True)

    def close(self) -> None:
        """Close the file."""
        self._log.close()
