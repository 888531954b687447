"""The ways of wires: strands, lanes and gutters, and the boxes that they leave and enter.

To the next column a strand runs straight. What goes further rises into a lane above all boxes,
what goes back sinks into one below, so that no line meets a box.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

from palpate.tools.graph_drawing.sizes import (
    BEND,
    CARD,
    CARDS,
    HEAD,
    LINE,
    NAME,
    PAD,
    PORT,
    ROW,
    SLOT,
    SMALL,
    STUB,
    TOPIC,
    UNDER,
    text_width,
)
from palpate.tools.graph_drawing.sketch import Box, Wire, joined

Point = tuple[float, float]  # To the right and down, in pixels
Line = tuple[Point, ...]
_SIDE = 6.0
_LEAST = 40.0
# Where a strand runs; a loose one ends where it begins, for nobody but sinks hears it.
Way = Literal["above", "straight", "loose", "below"]
_ORDER: Mapping[Way, int] = {"above": 0, "straight": 1, "loose": 2, "below": 3}


@dataclass(frozen=True, slots=True)
class RoutingPlan:
    """What lines run between."""

    boxes: Sequence[Rect]  # Front cards by index
    forms: Mapping[int, BoxForm]  # Where lines leave and enter them
    column_of: Mapping[int, int]  # Column of each box
    labels: Sequence[float]  # Left edges of the labels behind each column
    gutters: Sequence[Gutter]  # The gutter left of each column, and the last one
    gutter_lefts: Sequence[float]  # Left edges of the gutters
    above: float  # Height of the lowest lane above the boxes
    below: float  # Height of the highest lane below them

    def entry(self, strand: Strand, box: int) -> Point:
        """Where a strand enters a box."""
        rect = self.boxes[box]
        return rect.left, rect.top + self.forms[box].left[strand]

    def exit(self, strand: Strand) -> Point:
        """Where a strand leaves its box."""
        rect = self.boxes[strand.wire.source]
        return rect.right, rect.top + self.forms[strand.wire.source].right[strand]

    def turn_out(self, strand: Strand) -> float:
        """Where it turns into its lane."""
        gutter = strand.column + 1
        return self.gutter_lefts[gutter] + self.gutters[gutter].leaving[strand]

    def turn_in(self, strand: Strand, column: int) -> float:
        """Where it leaves its lane for a column."""
        return self.gutter_lefts[column] + self.gutters[column].entering[strand]

    def lane(self, strand: Strand) -> float:
        """Height of its lane."""
        if strand.way == "above":
            return self.above - ROW * strand.row
        return self.below + ROW * strand.row


def route_strands(strand: Strand, ground: RoutingPlan) -> DrawnStrand:
    """A strand with its labels and lines."""
    if strand.way == "loose":
        x, y = ground.exit(strand)
        end = ground.labels[strand.column] + _widest(strand) + STUB
        return DrawnStrand(strand, _labels(strand, ground), (((x, y), (end, y)),), ())
    if strand.way == "straight":
        lines, forks = _straight(strand, ground, ground.exit(strand), strand.wire.targets)
    else:
        lines, forks = _by_lane(strand, ground)
    return DrawnStrand(strand, _labels(strand, ground), tuple(lines), tuple(forks))


def _widest(strand: Strand) -> float:
    return max(text_width(text, TOPIC) for text in strand.wire.labels)


def _labels(strand: Strand, ground: RoutingPlan) -> tuple[Label, ...]:
    """One line for each topic, above the strand's own line."""
    left, y = ground.labels[strand.column], ground.exit(strand)[1] - 1.0
    labels = []
    for text in reversed(strand.wire.labels):
        rect = Rect(left, y - LINE, left + text_width(text, TOPIC), y)
        labels.append(Label(text, rect))
        y -= LINE
    return tuple(reversed(labels))


def _by_lane(strand: Strand, ground: RoutingPlan) -> tuple[list[Line], list[Point]]:
    """Lines along a lane: the first to the end of it, the others part from that one."""
    start, lane, out = ground.exit(strand), ground.lane(strand), ground.turn_out(strand)
    beside = strand.column + 1 if strand.way == "above" else None
    stops = [column for column in strand.reach if column != beside]
    if strand.way == "below":
        stops.reverse()
    lines: list[Line] = []
    forks: list[Point] = []
    trunk: Line = (start, (out, start[1]), (out, lane))
    for column in reversed(stops):
        x = ground.turn_in(strand, column)
        entries = sorted(
            (ground.entry(strand, target) for target in _in_column(strand, ground, column)),
            key=lambda point: -abs(point[1] - lane),
        )
        last = ((x, lane), (x, entries[0][1]), entries[0])
        forks += [(x, lane)] if lines else []
        lines.append(last if lines else (*trunk, *last))
        forks += [(x, y) for _, y in entries[1:]]
        lines += [((x, y), (left, y)) for left, y in entries[1:]]
    if beside is not None and (near := _in_column(strand, ground, beside)):
        fork = (out, start[1])
        branches, more = _straight(strand, ground, fork, near)
        lines += branches
        forks += [fork, *more]
    return lines, forks


