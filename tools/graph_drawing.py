"""The wiring of a graph drawn: as SVG, laid out in layers, or as text that other tools draw.

Layered drawing (Sugiyama, Tagawa and Toda, 1981): columns by the longest way, order within them by
the mean place of neighbours. A box publishes at its right, each line under its topics, and receives
at its left. In the gutter between two columns each line has an upright way of its own; what goes
further than to the next column runs above all boxes, what goes back below. So no line meets a box,
and no text anything but its own line.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

from palpate.launch import Graph
from palpate.launch.files import InputError, write_atomically
from palpate.tools.graph_sketch import Box, Sketch, Wire, dot_text, joined, mermaid_text, sketch_of

NAME, SMALL, TOPIC = 14.0, 10.5, 12.0  # Sizes in pixels: of names, of what is under them, of topics
MARGIN, PAD, GAP = 16.0, 9.0, 26.0  # Around all, within a box, between two boxes of a column
LINE, UNDER = 14.0, 4.0  # From one topic to the next, and from the last to its line
PORT, SLOT, LANE = 13.0, 8.0, 11.0  # Between lines that enter a box, that are upright, in lanes
CLEAR, SIDE, HEAD = 16.0, 8.0, 9.0  # From boxes to lanes, from labels to lines, an arrow head
CARD, STUB, FOOT, SAMPLE = 4.0, 16.0, 26.0, 26.0
NEAR = 3.0  # Lines of two wires that end side by side are farther apart
SWEEPS = 8
Edges = Mapping[int, Sequence[int]]  # Box to the boxes that subscribe
Point = tuple[float, float]  # To the right and down
_NARROW, _WIDE = frozenset("fijlrt/.,:;|!' ()[]-_1"), frozenset("mwMW@%")
_UNFIT = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_STYLE = Path(__file__).with_name("graph.css").read_text("utf-8")


def write_picture(graph: Graph, path: Path, title: str) -> None:
    """Draw the resolved wiring into a file: .svg, .mmd (Mermaid) or .dot (Graphviz).

    ``-`` is SVG on standard output. Raises InputError if the graph could not run, or the file
    cannot be written; then none has changed.
    """
    kind = ".svg" if str(path) == "-" else path.suffix
    writers: dict[str, Callable[[Sketch], str]] = {
        ".svg": partial(draw_svg, title=title),
        ".mmd": mermaid_text,
        ".dot": dot_text,
    }
    if kind not in writers:
        raise InputError(f"--graph: {path}: must end in one of {', '.join(writers)}")
    text = writers[kind](sketch_of(graph))
    if str(path) == "-":
        sys.stdout.write(text)
    else:
        write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})


def draw_svg(sketch: Sketch, title: str) -> str:
    """The wiring as the text of an SVG file."""
    places, strands, right, bottom = lay_out(sketch)
    parts = [line for one in strands for line in _strand_lines(one, places)]
    parts += [line for one in places for line in _box_lines(one)]
    legend, right = _legend(sketch, strands, bottom, right)
    wide, high = math.ceil(right), math.ceil(bottom + FOOT + MARGIN)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}" width="{wide}" '
        f'height="{high}" role="img" aria-label={quoteattr(_UNFIT.sub("?", title))}>',
        f"<title>{_safe(title)}</title>\n<style>\n{_STYLE}</style>",
        _rect("page", 0.5, 0.5, wide - 1.0, high - 1.0),
        *(*parts, *legend, "</svg>"),
    ]
    return "\n".join(lines) + "\n"


class Place(NamedTuple):
    """A box where it stands."""

    box: Box
    left: float
    top: float
    width: float
    height: float


@dataclass(slots=True)
class Strand:
    """A wire, or the part of one, that runs one way."""

    wire: Wire
    column: int  # Of its source
    reach: Mapping[int, int]  # The targets that it reaches this way, to their columns
    gutters: tuple[int, ...]  # In which it goes up or down; gutter i lies left of column i
    lane: int = 0  # Above the boxes, or below if it goes back; 0 is the one next to them
    exit: Point = (0.0, 0.0)  # Where it leaves its box
    height: float = 0.0  # Of its lane
    upright: dict[int, float] = field(default_factory=dict)  # By gutter, where it goes up or down
    entries: dict[int, float] = field(default_factory=dict)  # By target, where it enters

    @property
    def back(self) -> bool:
        """Whether it goes to its own column or to one before."""
        return self.gutters[:1] != (self.column + 1,) and bool(self.reach)

    @property
    def far(self) -> bool:
        """Whether it takes a lane."""
        return len(self.gutters) > 1

    @property
    def order(self) -> tuple[int, int]:
        """Its place at the side of a box, so that lines rarely cross."""
        if self.back:
            return 3, -self.lane
        return (0, -self.lane) if self.far else (1 if self.reach else 2, 0)

    @property
    def label_width(self) -> float:
        """Width of its longest topic."""
        return max(text_width(text, TOPIC) for text in self.wire.labels)


def lay_out(sketch: Sketch) -> tuple[list[Place], list[Strand], float, float]:
    """All boxes and strands in their places, and where to the right and below nothing stands."""
    edges: dict[int, list[int]] = {i: [] for i in range(len(sketch.boxes))}
    for wire in sketch.wires:
        edges[wire.source] += [one for one in wire.targets if one not in edges[wire.source]]
    columns = layers_of(edges)
    strands = _strands(sketch.wires, {box: i for i, one in enumerate(columns) for box in one})
    tops, heights = dict[int, float](), dict[int, float]()
    for number, column in enumerate(columns):
        _place_column(number, column, sketch.boxes, strands, tops, heights)
    above, below = (
        1 + max((one.lane for one in strands if one.back is back and one.far), default=-1)
        for back in (False, True)
    )
    top = min(tops.values(), default=0.0)
    down = MARGIN + (CLEAR + LANE * above if above else 0.0) + CARD - top
    highest = down + top - CARD - CLEAR
    lowest = down + max((tops[i] + heights[i] for i in tops), default=0.0) + CLEAR
    for one in strands:
        one.height = lowest + LANE * one.lane if one.back else highest - LANE * one.lane
        one.entries = {box: y + down for box, y in one.entries.items()}
    places = dict[int, Place]()
    x = _gutter(0, MARGIN, strands)
    for number, column in enumerate(columns):
        wide = 2.0 * PAD + max(
            max(text_width(box.name, NAME, bold=True), text_width(box.kind, SMALL))
            for box in (sketch.boxes[i] for i in column)
        )
        for i in column:
            places[i] = Place(sketch.boxes[i], x, tops[i] + down, wide, heights[i])
        leaving = [one for one in strands if one.column == number]
        for one in leaving:
            one.exit = x + wide, one.exit[1] + down
        labels = [one.label_width + (0.0 if one.reach else STUB) for one in leaving]
        x = _gutter(number + 1, x + wide + CARD + UNDER + max(labels, default=0.0), strands)
    return [places[i] for i in edges], strands, x, lowest + LANE * below + CLEAR


def _strands(wires: Sequence[Wire], column_of: Mapping[int, int]) -> list[Strand]:
    """Strands with their lanes: those that go on, and those that go back."""
    parts: dict[bool, list[Wire]] = {False: [], True: []}
    for wire in wires:
        start = column_of[wire.source]
        for back, some in parts.items():
            targets = tuple(t for t in wire.targets if (column_of[t] <= start) is back)
            if targets or not (wire.targets or back):
                some.append(replace(wire, targets=targets))
    strands = []
    for wire in (*joined(parts[False]), *joined(parts[True])):
        column, reach = column_of[wire.source], {t: column_of[t] for t in wire.targets}
        gutters = sorted({*reach.values(), column + 1}) if reach else []
        strands.append(Strand(wire, column, reach, tuple(gutters)))
    taken: dict[tuple[bool, int], list[Strand]] = {}
    lanes = [one for one in strands if one.far]  # The shortest first: what goes far arches over
    for one in sorted(lanes, key=lambda one: one.gutters[-1] - one.gutters[0]):
        while any(
            one.gutters[0] <= other.gutters[-1] and other.gutters[0] <= one.gutters[-1]
            for other in taken.get((one.back, one.lane), ())
        ):
            one.lane += 1
        taken.setdefault((one.back, one.lane), []).append(one)
    return strands


def _place_column(
    number: int,
    column: Sequence[int],
    boxes: Sequence[Box],
    strands: Sequence[Strand],
    tops: dict[int, float],
    heights: dict[int, float],
) -> None:
    """Heights of a column's boxes and of their lines; the first line from before is straight."""
    y, shift = 0.0, None
    for box in column:
        leaving = sorted((s for s in strands if s.wire.source == box), key=lambda s: s.order)
        entering = [s for s in strands if box in s.reach]
        entering.sort(key=lambda s: (1, 0) if s.column == number - 1 else s.order)
        slots = [len(one.wire.labels) * LINE + UNDER for one in leaving]
        least = NAME + UNDER + SMALL if boxes[box].kind else NAME
        tall = max(sum(slots), PORT * len(entering), least) + 2.0 * PAD
        tops[box], heights[box] = y, tall
        at = y + (tall - sum(slots)) / 2.0
        for one, slot in zip(leaving, slots, strict=True):
            at += slot
            one.exit = 0.0, at
        at = y + (tall - PORT * (len(entering) - 1)) / 2.0
        for one in entering:
            one.entries[box] = at
            if shift is None and one.column == number - 1:
                shift = one.exit[1] - at
            at += PORT
        y += tall + GAP
    for box in column:
        tops[box] += shift or 0.0
    for one in strands:
        if one.column == number:
            one.exit = 0.0, one.exit[1] + (shift or 0.0)
    for one in strands:
        for box in set(column) & set(one.reach):
            one.entries[box] += shift or 0.0
            others = [s.exit[1] for s in strands if s.column == number - 1 and s is not one]
            while any(abs(one.entries[box] - other) < NEAR for other in others):
                one.entries[box] += NEAR


