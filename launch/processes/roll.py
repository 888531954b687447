"""What the launcher knows of each node: who is ready, alive, has failed, has said goodbye."""

from __future__ import annotations

import time
from collections.abc import Sequence

from palpate.messages.bus.words import Word
from palpate.messages.codec import decode
from palpate.messages.types import LogRecord, NodeStatus

SILENCE = 5.0
"""A node without a sign of life for this long is mentioned in the log, s."""
_MAX_TEXT = 4000


class Roll:
    """The nodes of one graph, as they have spoken so far.

    Parameters
    ----------
    names : sequence of str
        Names of the nodes.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.statuses: dict[str, NodeStatus] = {}
        """The latest counters of each node."""
        self.ready: set[str] = set()
        """Nodes of which all inputs are in step."""
        self.bye: set[str] = set()
        """Nodes that have put away what they held."""
        self.failed: dict[str, str] = {}
        """Nodes that have failed, and of what."""
        self._alive = dict.fromkeys(names, time.monotonic())
        self._mentioned: set[str] = set()

    def hear(self, name: str, word: Word) -> list[LogRecord]:
        """Take a node's word about itself; returns what is worth a line in the log.

        Raises
        ------
        ValueError
            If the node's counters cannot be read.
        """
        kind = word["kind"]
        if name not in self._alive:
            raise ValueError(f"somebody called {name!r} spoke, who is not in the graph")
        self._alive[name] = time.monotonic()
        self._mentioned.discard(name)
        if kind == "ready":
            self.ready.add(name)
        elif kind == "bye":
            self.bye.add(name)
            self.statuses[name] = decode(NodeStatus, word["status"])
        elif kind == "failed":
            self.failed[name] = str(word["text"])
            trace = str(word["trace"]).encode()[-_MAX_TEXT:].decode(errors="ignore")
            return [_record(name, "error", self.failed[name]), _record(name, "debug", trace)]
        return []

    def left(self, name: str) -> str | None:
        """A node's process has ended; what it failed of, if it said so."""
        self.ready.discard(name)
        self._alive[name] = time.monotonic()
        return self.failed.pop(name, None)

    def silence(self, name: str, now: float) -> float:
        """Time since a node was last heard of, s."""
        return now - self._alive[name]

    def silent(self, now: float) -> list[LogRecord]:
        """Lines for the log about nodes that have not been heard of for long, once each."""
        lines = []
        for name, when in self._alive.items():
            if now - when > SILENCE and name not in self._mentioned and name not in self.bye:
                self._mentioned.add(name)
                doing = "is still working" if name in self.ready else "is still starting"
                text = f"{name} {doing}, or hangs: no sign of life for {SILENCE:g} s"
                lines.append(_record(name, "warning", text))
        return lines


def _record(node: str, level: str, text: str) -> LogRecord:
    return LogRecord(node=node, level=level, text=text, robot_time=0.0)  # type: ignore[arg-type]
