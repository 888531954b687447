"""Functions for tests of nodes: drive nodes by calls, make messages, and compare them bit by bit.

There are no sockets. Messages are encoded and decoded on their way in and out, held until the
node's needs have arrived, and refused if they violate the node's declaration. A node can also get
the messages of a node in a recording.
"""

from __future__ import annotations

import dataclasses
import os
import sys
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar, overload

import msgspec
import numpy as np

from palpate.messages import (
    Header,
    codec_of,
    decode,
    encode,
    first_difference,
    recording as recordings,
    schema,
    schema_hash,
)
from palpate.messages.bus import Received
from palpate.messages.types import TYPES
from palpate.nodes.runtime.node import (
    Finished,
    Input,
    Node,
    RecordedNode,
    Source,
    lone_wiring,
    recorded_nodes,
)
from palpate.nodes.runtime.sources import SourceWork
from palpate.nodes.runtime.work import NodeWork, Outgoing, recorded_changes

# Pairs of the node's name of a topic and a message, in the order of publication.
Published = list[tuple[str, Any] | Finished]
Message = TypeVar("Message")
_PLAIN: dict[str, Any] = {"number": 0.0, "integer": 0, "boolean": False, "string": "", "array": ()}


def drive(
    node: Node | Source,
    inputs: Iterable[tuple[str, object] | Finished] = (),
    params: object = None,
    *,
    most: int | None = None,
) -> Published:
    """Outputs of a node from its start on, with some inputs.

    `inputs`: pairs of the node's name of a topic and a message; a source has none. Finished is
    ignored, so that outputs of a node can be inputs of the next. `params`: as in a launch file, or
    an instance of the node's own type; None: defaults. `most`: maximum number of messages of a
    source, which may never end.

    Returns pairs of topic and message, read-only as for subscribers, and Finished.

    Raises ValueError if the parameters do not suit the node, the node does not subscribe to a
    topic, or a message has another type; ContractError if the node violates its declaration; and
    exceptions of its handlers.
    """
    if isinstance(node, Source):
        if list(inputs):
            raise ValueError("a source subscribes to nothing; give it no inputs")
        return list(_published_by(node, params_of(node, params), most))
    work = _work_of(node, params)
    counts = Counter[str]()
    published = work.begin()
    for topic, message in (item for item in inputs if not isinstance(item, Finished)):
        published += work.take(_arrival(node, topic, message, counts[topic]))
        counts[topic] += 1
    return decoded_outputs(node, published)


def drive_together(
    nodes: Iterable[tuple[Node, object]], inputs: Iterable[tuple[str, object] | Finished] = ()
) -> Published:
    """Outputs of several nodes, each of which is handled at once by its subscribers.

    `nodes`: pairs of a node and its parameters, as of `drive`. `inputs`: handled one by one, each
    with all its consequences. Raises as `drive` does, except for topics without subscriber.
    """
    works = [(node, _work_of(node, params)) for node, params in nodes]
    published: Published = []
    counts = Counter[str]()

    def deliver(waiting: deque[tuple[str, object] | Finished]) -> None:
        while waiting:
            output = waiting.popleft()
            published.append(output)
            if isinstance(output, Finished):
                continue
            topic, message = output
            for node, work in works:
                if topic in node.inputs:
                    arrival = _arrival(node, topic, message, counts[topic])
                    waiting.extend(decoded_outputs(node, work.take(arrival)))
            counts[topic] += 1

    begun = [decoded_outputs(node, work.begin()) for node, work in works]
    deliver(deque(output for outputs in begun for output in outputs))
    for item in inputs:
        deliver(deque([item]))
    return published


def _work_of(node: Node, params: object) -> NodeWork:
    decoded = params_of(node, params)
    edges = [Input("test", topic, topic, cls.__name__) for topic, (cls, _) in node.inputs.items()]
    return NodeWork(node, decoded, lone_wiring(decoded, edges, node.outputs))


def _published_by(
    source: Source, params: Any, most: int | None
) -> Iterator[tuple[str, Any] | Finished]:
    """The first `most` messages of a source, without waiting for their times."""
    outputs = source.outputs(params)
    work = SourceWork(source, params, lone_wiring(params, (), outputs))
    list(work.begin())
    for output in islice(work.all(), most):
        if isinstance(output, Finished):
            yield output
            return
        yield output.topic, decode(outputs[output.topic], output.body)


