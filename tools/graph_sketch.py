"""The boxes and wires of a drawn graph, and both as text for other programs.

Nodes of the same kind, one for each finger, are one stack. Sinks, which subscribe to all topics,
have no wires.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from palpate.launch.graph import Graph, ResolvedNode, plain_params, resolve_nodes
from palpate.nodes.runtime.node import Node, Sink, Wiring

TIMES = "\N{MULTIPLICATION SIGN}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A node, or the nodes of several fingers."""

    text: str  # name
    title: str  # names, modules and parameters, for a tooltip
    count: int = 1  # of nodes
    ends: bool = False  # whether its Finished ends the graph

    @property
    def name(self) -> str:
        """Name and number of nodes."""
        return self.text if self.count == 1 else f"{self.text} {TIMES} {self.count}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """Topics that go from one box to others."""

    source: int  # index of the box that publishes them
    targets: tuple[int, ...]  # boxes that subscribe, once each; empty if only sinks do
    labels: tuple[str, ...]  # one for each topic
    title: str  # topics, types, publishers and subscribers, for a tooltip
    latched: bool = False  # whether a node waits for it before other topics


class Sketch(NamedTuple):
    """A graph as boxes and wires."""

    boxes: tuple[Box, ...]  # in the order of the launch file, without sinks
    wires: tuple[Wire, ...]  # each with one source
    sinks: tuple[Box, ...]  # nodes that subscribe to every topic

    def labels(self) -> list[tuple[Box, str]]:
        """Boxes with their texts, those of the sinks last."""
        sinks = ((sink, f"{sink.name}: subscribes to every topic") for sink in self.sinks)
        return [*((box, box.name) for box in self.boxes), *sinks]


def sketch_of(graph: Graph) -> Sketch:
    """Boxes and wires of a graph; raises InputError if it could not run."""
    wirings = {wiring.name: wiring for wiring in graph.wirings()}
    stacks: dict[tuple[str, str], list[ResolvedNode]] = {}
    sinks, latched = [], set[str]()
    for resolved in resolve_nodes(graph.entries):
        entry, node = resolved.entry, resolved.node
        if isinstance(node, Sink):
            sinks.append(_box([resolved], graph.ends))
            continue
        stacks.setdefault((entry.group, entry.module), []).append(resolved)
        needs = node.needs if isinstance(node, Node) else ()
        latched |= {edge.topic for edge in wirings[entry.name].inputs if edge.local in needs}
    boxes = tuple(_box(stack, graph.ends) for stack in stacks.values())
    names = [[node.entry.name for node in stack] for stack in stacks.values()]
    types = {topic: cls.__name__ for topic, cls in graph.topics().items()}
    return Sketch(boxes, tuple(_wires(names, wirings, types, latched)), tuple(sinks))


def _wires(
    stacks: Sequence[Sequence[str]],
    wirings: Mapping[str, Wiring],
    types: Mapping[str, str],
    latched: Container[str],
) -> Iterator[Wire]:
    """Wires from stacks of nodes, named by their nodes; `latched`: topics that a node waits for."""
    box_of = {name: i for i, stack in enumerate(stacks) for name in stack}
    for source, stack in enumerate(stacks):
        by_local: dict[str, list[tuple[Wiring, str]]] = {}
        for wiring in (wirings[name] for name in stack):
            for local, topic in wiring.outputs.items():
                by_local.setdefault(local, []).append((wiring, topic))
        for local, topics in by_local.items():
            lines, targets = [], set[int]()
            for wiring, topic in topics:
                to = wiring.subscribers[topic]
                link = f"{wiring.name} to {', '.join(to) or 'no node'}"
                lines.append(f"{topic}: {types[topic]}, {link}")
                targets |= {box_of[name] for name in to if name in box_of}
            yield Wire(
                source=source,
                targets=tuple(sorted(targets)),
                labels=(topics[0][1] if len(topics) == 1 else f"{local} {TIMES} {len(topics)}",),
                title="\n".join(lines),
                latched=any(topic in latched for _, topic in topics),
            )


def _box(stack: Sequence[ResolvedNode], ends: str, max_letters: int = 400) -> Box:
    """Box of a stack of nodes; `max_letters` of the parameters of a node in the tooltip."""
    lines = []
    for node in stack:
        params = json.dumps(plain_params(node.params), ensure_ascii=False)
        if len(params) > max_letters:
            params = params[:max_letters] + " ..."
        lines.append(f"{node.entry.name}: {node.entry.module} {params}")
    first = stack[0].entry
    return Box(
        text=first.group if len(stack) > 1 else first.name,
        title="\n".join(lines),
        count=len(stack),
        ends=any(node.entry.name == ends for node in stack),
    )


def joined(wires: Iterable[Wire]) -> tuple[Wire, ...]:
    """Wires, those between the same boxes as one."""
    merged: dict[object, Wire] = {}
    for wire in wires:
        key = (wire.source, wire.targets, wire.latched)
        if known := merged.get(key):
            labels, title = known.labels + wire.labels, f"{known.title}\n{wire.title}"
            wire = replace(known, labels=labels, title=title)
        merged[key] = wire
    return tuple(merged.values())


def mermaid_text(sketch: Sketch) -> str:
    """The wiring as a Mermaid flowchart."""

    def quoted(text: str) -> str:
        return '"' + text.replace("#", "#35;").replace('"', "#quot;").replace("<", "#lt;") + '"'

    lines = ["flowchart LR"]
    for i, (box, label) in enumerate(sketch.labels()):
        lines.append(f"  n{i}[{quoted(label)}]")
        lines += [f"  style n{i} stroke-width:3px"] if box.ends else []
    for target, wire in _arrows(sketch):
        arrow = "-.->" if wire.latched else "-->"
        end = target if wire.targets else f"{target}(( ))"
        lines.append(f"  n{wire.source} {arrow}|{quoted(', '.join(wire.labels))}| {end}")
    return "\n".join(lines) + "\n"


def dot_text(sketch: Sketch) -> str:
    """The wiring in the DOT language of Graphviz."""
    lines = ["digraph {", "  rankdir=LR", "  node [shape=box]"]
    for i, (box, label) in enumerate(sketch.labels()):
        style = ", penwidth=3" if box.ends else ", style=dashed" if i >= len(sketch.boxes) else ""
        lines.append(f"  n{i} [label={json.dumps(label, ensure_ascii=False)}{style}]")
    for target, wire in _arrows(sketch):
        lines += [] if wire.targets else [f"  {target} [shape=point]"]
        label = json.dumps("\n".join(wire.labels), ensure_ascii=False)
        style = ", style=dashed" if wire.latched else ""
        lines.append(f"  n{wire.source} -> {target} [label={label}{style}]")
    return "\n".join([*lines, "}"]) + "\n"


def _arrows(sketch: Sketch) -> Iterator[tuple[str, Wire]]:
    """Arrows by the name of their target; a topic that only sinks receive leads to a point."""
    for number, wire in enumerate(joined(sketch.wires)):
        for target in [f"n{target}" for target in wire.targets] or [f"nowhere{number}"]:
            yield target, wire
