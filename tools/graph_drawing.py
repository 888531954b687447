"""The wiring of a graph drawn: as SVG, in layers, or as text for Mermaid and Graphviz.

Nodes of the same kind, one for each finger, are one stack. Who receives everything has no wires.
Layered drawing (Sugiyama, Tagawa and Toda, 1981): columns by the longest way, order within them by
the mean place of neighbours. A box publishes at its right, each line under its topics, and receives
at its left. In the gutter between two columns each line has an upright way of its own; what goes
further than to the next column has a lane above all boxes, what goes back one below. So no line
meets a box, and no text anything but its own line.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.source_map import InputError
from palpate.launch.graph import Graph, ResolvedNode, plain_params, resolve_nodes
from palpate.nodes.runtime.node import Node, Sink, Wiring

MAX_PARAM_LETTERS = 400  # Of the parameters in a title
TIMES = "\N{MULTIPLICATION SIGN}"
NAME, TOPIC = 14.0, 12.0  # Sizes of names and of other texts, in pixels
MARGIN, PAD, GAP = 16.0, 9.0, 26.0  # Around all, within a box, between two boxes of a column
LINE, UNDER = 14.0, 4.0  # From one topic to the next, and from the last to its line
PORT, SLOT, LANE = 13.0, 8.0, 11.0  # Between lines that enter a box, that are upright, in lanes
CLEAR, HEAD = 20.0, 9.0  # From boxes to lanes; an arrow head
CARD, STUB, FOOT = 4.0, 16.0, 26.0  # Of a stack; a line to nobody; height of the legend
NEAR = 3.0  # Lines of two wires that end side by side are farther apart
Edges = Mapping[int, Sequence[int]]  # Box to the boxes that subscribe
Point = tuple[float, float]  # To the right and down
_NARROW, _WIDE = frozenset("fijlrt/.,:;|!' ()[]-_1"), frozenset("mwMW@%")
_UNFIT = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_STYLE = Path(__file__).with_name("graph.css").read_text("utf-8")


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


def write_picture(graph: Graph, path: Path, title: str) -> None:
    """Draw the resolved wiring into a file: .svg, .mmd (Mermaid) or .dot (Graphviz).

    ``-`` is SVG on standard output. Raises InputError if the graph could not run, or the file
    cannot be written; then none has changed.
    """
    kind = ".svg" if str(path) == "-" else path.suffix
    writers: dict[str, Callable[[Sketch], str]] = {
        ".svg": partial(draw_svg, title=title),
        **{".mmd": mermaid_text, ".dot": dot_text},
    }
    if kind not in writers:
        raise InputError(f"--graph: {path}: must end in one of {', '.join(writers)}")
    write_drawing(path, writers[kind](sketch_of(graph)))


def write_drawing(path: Path, text: str) -> None:
    """Write a drawing whole, ``-`` to standard output; raises InputError if it cannot be."""
    if str(path) == "-":
        sys.stdout.write(text)
    else:
        write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})


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


def draw_svg(sketch: Sketch, title: str) -> str:
    """The wiring as the text of an SVG file."""
    places, strands, right, bottom = lay_out(sketch)
    parts = [line for one in strands for line in _strand_lines(one, places)]
    parts += [line for i, box in enumerate(sketch.boxes) for line in _box_lines(box, places[i])]
    legend, end = _legend(sketch, strands, bottom)
    wide, high = math.ceil(max(right + MARGIN, end)), math.ceil(bottom + FOOT + MARGIN)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}" width="{wide}" '
        f'height="{high}" role="img" aria-label={quoteattr(_UNFIT.sub("?", title))}>',
        f"<title>{_safe(title)}</title>\n<style>\n{_STYLE}</style>",
        _rect("page", (0.5, 0.5, wide - 1.0, high - 1.0)),
        *(*parts, *legend, "</svg>"),
    ]
    return "\n".join(lines) + "\n"


Place = tuple[float, float, float, float]  # Of a box: left, top, width, height


@dataclass(slots=True)
class Strand:
    """A wire, or the part of one, that runs one way."""

    wire: Wire
    column: int  # Of its source
    reach: Mapping[int, int]  # The targets that it reaches this way, to their columns
    back: bool  # Whether it goes to its own column or to one before
    lane: int = 0  # From 1, above the boxes, or below if it goes back; 0: it needs none
    exit: Point = (0.0, 0.0)  # Where it leaves its box
    height: float = 0.0  # Of its lane
    upright: dict[int, float] = field(default_factory=dict)  # By gutter, where it goes up or down
    entries: dict[int, float] = field(default_factory=dict)  # By target, where it enters

    @property
    def order(self) -> tuple[int, int]:
        """Its place at the side of a box and in a gutter, so that lines rarely cross."""
        return (3, -self.lane) if self.back else (0, -self.lane) if self.lane else (1, 0)

    @property
    def slot(self) -> float:
        """Height that it needs at the right of its box."""
        return len(self.wire.labels) * LINE + UNDER

    @property
    def width(self) -> float:
        """Width of its longest topic, and of what leads to nobody."""
        return max(text_width(text, TOPIC) for text in self.wire.labels) + STUB * (not self.reach)


def lay_out(sketch: Sketch) -> tuple[dict[int, Place], list[Strand], float, float]:
    """All boxes and strands in their places, and where to the right and below nothing stands."""
    edges: dict[int, list[int]] = {i: [] for i in range(len(sketch.boxes))}
    for wire in sketch.wires:
        edges[wire.source] += [one for one in wire.targets if one not in edges[wire.source]]
    columns = layers_of(edges)
    strands = _strands(sketch.wires, {box: i for i, one in enumerate(columns) for box in one})
    above, below = (
        max((one.lane for one in strands if one.back is back), default=0) for back in (False, True)
    )
    top = MARGIN + CARD + (CLEAR + LANE * above if above else 0.0)
    tall = {box: _tall(box, strands) for box in edges}
    deep = [sum(tall[box] + GAP for box in column) - GAP for column in columns]
    low = top + max(deep, default=0.0)
    for one in strands:
        one.height = low + CLEAR + LANE * one.lane if one.back else top - CLEAR - LANE * one.lane
    places, x = dict[int, Place](), MARGIN
    for number, column in enumerate(columns):
        wide = 2.0 * PAD + max(text_width(sketch.boxes[i].name, NAME, bold=True) for i in column)
        y = 0.5 * (top + low - deep[number])
        for box in column:
            places[box] = 0.0, y, wide, tall[box]
            _place_lines(number, box, y + 0.5 * tall[box], strands)
            y += tall[box] + GAP
        x = _gutter(number, x, strands)
        places |= {box: (x, *places[box][1:]) for box in column}
        leaving = [one for one in strands if one.column == number]
        for one in leaving:
            one.exit = x + wide, one.exit[1]
        x += wide + CARD + UNDER + max((one.width for one in leaving), default=0.0)
    x = _gutter(len(columns), x, strands)
    return places, strands, x, low + CLEAR + (CLEAR + LANE * below if below else 0.0)


def _strands(wires: Sequence[Wire], column_of: Mapping[int, int]) -> list[Strand]:
    """Strands with their lanes, in their order: those that go on, and those that go back."""
    strands = []
    for back in (False, True):
        some = []
        for wire in wires:
            start = column_of[wire.source]
            targets = tuple(t for t in wire.targets if (column_of[t] <= start) is back)
            if targets or not (wire.targets or back):
                some.append(replace(wire, targets=targets))
        found = [
            Strand(wire, column_of[wire.source], {t: column_of[t] for t in wire.targets}, back)
            for wire in joined(some)
        ]
        far = [one for one in found if set(one.reach.values()) - {one.column + 1}]
        # The shortest is next to the boxes: what goes far arches over.
        far.sort(key=lambda s: max(abs(column - s.column - 1) for column in s.reach.values()))
        for lane, one in enumerate(far, 1):
            one.lane = lane
        strands += found
    return sorted(strands, key=lambda one: one.order)


def _tall(box: int, strands: Sequence[Strand]) -> float:
    leaving = sum(one.slot for one in strands if one.wire.source == box)
    return max(leaving, PORT * sum(box in one.reach for one in strands), NAME) + 2.0 * PAD


def _place_lines(column: int, box: int, middle: float, strands: Sequence[Strand]) -> None:
    """Heights at which lines leave and enter a box."""
    leaving = [one for one in strands if one.wire.source == box]
    at = middle - 0.5 * sum(one.slot for one in leaving)
    for one in leaving:
        at += one.slot
        one.exit = 0.0, at - 0.5 * (LINE + UNDER)
    entering = [one for one in strands if box in one.reach]
    for i, one in enumerate(entering):
        at = middle + PORT * (i - 0.5 * (len(entering) - 1))
        others = [s.exit[1] for s in strands if s.column == column - 1 and s is not one]
        while any(abs(at - other) < NEAR for other in others):
            at += NEAR
        one.entries[box] = at


def _gutter(number: int, x: float, strands: Sequence[Strand]) -> float:
    """Give each line in a gutter its upright way; gives the gutter's right end."""

    def key(one: Strand) -> tuple[int, float]:
        if one.column != number - 1:
            return (5, -one.lane) if one.back else (4, one.lane)
        if one.lane:
            return one.order
        falls = next(iter(one.entries.values())) > one.exit[1]
        return (2, -one.exit[1]) if falls else (1, one.exit[1])

    through = [s for s in strands if s.reach and number in (s.column + 1, *s.reach.values())]
    for place, one in enumerate(sorted(through, key=key), 1):
        one.upright[number] = x + SLOT * place
    return x + SLOT * (len(through) + 1) + HEAD


