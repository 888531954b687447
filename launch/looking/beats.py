"""What the nodes of a running graph say of themselves, a few times a second."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import NamedTuple

from palpate.launch.looking.hearing import Hearing
from palpate.launch.looking.topics import Topic
from palpate.launch.processes.register import Card
from palpate.messages.bus.tap import STATUS
from palpate.messages.codec import decode
from palpate.messages.types import NodeStatus

PATIENCE = 1.5
"""A node that says nothing for so long works, hangs or is stopped, s."""


class Beats(NamedTuple):
    """The last words of one node about itself."""

    status: NodeStatus
    """The latest."""
    load: float | None
    """Share of one processor since the word before; None if there was none."""


def hear_beats(card: Card, names: Collection[str], patience: float = PATIENCE) -> dict[str, Beats]:
    """What the nodes of these names say; twice each, unless the patience ends, s.

    Raises
    ------
    ValueError
        If what comes is no such word.
    """
    found: dict[str, Beats] = {}
    sent: dict[str, int] = {}
    topic = Topic(STATUS, NodeStatus.__name__, tuple(names), ())
    until = time.monotonic() + patience
    with Hearing(card, [topic]) as hearing:
        while (left := until - time.monotonic()) > 0 and not _twice(found, names):
            for heard in hearing.take(left):
                status, when = decode(NodeStatus, heard.body), heard.header.sent_ns
                before = found.get(heard.publisher)
                load = None
                if before is not None and status.cpu >= before.status.cpu:
                    passed = 1e-9 * (when - sent[heard.publisher])
                    load = (status.cpu - before.status.cpu) / passed
                found[heard.publisher] = Beats(status, load)
                sent[heard.publisher] = when
    return found


def _twice(found: dict[str, Beats], names: Collection[str]) -> bool:
    return all(name in found and found[name].load is not None for name in names)
