"""For tests of nodes: drive one by plain calls, make messages, and compare them bit by bit.

Nothing here has a socket. Every message is encoded and decoded on its way in and out, held back
until the node's needs have come, and refused if it is not what the node declares.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeVar

import msgspec
import numpy as np

from palpate.messages import Header, codec_of, decode, encode, first_difference, schema
from palpate.messages.bus import Received
from palpate.nodes.runtime.node import Finished, Node, Source
from palpate.nodes.runtime.sources import SourceWork
from palpate.nodes.runtime.wiring import Input, lone_wiring
from palpate.nodes.runtime.work import NodeWork, Outgoing

# Topic, as the node calls it, and message each, in the order in which they were published.
Published = list[tuple[str, Any] | Finished]
Message = TypeVar("Message")
_PLAIN: dict[str, Any] = {
    "number": 0.0,
    "integer": 0,
    "boolean": False,
    "string": "",
    "array": (),
}


def drive(
    node: Node | Source,
    inputs: Iterable[tuple[str, object] | Finished] = (),
    params: object = None,
    *,
    most: int | None = None,
) -> Published:
    """What a node publishes from its start on, given what it receives.

    Parameters
    ----------
    node : Node or Source
        What to drive.
    inputs : pairs of str and message
        Topic, as the node calls it, and message each; nothing of a source. Finished is passed
        over, so that what one node publishes can be given to the next.
    params : map, Struct or None
        Parameters as a launch file has them, or an instance of the node's own type; None for
        all defaults.
    most : int, optional
        Ask a source for no more than so many messages: what comes from outside may never end.

    Returns
    -------
    list
        Pairs of topic and message, read-only as a listener gets them, and Finished.

    Raises
    ------
    ValueError
        If the parameters are not the node's, the node does not subscribe to a topic, or a message
        is not of its type.
    ContractError
        If the node publishes what it does not declare. What its handlers raise is handed on.
    """
    given = params_of(node, params)
    if isinstance(node, Source):
        if list(inputs):
            raise ValueError("a source subscribes to nothing; give it no inputs")
        return list(_published_by(node, given, most))
    edges = [Input("test", topic, topic, cls.__name__) for topic, (cls, _) in node.inputs.items()]
    work = NodeWork(node, given, lone_wiring(given, edges, node.outputs))
    counts = Counter[str]()
    published = work.begin()
    for topic, message in (one for one in inputs if not isinstance(one, Finished)):
        published += work.take(_arrival(node, topic, message, counts[topic]))
        counts[topic] += 1
    return decoded_outputs(node, published)


def _published_by(
    source: Source, params: Any, most: int | None
) -> Iterator[tuple[str, Any] | Finished]:
    """What a source publishes until it ends, or has published so much; nothing is waited for."""
    outputs = source.outputs(params)
    work = SourceWork(source, params, lone_wiring(params, (), outputs))
    list(work.begin())
    for number, one in enumerate(work.all()):
        if isinstance(one, Finished):
            yield one
            return
        yield one.topic, decode(outputs[one.topic], one.body)
        if number + 1 == most:
            return


def _arrival(node: Node, topic: str, message: object, seq: int) -> Received:
    """A message on its way to a node."""
    if topic not in node.inputs:
        subscriptions = ", ".join(node.inputs) or "nothing"
        raise ValueError(
            f"the node does not subscribe to {topic}; it subscribes to {subscriptions}"
        )
    wanted = node.inputs[topic][0]
    if type(message) is not wanted:
        raise ValueError(
            f"the node subscribes to {topic} as {wanted.__name__}, got a {type(message).__name__}"
        )
    return Received(
        "test", topic, Header(0, 0, seq, 0, 0.0, codec_of(wanted).hash), encode(message)
    )


def params_of(node: Node | Source, params: object) -> Any:
    """The parameters on their way to a process, and back.

    Raises ValueError if they are not the node's.
    """
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
    """A message of which only some fields matter.

    Parameters
    ----------
    cls : type
        The message type.
    fields : values
        Those that matter; the others are 0, empty, the first word that is allowed or, if they
        have one, their default. An array has no rows where its type leaves their number open.

    Raises
    ------
    ValueError
        If the type has no such field, or a value does not fit.
    """
    described = schema(cls)["properties"]
    unknown = sorted(fields.keys() - described.keys())
    if unknown:
        raise ValueError(f"a {cls.__name__} has no {unknown[0]}; it has {', '.join(described)}")
    defaults = {
        field.name
        for field in dataclasses.fields(cls)  # type: ignore[arg-type]
        if field.default is not dataclasses.MISSING
        or field.default_factory is not dataclasses.MISSING
    }
    plain = {name: _plain(rule) for name, rule in described.items() if name not in defaults}
    message = cls(**{**plain, **fields})
    encode(message)
    return message


def _plain(rule: dict[str, Any]) -> Any:
    """The plainest value that a field of this schema may have."""
    if "anyOf" in rule:
        return None
    if "enum" in rule:
        return rule["enum"][0]
    if "dtype" in rule:
        return np.zeros(
            [0 if length is None else length for length in rule["shape"]], rule["dtype"]
        )
    return {} if rule["type"] == "object" else _PLAIN[rule["type"]]


def messages_on(published: Sequence[tuple[str, Any] | Finished], topic: str) -> list[Any]:
    """The messages on one topic, in their order."""
    return [one[1] for one in published if not isinstance(one, Finished) and one[0] == topic]


def assert_same(
    published: Sequence[tuple[str, object] | Finished],
    expected: Sequence[tuple[str, object] | Finished],
) -> None:
    """Compare what was published with what is expected, bit by bit.

    Raises
    ------
    AssertionError
        With the first message, and the first field in it, that differs.
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
