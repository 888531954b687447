"""What a recording says of its graph, so that its nodes can be run again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec

from palpate.nodes.wiring import Input, OnExit, Wiring

RECORDER = "palpate.nodes.recorder"


class Recorded(msgspec.Struct, frozen=True, kw_only=True):
    """One node's place in a graph that was recorded."""

    name: str
    module: str
    params: msgspec.Raw
    """JSON of the node's own parameters."""
    inputs: tuple[Input, ...]
    outputs: dict[str, str]
    """The topic as the node calls it, to the topic on the wire."""
    types: dict[str, str] = {}
    """The topic on the wire to the name of its message type."""
    nice: int = 0
    on_exit: OnExit = "restart"

    def wiring(self, params: type) -> Wiring:
        """The node's wiring, given the type of its parameters.

        Raises
        ------
        ValueError
            If the recorded parameters are not of that type.
        """
        try:
            value: Any = msgspec.json.decode(self.params, type=params)
        except msgspec.DecodeError as error:
            raise ValueError(
                f"the recorded parameters of {self.name} do not fit: {error}"
            ) from None
        return Wiring(
            name=self.name,
            module=self.module,
            params=value,
            inputs=self.inputs,
            outputs=self.outputs,
            listeners={},
            types=self.types,
            nice=self.nice,
            on_exit=self.on_exit,
        )


def describe_wirings(wirings: Sequence[Wiring]) -> bytes:
    """Describe a graph in JSON, parameters included, for a recorder to keep."""
    return msgspec.json.encode(
        [
            {
                "name": one.name,
                "module": one.module,
                "params": one.params,
                "inputs": one.inputs,
                "outputs": one.outputs,
                "types": one.types,
                "nice": one.nice,
                "on_exit": one.on_exit,
            }
            for one in wirings
        ]
    )


def recorded_wirings(graph: bytes) -> tuple[Recorded, ...]:
    """Read what `describe_wirings` wrote.

    Raises
    ------
    ValueError
        If it is no such description.
    """
    try:
        return msgspec.json.decode(graph, type=tuple[Recorded, ...])
    except msgspec.DecodeError as error:
        raise ValueError(f"this is no description of a graph: {error}") from None


def publishers_of(graph: bytes) -> Mapping[str, str]:
    """Topic on the wire to the node that publishes it; nothing of an empty description."""
    if not graph:
        return {}
    return {topic: one.name for one in recorded_wirings(graph) for topic in one.outputs.values()}


def schemas_of(graph: bytes) -> Mapping[str, str]:
    """Name of each message type that palpate does not have, to its JSON schema."""
    if not graph:
        return {}
    heard = [edge for one in recorded_wirings(graph) for edge in one.inputs]
    return {edge.type: edge.schema for edge in heard if edge.schema}


def with_description(wirings: Sequence[Wiring], about: Mapping[str, str]) -> tuple[Wiring, ...]:
    """The same graph, whose recorders have been given its description and other texts about it."""
    graph = describe_wirings(wirings)
    return tuple(
        replace(one, params=msgspec.structs.replace(one.params, graph=graph, about=dict(about)))
        if one.module == RECORDER
        else one
        for one in wirings
    )
