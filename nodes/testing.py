"""Drives a node as the runtime would, without sockets: what is sent is what a listener gets.

Every message is encoded and decoded on its way in and out, held back until the node's needs have
come, and refused if it is not what the node declares.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec

from palpate.messages.bus.subscriber import Arrival
from palpate.messages.codec import codec_of, decode, encode
from palpate.messages.header import Header
from palpate.nodes.node import Finished, Node, Source
from palpate.nodes.runtime_source import SourceWork
from palpate.nodes.runtime_work import NodeWork, Parcel
from palpate.nodes.wiring import Input, Wiring

NAME = "node"
"""What a driven node is called in complaints."""

Heard = list[tuple[str, Any] | Finished]
"""Topic, as the node calls it, and message each, in the order in which they were said."""


def drive(
    node: Node | Source,
    inputs: Iterable[tuple[str, object] | Finished] = (),
    params: object = None,
    *,
    most: int | None = None,
) -> Heard:
    """What a node says from its start on, given what it hears.

    Parameters
    ----------
    node : Node or Source
        What to drive.
    inputs : pairs of str and message
        Topic, as the node calls it, and message each; nothing of a source. Finished is passed
        over, so that what one node says can be given to the next.
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
        If the parameters are not the node's, the node does not hear a topic, or a message is not
        of its type.
    ContractError
        If the node says what it does not declare. What its handlers raise is handed on.
    """
    given = params_of(node, params)
    if isinstance(node, Source):
        if list(inputs):
            raise ValueError("a source hears nothing; give it no inputs")
        return list(_said(node, given, most))
    heard = tuple(
        Input("test", local, local, cls.__name__) for local, (cls, _) in node.inputs.items()
    )
    outputs = {local: local for local in node.outputs}
    wiring = Wiring(name=NAME, module="", params=given, inputs=heard, outputs=outputs, listeners={})
    work, counts = NodeWork(node, given, wiring), Counter[str]()
    said = work.begin()
    for topic, message in (one for one in inputs if not isinstance(one, Finished)):
        said += work.take(_arrival(node, topic, message, counts[topic]))
        counts[topic] += 1
    return opened(node, said, outputs)


def params_of(node: Node | Source, params: object) -> Any:
    """The parameters on their way to a process, and back.

    Raises
    ------
    ValueError
        If they are not the node's.
    """
    try:
        data = msgspec.msgpack.encode({} if params is None else params)
        return msgspec.msgpack.decode(data, type=node.params)
    except (msgspec.ValidationError, TypeError) as error:
        raise ValueError(f"the parameters do not fit: {error}") from None


def opened(node: Node, said: Iterable[Parcel | Finished], outputs: Mapping[str, str]) -> Heard:
    """What a listener gets, topics as the node calls them.

    Parameters
    ----------
    node : Node
        Who said it.
    said : parcels and Finished
        On the wire.
    outputs : map
        The topic as the node calls it, to the topic on the wire.
    """
    local_of = {wire: local for local, wire in outputs.items()}
    heard: Heard = []
    for one in said:
        if isinstance(one, Finished):
            heard.append(one)
        else:
            local = local_of[one.topic]
            heard.append((local, decode(node.outputs[local], one.body)))
    return heard


def _arrival(node: Node, topic: str, message: object, seq: int) -> Arrival:
    """A message on its way to a node."""
    if topic not in node.inputs:
        hears = ", ".join(node.inputs) or "nothing"
        raise ValueError(f"the node does not hear {topic}; it hears {hears}")
    wanted = node.inputs[topic][0]
    if type(message) is not wanted:
        raise ValueError(
            f"the node hears {topic} as {wanted.__name__}, got a {type(message).__name__}"
        )
    return Arrival("test", topic, Header(0, 0, seq, 0, 0.0, codec_of(wanted).hash), encode(message))


def _said(source: Source, params: Any, most: int | None) -> Iterator[tuple[str, Any] | Finished]:
    """What a source says until it ends, or has said so much; nothing is waited for."""
    outputs = source.outputs(params)
    wires = {local: local for local in outputs}
    wiring = Wiring(name=NAME, module="", params=params, inputs=(), outputs=wires, listeners={})
    work = SourceWork(source, params, wiring)
    list(work.begin())
    for number, one in enumerate(work.all()):
        if isinstance(one, Finished):
            yield one
            return
        yield one.topic, decode(outputs[one.topic], one.body)
        if number + 1 == most:
            return