def _arrival(node: Node, topic: str, message: object, seq: int) -> Received:
    """An encoded message to a node."""
    if topic not in node.inputs:
        known = ", ".join(node.inputs) or "nothing"
        raise ValueError(f"the node does not subscribe to {topic}; it subscribes to {known}")
    cls = node.inputs[topic][0]
    if type(message) is not cls:
        raise ValueError(
            f"the node subscribes to {topic} as {cls.__name__}, got a {type(message).__name__}"
        )
    header = Header(0, 0, seq, 0, 0.0, codec_of(cls).hash)
    return Received("test", topic, header, encode(message))


def params_of(node: Node | Source, params: object) -> Any:
    """The parameters, encoded and decoded; ValueError if they do not suit the node."""
    try:
        data = msgspec.msgpack.encode({} if params is None else params)
        return msgspec.msgpack.decode(data, type=node.params)
    except (msgspec.ValidationError, TypeError) as error:
        raise ValueError(f"the parameters do not fit: {error}") from None


def decoded_outputs(node: Node, published: Iterable[Outgoing | Finished]) -> Published:
    """Decoded outputs of a single node."""
    return [
        item
        if isinstance(item, Finished)
        else (item.topic, decode(node.outputs[item.topic], item.body))
        for item in published
    ]


def example(cls: type[Message], **fields: object) -> Message:
    """A message with some fields set.

    Other fields have their default, or are 0, empty, or the first allowed word. An array with any
    number of rows has none.

    Raises ValueError if the type has no such field, or a value does not fit.
    """
    described = schema(cls)["properties"]
    unknown = sorted(fields.keys() - described.keys())
    if unknown:
        raise ValueError(f"a {cls.__name__} has no {unknown[0]}; it has {', '.join(described)}")
    required = [
        field.name
        for field in dataclasses.fields(cls)  # type: ignore[arg-type]
        if field.default is field.default_factory is dataclasses.MISSING
    ]
    message = cls(**{**{name: _simplest(described[name]) for name in required}, **fields})
    encode(message)
    return message


def _simplest(rule: dict[str, Any]) -> Any:
    """The simplest value of a field with this schema."""
    if "anyOf" in rule:
        return None
    if "enum" in rule:
        return rule["enum"][0]
    if "dtype" in rule:
        return np.zeros([length or 0 for length in rule["shape"]], rule["dtype"])
    return {} if rule["type"] == "object" else _PLAIN[rule["type"]]


def messages_on(published: Sequence[tuple[str, Any] | Finished], topic: str) -> list[Any]:
    """The messages on one topic, in their order."""
    outputs = (item for item in published if not isinstance(item, Finished))
    return [message for its_topic, message in outputs if its_topic == topic]


def assert_same(
    published: Sequence[tuple[str, object] | Finished],
    expected: Sequence[tuple[str, object] | Finished],
) -> None:
    """Compare outputs with expected ones, bit by bit.

    Raises AssertionError with the first different message and field.
    """
    for number, (now, then) in enumerate(zip(published, expected, strict=False)):
        if _named(now) != _named(then):
            raise AssertionError(f"{number}: published {_named(now)}, expected {_named(then)}")
        if isinstance(now, Finished) or isinstance(then, Finished):
            continue
        difference = first_difference(type(now[1]), encode(now[1]), encode(then[1]))
        if difference is not None:
            field, *values = difference
            raise AssertionError(
                f"{number}: {now[0]} {field}: published {values[0]}, expected {values[1]}"
            )
    rest = published[len(expected) :] or expected[len(published) :]
    if rest:
        more = "more was published" if len(published) > len(expected) else "not published"
        raise AssertionError(
            f"published {len(published)}, expected {len(expected)}; {more}: {_named(rest[0])}"
        )


def _named(output: tuple[str, object] | Finished) -> str:
    if isinstance(output, Finished):
        return f"Finished({output.reason!r})"
    return f"a {type(output[1]).__name__} on {output[0]}"


TOPICS_FILE = "topics.mcap"  # recording in a run directory
RecordingPath = str | os.PathLike[str]


@overload
def recorded(recording: RecordingPath, topic: str) -> list[Any]: ...


