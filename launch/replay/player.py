"""One node that is run again: it hears, what it says is compared, and it may fail."""

from __future__ import annotations

from collections.abc import Callable

from palpate.launch.replay.chosen import Chosen
from palpate.launch.replay.comparison import TopicComparison
from palpate.messages.bus.subscriber import Arrival
from palpate.messages.codec import schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.reader import Kept
from palpate.nodes.node import Finished
from palpate.nodes.runtime_work import ContractError, NodeWork, Parcel


class Player:
    """A node under replay.

    Parameters
    ----------
    chosen : Chosen
        The node.

    Raises
    ------
    ValueError
        If it was recorded with topics that it has no more.
    """

    def __init__(self, chosen: Chosen) -> None:
        node, wiring = chosen
        self.name = wiring.name
        try:
            self._work = NodeWork(node, wiring.params, wiring)
        except ContractError as error:
            raise ValueError(f"{error}; it was recorded with another version of it") from None
        self.failure = ""
        """What it raised and when, in words; it hears and says no more after that."""
        self.first = ""
        """Its first difference, in words."""
        self.says = {
            topic: TopicComparison(topic, node.outputs[local])
            for local, topic in wiring.outputs.items()
        }
        """What it says, by topic."""
        self.hears = {one.topic: node.inputs[one.local][0] for one in wiring.inputs}
        """Types of what it hears, by topic."""
        self._types = {wiring.outputs[local]: node.outputs[local] for local in wiring.outputs}
        self._types |= self.hears
        self._publishers = {one.topic: one.publisher for one in wiring.inputs}

    def begin(self) -> list[Parcel]:
        """Start the node; what it says."""
        return self._run(self._work.begin)

    def hear(self, topic: str, header: Header, body: bytes) -> list[Parcel]:
        """Hand it one message; what it says."""
        arrival = Arrival(self._publishers[topic], topic, header, body)
        return [] if self.failure else self._run(lambda: self._work.take(arrival))

    def check(self, kept: Kept) -> None:
        """Refuse a recorded message of a topic of its own that is of another version.

        Raises
        ------
        ValueError
            If its schema is not that of today.
        """
        cls = self._types.get(kept.topic)
        if cls is not None and kept.schema != schema_hash(cls):
            raise ValueError(
                f"{kept.topic} was recorded with another version of {cls.__name__} "
                f"(schema {kept.schema:08x}, now {schema_hash(cls):08x})"
            )

    def had_said(self, kept: Kept) -> None:
        """Compare with what it had said, if the recorded message was its own."""
        if kept.topic in self.says:
            comparison = self.says[kept.topic]
            comparison.recorded(kept.body)
            self.first = self.first or comparison.first

    def end(self, *, closed: bool) -> None:
        """Count what was said only then or only now, if all was recorded."""
        for comparison in self.says.values():
            comparison.end(closed=closed)
            self.first = self.first or comparison.first

    def _run(self, act: Callable[[], list[Parcel | Finished]]) -> list[Parcel]:
        try:
            said = act()
        except Exception as error:  # The edge of the node: whatever it was must be told in words.
            text = " ".join(str(error).split())
            self.failure = f"{type(error).__name__} {self._work.doing}: {text}"
            for comparison in self.says.values():
                comparison.fall_silent()
            return []
        parcels = [one for one in said if isinstance(one, Parcel)]
        for topic, body, *_ in parcels:
            self.says[topic].said(body)
            self.first = self.first or self.says[topic].first
        return parcels
