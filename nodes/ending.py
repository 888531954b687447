"""How a graph ended, and who watches it while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

from palpate.messages.types import LogRecord, NodeStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """What is left to say when all nodes have stopped."""

    status: Literal["finished", "died", "stalled", "interrupted"]
    """``finished``: the ending node said so and every message was consumed. ``died``: a node
    failed. ``stalled``: all quiet without an end. ``interrupted``: somebody pressed Ctrl-C."""
    reason: str
    """One sentence: the reason of Finished, or which node died of what, or who waits for whom."""
    statuses: Mapping[str, NodeStatus] = field(default_factory=dict)
    """The last counters of each node."""
    gaps: int = 0
    """Missing messages over all reliable topics."""
    duplicates: int = 0
    """Messages that came twice over all reliable topics."""
    restarts: Mapping[str, int] = field(default_factory=dict)
    """How often each node was started again, of those that were."""


class Watcher(Protocol):
    """Hears what the launcher hears, while the graph runs."""

    def ready(self, seconds: float) -> None:
        """All nodes are up and joined, this long after the launch began."""

    def heard(self, topic: str, message: object) -> None:
        """A message on one of the topics that were asked for."""

    def log(self, record: LogRecord) -> None:
        """A node has something to say."""

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Called some ten times a second with the latest counters; may draw."""
