"""What the nodes of a graph had done in an earlier run, laid where they look for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from palpate.messages.bus.journal import Consumed, Journal
from palpate.messages.bus.past import Past
from palpate.messages.bus.place import Place
from palpate.messages.bus.times import Times
from palpate.messages.header import Header, pack_frame
from palpate.nodes.wiring import Wiring


class Spoken(NamedTuple):
    """One message that a node had sent."""

    topic: str
    """On the wire."""
    sent_ns: int
    """The node's clock, ns."""
    schema: int
    """Hash of the type's schema."""
    body: bytes
    """Encoded."""


@dataclass(frozen=True, slots=True)
class Before:
    """An earlier run, as far as it shall not be done again."""

    consumed: Mapping[str, Sequence[Consumed]]
    """What each node had handled, in its order: it goes through it once more, unheard."""
    spoken: Mapping[str, Sequence[Spoken]]
    """What those had said that act on the world: they do not go through it again."""
    times: Mapping[str, Sequence[tuple[str, int]]]
    """Topics and times, ns, of what the others had said: they say it again with these."""

    def lay(self, wirings: Sequence[Wiring], place: Place) -> None:
        """Write the journals and memories that the nodes will find."""
        for wiring in wirings:
            edges = [(one.publisher, one.topic) for one in wiring.inputs]
            if consumed := self.consumed.get(wiring.name):
                with closing(Journal(Path(place.journals[wiring.name]), edges)) as journal:
                    for one in consumed:
                        journal.note(*one)
            if times := self.times.get(wiring.name):
                self._put_down(wiring, place, times)
            if spoken := self.spoken.get(wiring.name):
                self._remember(wiring, place, spoken)

    def _put_down(self, wiring: Wiring, place: Place, times: Sequence[tuple[str, int]]) -> None:
        file = Path(place.times[wiring.name])
        with closing(Times(file, wiring.name, wiring.outputs.values())) as said:
            for topic, sent_ns in times:
                said.note(topic, sent_ns)

    def _remember(self, wiring: Wiring, place: Place, spoken: Sequence[Spoken]) -> None:
        topics = tuple(wiring.outputs.values())
        past = Past(Path(place.pasts[wiring.name]), topics, keep=True)
        with closing(past):
            for topic, sent_ns, schema, body in spoken:
                header = Header(place.run, 0, past.count(topic), sent_ns, 0.0, schema)
                past.add(topic, pack_frame(topic, header, body))
