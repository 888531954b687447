"""Where a node stands in a graph: its checked parameters, and its topics on the wire."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.launch.convert import convert
from palpate.launch.entry import Entry
from palpate.launch.kinds import node_of
from palpate.launch.nearest import hint
from palpate.messages.bus.place import LAUNCHER
from palpate.nodes.node import Node, Sink

_NAME = re.compile(r"[a-z][a-z0-9_]{0,31}")
_TOPIC = re.compile(r"(/[a-z][a-z0-9_]*)+")


@dataclass(frozen=True, slots=True)
class Placed:
    """An entry whose node is known."""

    entry: Entry
    node: Node | Sink
    params: Any
    """An instance of the node's own parameter type."""
    outputs: Mapping[str, str]
    """The topic as the node calls it, to the topic on the wire."""


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
        node = node_of(entry)
        _check_remap(entry, node)
        outputs = {} if isinstance(node, Sink) else _outputs(entry, node)
        placed[entry.name] = Placed(entry, node, _params(entry, node.params), outputs)
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
        if isinstance(one.node, Sink):
            continue
        for local, topic in one.outputs.items():
            if topic in found:
                other = found[topic].placed.entry.name
                raise one.entry.error(
                    f"publishes {topic}, which {other!r} publishes already; "
                    "put one into a namespace or remap the topic"
                )
            found[topic] = Publisher(one, one.node.outputs[local])
    return found


def is_left_out(entry: Entry, node: Node, topic: str) -> bool:
    """Whether another finger's node hears or says this topic for all of them."""
    return entry.finger > 1 and topic in node.shared


def _outputs(entry: Entry, node: Node) -> dict[str, str]:
    """The topic as the node calls it, to the topic on the wire."""
    said = [topic for topic in node.outputs if not is_left_out(entry, node, topic)]
    return {topic: _on_wire(entry, node, topic) for topic in said}


def _on_wire(entry: Entry, node: Node, topic: str) -> str:
    if topic in entry.remap:
        return entry.remap[topic]
    outside = not entry.namespace or (entry.finger and topic in node.shared)
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


def _check_remap(entry: Entry, node: Node | Sink) -> None:
    known = () if isinstance(node, Sink) else (*node.inputs, *node.outputs)
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
