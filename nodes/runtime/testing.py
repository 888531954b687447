"""For tests of nodes: drive one by plain calls, make messages, and compare them bit by bit.

Nothing here has a socket. Every message is encoded and decoded on its way in and out, held back
until the node's needs have come, and refused if it is not what the node declares. A node can be
fed with what another one received in a recording, too.
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

# Topic, as the node calls it, and message each, in the order in which they were published.
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
    """What a node publishes from its start on, given what it receives.

    `inputs` are pairs of the topic, as the node calls it, and the message; a source has none.
    Finished is passed over, so that what one node publishes can be given to the next. `params` are
    as a launch file has them, or an instance of the node's own type; None for all defaults. A
    source is asked for no more than `most` messages: what comes from outside may never end.

    Returns pairs of topic and message, read-only as a subscriber gets them, and Finished.

    Raises ValueError if the parameters are not the node's, the node does not subscribe to a topic,
    or a message is not of its type; ContractError if the node publishes what it does not declare.
    What its handlers raise is handed on.
    """
    if isinstance(node, Source):
        if list(inputs):
            raise ValueError("a source subscribes to nothing; give it no inputs")
        return list(_published_by(node, params_of(node, params), most))
    work = _work_of(node, params)
    counts = Counter[str]()
    published = work.begin()
    for topic, message in (one for one in inputs if not isinstance(one, Finished)):
        published += work.take(_arrival(node, topic, message, counts[topic]))
        counts[topic] += 1
    return decoded_outputs(node, published)


def drive_together(
    nodes: Iterable[tuple[Node, object]], inputs: Iterable[tuple[str, object] | Finished] = ()
) -> Published:
    """What several nodes publish, each message handed at once to those that subscribe to it.

    `nodes` are pairs of a node and its parameters, as `drive` takes them; `inputs` come one after
    the other, each once all that followed from the one before is done. Raises as `drive` does, but
    for a topic that none of them subscribes to, which is only returned.
    """
    works = [(node, _work_of(node, params)) for node, params in nodes]
    published: Published = []
    counts = Counter[str]()

    def hand_on(waiting: deque[tuple[str, object] | Finished]) -> None:
        while waiting:
            one = waiting.popleft()
            published.append(one)
            if isinstance(one, Finished):
                continue
            topic, message = one
            for node, work in works:
                if topic in node.inputs:
                    arrival = _arrival(node, topic, message, counts[topic])
                    waiting.extend(decoded_outputs(node, work.take(arrival)))
            counts[topic] += 1

    begun = [decoded_outputs(node, work.begin()) for node, work in works]
    hand_on(deque(one for each in begun for one in each))
    for given in inputs:
        hand_on(deque([given]))
    return published


def _work_of(node: Node, params: object) -> NodeWork:
    given = params_of(node, params)
    edges = [Input("test", topic, topic, cls.__name__) for topic, (cls, _) in node.inputs.items()]
    return NodeWork(node, given, lone_wiring(given, edges, node.outputs))


def _published_by(
    source: Source, params: Any, most: int | None
) -> Iterator[tuple[str, Any] | Finished]:
    """What a source publishes until it ends, or has published so much; nothing is waited for."""
    outputs = source.outputs(params)
    work = SourceWork(source, params, lone_wiring(params, (), outputs))
    list(work.begin())
    for one in islice(work.all(), most):
        if isinstance(one, Finished):
            yield one
            return
        yield one.topic, decode(outputs[one.topic], one.body)


def _arrival(node: Node, topic: str, message: object, seq: int) -> Received:
    """A message on its way to a node."""
    if topic not in node.inputs:
        known = ", ".join(node.inputs) or "nothing"
        raise ValueError(f"the node does not subscribe to {topic}; it subscribes to {known}")
    wanted = node.inputs[topic][0]
    if type(message) is not wanted:
        raise ValueError(
            f"the node subscribes to {topic} as {wanted.__name__}, got a {type(message).__name__}"
        )
    header = Header(0, 0, seq, 0, 0.0, codec_of(wanted).hash)
    return Received("test", topic, header, encode(message))


def params_of(node: Node | Source, params: object) -> Any:
    """The parameters on their way to a process and back; ValueError if not the node's."""
    try:
        data = msgspec.msgpack.encode({} if params is None else params)
        return msgspec.msgpack.decode(data, type=node.params)
    except (msgspec.ValidationError, TypeError) as error:
        raise ValueError(f"the parameters do not fit: {error}") from None


def decoded_outputs(node: Node, published: Iterable[Outgoing | Finished]) -> Published:
    """What subscribers get of what a node by itself publishes."""
    return [
        one if isinstance(one, Finished) else (one.topic, decode(node.outputs[one.topic], one.body))
        for one in published
    ]


def example(cls: type[Message], **fields: object) -> Message:
    """A message of which only the given fields matter.

    The others are 0, empty, the first word that is allowed or, if they have one, their default. An
    array has no rows where its type leaves their number open.

    Raises ValueError if the type has no such field, or a value does not fit.
    """
    described = schema(cls)["properties"]
    unknown = sorted(fields.keys() - described.keys())
    if unknown:
        raise ValueError(f"a {cls.__name__} has no {unknown[0]}; it has {', '.join(described)}")
    open_ = [
        field.name
        for field in dataclasses.fields(cls)  # type: ignore[arg-type]
        if field.default is field.default_factory is dataclasses.MISSING
    ]
    message = cls(**{**{name: _plain(described[name]) for name in open_}, **fields})
    encode(message)
    return message


