"""When a node has said what: once more it says it with the times of the first time.

A time orders what was sent: an effect that others have kept must stay later than its cause, though
the cause is said again after a death.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from palpate.messages.bus.journal import Journal


class Times:
    """The times at which one node has sent its messages.

    Parameters
    ----------
    path : Path
        The file; what an earlier start of the node has written is gone on with.
    name : str
        Name of the node.
    topics : iterable of str
        Its topics that are put down, in an order that is the same at every start.

    Raises
    ------
    OSError
        If the file cannot be read or written.
    ValueError
        If it speaks of other topics.
    """

    def __init__(self, path: Path, name: str, topics: Iterable[str]) -> None:
        names = list(topics)
        self._name, self._journal = name, Journal(path, [(name, topic) for topic in names])
        self._before: dict[str, list[int]] = {topic: [] for topic in names}
        for _, topic, sent_ns in self._journal.before:
            self._before[topic].append(sent_ns)

    def before(self, topic: str, seq: int) -> int | None:
        """Time at which an earlier start has sent a message, ns; None if that is not put down."""
        said = self._before.get(topic, ())
        return said[seq] if seq < len(said) else None

    def note(self, topic: str, sent_ns: int) -> None:
        """Put down the time of a topic's next message, before it is sent; of other topics nothing.

        Raises
        ------
        OSError
            If there is no more room for it.
        """
        if topic in self._before:
            self._journal.note(self._name, topic, sent_ns)

    def close(self) -> None:
        """Close the file."""
        self._journal.close()
