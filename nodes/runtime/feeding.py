"""Recordings under test: their messages, and a node fed with what another one received.

By itself, since it imports the reader of recordings, which `drive` does not need.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any, TypeVar, overload

from palpate.messages import Header, decode, schema_hash
from palpate.messages.bus import Received
from palpate.messages.recording import RecordedMessage, Recording, open_recording
from palpate.messages.types import TYPES
from palpate.nodes.runtime.node import Finished, Node
from palpate.nodes.runtime.testing import Published, decoded_outputs, params_of
from palpate.nodes.runtime.wiring import Input, RecordedNode, lone_wiring, recorded_nodes
from palpate.nodes.runtime.work import NodeWork, Outgoing

TOPICS_FILE = "topics.mcap"  # The recording in a run directory
Message = TypeVar("Message")
RecordingPath = str | os.PathLike[str]


@overload
def recorded(recording: RecordingPath, topic: str) -> list[Any]: ...


@overload
def recorded(recording: RecordingPath, topic: str, cls: type[Message]) -> list[Message]: ...


def recorded(recording: RecordingPath, topic: str, cls: Any = None) -> list[Any]:
    """The messages of one topic, in their order.

    Parameters
    ----------
    recording : path
        A recording, or a run directory.
    topic : str
        Topic on the wire.
    cls : type, optional
        Type of the messages; needed for types of one's own.

    Raises
    ------
    ValueError
        If the recording cannot be read, has no such topic, or its messages are of another type.
    """
    bag = _open(recording)
    if topic not in bag.counts:
        known = ", ".join(sorted(bag.counts)) or "nothing"
        raise ValueError(f"recording {bag.path} has nothing on {topic}; it has {known}")
    return [_decoded(kept, cls) for kept in bag.messages() if kept.topic == topic]


def feed(
    node: Node, recording: RecordingPath, *, name: str | None = None, params: object = None
) -> Published:
    """What a node publishes to what a node of a recording received.

    Parameters
    ----------
    node : Node
        What to drive.
    recording : path
        A recording, or a run directory.
    name : str, optional
        The node of the recorded graph whose place it takes. Without a name it is its own, or, if
        it was not there, it subscribes to the topics that it declares.
    params : map, Struct or None
        Its parameters; those that were recorded, where it takes its own place, if None.

    Returns
    -------
    list
        As `drive` returns it.

    Raises
    ------
    ValueError
        If the recording cannot be read, or has no such place for the node.
    """
    bag = _open(recording)
    place = _recorded_place(bag, node, name)
    own = place is not None and _holds(place, node)
    given = params_of(node, params if params is not None or not own else _recorded(place, node))
    edges = _inputs(bag, node, place)
    wiring = lone_wiring(given, edges, node.outputs, place.name if place else "node")
    work = NodeWork(node, given, wiring)
    publishers = {one.topic: one.publisher for one in edges}
    published: list[Outgoing | Finished] = work.begin()
    # Processes of one machine share the clock; the recorder may have another order.
    for kept in sorted(bag.messages(), key=lambda kept: kept.sent_ns):
        if kept.topic in publishers:
            header = Header(kept.run, kept.epoch, kept.seq, kept.sent_ns, 0.0, kept.schema)
            published += work.take(Received(publishers[kept.topic], kept.topic, header, kept.body))
    return decoded_outputs(node, published)


def _open(recording: RecordingPath) -> Recording:
    path = Path(recording)
    return open_recording(path / TOPICS_FILE if path.is_dir() else path)


def _decoded(kept: RecordedMessage, cls: type | None) -> object:
    wanted = cls or TYPES.get(kept.type)
    if wanted is None:
        raise ValueError(
            f"{kept.topic} holds {kept.type}, which palpate does not have; name the type"
        )
    if kept.schema != schema_hash(wanted):
        raise ValueError(f"{kept.topic} is not a {wanted.__name__} of this version")
    return decode(wanted, kept.body)


def _recorded_place(bag: Recording, node: Node, name: str | None) -> RecordedNode | None:
    """The place in the recorded graph that the node takes; None if it was not there."""
    places = recorded_nodes(bag.graph) if bag.graph else ()
    if name is None:
        own = [one for one in places if _holds(one, node)]
        if len(own) > 1:
            names = ", ".join(one.name for one in own)
            raise ValueError(f"recording {bag.path} has {names}; say with name whose place to take")
        return own[0] if own else None
    for one in places:
        if one.name == name:
            return one
    known = ", ".join(one.name for one in places) or "none"
    raise ValueError(f"recording {bag.path} has no node {name!r}; it has {known}")


def _holds(place: RecordedNode, node: Node) -> bool:
    """Whether this very node was there; nothing is imported to find out."""
    return getattr(sys.modules.get(place.module), "NODE", None) is node


def _recorded(place: RecordedNode | None, node: Node) -> object:
    return None if place is None else place.wiring(node.params).params


def _inputs(bag: Recording, node: Node, place: RecordedNode | None) -> tuple[Input, ...]:
    """What the node receives of the recording."""
    if place is None:
        found = [
            Input("recording", topic, topic, cls.__name__)
            for topic, (cls, _) in node.inputs.items()
            if topic in bag.counts
        ]
    else:
        found = [one for one in place.inputs if one.local in node.inputs]
    if not found and node.inputs:
        whose = f"what {place.name} received in it" if place else "its topics"
        subscriptions = ", ".join(node.inputs)
        raise ValueError(
            f"recording {bag.path}: the node subscribes to {subscriptions}, none of {whose}"
        )
    return tuple(found)