def _in_column(strand: Strand, ground: RoutingPlan, column: int) -> list[int]:
    return [target for target in strand.wire.targets if ground.column_of[target] == column]


def _straight(
    strand: Strand, ground: RoutingPlan, start: Point, targets: Sequence[int]
) -> tuple[list[Line], list[Point]]:
    """Lines to the next column; those after the first part from it where they bend."""
    gutter = strand.column + 1
    bend = ground.gutter_lefts[gutter] + ground.gutters[gutter].bend
    wide = ground.gutters[gutter].bend_width
    lines: list[Line] = []
    for target in targets:
        left, y = ground.entry(strand, target)
        way = ((bend, start[1]), (bend + wide, y), (left, y))
        lines.append(way if lines else (start, *way))
    return lines, [(bend, start[1])] if len(lines) > 1 else []


@dataclass(frozen=True, slots=True)
class Gutter:
    """The upright lines between two columns, from the gutter's left edge."""

    leaving: Mapping[Strand, float]  # Of what comes from the column on the left and takes a lane
    bend: float  # From here on lines to the next column may change their height
    bend_width: float  # Within so much; 0 if all are straight
    entering: Mapping[Strand, float]  # Of what comes from a lane into the column on the right
    width: float  # Of the whole gutter


def gutter_of(
    number: int, strands: Sequence[Strand], left: int, right: int, *, bends: bool
) -> Gutter:
    """The gutter left of column `number`.

    Lines are put in the order in which those of one side do not cross each other.

    Parameters
    ----------
    number : int
        Number of the column on its right.
    strands : sequence of Strand
        All that there are.
    left, right : int
        Boxes in the columns on both sides; where there is one alone, lines to lanes above and
        below share a place.
    bends : bool
        Whether a line to the next column changes its height.
    """
    from_left = [one for one in strands if one.column == number - 1]
    into = [one for one in strands if number in one.reach]
    rise = sorted((one for one in from_left if one.way == "above"), key=lambda one: -one.row)
    sink = sorted((one for one in from_left if one.way == "below"), key=lambda one: one.row)
    fall = [one for one in into if one.way == "above" and one.column < number - 1]
    fall.sort(key=lambda one: one.row)
    climb = sorted((one for one in into if one.way == "below"), key=lambda one: -one.row)
    leaving, x = _slots(rise, sink, _SIDE, shared=left == 1)
    wide = BEND if bends else 0.0
    entering, end = _slots(fall, climb, x + wide, shared=right == 1)
    return Gutter(leaving, x, wide, entering, end + _SIDE + HEAD)


def _slots(
    above: Sequence[Strand], below: Sequence[Strand], x: float, *, shared: bool
) -> tuple[dict[Strand, float], float]:
    """Places of upright lines, and where the next could stand."""
    start = 0 if shared else len(above)
    places = {one: x + i * SLOT for i, one in enumerate(above)}
    places |= {one: x + (start + i) * SLOT for i, one in enumerate(below)}
    number = max(len(above), start + len(below))
    return places, x + number * SLOT


@dataclass(frozen=True, slots=True)
class BoxForm:
    """A box that stands nowhere yet."""

    width: float
    height: float
    back: float  # How far the cards behind stand out, up and to the right
    labels: float  # Width of the widest label at its right side
    right: Mapping[Strand, float]  # Heights below its top at which lines leave
    left: Mapping[Strand, float]  # Heights below its top at which lines enter


def form_of(box: Box, leaving: Sequence[Strand], entering: Sequence[Strand]) -> BoxForm:
    """Form of a box with its lines, both from top to bottom."""
    slots = [len(one.wire.labels) * LINE + UNDER for one in leaving]
    tall = max(sum(slots), PORT * len(entering)) + 2.0 * PAD
    height = max(tall, _LEAST + (SMALL + UNDER if small_text(box) else 0.0))
    right, y = {}, (height - sum(slots)) / 2.0
    for strand, slot in zip(leaving, slots, strict=True):
        y += slot
        right[strand] = y
    first = (height - PORT * (len(entering) - 1)) / 2.0
    texts = [text for one in leaving for text in one.wire.labels]
    return BoxForm(
        width=2.0 * PAD + max(_name_width(box), text_width(small_text(box), SMALL)),
        height=height,
        back=CARD * (min(box.count, CARDS) - 1),
        labels=max((text_width(text, TOPIC) for text in texts), default=0.0),
        right=right,
        left={strand: first + i * PORT for i, strand in enumerate(entering)},
    )


def _name_width(box: Box) -> float:
    return text_width(name_text(box), NAME, bold=True)


def name_text(box: Box) -> str:
    """What stands large in a box."""
    return box.text if box.count == 1 else f"{box.text} \N{MULTIPLICATION SIGN} {box.count}"


