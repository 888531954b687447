"""The topics of a running graph: who publishes each, and who hears it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from palpate.launch.nearest import hint
from palpate.launch.processes.register import Card
from palpate.messages.bus.place import LAUNCHER
from palpate.messages.bus.tap import LOG, STATUS
from palpate.messages.types import TYPES, LogRecord, NodeStatus

OWN = {STATUS: NodeStatus, LOG: LogRecord}
"""Topics on which every node speaks of itself, heard by the launcher."""


class Topic(NamedTuple):
    """One topic of a running graph."""

    name: str
    """As it is on the wire."""
    type: str
    """Name of its message type; empty if the graph does not say."""
    publishers: tuple[str, ...]
    """The nodes that publish it: one, but all of them where nodes speak of themselves."""
    listeners: tuple[str, ...]
    """The nodes that hear it."""


def topics_of(card: Card) -> dict[str, Topic]:
    """The topics of a running graph by name, sorted."""
    types, publishers = card.topics, card.publishers
    found = {
        name: Topic(name, types.get(name, ""), (publisher,), card.listeners(name))
        for name, publisher in publishers.items()
    }
    everybody = tuple(one.name for one in card.nodes)
    for name, said in OWN.items():
        found[name] = Topic(name, said.__name__, everybody, (LAUNCHER,))
    return dict(sorted(found.items()))


def find_topic(card: Card, name: str) -> Topic:
    """The topic of this name, which may lack its first slash.

    Raises
    ------
    ValueError
        If nobody publishes it.
    """
    known = topics_of(card)
    wanted = name if name.startswith("/") else f"/{name}"
    if wanted not in known:
        raise ValueError(f"nobody publishes {wanted}; {hint(wanted, known)}")
    return known[wanted]


def find_topics(card: Card, names: Sequence[str]) -> list[Topic]:
    """The topics of these names, each once.

    Raises
    ------
    ValueError
        If nobody publishes one of them.
    """
    return list(
        {topic.name: topic for topic in (find_topic(card, name) for name in names)}.values()
    )


def type_of(topic: Topic) -> type:
    """The message type of a topic.

    Raises
    ------
    ValueError
        If this palpate does not know it.
    """
    if topic.type not in TYPES:
        what = f"the type {topic.type!r}" if topic.type else "a type that its graph does not name"
        raise ValueError(f"{topic.name} carries {what}, which is not known here; --raw shows bytes")
    return TYPES[topic.type]


def taps_of(card: Card, topics: Iterable[Topic]) -> dict[str, list[str]]:
    """Node to those of the topics that its tap carries."""
    found: dict[str, list[str]] = {}
    for topic in topics:
        for publisher in topic.publishers:
            found.setdefault(publisher, []).append(topic.name)
    return found
