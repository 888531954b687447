"""Where a node stands in a graph: its checked parameters, and its topics on the wire."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.launch.convert import convert
from palpate.launch.entry import Entry
from palpate.launch.hosts.addresses import read_host
from palpate.launch.kinds import node_of
from palpate.launch.located import InputError
from palpate.launch.nearest import hint
from palpate.messages.bus.place import LAUNCHER
from palpate.nodes.node import AnyNode, Node, Sink

_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_TOPIC = re.compile(r"(/[a-z][a-z0-9_]*)+")


@dataclass(frozen=True, slots=True)
class Placed:
    """An entry whose node is known."""

    entry: Entry
    node: AnyNode
    params: Any
    """An instance of the node's own parameter type."""
    types: Mapping[str, type]
    """What it says: the topic as the node calls it, to the message type."""
    outputs: Mapping[str, str]
    """The same topics, to the topic on the wire."""


@dataclass(frozen=True, slots=True)
class Publisher:
    """Who publishes a topic, and what."""

    placed: Placed
    type: type


def place(entries: Iterable[Entry]) -> tuple[Placed, ...]:
    """Find the node of each entry and check its name, parameters and remapping.

    Raises
    ------
    InputError
        If a name is taken or malformed, a kind or parameter is unknown, a parameter is of the
        wrong type or out of range, or a topic is remapped that the node does not have.
    """
    placed: dict[str, Placed] = {}
    for entry in entries:
        _check_name(entry, placed)
        _check_host(entry)
        node = node_of(entry)
        params = _params(entry, node.params)
        types = _types(entry, node, params)
        _check_remap(entry, node, types)
        outputs = {topic: _on_wire(entry, node, topic) for topic in types}
        placed[entry.name] = Placed(entry, node, params, types, outputs)
    return tuple(placed.values())


def publishers(placed: Iterable[Placed]) -> dict[str, Publisher]:
    """Topic on the wire to its one publisher.

    Raises
    ------
    InputError
        If two nodes publish one topic.
    """
    found: dict[str, Publisher] = {}
    for one in placed:
        for local, topic in one.outputs.items():
            if topic in found:
                other = found[topic].placed.entry.name
                raise one.entry.error(
                    f"publishes {topic}, which {other!r} publishes already; "
                    "put one into a namespace or remap the topic"
                )
            found[topic] = Publisher(one, one.types[local])
    return found


def is_left_out(entry: Entry, node: Node, topic: str) -> bool:
    """Whether another finger's node hears or says this topic for all of them."""
    return entry.finger > 1 and topic in node.shared


def _types(entry: Entry, node: AnyNode, params: Any) -> Mapping[str, type]:
    """What a node says, by the topic as the node calls it."""
    if isinstance(node, Sink):
        return {}
    if isinstance(node, Node):
        said = node.outputs.items()
        return {topic: kind for topic, kind in said if not is_left_out(entry, node, topic)}
    try:
        return node.outputs(params)
    except ValueError as error:
        raise entry.error(str(error)) from None


def _on_wire(entry: Entry, node: AnyNode, topic: str) -> str:
    if topic in entry.remap:
        return entry.remap[topic]
    shared = isinstance(node, Node) and topic in node.shared
    outside = not entry.namespace or (entry.finger and shared)
    return topic if outside else f"/{entry.namespace}{topic}"


def _check_name(entry: Entry, placed: Mapping[str, Placed]) -> None:
    rule = "a letter, then letters, digits and _, in lower case, at most 32"
    if not _NAME.fullmatch(entry.name):
        raise entry.error(f"the name must be {rule}")
    if entry.namespace and not _NAME.fullmatch(entry.namespace):
        raise entry.error(f"the namespace {entry.namespace!r} must be {rule}")
    if entry.name == LAUNCHER:
        raise entry.error("that is the launcher's own name; choose another")
    if entry.name in placed:
        first = placed[entry.name].entry.source
        raise entry.error(f"the name is taken{f' by {first}' if first else ''}; choose another")


def _check_host(entry: Entry) -> None:
    if entry.host:
        try:
            read_host(entry.host)
        except InputError as error:
            raise entry.error(str(error)) from None


def _check_remap(entry: Entry, node: AnyNode, says: Iterable[str]) -> None:
    # Of several fingers' nodes, those that leave a topic to the first may have it remapped, too.
    known = (*node.inputs, *node.outputs) if isinstance(node, Node) else tuple(says)
    for local, topic in entry.remap.items():
        if local not in known:
            raise entry.error(f"has no topic {local!r} to remap; {hint(local, known)}")
        if not _TOPIC.fullmatch(topic):
            raise entry.error(f"{local} cannot become {topic!r}; a topic looks like /touch/raw")


def _params(entry: Entry, kind: type) -> Any:
    if isinstance(entry.params, kind):
        return entry.params
    if not isinstance(entry.params, Mapping):
        raise entry.error(f"params must be a map, got {entry.params!r:.60}")
    return convert(entry.settings, kind, entry.name)