def layers_of(edges: Edges) -> list[list[int]]:
    """Columns of boxes from left to right: a subscriber stands right of its publishers.

    Edges that go back to where they came from are not asked. The column is the length of the
    longest way to a box; within it, boxes are ordered by their neighbours' mean place.
    """
    back = back_edges(edges)
    onward = {box: [t for t in targets if (box, t) not in back] for box, targets in edges.items()}
    before: dict[int, list[int]] = {box: [] for box in edges}
    for box, targets in onward.items():
        for target in targets:
            before[target].append(box)
    depth: dict[int, int] = {}
    for box in TopologicalSorter(before).static_order():
        depth[box] = max((depth[one] + 1 for one in before[box]), default=0)
    deepest = max(depth.values(), default=-1)
    columns = [[box for box in edges if depth[box] == level] for level in range(deepest + 1)]
    place: dict[int, float] = {}
    for column in columns:
        column.sort(key=lambda box: fmean([place[one] for one in before[box]] or [0.0]))
        place |= {box: (i + 0.5) / len(column) for i, box in enumerate(column)}
    return columns


def back_edges(edges: Edges) -> set[tuple[int, int]]:
    """Edges to a box from which the way to their source has come; without them is no cycle."""
    back, seen = set[tuple[int, int]](), set[int]()
    for start in edges:
        # A way is kept by hand, its boxes to what is left of their edges: a launch file may be
        # deeper than Python's own stack.
        way = {} if start in seen else {start: iter(edges[start])}
        seen.add(start)
        while way:
            box = next(reversed(way))
            target = next(way[box], None)
            if target is None:
                del way[box]
            elif target in way:
                back.add((box, target))
            elif target not in seen:
                seen.add(target)
                way[target] = iter(edges[target])
    return back


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Width of a text in a common sans-serif of this size, estimated without a font."""
    em = sum(0.35 if one in _NARROW else 0.86 if one in _WIDE else 0.56 for one in text)
    return size * em * (1.14 if bold else 1.0)


def _strand_lines(strand: Strand, places: Mapping[int, Place]) -> Iterator[str]:
    yield f'<g class="{"back" if strand.back else "ahead"}{" latched" * strand.wire.latched}">'
    yield f"<title>{_safe(strand.wire.title)}</title>"
    (x, y), left = strand.exit, strand.exit[0] + CARD + UNDER
    for target, gutter in strand.reach.items():
        out, into = strand.upright[strand.column + 1], strand.upright[gutter]
        lane = [strand.height] if gutter != strand.column + 1 else []
        entry = strand.entries[target]
        corners = [(out, y), *((at, lane[0]) for at in (out, into) if lane), (into, entry)]
        yield _arrow([(x, y), *corners, (places[target][0], entry)])
    if not strand.reach:
        end = _n(left + strand.width)
        yield f'<path class="line" d="M{_n(x)},{_n(y)} H{end}"/>'
        yield f'<circle class="head" cx="{end}" cy="{_n(y)}" r="2.6"/>'
    for i, text in enumerate(reversed(strand.wire.labels)):
        yield _text("topic", text, (left, y - UNDER - LINE * i), TOPIC)
    yield "</g>"


def _arrow(way: Sequence[Point]) -> str:
    parts = [f"M{_n(way[0][0])},{_n(way[0][1])}"]
    x, y = way[-1]
    for (ax, ay), (bx, by) in pairwise((*way[:-1], (x - HEAD + 1.0, y))):
        parts += [f"H{_n(bx)}"] if ax != bx else [f"V{_n(by)}"] if ay != by else []
    back, half = _n(x - HEAD), 0.42 * HEAD
    head = f"M{_n(x)},{_n(y)} L{back},{_n(y - half)} L{back},{_n(y + half)} Z"
    return f'<path class="line" d="{" ".join(parts)}"/>\n<path class="head" d="{head}"/>'


def _box_lines(box: Box, place: Place) -> Iterator[str]:
    left, top, width, height = place
    card = "card ends" if box.ends else "card"
    yield f"<g>\n<title>{_safe(box.title)}</title>"
    if box.count > 1:
        yield _rect(card, (left + CARD, top - CARD, width, height))
    yield _rect(card, place)
    wide = text_width(box.name, NAME, bold=True)
    middle = left + (width - wide) / 2.0, top + height / 2.0 + 0.36 * NAME
    yield _text("name", box.name, middle, NAME, bold=True)
    yield "</g>"


def _legend(sketch: Sketch, strands: Sequence[Strand], top: float) -> tuple[list[str], float]:
    """What the signs mean, and the sinks, side by side; and where they end."""
    latched, back = any(s.wire.latched for s in strands), any(s.back for s in strands)
    signs = [("latched", "latched: received before all else", "")] * latched
    signs += [("back", "feedback", "")] * back
    signs += [("card ends", "ends the graph", "")] * any(box.ends for box in sketch.boxes)
    signs += [("sink", text, sink.title) for sink, text in sketch.labels()[len(sketch.boxes) :]]
    lines, x, y = [], MARGIN, top + FOOT / 2.0
    for name, text, title in signs:
        arrow = name in ("latched", "back")
        sign = _arrow([(x, y), (x + FOOT, y)]) if arrow else _rect(name, (x, y - 7.0, FOOT, 14.0))
        lines += [f'<g class="legend{f" {name}" * arrow}">\n<title>{_safe(title or text)}</title>']
        lines += [sign, _text("small", text, (x + FOOT + UNDER, y + 4.0), TOPIC), "</g>"]
        x += FOOT + UNDER + text_width(text, TOPIC) + MARGIN
    return lines, x


def _rect(name: str, place: Place) -> str:
    left, top, width, height = map(_n, place)
    return f'<rect class="{name}" x="{left}" y="{top}" width="{width}" height="{height}" rx="7"/>'


def _text(name: str, text: str, place: Point, size: float, *, bold: bool = False) -> str:
    """A text that is as wide as was kept for it, whatever font there is."""
    (x, y), wide = map(_n, place), _n(text_width(text, size, bold=bold))
    return (
        f'<text class="{name}" x="{x}" y="{y}" font-size="{_n(size)}" '
        f'textLength="{wide}" lengthAdjust="spacingAndGlyphs">{_safe(text)}</text>'
    )


def _n(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _safe(text: str) -> str:
    """Text for XML, without the signs that XML cannot hold."""
    return escape(_UNFIT.sub("?", text))
