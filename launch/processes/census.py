"""Whether all that was sent has been heard: the only sign by which a graph may end.

A graph with a cycle has no order in which its nodes could be closed. So all are counted: what
each has sent, by topic, and consumed, by publisher and topic. When two rounds are equal and
every edge has consumed what was sent, nothing is on its way any more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

AGAIN = 0.2
"""A node that has not answered is asked again after this long, s."""


class Edge(NamedTuple):
    """One listener of one topic."""

    listener: str
    publisher: str
    topic: str


@dataclass(frozen=True, slots=True)
class Count:
    """One node's answer."""

    sent: dict[str, int]
    """Messages sent on each topic."""
    consumed: dict[tuple[str, str], int]
    """Messages consumed, by publisher and topic."""
    waits: tuple[str, ...] = ()
    """Topics without whose first message the node handles nothing else."""
    speaks: bool = False
    """Whether it may still say something of its own: then nothing need move for long."""


class Census:
    """Rounds of counting.

    Parameters
    ----------
    names : sequence of str
        Everybody who is counted.
    edges : sequence of Edge
        Who hears what from whom.
    """

    def __init__(self, names: Sequence[str], edges: Sequence[Edge]) -> None:
        self.round = 0
        """Number of the round."""
        self._names, self._edges = tuple(names), tuple(edges)
        self._counts: dict[str, Count] = {}
        self._last: dict[str, Count] | None = None
        self._since = 0.0
        self._equal = 0
        self._due = 0.0

    def forget(self) -> None:
        """Begin anew: what was counted before does not matter any more."""
        self.round += 1
        self._counts, self._last, self._equal, self._due = {}, None, 0, 0.0

    def drop(self, name: str) -> None:
        """Count somebody no more, who has died and is done without."""
        self._names = tuple(one for one in self._names if one != name)
        self._edges = tuple(
            edge for edge in self._edges if name not in (edge.listener, edge.publisher)
        )
        self.forget()

    def to_ask(self, now: float) -> list[str]:
        """Names of those who are to be asked now."""
        if now < self._due:
            return []
        self._due = now + AGAIN
        return [name for name in self._names if name not in self._counts]

    def answer(self, name: str, round_: int, count: Count, now: float, pause: float) -> None:
        """Take a node's answer; when it is the last of its round, the next is due after a pause."""
        if round_ != self.round or name not in self._names:
            return
        self._counts[name] = count
        if len(self._counts) < len(self._names):
            return
        if self._counts == self._last:
            self._equal += 1
        else:
            self._equal, self._since = 1, now
        self._last, self._counts = self._counts, {}
        self.round += 1
        self._due = now + pause

    @property
    def settled(self) -> bool:
        """Whether nothing is on its way: two rounds are equal, and all that was sent was heard."""
        return self._equal > 1 and not self.unheard()

    def still_for(self, now: float) -> float:
        """Time for which nothing has been sent or consumed, s; 0 if a source may speak yet."""
        speaks = any(count.speaks for count in (self._last or {}).values())
        if self._equal < 2 or (speaks and not self.unheard()):
            return 0.0
        return now - self._since

    def unheard(self) -> list[tuple[Edge, int, int]]:
        """Edges on which more was sent than consumed, with both numbers, from the last round."""
        return [entry for entry in self._traffic() if entry[1] != entry[2]]

    def complaints(self) -> list[str]:
        """Who waits for what, as far as counting can tell."""
        said = []
        for name, count in (self._last or {}).items():
            if count.waits:
                said.append(f"{name} needs {', '.join(count.waits)} before anything else")
        for edge, sent, consumed in self.unheard():
            said.append(
                f"{edge.listener} has consumed {consumed} of {sent} on {edge.topic} "
                f"from {edge.publisher}"
            )
        for edge, sent, _ in self._traffic():
            if sent == 0:
                said.append(f"{edge.listener} has heard nothing on {edge.topic} ({edge.publisher})")
        return said

    def _traffic(self) -> list[tuple[Edge, int, int]]:
        counts = self._last or {}
        entries = []
        for edge in self._edges:
            if edge.publisher in counts and edge.listener in counts:
                sent = counts[edge.publisher].sent.get(edge.topic, 0)
                consumed = counts[edge.listener].consumed.get((edge.publisher, edge.topic), 0)
                entries.append((edge, sent, consumed))
        return entries
