"""Who hears what: recorded messages, and in place of them what their nodes say now.

The k-th message that a replayed node says on a topic is handed over in place of the k-th that was
recorded of it. If it says fewer, its listeners hear no more; if it says more, they hear the rest
after all that was recorded.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

from palpate.launch.replay.player import Player
from palpate.messages.header import Header
from palpate.messages.recording.reader import Kept
from palpate.nodes.runtime_work import Parcel


class Shortage(NamedTuple):
    """A topic of which replayed nodes heard fewer or more messages than had been recorded."""

    topic: str
    publisher: str
    listeners: tuple[str, ...]
    fewer: int
    more: int


@dataclass(slots=True)
class _Link:
    """A topic that a replayed node says and replayed nodes hear."""

    publisher: str
    waiting: deque[tuple[int, Parcel]] = field(default_factory=deque)
    """Said now, before their place has come; numbered in the order in which they were said."""
    owed: int = 0
    """Places that have come before their messages were said."""
    heard: int = 0
    more: int = 0
    """Messages heard after all that was recorded."""


class Exchange:
    """Replayed nodes, and what is under way between them.

    Parameters
    ----------
    players : sequence of Player
        The nodes.
    """

    def __init__(self, players: Sequence[Player]) -> None:
        self._players = players
        self._listeners: dict[str, list[Player]] = {}
        for player in players:
            for topic in player.hears:
                self._listeners.setdefault(topic, []).append(player)
        self._links = {
            topic: _Link(player.name)
            for player in players
            for topic in player.says
            if topic in self._listeners
        }
        self._ready: deque[tuple[str, Header, bytes]] = deque()
        self._numbers = count()
        self._ended = False

    def begin(self) -> None:
        """Start the nodes."""
        for player in self._players:
            self._take(player.begin())

    def hear(self, kept: Kept) -> None:
        """Take the next recorded message.

        Raises
        ------
        ValueError
            If it is of another version than the nodes are.
        """
        for player in self._players:
            player.check(kept)
            player.had_said(kept)
        link = self._links.get(kept.topic)
        if link is None:
            header = Header(kept.run, kept.epoch, kept.seq, kept.sent_ns, 0.0, kept.schema)
            self._ready.append((kept.topic, header, kept.body))
        elif link.waiting:
            self._pass_on(link, link.waiting.popleft()[1])
        else:
            link.owed += 1
        self._deliver()

    def end(self) -> None:
        """Hand over what was said beyond the recorded, until all is quiet."""
        self._ended = True
        rest = [one for link in self._links.values() for one in link.waiting]
        for link in self._links.values():
            link.waiting.clear()
        self._take(parcel for _, parcel in sorted(rest, key=lambda one: one[0]))
        self._deliver()

    def shortages(self) -> tuple[Shortage, ...]:
        """Topics of which other numbers were heard than had been recorded."""
        return tuple(
            Shortage(
                topic,
                link.publisher,
                tuple(player.name for player in self._listeners[topic]),
                link.owed,
                link.more,
            )
            for topic, link in self._links.items()
            if link.owed or link.more
        )

    def _take(self, said: Iterable[Parcel]) -> None:
        for parcel in said:
            link = self._links.get(parcel.topic)
            if link is None:
                continue
            if link.owed:
                link.owed -= 1
                self._pass_on(link, parcel)
            elif self._ended:
                link.more += 1
                self._pass_on(link, parcel)
            else:
                link.waiting.append((next(self._numbers), parcel))

    def _pass_on(self, link: _Link, parcel: Parcel) -> None:
        header = Header(0, 0, link.heard, 0, parcel.robot_time, parcel.schema)
        link.heard += 1
        self._ready.append((parcel.topic, header, parcel.body))

    def _deliver(self) -> None:
        while self._ready:
            topic, header, body = self._ready.popleft()
            for player in self._listeners.get(topic, ()):
                self._take(player.hear(topic, header, body))