def small_text(box: Box) -> str:
    """What stands small in a box, under its name; empty if nothing does."""
    return box.kind


@dataclass(frozen=True)
class Strand:
    """A wire, or the part of one, that runs one way."""

    wire: Wire  # With the targets that it reaches this way
    way: Way  # Where it runs
    column: int  # Of its source
    reach: tuple[int, ...]  # Columns of its targets, ascending
    row: int = 0  # Its lane above or below; 0 is the one next to the boxes

    @cached_property
    def span(self) -> tuple[int, int]:
        """First and last gutter of its lane; gutter i is left of column i."""
        if self.way == "below":
            return self.reach[0], self.column + 1
        return self.column + 1, self.reach[-1]


def strands_of(wires: Sequence[Wire], column_of: Mapping[int, int]) -> list[Strand]:
    """Strands with their lanes, in the order of the wires."""
    ahead = [_part(wire, lambda a, b: b > a, column_of) for wire in wires]
    behind = [_part(wire, lambda a, b: b <= a, column_of) for wire in wires]
    kept = [
        part for part, wire in zip(ahead, wires, strict=True) if part.targets or not wire.targets
    ]
    strands = [_strand(wire, column_of, back=False) for wire in joined(kept)]
    back = joined(part for part in behind if part.targets)
    strands += [_strand(wire, column_of, back=True) for wire in back]
    return _with_rows(strands)


def _part(wire: Wire, runs: Callable[[int, int], bool], column_of: Mapping[int, int]) -> Wire:
    start = column_of[wire.source]
    return replace(wire, targets=tuple(t for t in wire.targets if runs(start, column_of[t])))


def _strand(wire: Wire, column_of: Mapping[int, int], *, back: bool) -> Strand:
    column = column_of[wire.source]
    reach = tuple(sorted({column_of[target] for target in wire.targets}))
    if not reach:
        return Strand(wire, "loose", column, reach)
    far: Way = "above" if reach[-1] > column + 1 else "straight"
    return Strand(wire, "below" if back else far, column, reach)


def _with_rows(strands: Sequence[Strand]) -> list[Strand]:
    """The strands, each with the lane next to the boxes that is free where it runs."""
    taken: dict[tuple[Way, int], list[tuple[int, int]]] = {}
    rows: dict[int, int] = {}
    in_lanes = [i for i, one in enumerate(strands) if one.way in ("above", "below")]
    # The shortest first: what goes far arches over what does not.
    for i in sorted(in_lanes, key=lambda i: strands[i].span[1] - strands[i].span[0]):
        way, (first, last) = strands[i].way, strands[i].span
        row = 0
        while any(a <= last and first <= b for a, b in taken.get((way, row), ())):
            row += 1
        taken.setdefault((way, row), []).append((first, last))
        rows[i] = row
    return [replace(one, row=rows.get(i, 0)) for i, one in enumerate(strands)]


def ports_right(strands: Sequence[Strand], box: int) -> list[Strand]:
    """What leaves a box at its right side, from top to bottom, so that lines rarely cross."""
    own = [strand for strand in strands if strand.wire.source == box]
    return sorted(own, key=lambda strand: (_ORDER[strand.way], -strand.row))


def ports_left(strands: Sequence[Strand], box: int, column: int) -> list[Strand]:
    """What enters a box at its left side, from top to bottom, so that lines rarely cross."""

    def key(strand: Strand) -> tuple[int, int]:
        straight = strand.way != "below" and strand.column == column - 1
        if straight:
            return 1, _ORDER[strand.way]
        return (0, -strand.row) if strand.way == "above" else (2, -strand.row)

    return sorted((one for one in strands if box in one.wire.targets), key=key)


class Rect(NamedTuple):
    """A rectangle."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Rect) -> bool:
        """Whether they have an area in common."""
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom


class Label(NamedTuple):
    """One line of text."""

    text: str
    rect: Rect  # What it covers; its baseline is `DESCENT` above the lower edge


@dataclass(frozen=True, slots=True)
class DrawnBox:
    """A node, or a stack of them."""

    box: Box
    rect: Rect  # The front card
    cover: Rect  # With the cards behind


@dataclass(frozen=True, slots=True)
class DrawnStrand:
    """A strand with its labels and lines."""

    strand: Strand
    labels: tuple[Label, ...]
    # Ways along corners; each ends with an arrow head unless the strand is loose.
    lines: tuple[tuple[Point, ...], ...]
    forks: tuple[Point, ...]  # Where lines part


@dataclass(frozen=True, slots=True)
class Picture:
    """All of it; its upper left corner is (0, 0)."""

    width: float
    height: float
    boxes: tuple[DrawnBox, ...]
    strands: tuple[DrawnStrand, ...]
    sinks: tuple[DrawnBox, ...]  # Each with the words that it hears everything
    signs: Mapping[str, Label]  # What lines and frames mean, each with a sample on its left
