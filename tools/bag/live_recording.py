"""Records a running graph from outside: what it had published before, and what it publishes.

Messages come as copies, of which some may be lost on the way; the node is asked for those once
more, as for what it had published before. So nothing is missing but what nobody had subscribed to
within the graph, and what a node that has ended can no longer be asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import msgspec

from palpate import __version__
from palpate.launch.files.file_access import check_new
from palpate.launch.printing import counted
from palpate.launch.processes.registry import RunCard
from palpate.launch.run_directory import free_path
from palpate.messages import Header, recording
from palpate.messages.bus import PAST_BATCH, PastReader, SocketContext
from palpate.tools.introspection.topics import STATUS_TOPICS, TICK, TapSubscription, Topic, taps_of

PATIENCE = 2.0  # A node that does not answer for so long is asked once more, s
SPARE = 64 << 20  # Bytes that are left free on the disk, as by a recorder


class RecordedGraph(NamedTuple):
    """What was recorded."""

    path: Path
    counts: Mapping[str, int]  # Messages by topic
    lost: Mapping[str, int]  # Messages that never came, by topic; of those of which some did not


@dataclass(slots=True)
class TopicOrder:
    """The messages of one topic, put into the order of their numbers."""

    next: int = 0  # Number of the message that is to be written next
    held: dict[int, tuple[Header, bytes]] = field(default_factory=dict)  # By number, from there on
    whole: bool = False  # Whether all that had been published before has come
    lost: int = 0  # Messages that have not come, and will not

    @property
    def lacks(self) -> bool:
        """Whether something is to be asked for."""
        return not self.whole or (bool(self.held) and self.next not in self.held)

    def put(self, header: Header, body: bytes) -> None:
        """Take a message, whether a copy or what was asked for."""
        if header.seq >= self.next:
            self.held[header.seq] = header, body

    def answered(self, number: int) -> None:
        """So many have come of what was asked for; the node has no more if that is not all."""
        self.whole = self.whole or number < PAST_BATCH
        if not number and self.held:
            self.lost += min(self.held) - self.next
            self.next = min(self.held)

    def take(self) -> Iterator[tuple[Header, bytes]]:
        """What can be written."""
        while self.next in self.held:
            yield self.held.pop(self.next)
            self.next += 1


class PastRequests:
    """Asks one node for what its topics lack, one request after the other."""

    def __init__(self, reader: PastReader, run: int, orders: Mapping[str, TopicOrder]) -> None:
        self._reader, self._run, self._orders = reader, run, orders
        self._asked, self._number, self._until = "", 0, 0.0

    def turn(self) -> None:
        """Take what has come, and ask for what is still missing."""
        while (found := self._reader.receive()) is not None:
            topic, message = found
            if message is None and topic == self._asked:
                self._orders[topic].answered(self._number)
                self._asked = ""
            elif message is not None and message[0].run == self._run:
                self._orders[topic].put(*message)
                self._number += topic == self._asked
        if self._asked and time.monotonic() < self._until:
            return
        self._asked = next((topic for topic, one in self._orders.items() if one.lacks), "")
        if self._asked:
            self._number, self._until = 0, time.monotonic() + PATIENCE
            self._reader.ask(self._asked, self._orders[self._asked].next)


class GraphMessages:
    """All messages of some topics of a running graph, each topic's from its first and in order.

    What nobody within the graph subscribes to has no past that could be asked for.
    """

    def __init__(self, card: RunCard, topics: Sequence[Topic]) -> None:
        self._card, self._topics = card, topics
        self._orders = {one.name: TopicOrder() for one in topics}
        self._past: list[PastRequests] = []
        self._stack = ExitStack()

    def __enter__(self) -> GraphMessages:
        sockets = self._stack.enter_context(closing(SocketContext(self._card.key)))
        for node, names in taps_of(self._card, self._topics).items():
            reader = PastReader(sockets.context, self._card.taps[node], names)
            self._stack.callback(reader.close)
            orders = {name: self._orders[name] for name in names}
            self._past.append(PastRequests(reader, int(self._card.run, 16), orders))
        taps = TapSubscription(self._card, self._topics, latched=True)
        self._taps = self._stack.enter_context(taps)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    @property
    def whole(self) -> bool:
        """Whether all that had been published before has come."""
        return all(order.whole for order in self._orders.values())

    @property
    def lost(self) -> dict[str, int]:
        """Messages that never came, of each topic of which some did not."""
        return {topic: one.lost for topic, one in self._orders.items() if one.lost}

    def batches(
        self, duration: float | None = None, tick: float = TICK
    ) -> Iterator[list[tuple[str, Header, bytes]]]:
        """What can be told by now, every `tick`, s; ends as `TapSubscription.batches` does.

        What was published before a `duration`, s, began is waited for beyond its end.
        """
        for batch in self._taps.batches(duration, tick):
            for one in batch:
                self._orders[one.topic].put(one.header, one.body)
            yield self._asked()
        until = time.monotonic() + (0.0 if duration is None else PATIENCE)
        while not self.whole and time.monotonic() < until:
            time.sleep(tick)
            yield self._asked()
        for order in self._orders.values():
            while order.held:
                order.answered(0)
                yield self._ready()

    def _asked(self) -> list[tuple[str, Header, bytes]]:
        for requests in self._past:
            requests.turn()
        return self._ready()

    def _ready(self) -> list[tuple[str, Header, bytes]]:
        return [(topic, *one) for topic, order in self._orders.items() for one in order.take()]


def default_path() -> Path:
    """A new file in the working directory, named by the local time as rosbag2 does."""
    return free_path(Path(f"palpate_{time.strftime('%Y_%m_%d-%H_%M_%S')}.mcap"))


def record_graph(
    card: RunCard,
    topics: Sequence[Topic],
    path: Path,
    *,
    duration: float | None = None,
    echo: Callable[[str], None],
) -> RecordedGraph:
    """Record topics of a running graph until it ends, the duration, s, is over, or Ctrl-C.

    Raises InputError if the file exists; ValueError if a topic is not a reliable one, or of a type
    that nobody knows; OSError if the file cannot be written.
    """
    if aside := [one.name for one in topics if one.name in STATUS_TOPICS]:
        raise ValueError(f"{aside[0]} cannot be recorded: messages of it may be lost for good")
    check_new(path)
    counts = dict.fromkeys((one.name for one in topics), 0)
    with GraphMessages(card, topics) as messages, ExitStack() as stack:
        writer = _writer(card, topics, path)
        stack.callback(lambda: writer.close(messages.lost))
        what = f"{counted(len(topics), 'topic')} of {card.name}"
        echo(f"recording {what} into {path}; Ctrl-C ends it")
        begun: list[tuple[str, Header, bytes]] = []
        for batch in messages.batches(duration):
            begun += batch
            if messages.whole:
                _write(writer, begun, counts)
        _write(writer, begun, counts)
    return RecordedGraph(path, counts, messages.lost)


def _writer(card: RunCard, topics: Sequence[Topic], path: Path) -> recording.RecordingWriter:
    """The new file, which says of the graph what a recorder's says, as the graph began."""
    nodes = [
        msgspec.structs.replace(one, params=card.initial.get(one.name, one.params))
        for one in card.nodes
    ]
    graph = msgspec.json.encode(nodes).decode()
    about = {"version": __version__, "graph": graph, "scene_name": card.name, "ends": card.ends}
    types = {one.name: one.type for one in topics}
    return recording.RecordingWriter(path, types, card.publishers, about, SPARE, card.schemas)


def _write(
    writer: recording.RecordingWriter,
    messages: list[tuple[str, Header, bytes]],
    counts: dict[str, int],
) -> None:
    """Write messages in the order of sending, and forget them."""
    for topic, header, body in sorted(messages, key=lambda one: one[1].sent_ns):
        writer.write(topic, header, body)
        counts[topic] += 1
    messages.clear()


def recorded_text(done: RecordedGraph) -> str:
    """What was recorded, in a line, and what was lost."""
    topics = sum(map(bool, done.counts.values()))
    told = f"{done.path}: {counted(sum(done.counts.values()), 'message')} on {topics} topics"
    lost = ", ".join(f"{number} of {topic}" for topic, number in done.lost.items())
    return f"{told}; not recorded: {lost}" if lost else told
