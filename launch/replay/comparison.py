"""What a node had said beside what it says now: the first difference, and all that has changed."""

from __future__ import annotations

from collections import deque

from palpate.launch.replay.changes import TopicChanges
from palpate.messages.recording.difference import first_difference


class TopicComparison:
    """The messages of one topic; those that wait for their counterpart are held.

    Parameters
    ----------
    topic : str
        The topic on the wire.
    cls : type
        Type of its messages.
    """

    def __init__(self, topic: str, cls: type) -> None:
        self.topic = topic
        self.compared = 0
        """Messages that were compared."""
        self.differ = 0
        """Messages of them that differ."""
        self.fewer = 0
        """Messages that were recorded, but are not said now."""
        self.more = 0
        """Messages that are said now, but were not recorded."""
        self.changes = TopicChanges(cls)
        """Field by field."""
        self.first = ""
        """The first difference, in words; empty as long as there is none."""
        self._cls = cls
        self._then: deque[bytes] = deque()
        self._now: deque[bytes] = deque()
        self._silent, self._unsaid = False, 0

    def recorded(self, body: bytes) -> None:
        """Take the next message that was recorded."""
        self._then.append(body)
        self._compare()
        if self._silent:
            self.fall_silent()

    def said(self, body: bytes) -> None:
        """Take the next message that is said now."""
        self._now.append(body)
        self._compare()

    def fall_silent(self) -> None:
        """Nothing is said any more: what was recorded is counted, but not held."""
        self._silent = True
        self._unsaid += len(self._then)
        self._then.clear()

    def end(self, *, closed: bool) -> None:
        """Count what one side said and the other did not, if all was recorded."""
        if not closed:
            return
        self.fewer, self.more = self._unsaid + len(self._then), len(self._now)
        if not self.first and self.fewer:
            self.first = f"{self.topic} {self.compared}: recorded, but not said again"
        elif not self.first and self.more:
            self.first = f"{self.topic} {self.compared}: said now, but not recorded"

    def _compare(self) -> None:
        if not (self._then and self._now):
            return
        then, now, seq = self._then.popleft(), self._now.popleft(), self.compared
        self.compared += 1
        if then == now:
            return
        self.differ += 1
        self.changes.add(seq, then, now)
        found = None if self.first else first_difference(self._cls, then, now)
        if found is not None:
            field, before, after = found
            self.first = f"{self.topic} {seq} {field}: recorded {before}, now {after}"
