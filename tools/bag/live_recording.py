"""Records a running graph from outside: earlier messages and new ones.

New messages come as copies, of which some may be lost; the node is then asked for them, as it is
for earlier messages. A recording lacks only earlier messages of topics without a subscriber in the
graph, and lost messages of nodes that have ended.
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
from palpate.tools.introspection.topics import STATUS_TOPICS, TapSubscription, Topic, taps_of


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveRecordingSettings:
    """Waits and the disk reserve of a recording from outside."""

    retry_after: float = 2.0  # [s] after which a node that has not answered is asked again
    min_free_bytes: int = 64 << 20  # [bytes] left free on the disk, as by a recorder


DEFAULT_LIVE = LiveRecordingSettings()


class RecordedGraph(NamedTuple):
    """A new recording."""

    path: Path
    counts: Mapping[str, int]  # messages by topic
    lost: Mapping[str, int]  # number of lost messages, by topic, where there are any


@dataclass(slots=True)
class TopicOrder:
    """The messages of one topic, put into the order of their numbers."""

    next: int = 0  # number of the message that is written next
    held: dict[int, tuple[Header, bytes]] = field(default_factory=dict)  # by number, from `next` on
    whole: bool = False  # whether all earlier messages have come
    lost: int = 0  # messages that the node can no longer send

    @property
    def lacks(self) -> bool:
        """Whether the node has to be asked for messages."""
        return not self.whole or (bool(self.held) and self.next not in self.held)

    def put(self, header: Header, body: bytes) -> None:
        """Take a message, a copy or an answer."""
        if header.seq >= self.next:
            self.held[header.seq] = header, body

    def answered(self, number: int) -> None:
        """Take note of an answer of `number` messages; with fewer than asked for it is the last."""
        self.whole = self.whole or number < PAST_BATCH
        if not number and self.held:
            self.lost += min(self.held) - self.next
            self.next = min(self.held)

    def take(self) -> Iterator[tuple[Header, bytes]]:
        """Messages that can be written now."""
        while self.next in self.held:
            yield self.held.pop(self.next)
            self.next += 1


class PastRequests:
    """Asks one node for messages that its topics lack, one request after the other."""

    def __init__(
        self, reader: PastReader, run: int, orders: Mapping[str, TopicOrder], retry_after: float
    ) -> None:
        self._reader, self._run, self._orders = reader, run, orders
        self._retry_after = retry_after
        self._asked, self._number, self._until = "", 0, 0.0

    def turn(self) -> None:
        """Take the answers that have come, and ask for messages that are still missing."""
        while (received := self._reader.receive()) is not None:
            topic, message = received
            if message is None and topic == self._asked:
                self._orders[topic].answered(self._number)
                self._asked = ""
            elif message is not None and message[0].run == self._run:
                self._orders[topic].put(*message)
                self._number += topic == self._asked
        if self._asked and time.monotonic() < self._until:
            return
        self._asked = next((topic for topic, order in self._orders.items() if order.lacks), "")
        if self._asked:
            self._number, self._until = 0, time.monotonic() + self._retry_after
            self._reader.ask(self._asked, self._orders[self._asked].next)


class GraphMessages:
    """All messages of some topics of a running graph, of each topic from its first and in order.

    Earlier messages of a topic without a subscriber in the graph are not kept, and so left out.
    """

    def __init__(
        self, card: RunCard, topics: Sequence[Topic], retry_after: float = DEFAULT_LIVE.retry_after
    ) -> None:
        self._card, self._topics, self._retry_after = card, topics, retry_after
        self._orders = {topic.name: TopicOrder() for topic in topics}
        self._past: list[PastRequests] = []
        self._stack = ExitStack()

    def __enter__(self) -> GraphMessages:
        sockets = self._stack.enter_context(closing(SocketContext(self._card.key)))
        for node, names in taps_of(self._card, self._topics).items():
            reader = PastReader(sockets.context, self._card.taps[node], names)
            self._stack.callback(reader.close)
            orders = {name: self._orders[name] for name in names}
            run = int(self._card.run, 16)
            self._past.append(PastRequests(reader, run, orders, self._retry_after))
        taps = TapSubscription(self._card, self._topics, latched=True)
        self._taps = self._stack.enter_context(taps)
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    @property
    def whole(self) -> bool:
        """Whether all earlier messages have come."""
        return all(order.whole for order in self._orders.values())

    @property
    def lost(self) -> dict[str, int]:
        """Number of lost messages, by topic, where there are any."""
        return {topic: order.lost for topic, order in self._orders.items() if order.lost}

    def batches(
        self, duration: float | None = None, tick: float = 0.1
    ) -> Iterator[list[tuple[str, Header, bytes]]]:
        """New messages in order, every `tick` [s]; ends as `TapSubscription.batches` does.

        After a `duration` [s] it still waits for messages that were published before the start.
        """
        for batch in self._taps.batches(duration, tick):
            for received in batch:
                self._orders[received.topic].put(received.header, received.body)
            yield self._asked()
        until = time.monotonic() + (0.0 if duration is None else self._retry_after)
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
        return [(topic, *taken) for topic, order in self._orders.items() for taken in order.take()]


def default_path() -> Path:
    """A new file in the working directory, named by the local time, as rosbag2 names it."""
    return free_path(Path(f"palpate_{time.strftime('%Y_%m_%d-%H_%M_%S')}.mcap"))


def record_graph(
    card: RunCard,
    topics: Sequence[Topic],
    path: Path,
    *,
    duration: float | None = None,
    echo: Callable[[str], None],
    settings: LiveRecordingSettings = DEFAULT_LIVE,
) -> RecordedGraph:
    """Record topics of a running graph until it ends, the duration [s] is over, or Ctrl-C.

    Raises InputError if the file exists; ValueError if a topic is not a reliable one, or of an
    unknown type; OSError if the file cannot be written.
    """
    if unreliable := [topic.name for topic in topics if topic.name in STATUS_TOPICS]:
        raise ValueError(f"{unreliable[0]} cannot be recorded: messages of it may be lost for good")
    check_new(path)
    counts = dict.fromkeys((topic.name for topic in topics), 0)
    with GraphMessages(card, topics, settings.retry_after) as messages, ExitStack() as stack:
        writer = _writer(card, topics, path, settings.min_free_bytes)
        stack.callback(lambda: writer.close(messages.lost))
        names = f"{counted(len(topics), 'topic')} of {card.name}"
        echo(f"recording {names} into {path}; Ctrl-C ends it")
        waiting: list[tuple[str, Header, bytes]] = []
        for batch in messages.batches(duration):
            waiting += batch
            if messages.whole:
                _write(writer, waiting, counts)
        _write(writer, waiting, counts)
    return RecordedGraph(path, counts, messages.lost)


def _writer(
    card: RunCard, topics: Sequence[Topic], path: Path, min_free_bytes: int
) -> recording.RecordingWriter:
    """Writer of the new file, with the graph as it started, as in the file of a recorder."""
    nodes = [
        msgspec.structs.replace(node, params=card.initial.get(node.name, node.params))
        for node in card.nodes
    ]
    graph = msgspec.json.encode(nodes).decode()
    about = {"version": __version__, "graph": graph, "scene_name": card.name, "ends": card.ends}
    types = {topic.name: topic.type for topic in topics}
    publishers, schemas = card.publishers, card.schemas
    return recording.RecordingWriter(path, types, publishers, about, min_free_bytes, schemas)


def _write(
    writer: recording.RecordingWriter,
    messages: list[tuple[str, Header, bytes]],
    counts: dict[str, int],
) -> None:
    """Write messages in the order of sending, and clear the list."""
    for topic, header, body in sorted(messages, key=lambda message: message[1].sent_ns):
        writer.write(topic, header, body)
        counts[topic] += 1
    messages.clear()


def recorded_text(done: RecordedGraph) -> str:
    """A line about a new recording and its lost messages."""
    topics = sum(map(bool, done.counts.values()))
    text = f"{done.path}: {counted(sum(done.counts.values()), 'message')} on {topics} topics"
    lost = ", ".join(f"{number} of {topic}" for topic, number in done.lost.items())
    return f"{text}; not recorded: {lost}" if lost else text