def _gutter(number: int, x: float, strands: Sequence[Strand]) -> float:
    """Give each line in a gutter its upright way; gives the gutter's right end."""

    def key(one: Strand) -> tuple[int, float]:
        if one.column == number - 1:
            if one.far:
                return (1, one.lane) if one.back else (0, -one.lane)
            falls = next(iter(one.entries.values())) > one.exit[1]
            return (3, -one.exit[1]) if falls else (2, one.exit[1])
        return (5, -one.lane) if one.back else (4, one.lane)

    x += SIDE
    for one in sorted((s for s in strands if number in s.gutters), key=key):
        one.upright[number] = x
        x += SLOT
    return x + HEAD


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
    columns: list[list[int]] = [[] for _ in range(max(depth.values(), default=-1) + 1)]
    for box in edges:
        columns[depth[box]].append(box)
    place = {box: spot for column in columns for box, spot in _spots(column).items()}
    for sweep in range(SWEEPS):
        near = onward if sweep % 2 else before
        for column in reversed(columns) if sweep % 2 else columns:
            mean = {box: fmean(place[one] for one in near[box] or [box]) for box in column}
            column.sort(key=mean.__getitem__)
            place |= _spots(column)
    return columns


def back_edges(edges: Edges) -> set[tuple[int, int]]:
    """Edges to a box from which the way to their source has come; without them is no cycle."""
    back: set[tuple[int, int]] = set()
    seen: set[int] = set()
    for start in edges:
        # A way is kept by hand: a launch file may be deeper than Python's own stack.
        way = [] if start in seen else [(start, iter(edges[start]))]
        on_way = {start}
        seen.add(start)
        while way:
            box, rest = way[-1]
            target = next(rest, None)
            if target is None:
                way.pop()
                on_way.discard(box)
            elif target in on_way:
                back.add((box, target))
            elif target not in seen:
                seen.add(target)
                on_way.add(target)
                way.append((target, iter(edges[target])))
    return back