@overload
def recorded(recording: RecordingPath, topic: str, cls: type[Message]) -> list[Message]: ...


def recorded(recording: RecordingPath, topic: str, cls: Any = None) -> list[Any]:
    """The messages on one topic on the wire, of a recording or a run directory, in their order.

    `cls`: their type, which is needed only for a user's own types.

    Raises ValueError if the recording cannot be read, has no such topic, or its messages are of
    another type.
    """
    bag = _open(recording)
    if topic not in bag.counts:
        known = ", ".join(sorted(bag.counts)) or "nothing"
        raise ValueError(f"recording {bag.path} has nothing on {topic}; it has {known}")
    return [_decoded(kept, cls) for kept in bag.messages() if kept.topic == topic]


def feed(
    node: Node, recording: RecordingPath, *, name: str | None = None, params: object = None
) -> Published:
    """Outputs of a node, as of `drive`, to the messages that a node of a recording received.

    `name`: the node of the recorded graph whose place it takes; by default its own place, or, if it
    was not in the graph, the topics that it declares. `params`: by default those recorded at its
    own place.

    Raises ValueError if the recording cannot be read, or has no such place for the node.
    """
    bag = _open(recording)
    place = _recorded_place(bag, node, name)
    if params is None and place is not None and _holds(place, node):
        params = place.wiring(node.params).params
    decoded = params_of(node, params)
    edges = _inputs(bag, node, place)
    wiring = lone_wiring(decoded, edges, node.outputs, place.name if place else "node")
    work = NodeWork(node, decoded, wiring, recorded_changes(bag.messages(), node, wiring))
    publishers = {edge.topic: edge.publisher for edge in edges}
    published: list[Outgoing | Finished] = work.begin()
    # The clock of one machine gives the order, from which the recorder's may differ.
    for kept in sorted(bag.messages(), key=lambda kept: kept.sent_ns):
        if kept.topic in publishers:
            header = Header(kept.run, kept.epoch, kept.seq, kept.sent_ns, 0.0, kept.schema)
            published += work.take(Received(publishers[kept.topic], kept.topic, header, kept.body))
    return decoded_outputs(node, published)


def _open(recording: RecordingPath) -> recordings.Recording:
    path = Path(recording)
    return recordings.open_recording(path / TOPICS_FILE if path.is_dir() else path)


def _decoded(kept: recordings.RecordedMessage, cls: type | None) -> object:
    known = cls or TYPES.get(kept.type)
    if known is None:
        raise ValueError(
            f"{kept.topic} holds {kept.type}, which palpate does not have; name the type"
        )
    if kept.schema != schema_hash(known):
        raise ValueError(f"{kept.topic} is not a {known.__name__} of this version")
    return decode(known, kept.body)


def _recorded_place(bag: recordings.Recording, node: Node, name: str | None) -> RecordedNode | None:
    """The place in the recorded graph that the node takes; None if there is none."""
    places = recorded_nodes(bag.graph) if bag.graph else ()
    if name is None:
        own = [item for item in places if _holds(item, node)]
        if len(own) > 1:
            names = ", ".join(item.name for item in own)
            raise ValueError(f"recording {bag.path} has {names}; say with name whose place to take")
        return own[0] if own else None
    named = {item.name: item for item in places}
    if name not in named:
        known = ", ".join(named) or "none"
        raise ValueError(f"recording {bag.path} has no node {name!r}; it has {known}")
    return named[name]


def _holds(place: RecordedNode, node: Node) -> bool:
    """Whether a place is of this node, without importing its module."""
    return getattr(sys.modules.get(place.module), "NODE", None) is node


def _inputs(bag: recordings.Recording, node: Node, place: RecordedNode | None) -> tuple[Input, ...]:
    """The node's inputs in the recording."""
    own = (
        Input("recording", topic, topic, cls.__name__) for topic, (cls, _) in node.inputs.items()
    )
    edges = [edge for edge in own if edge.topic in bag.counts]
    if place is not None:
        edges = [edge for edge in place.inputs if edge.local in node.inputs]
    if not edges and node.inputs:
        source = f"what {place.name} received in it" if place else "its topics"
        names = ", ".join(node.inputs)
        raise ValueError(f"recording {bag.path}: the node subscribes to {names}, none of {source}")
    return tuple(edges)