def _plain(rule: dict[str, Any]) -> Any:
    """The plainest value that a field of this schema may have."""
    if "anyOf" in rule:
        return None
    if "enum" in rule:
        return rule["enum"][0]
    if "dtype" in rule:
        return np.zeros([length or 0 for length in rule["shape"]], rule["dtype"])
    return {} if rule["type"] == "object" else _PLAIN[rule["type"]]


def messages_on(published: Sequence[tuple[str, Any] | Finished], topic: str) -> list[Any]:
    """The messages on one topic, in their order."""
    return [one[1] for one in published if not isinstance(one, Finished) and one[0] == topic]


def assert_same(
    published: Sequence[tuple[str, object] | Finished],
    expected: Sequence[tuple[str, object] | Finished],
) -> None:
    """Compare what was published with what is expected, bit by bit.

    Raises AssertionError with the first message, and the first field in it, that differs.
    """
    for number, (one, other) in enumerate(zip(published, expected, strict=False)):
        if _named(one) != _named(other):
            raise AssertionError(f"{number}: published {_named(one)}, expected {_named(other)}")
        if isinstance(one, Finished) or isinstance(other, Finished):
            continue
        found = first_difference(type(one[1]), encode(one[1]), encode(other[1]))
        if found is not None:
            field, now, then = found
            raise AssertionError(f"{number}: {one[0]} {field}: published {now}, expected {then}")
    rest = published[len(expected) :] or expected[len(published) :]
    if rest:
        more = "more was published" if len(published) > len(expected) else "not published"
        raise AssertionError(
            f"published {len(published)}, expected {len(expected)}; {more}: {_named(rest[0])}"
        )


def _named(one: tuple[str, object] | Finished) -> str:
    if isinstance(one, Finished):
        return f"Finished({one.reason!r})"
    return f"a {type(one[1]).__name__} on {one[0]}"


TOPICS_FILE = "topics.mcap"  # The recording in a run directory
RecordingPath = str | os.PathLike[str]


@overload
def recorded(recording: RecordingPath, topic: str) -> list[Any]: ...


@overload
def recorded(recording: RecordingPath, topic: str, cls: type[Message]) -> list[Message]: ...


def recorded(recording: RecordingPath, topic: str, cls: Any = None) -> list[Any]:
    """The messages of one topic, as on the wire, of a recording or a run directory, in their order.

    Their type is needed only for types of one's own.

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
    """What a node publishes, as `drive` returns it, to what a node of a recording received.

    `name` is the node of the recorded graph, or of a run directory's, whose place it takes. Without
    a name it is its own, or, if it was not there, it subscribes to the topics that it declares. Its
    parameters, if None, are those that were recorded where it takes its own place.

    Raises ValueError if the recording cannot be read, or has no such place for the node.
    """
    bag = _open(recording)
    place = _recorded_place(bag, node, name)
    if params is None and place is not None and _holds(place, node):
        params = place.wiring(node.params).params
    given = params_of(node, params)
    edges = _inputs(bag, node, place)
    wiring = lone_wiring(given, edges, node.outputs, place.name if place else "node")
    work = NodeWork(node, given, wiring, recorded_changes(bag.messages(), node, wiring))
    publishers = {one.topic: one.publisher for one in edges}
    published: list[Outgoing | Finished] = work.begin()
    # Processes of one machine share the clock; the recorder may have another order.
    for kept in sorted(bag.messages(), key=lambda kept: kept.sent_ns):
        if kept.topic in publishers:
            header = Header(kept.run, kept.epoch, kept.seq, kept.sent_ns, 0.0, kept.schema)
            published += work.take(Received(publishers[kept.topic], kept.topic, header, kept.body))
    return decoded_outputs(node, published)


def _open(recording: RecordingPath) -> recordings.Recording:
    path = Path(recording)
    return recordings.open_recording(path / TOPICS_FILE if path.is_dir() else path)


def _decoded(kept: recordings.RecordedMessage, cls: type | None) -> object:
    wanted = cls or TYPES.get(kept.type)
    if wanted is None:
        raise ValueError(
            f"{kept.topic} holds {kept.type}, which palpate does not have; name the type"
        )
    if kept.schema != schema_hash(wanted):
        raise ValueError(f"{kept.topic} is not a {wanted.__name__} of this version")
    return decode(wanted, kept.body)


def _recorded_place(bag: recordings.Recording, node: Node, name: str | None) -> RecordedNode | None:
    """The place in the recorded graph that the node takes; None if it was not there."""
    places = recorded_nodes(bag.graph) if bag.graph else ()
    if name is None:
        own = [one for one in places if _holds(one, node)]
        if len(own) > 1:
            names = ", ".join(one.name for one in own)
            raise ValueError(f"recording {bag.path} has {names}; say with name whose place to take")
        return own[0] if own else None
    named = {one.name: one for one in places}
    if name not in named:
        known = ", ".join(named) or "none"
        raise ValueError(f"recording {bag.path} has no node {name!r}; it has {known}")
    return named[name]


def _holds(place: RecordedNode, node: Node) -> bool:
    """Whether this very node was there; nothing is imported to find out."""
    return getattr(sys.modules.get(place.module), "NODE", None) is node


def _inputs(bag: recordings.Recording, node: Node, place: RecordedNode | None) -> tuple[Input, ...]:
    """What the node receives of the recording."""
    own = (
        Input("recording", topic, topic, cls.__name__) for topic, (cls, _) in node.inputs.items()
    )
    found = [one for one in own if one.topic in bag.counts]
    if place is not None:
        found = [one for one in place.inputs if one.local in node.inputs]
    if not found and node.inputs:
        whose = f"what {place.name} received in it" if place else "its topics"
        wanted = ", ".join(node.inputs)
        raise ValueError(f"recording {bag.path}: the node subscribes to {wanted}, none of {whose}")
    return tuple(found)
