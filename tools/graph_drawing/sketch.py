"""What is to be drawn of a graph: boxes and wires, before anything has a place.

Nodes of the same kind, one for each finger, are one stack. Who receives everything has no wires.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from palpate.launch import Graph, ResolvedNode, plain_params, resolve_nodes
from palpate.nodes.runtime import Node, Wiring

MOST_LETTERS = 400  # Of the parameters in a title


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A node, or the nodes of several fingers."""

    text: str  # What it is called
    kind: str = ""  # Its module, where the name does not tell it
    title: str  # What is said of it when it is pointed at
    count: int = 1  # How many nodes it stands for
    ends: bool = False  # Whether its Finished ends the graph


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """Topics that go from one box to others."""

    source: int  # Index of the box that publishes them
    # Indices of the boxes that hear them, without repetition; none if only sinks do.
    targets: tuple[int, ...]
    labels: tuple[str, ...]  # One for each topic
    title: str  # What is said of it when it is pointed at
    latched: bool = False  # Whether somebody waits for it before anything else


@dataclass(frozen=True, slots=True)
class Sketch:
    """A graph, ready to be laid out."""

    boxes: tuple[Box, ...]  # In the order of the launch file, without sinks
    wires: tuple[Wire, ...]  # Each with one source
    sinks: tuple[Box, ...]  # Who hears every topic


def sketch_of(graph: Graph) -> Sketch:
    """What is to be drawn of a graph.

    Raises
    ------
    InputError
        If the graph could not run.
    """
    wirings = {wiring.name: wiring for wiring in graph.wirings()}
    placed = resolve_nodes(graph.entries)
    stacks = _stacks([one for one in placed if isinstance(one.node, Node)])
    box_of = {one.entry.name: i for i, stack in enumerate(stacks) for one in stack}
    latched = {
        heard.topic
        for one in placed
        if isinstance(one.node, Node)
        for heard in wirings[one.entry.name].inputs
        if heard.local in one.node.needs
    }
    types = {topic: said.__name__ for topic, said in graph.topics().items()}
    wires = [
        _wire(i, topics, box_of, latched, types)
        for i, stack in enumerate(stacks)
        for topics in _alike([wirings[one.entry.name] for one in stack])
    ]
    boxes = tuple(_box(stack, graph.ends) for stack in stacks)
    sinks = tuple(_box([one], graph.ends) for one in placed if not isinstance(one.node, Node))
    return Sketch(boxes, tuple(wires), sinks)


def _stacks(placed: Sequence[ResolvedNode]) -> list[list[ResolvedNode]]:
    """Nodes by themselves, but those of one kind for several fingers together."""
    stacks: dict[tuple[str, str], list[ResolvedNode]] = {}
    for one in placed:
        stacks.setdefault((one.entry.group, one.entry.module), []).append(one)
    return list(stacks.values())


def _box(stack: Sequence[ResolvedNode], ends: str) -> Box:
    lines = []
    for one in stack:
        params = json.dumps(plain_params(one.params), ensure_ascii=False)
        if len(params) > MOST_LETTERS:
            params = params[:MOST_LETTERS] + " ..."
        lines.append(f"{one.entry.name}: {one.entry.module} {params}")
    first = stack[0].entry
    return Box(
        text=first.group if len(stack) > 1 else first.name,
        kind="" if first.group == first.module.rpartition(".")[2] else first.module,
        title="\n".join(lines),
        count=len(stack),
        ends=any(one.entry.name == ends for one in stack),
    )


def _alike(wirings: Sequence[Wiring]) -> list[list[tuple[Wiring, str]]]:
    """The topics of a stack, those that its nodes call the same together."""
    alike: dict[str, list[tuple[Wiring, str]]] = {}
    for wiring in wirings:
        for local, topic in wiring.outputs.items():
            alike.setdefault(local, []).append((wiring, topic))
    return list(alike.values())


def _wire(
    source: int,
    topics: Sequence[tuple[Wiring, str]],
    box_of: Mapping[str, int],
    latched: Container[str],
    types: Mapping[str, str],
) -> Wire:
    """The wire of one topic, or of the topics of several fingers that are alike."""
    lines, targets = [], set()
    for wiring, topic in topics:
        heard = wiring.listeners[topic]
        lines.append(f"{topic}: {types[topic]}, {wiring.name} to {', '.join(heard) or 'nobody'}")
        targets |= {box_of[name] for name in heard if name in box_of}
    wiring, topic = topics[0]
    if len(topics) > 1:
        local = next(name for name, said in wiring.outputs.items() if said == topic)
        topic = f"{local} \N{MULTIPLICATION SIGN} {len(topics)}"
    return Wire(
        source=source,
        targets=tuple(sorted(targets)),
        labels=(topic,),
        title="\n".join(lines),
        latched=any(topic in latched for _, topic in topics),
    )


def joined(wires: Iterable[Wire]) -> tuple[Wire, ...]:
    """Wires between the same boxes as one."""
    joined: dict[object, Wire] = {}
    for wire in wires:
        key = (wire.source, wire.targets, wire.latched)
        known = joined.get(key)
        if known is not None:
            labels, title = known.labels + wire.labels, f"{known.title}\n{wire.title}"
            wire = replace(known, labels=labels, title=title)
        joined[key] = wire
    return tuple(joined.values())
