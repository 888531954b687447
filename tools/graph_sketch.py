"""What is to be drawn of a graph: boxes and wires, also as text for Mermaid and Graphviz.

Nodes of the same kind, one for each finger, are one stack. Who receives everything has no wires.
"""

from __future__ import annotations

import json
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from palpate.launch import Graph, ResolvedNode, plain_params, resolve_nodes
from palpate.nodes.runtime import Node, Wiring

MAX_PARAM_LETTERS = 400  # Of the parameters in a title


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A node, or the nodes of several fingers."""

    text: str  # What it is called
    kind: str = ""  # Its module, where the name does not tell it
    title: str  # Names, modules and parameters
    count: int = 1  # How many nodes it stands for
    ends: bool = False  # Whether its Finished ends the graph

    @property
    def name(self) -> str:
        """Its name, and how many there are."""
        return self.text if self.count == 1 else f"{self.text} \N{MULTIPLICATION SIGN} {self.count}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """Topics that go from one box to others."""

    source: int  # Index of the box that publishes them
    targets: tuple[int, ...]  # Boxes that subscribe, once each; none if only sinks do
    labels: tuple[str, ...]  # One for each topic
    title: str  # Topics, types, publishers and subscribers
    latched: bool = False  # Whether somebody waits for it before anything else


@dataclass(frozen=True, slots=True)
class Sketch:
    """A graph, ready to be laid out."""

    boxes: tuple[Box, ...]  # In the order of the launch file, without sinks
    wires: tuple[Wire, ...]  # Each with one source
    sinks: tuple[Box, ...]  # Who subscribes to every topic


def sketch_of(graph: Graph) -> Sketch:
    """What is to be drawn of a graph.

    Raises InputError if the graph could not run.
    """
    wirings = {wiring.name: wiring for wiring in graph.wirings()}
    resolved = resolve_nodes(graph.entries)
    sinks = [one for one in resolved if not isinstance(one.node, Node)]
    stacks: dict[tuple[str, str], list[ResolvedNode]] = {}
    for one in resolved:
        if isinstance(one.node, Node):
            stacks.setdefault((one.entry.group, one.entry.module), []).append(one)
    box_of = {one.entry.name: i for i, stack in enumerate(stacks.values()) for one in stack}
    latched = {
        received.topic
        for one in resolved
        if isinstance(one.node, Node)
        for received in wirings[one.entry.name].inputs
        if received.local in one.node.needs
    }
    types = {topic: cls.__name__ for topic, cls in graph.topics().items()}
    return Sketch(
        tuple(_box(stack, graph.ends) for stack in stacks.values()),
        tuple(
            _wire(i, topics, box_of, latched, types)
            for i, stack in enumerate(stacks.values())
            for topics in _alike([wirings[one.entry.name] for one in stack])
        ),
        tuple(_box([one], graph.ends) for one in sinks),
    )


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
        names = wiring.listeners[topic]
        lines.append(f"{topic}: {types[topic]}, {wiring.name} to {', '.join(names) or 'nobody'}")
        targets |= {box_of[name] for name in names if name in box_of}
    wiring, topic = topics[0]
    if len(topics) > 1:
        local = next(name for name, sent in wiring.outputs.items() if sent == topic)
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
    found: dict[object, Wire] = {}
    for wire in wires:
        key = (wire.source, wire.targets, wire.latched)
        known = found.get(key)
        if known is not None:
            labels, title = known.labels + wire.labels, f"{known.title}\n{wire.title}"
            wire = replace(known, labels=labels, title=title)
        found[key] = wire
    return tuple(found.values())


def mermaid_text(sketch: Sketch) -> str:
    """The wiring as a Mermaid flowchart."""

    def quoted(text: str) -> str:
        return '"' + text.replace("#", "#35;").replace('"', "#quot;").replace("<", "#lt;") + '"'

    lines = ["flowchart LR"]
    for i, box in enumerate((*sketch.boxes, *sketch.sinks)):
        lines.append(f"  n{i}[{quoted(_label(sketch, i))}]")
        lines += [f"  style n{i} stroke-width:3px"] if box.ends else []
    for source, target, wire in _arrows(sketch):
        arrow = "-.->" if wire.latched else "-->"
        end = f"{target}(( ))" if not wire.targets else target
        lines.append(f"  {source} {arrow}|{quoted(', '.join(wire.labels))}| {end}")
    return "\n".join(lines) + "\n"


def dot_text(sketch: Sketch) -> str:
    """The wiring in the DOT language of Graphviz."""
    lines = ["digraph {", "  rankdir=LR", "  node [shape=box]"]
    for i, box in enumerate((*sketch.boxes, *sketch.sinks)):
        style = ", penwidth=3" if box.ends else ", style=dashed" if i >= len(sketch.boxes) else ""
        lines.append(f"  n{i} [label={json.dumps(_label(sketch, i), ensure_ascii=False)}{style}]")
    for source, target, wire in _arrows(sketch):
        if not wire.targets:
            lines.append(f"  {target} [shape=point]")
        label = json.dumps("\n".join(wire.labels), ensure_ascii=False)
        style = ", style=dashed" if wire.latched else ""
        lines.append(f"  {source} -> {target} [label={label}{style}]")
    return "\n".join([*lines, "}"]) + "\n"


def _label(sketch: Sketch, i: int) -> str:
    boxes = (*sketch.boxes, *sketch.sinks)
    return boxes[i].name if i < len(sketch.boxes) else sink_text(boxes[i])


def sink_text(sink: Box) -> str:
    """What stands in the box of one that receives everything."""
    return f"{sink.name}: subscribes to every topic"


def _arrows(sketch: Sketch) -> Iterator[tuple[str, str, Wire]]:
    """From and to which node an arrow goes; a topic that only sinks receive goes nowhere."""
    for number, wire in enumerate(joined(sketch.wires)):
        for target in wire.targets:
            yield f"n{wire.source}", f"n{target}", wire
        if not wire.targets:
            yield f"n{wire.source}", f"nowhere{number}", wire
