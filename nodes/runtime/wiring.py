"""One node's place in a graph, its publishers and subscribers, and how a recording keeps it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Literal

import msgspec

from palpate.nodes.runtime.node import HANDLER_TIMEOUT, AnyNode, Node, Sink, Source

# What is done when a node dies: it is started again, the run ends, or it goes on without.
OnExit = Literal["restart", "stop", "ignore"]
RECORDER = "palpate.nodes.recorder"


@dataclass(frozen=True, slots=True)
class Input:
    """One edge of the graph, seen from its hearing end."""

    publisher: str  # Name of the node that publishes the topic
    topic: str  # The topic on the wire, with namespace and remapping applied
    local: str  # The topic as the node calls it
    type: str  # Name of the message type
    schema: str = ""  # JSON schema of a type that palpate does not have; empty of its own


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiring:
    """Everything that a process must know to run its node."""

    name: str  # Name of the node in the graph
    module: str  # Module that holds ``NODE``, ``SOURCE`` or ``SINK``
    params: Any  # Parameters: an instance of the node's own type
    inputs: tuple[Input, ...]  # What it subscribes to
    outputs: Mapping[str, str]  # The topic as the node calls it, to the topic on the wire
    listeners: Mapping[str, tuple[str, ...]]  # Topic on the wire to the names of its subscribers
    # Topic on the wire to the name of its message type.
    types: Mapping[str, str] = field(default_factory=dict)
    host: str = ""  # Address of the machine on which it runs; empty for the launcher's
    nice: int = 0  # How far its process stands back when the processor is busy, from 0 to 19
    on_exit: OnExit = "restart"  # What is done when it dies
    # Longest time for which it may give no sign of life though it works, s.
    handler_timeout: float = HANDLER_TIMEOUT
    # Whether what it publishes is kept beyond its death, for it could not publish it again.
    persistent: bool = False


def lone_wiring(
    params: Any, inputs: Iterable[Input], topics: Iterable[str], name: str = "node"
) -> Wiring:
    """The wiring of a node by itself, whose topics on the wire are called as it calls them."""
    return Wiring(
        name=name,
        module="",
        params=params,
        inputs=tuple(inputs),
        outputs={topic: topic for topic in topics},
        listeners={},
    )


def load_node(module: str) -> AnyNode:
    """The node that a module holds.

    Raises ValueError if there is no such module or it holds no node.
    """
    if not all(part.isidentifier() for part in module.split(".")):
        raise ValueError(f"{module!r} is no name of a module")
    try:
        found = import_module(module)
    except ModuleNotFoundError as error:
        raise ValueError(f"no module {module!r}: {error}") from None
    for name in ("NODE", "SOURCE", "SINK"):
        value = getattr(found, name, None)
        if isinstance(value, (Node, Source, Sink)):
            return value
    raise ValueError(f"module {module!r} holds no NODE, no SOURCE and no SINK")


class RecordedNode(msgspec.Struct, frozen=True, kw_only=True):
    """One node's place in a graph that was recorded."""

    name: str
    module: str
    params: msgspec.Raw  # JSON of the node's own parameters
    inputs: tuple[Input, ...]
    outputs: dict[str, str]  # The topic as the node calls it, to the topic on the wire
    types: dict[str, str] = {}  # The topic on the wire to the name of its message type
    nice: int = 0
    on_exit: OnExit = "restart"

    def wiring(self, params: type) -> Wiring:
        """The node's wiring, given the type of its parameters.

        Raises ValueError if the recorded parameters are not of that type.
        """
        try:
            value: Any = msgspec.json.decode(self.params, type=params)
        except msgspec.DecodeError as error:
            raise ValueError(
                f"the recorded parameters of {self.name} do not fit: {error}"
            ) from None
        rest = {name: getattr(self, name) for name in RECORDED if name != "params"}
        return Wiring(params=value, listeners={}, **rest)


RECORDED = RecordedNode.__struct_fields__


def describe_wirings(wirings: Sequence[Wiring]) -> bytes:
    """Describe a graph in JSON, parameters included, for a recorder to keep."""
    return msgspec.json.encode([{name: getattr(one, name) for name in RECORDED} for one in wirings])


def recorded_nodes(graph: bytes) -> tuple[RecordedNode, ...]:
    """Read what `describe_wirings` wrote.

    Raises ValueError if it is no such description.
    """
    try:
        return msgspec.json.decode(graph, type=tuple[RecordedNode, ...])
    except msgspec.DecodeError as error:
        raise ValueError(f"this is no description of a graph: {error}") from None


def publishers_of(graph: bytes) -> Mapping[str, str]:
    """Topic on the wire to the node that publishes it; nothing of an empty description."""
    if not graph:
        return {}
    return {topic: one.name for one in recorded_nodes(graph) for topic in one.outputs.values()}


def schemas_of(graph: bytes) -> Mapping[str, str]:
    """Name of each message type that palpate does not have, to its JSON schema."""
    if not graph:
        return {}
    received = [edge for one in recorded_nodes(graph) for edge in one.inputs]
    return {edge.type: edge.schema for edge in received if edge.schema}


def with_description(wirings: Sequence[Wiring], about: Mapping[str, str]) -> tuple[Wiring, ...]:
    """The same graph, whose recorders have been given its description and other texts about it."""
    graph = describe_wirings(wirings)
    return tuple(
        replace(one, params=msgspec.structs.replace(one.params, graph=graph, about=dict(about)))
        if one.module == RECORDER
        else one
        for one in wirings
    )
