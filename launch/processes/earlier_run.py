"""What the nodes of a graph had done in an earlier run, laid where they look for it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from palpate.messages import Header, pack_frame
from palpate.messages.bus import Addresses, Cause, Consumed, Journal, MessageLog, SendTimes
from palpate.nodes.runtime import Wiring


class SentMessage(NamedTuple):
    """One message that a node had sent."""

    topic: str  # On the wire
    sent_ns: int  # The node's clock, ns
    schema: int  # Hash of the type's schema
    body: bytes  # Encoded


@dataclass(frozen=True, slots=True)
class EarlierRun:
    """An earlier run, as far as it shall not be done again.

    Its times are shifted, so that the latest of them is now: it may have run before the machine was
    started anew, and what comes is to follow it without a gap.
    """

    # What each node had handled, in its order: it goes through it once more, unheard. Those that
    # act on the world do not.
    consumed: Mapping[str, Sequence[Consumed]]
    spoken: Mapping[str, Sequence[SentMessage]]  # What those had said that act on the world
    # Topics and times, ns, of what the others had said: they say it again with these.
    times: Mapping[str, Sequence[tuple[str, int]]]

    def lay(self, wirings: Sequence[Wiring], place: Addresses) -> None:
        """Write the journals and memories that the nodes will find.

        Parameters
        ----------
        wirings : sequence of Wiring
            The nodes, each with all who hear what it says.
        place : Place
            Addresses of the run.
        """
        later_ns = time.monotonic_ns() - max(self._all_times(), default=0)
        for wiring in wirings:
            if wiring.persistent:
                self._remember(wiring, place, later_ns)
            else:
                self._put_down(wiring, place, later_ns)

    def _all_times(self) -> Iterator[int]:
        for spoken in self.spoken.values():
            yield from (one.sent_ns for one in spoken)
        for times in self.times.values():
            yield from (sent_ns for _, sent_ns in times)

    def _put_down(self, wiring: Wiring, place: Addresses, later_ns: int) -> None:
        """What a node goes through once more, and when it had said what."""
        edges = [(one.publisher, one.topic) for one in wiring.inputs]
        with closing(Journal(Path(place.journals[wiring.name]), edges)) as journal:
            for one in self.consumed.get(wiring.name, ()):
                journal.note(*one)
        heard = [topic for topic in wiring.outputs.values() if wiring.listeners.get(topic)]
        with closing(SendTimes(Path(place.times[wiring.name]), wiring.name, heard)) as said:
            for topic, sent_ns in self.times.get(wiring.name, ()):
                said.note(topic, sent_ns + later_ns)

    def _remember(self, wiring: Wiring, place: Addresses, later_ns: int) -> None:
        """What a node has answered, and how."""
        past = MessageLog(
            Path(place.pasts[wiring.name]), tuple(wiring.outputs.values()), persistent=True
        )
        with closing(past):
            for topic, sent_ns, schema, body in self.spoken.get(wiring.name, ()):
                seq, when = past.count(topic), sent_ns + later_ns
                header = Header(place.run, 0, seq, when, 0.0, schema)
                past.add(topic, pack_frame(topic, header, body))
            for publisher, topic, seq in self.consumed.get(wiring.name, ()):
                past.answer((), Cause(publisher, topic, seq))
