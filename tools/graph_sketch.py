"""The wiring of a graph as it is drawn: its boxes, its wires, and both as text for other programs.

Nodes of the same kind, one for each finger, are one stack. Who receives everything has no wires.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from palpate.launch.graph import Graph, ResolvedNode, plain_params, resolve_nodes
from palpate.nodes.runtime.node import Node, Sink, Wiring

MAX_PARAM_LETTERS = 400  # Of the parameters in a title
TIMES = "\N{MULTIPLICATION SIGN}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A node, or the nodes of several fingers."""

    text: str  # What it is called
    title: str  # Names, modules and parameters
    count: int = 1  # How many nodes it stands for
    ends: bool = False  # Whether its Finished ends the graph

    @property
    def name(self) -> str:
        """Its name, and how many there are."""
        return self.text if self.count == 1 else f"{self.text} {TIMES} {self.count}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """Topics that go from one box to others."""

    source: int  # Index of the box that publishes them
    targets: tuple[int, ...]  # Boxes that subscribe, once each; none if only sinks do
    labels: tuple[str, ...]  # One for each topic
    title: str  # Topics, types, publishers and subscribers
    latched: bool = False  # Whether somebody waits for it before anything else


class Sketch(NamedTuple):
    """A graph, ready to be laid out."""

    boxes: tuple[Box, ...]  # In the order of the launch file, without sinks
    wires: tuple[Wire, ...]  # Each with one source
    sinks: tuple[Box, ...]  # Who subscribes to every topic

    def labels(self) -> list[tuple[Box, str]]:
        """What stands in each box, those of the sinks last."""
        sinks = ((sink, f"{sink.name}: subscribes to every topic") for sink in self.sinks)
        return [*((box, box.name) for box in self.boxes), *sinks]


def sketch_of(graph: Graph) -> Sketch:
    """What is to be drawn of a graph; raises InputError if it could not run."""
    wirings = {wiring.name: wiring for wiring in graph.wirings()}
    types = {topic: cls.__name__ for topic, cls in graph.topics().items()}
    stacks: dict[tuple[str, str], list[ResolvedNode]] = {}
    sinks, latched = [], set[str]()
    for one in resolve_nodes(graph.entries):
        if isinstance(one.node, Sink):
            sinks.append(_box([one], graph.ends))
            continue
        stacks.setdefault((one.entry.group, one.entry.module), []).append(one)
        needs = one.node.needs if isinstance(one.node, Node) else ()
        inputs = wirings[one.entry.name].inputs
        latched |= {edge.topic for edge in inputs if edge.local in needs}
    box_of = {one.entry.name: i for i, stack in enumerate(stacks.values()) for one in stack}
    wires = []
    for source, stack in enumerate(stacks.values()):
        alike: dict[str, list[tuple[Wiring, str]]] = {}  # What the nodes of a stack call the same
        for one in stack:
            wiring = wirings[one.entry.name]
            for local, topic in wiring.outputs.items():
                alike.setdefault(local, []).append((wiring, topic))
        for local, topics in alike.items():
            told, targets = [], set[int]()
            for wiring, topic in topics:
                to = wiring.subscribers[topic]
                told.append(
                    f"{topic}: {types[topic]}, {wiring.name} to {', '.join(to) or 'nobody'}"
                )
                targets |= {box_of[name] for name in to if name in box_of}
            wire = Wire(
                source=source,
                targets=tuple(sorted(targets)),
                labels=(topics[0][1] if len(topics) == 1 else f"{local} {TIMES} {len(topics)}",),
                title="\n".join(told),
                latched=any(topic in latched for _, topic in topics),
            )
            wires.append(wire)
    boxes = tuple(_box(stack, graph.ends) for stack in stacks.values())
    return Sketch(boxes, tuple(wires), tuple(sinks))


def _box(stack: Sequence[ResolvedNode], ends: str) -> Box:
    lines = []
    for one in stack:
        params = json.dumps(plain_params(one.params), ensure_ascii=False)
        if len(params) > MAX_PARAM_LETTERS:
            params = params[:MAX_PARAM_LETTERS] + " ..."
        lines.append(f"{one.entry.name}: {one.entry.module} {params}")
    first = stack[0].entry
    return Box(
        text=first.group if len(stack) > 1 else first.name,
        title="\n".join(lines),
        count=len(stack),
        ends=any(one.entry.name == ends for one in stack),
    )


def joined(wires: Iterable[Wire]) -> tuple[Wire, ...]:
    """Wires between the same boxes as one."""
    found: dict[object, Wire] = {}
    for wire in wires:
        key = (wire.source, wire.targets, wire.latched)
        if known := found.get(key):
            labels, title = known.labels + wire.labels, f"{known.title}\n{wire.title}"
            wire = replace(known, labels=labels, title=title)
        found[key] = wire
    return tuple(found.values())


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
    """To which node an arrow goes; a topic that only sinks receive goes nowhere."""
    for number, wire in enumerate(joined(sketch.wires)):
        for target in [f"n{target}" for target in wire.targets] or [f"nowhere{number}"]:
            yield target, wire