def _spots(column: Sequence[int]) -> dict[int, float]:
    """Places of a column's boxes, from 0 at its upper end to 1 at its lower."""
    return {box: (i + 0.5) / len(column) for i, box in enumerate(column)}


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Width of a text in a common sans-serif of this size, estimated without a font."""
    em = sum(0.35 if one in _NARROW else 0.86 if one in _WIDE else 0.56 for one in text)
    return size * em * (1.14 if bold else 1.0)


def _strand_lines(strand: Strand, places: Sequence[Place]) -> Iterator[str]:
    yield f'<g class="{"back" if strand.back else "ahead"}{" latched" * strand.wire.latched}">'
    yield f"<title>{_safe(strand.wire.title)}</title>"
    (x, y), ways = strand.exit, [_way(strand, target, places) for target in strand.reach]
    left = x + CARD + UNDER
    for way in ways:
        yield _arrow(way)
    if not ways:
        end = left + strand.label_width + STUB
        yield f'<path class="line" d="M{_n(x)},{_n(y)} H{_n(end)}"/>'
    for px, py in sorted(_forks(ways)) if ways else [(end, y)]:
        yield f'<circle class="head" cx="{_n(px)}" cy="{_n(py)}" r="2.6"/>'
    for i, text in enumerate(reversed(strand.wire.labels)):
        yield _text("topic", text, left, y - UNDER - LINE * i, TOPIC)
    yield "</g>"


def _way(strand: Strand, target: int, places: Sequence[Place]) -> list[Point]:
    """Corners of the line to one target."""
    (x, y), entry, gutter = strand.exit, strand.entries[target], strand.reach[target]
    out, into = strand.upright[strand.column + 1], strand.upright[gutter]
    way = [(x, y), (out, y)]
    if gutter != strand.column + 1:
        way += [(out, strand.height), (into, strand.height)]
    return [*way, (into, entry), (places[target].left, entry)]


def _forks(ways: Sequence[Sequence[Point]]) -> set[Point]:
    """Corners at which the lines of one strand part."""
    pieces = {(a, b) for way in ways for a, b in pairwise(way) if a != b}
    found = set()
    for x, y in {corner for way in ways for corner in way}:
        sides = set()
        for (ax, ay), (bx, by) in pieces:
            if min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by):
                sides |= {((e > x) - (e < x), (f > y) - (f < y)) for e, f in ((ax, ay), (bx, by))}
        if len(sides - {(0, 0)}) > 2:
            found.add((x, y))
    return found


def _arrow(way: Sequence[Point]) -> str:
    parts = [f"M{_n(way[0][0])},{_n(way[0][1])}"]
    x, y = way[-1]
    for (ax, ay), (bx, by) in pairwise((*way[:-1], (x - HEAD + 1.0, y))):
        parts += [f"H{_n(bx)}"] if ax != bx else [f"V{_n(by)}"] if ay != by else []
    back, half = x - HEAD, 0.42 * HEAD
    head = f"M{_n(x)},{_n(y)} L{_n(back)},{_n(y - half)} L{_n(back)},{_n(y + half)} Z"
    return f'<path class="line" d="{" ".join(parts)}"/>\n<path class="head" d="{head}"/>'


def _box_lines(place: Place) -> Iterator[str]:
    box, left, top, width, height = place
    card = "card ends" if box.ends else "card"
    yield f"<g>\n<title>{_safe(box.title)}</title>"
    if box.count > 1:
        yield _rect(card, left + CARD, top - CARD, width, height)
    yield _rect(card, left, top, width, height)
    middle, base = left + width / 2.0, top + height / 2.0 + 0.36 * NAME
    wide = text_width(box.name, NAME, bold=True)
    base -= (SMALL / 2.0 + 1.0) * bool(box.kind)
    yield _text("name", box.name, middle - wide / 2.0, base, NAME, bold=True)
    if box.kind:
        small = middle - text_width(box.kind, SMALL) / 2.0
        yield _text("small", box.kind, small, base + SMALL + UNDER, SMALL)
    yield "</g>"


def _legend(
    sketch: Sketch, strands: Sequence[Strand], top: float, right: float
) -> tuple[list[str], float]:
    """What the signs mean, and the sinks, side by side; and where the picture ends."""
    lines, x, y = [], MARGIN, top + FOOT / 2.0
    signs = {
        "latched": ("latched: received before all else", any(s.wire.latched for s in strands)),
        "back": ("feedback", any(s.back for s in strands)),
        "ends": ("ends the graph", any(box.ends for box in sketch.boxes)),
    }
    for name, (text, there) in signs.items():
        if there:
            sample = _rect("card ends", x, y - 7.0, SAMPLE, 14.0)
            arrow = f'<g class="{name}">{_arrow([(x, y), (x + SAMPLE, y)])}</g>'
            lines.append(sample if name == "ends" else arrow)
            lines.append(_text("small", text, x + SAMPLE + UNDER, y + 4.0, TOPIC))
            x += SAMPLE + UNDER + text_width(text, TOPIC) + MARGIN
    labels = sketch.labels()[len(sketch.boxes) :]
    wides = [text_width(label, TOPIC) + 2.0 * PAD for _, label in labels]
    end = max(right + MARGIN, x + sum(wides) + MARGIN * len(wides))
    x = end - sum(wides) - MARGIN * len(wides)
    for (sink, label), wide in zip(labels, wides, strict=True):
        lines += [f"<g>\n<title>{_safe(sink.title)}</title>", _rect("sink", x, top, wide, FOOT)]
        lines += [_text("small", label, x + PAD, y + 4.0, TOPIC), "</g>"]
        x += wide + MARGIN
    return lines, end


def _rect(name: str, left: float, top: float, width: float, height: float) -> str:
    place = f'x="{_n(left)}" y="{_n(top)}" width="{_n(width)}" height="{_n(height)}"'
    return f'<rect class="{name}" {place} rx="7"/>'


def _text(name: str, text: str, x: float, y: float, size: float, *, bold: bool = False) -> str:
    """A text that is as wide as was kept for it, whatever font there is."""
    wide = _n(text_width(text, size, bold=bold))
    return (
        f'<text class="{name}" x="{_n(x)}" y="{_n(y)}" font-size="{_n(size)}" '
        f'textLength="{wide}" lengthAdjust="spacingAndGlyphs">{_safe(text)}</text>'
    )


def _n(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _safe(text: str) -> str:
    """Text for XML, without the signs that XML cannot hold."""
    return escape(_UNFIT.sub("?", text))
