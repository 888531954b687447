"""The lines of a strand, corner by corner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.launch.drawing import sizes
from palpate.launch.drawing.form import Form
from palpate.launch.drawing.gutters import Gutter
from palpate.launch.drawing.picture import DrawnStrand, Label, Point, Rect
from palpate.launch.drawing.strands import Strand
from palpate.launch.drawing.text_width import text_width

Line = tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Ground:
    """What lines run between."""

    boxes: Sequence[Rect]
    """Front cards by index."""
    forms: Mapping[int, Form]
    """Where lines leave and enter them."""
    column_of: Mapping[int, int]
    """Column of each box."""
    labels: Sequence[float]
    """Left edges of the labels behind each column."""
    gutters: Sequence[Gutter]
    """The gutter left of each column, and the last one."""
    gutter_lefts: Sequence[float]
    """Left edges of the gutters."""
    above: float
    """Height of the lowest lane above the boxes."""
    below: float
    """Height of the highest lane below them."""

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
            return self.above - sizes.ROW * strand.row
        return self.below + sizes.ROW * strand.row


def drawn(strand: Strand, ground: Ground) -> DrawnStrand:
    """A strand with its labels and lines."""
    if strand.way == "loose":
        x, y = ground.exit(strand)
        end = ground.labels[strand.column] + _widest(strand) + sizes.STUB
        return DrawnStrand(strand, _labels(strand, ground), (((x, y), (end, y)),), ())
    if strand.way == "straight":
        lines, forks = _straight(strand, ground, ground.exit(strand), strand.wire.targets)
    else:
        lines, forks = _by_lane(strand, ground)
    return DrawnStrand(strand, _labels(strand, ground), tuple(lines), tuple(forks))


def _straight(
    strand: Strand, ground: Ground, start: Point, targets: Sequence[int]
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


def _by_lane(strand: Strand, ground: Ground) -> tuple[list[Line], list[Point]]:
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


def _in_column(strand: Strand, ground: Ground, column: int) -> list[int]:
    return [target for target in strand.wire.targets if ground.column_of[target] == column]


def _labels(strand: Strand, ground: Ground) -> tuple[Label, ...]:
    """One line for each topic, above the strand's own line."""
    left, y = ground.labels[strand.column], ground.exit(strand)[1] - 1.0
    labels = []
    for text in reversed(strand.wire.labels):
        rect = Rect(left, y - sizes.LINE, left + text_width(text, sizes.TOPIC), y)
        labels.append(Label(text, rect))
        y -= sizes.LINE
    return tuple(reversed(labels))


def _widest(strand: Strand) -> float:
    return max(text_width(text, sizes.TOPIC) for text in strand.wire.labels)
