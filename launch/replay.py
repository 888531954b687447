"""Runs nodes again on what they heard, and compares what they say with what they said.

A node is a pure function of its inputs in their order. They are handed over in the order in which
they were sent, so that no effect comes before its cause; but of two publishers another one may
have been heard first. So nodes that heard one publisher beside their needs (filter, curvature,
evaluator) are replayed exactly, and are those that are replayed if none is named.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from threadpoolctl import threadpool_limits

from palpate.launch.own_modules import look_here
from palpate.messages.bus.subscriber import Arrival
from palpate.messages.codec import schema_hash
from palpate.messages.header import Header
from palpate.messages.recording.difference import first_difference
from palpate.messages.recording.reader import Kept, Recording, open_recording
from palpate.nodes.node import Finished, Node
from palpate.nodes.recording import Recorded, describe_wirings, recorded_wirings
from palpate.nodes.runtime_work import NodeWork, Parcel
from palpate.nodes.wiring import load_node

__all__ = ["describe_wirings", "replay"]

OURS = "palpate."
"""A recording names modules to import; others than ours only if the user names the node."""


def replay(bag: Path, nodes: Sequence[str] = (), echo: Callable[[str], None] = print) -> int:
    """Run nodes of a recording again.

    Parameters
    ----------
    bag : Path
        The recording.
    nodes : sequence of str
        Names of nodes in the recorded graph; all that can be replayed exactly if empty.
    echo : function
        Prints a line.

    Returns
    -------
    int
        0 if every node said what it had said, byte for byte; 1 if not.

    Raises
    ------
    ValueError
        If the recording cannot be read or lacks messages, or a node is unknown, cannot be
        replayed, or was recorded with other message types.
    """
    recording = open_recording(Path(bag))
    players = [_Player(place, node, recording) for place, node in _chosen(recording, nodes)]
    if not recording.closed:
        echo(f"{recording.path} was never closed: replaying as far as it goes")
    with threadpool_limits(limits=1):  # as when it was recorded: several threads round otherwise
        _play(recording, players)
    for player in players:
        player.end()
        echo(player.verdict())
    return int(any(player.difference for player in players))


def _play(recording: Recording, players: Sequence[_Player]) -> None:
    for player in players:
        player.begin()
    sequence: dict[str, int] = {}
    # Processes of one machine share the clock; the recorder may have heard them in another order.
    for kept in sorted(recording.messages(), key=lambda kept: kept.sent_ns):
        _check_sequence(recording, sequence, kept)
        for player in players:
            player.hear(kept)


def _chosen(recording: Recording, names: Sequence[str]) -> list[tuple[Recorded, Node]]:
    """The nodes to replay, loaded."""
    if not recording.graph:
        raise ValueError(f"recording {recording.path} does not say which nodes made it")
    known = {one.name: one for one in recorded_wirings(recording.graph)}
    for name in names:
        if name not in known:
            raise ValueError(f"recording {recording.path} has no node {name!r}; it has {[*known]}")
    chosen = []
    for one in [known[name] for name in names] or known.values():
        if not names and not one.module.startswith(OURS):
            continue
        if not one.module.startswith(OURS):
            look_here(f"{one.module}:NODE")
        node = load_node(one.module)
        if isinstance(node, Node) and (names or _is_exact(one, node, recording)):
            chosen.append((one, node))
        elif names:
            raise ValueError(f"{one.name} is a sink: it says nothing that could be compared")
    if not chosen:
        raise ValueError(f"recording {recording.path} has no node that can be replayed exactly")
    return chosen


def _is_exact(place: Recorded, node: Node, recording: Recording) -> bool:
    """Whether the recorded order is sure to be the order in which the node heard."""
    heard = [one for one in place.inputs if recording.counts.get(one.topic)]
    return len({one.publisher for one in heard if one.local not in node.needs}) <= 1


def _check_sequence(recording: Recording, sequence: dict[str, int], kept: Kept) -> None:
    wanted = sequence.get(kept.topic, 0)
    if kept.seq != wanted:
        raise ValueError(
            f"recording {recording.path} lacks {kept.topic} {wanted}: it has {kept.seq} instead"
        )
    sequence[kept.topic] = wanted + 1


class _Pair(NamedTuple):
    """What was said and is said on one topic, as far as it has not been compared."""

    cls: type
    recorded: deque[bytes]
    replayed: deque[bytes]


class _Player:
    """One node under replay."""

    def __init__(self, place: Recorded, node: Node, recording: Recording) -> None:
        self.difference = ""
        self._name, self._closed = place.name, recording.closed
        wiring = place.wiring(node.params)
        self._work = NodeWork(node, wiring.params, wiring)
        self._inputs = {
            one.topic: (one.publisher, node.inputs[one.local][0]) for one in place.inputs
        }
        self._said = {
            topic: _Pair(node.outputs[local], deque(), deque())
            for local, topic in place.outputs.items()
        }
        self._compared = {topic: 0 for topic in self._said}

    def begin(self) -> None:
        """Start the node."""
        self._run("at its start", self._work.begin)

    def hear(self, kept: Kept) -> None:
        """Take one recorded message, as an input or as what the node had said."""
        if self.difference:
            return
        if kept.topic in self._said:
            pair = self._said[kept.topic]
            _check_schema(kept, pair.cls)
            pair.recorded.append(kept.body)
        if kept.topic in self._inputs:
            publisher, cls = self._inputs[kept.topic]
            _check_schema(kept, cls)
            header = Header(kept.run, kept.epoch, kept.seq, kept.sent_ns, 0.0, kept.schema)
            arrival = Arrival(publisher, kept.topic, header, kept.body)
            self._run(f"at {kept.topic} {kept.seq}", lambda: self._work.take(arrival))
        self._compare()

    def end(self) -> None:
        """Count what one side said and the other did not."""
        for topic, pair in self._said.items():
            seq = self._compared[topic]
            if self.difference or not (pair.recorded or pair.replayed):
                continue
            if pair.recorded and self._closed:
                self.difference = f"{topic} {seq}: recorded, but not said again"
            elif pair.replayed and self._closed:
                self.difference = f"{topic} {seq}: said now, but not recorded"

    def verdict(self) -> str:
        """One line for the user."""
        if self.difference:
            return f"{self._name}: differs, {self.difference}"
        counts = ", ".join(f"{count} on {topic}" for topic, count in self._compared.items())
        return f"{self._name}: identical, {counts or 'nothing said'}"

    def _run(self, where: str, act: Callable[[], list[Parcel | Finished]]) -> None:
        try:
            said = act()
        except Exception as error:  # The edge of the node: whatever it was is a difference.
            self.difference = f"{type(error).__name__} {where}: {error}"
            return
        for one in said:
            if isinstance(one, Parcel):
                self._said[one.topic].replayed.append(one.body)

    def _compare(self) -> None:
        for topic, pair in self._said.items():
            while pair.recorded and pair.replayed and not self.difference:
                found = first_difference(pair.cls, pair.recorded.popleft(), pair.replayed.popleft())
                if found is not None:
                    field, then, now = found
                    seq = self._compared[topic]
                    self.difference = f"{topic} {seq} {field}: recorded {then}, now {now}"
                else:
                    self._compared[topic] += 1


def _check_schema(kept: Kept, cls: type) -> None:
    if kept.schema != schema_hash(cls):
        raise ValueError(
            f"{kept.topic} was recorded with another version of {cls.__name__} "
            f"(schema {kept.schema:08x}, now {schema_hash(cls):08x})"
        )
