"""Where everything stands: columns of boxes with their labels, gutters between them, and lanes.

Layered drawing (Sugiyama, Tagawa and Toda, 1981): columns by the longest way, order within them by
the mean place of neighbours. All that a box publishes leaves at its right, under its label; all
that it receives enters at its left. Lines run between columns, above all boxes, or below all. So
no line meets a box, and no label anything but its own line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from palpate.tools.graph_drawing.routing import (
    BoxForm,
    DrawnBox,
    Gutter,
    Label,
    Picture,
    Rect,
    RoutingPlan,
    Strand,
    form_of,
    gutter_of,
    name_text,
    ports_left,
    ports_right,
    route_strands,
    strands_of,
)
from palpate.tools.graph_drawing.sizes import (
    CLEAR,
    FOOT,
    GAP,
    LINE,
    MARGIN,
    PAD,
    ROW,
    TOPIC,
    UNDER,
    text_width,
)
from palpate.tools.graph_drawing.sketch import Box, Sketch

# What is explained, and how.
SIGNS = {
    "latched": "latched: heard before all else",
    "below": "feedback",
    "ends": "ends the graph",
}
_SAMPLE = 34.0
Edges = Mapping[int, Sequence[int]]  # Box to the boxes that hear it
_SWEEPS = 8
STRAIGHT = 0.05  # Two heights that differ by less are the same, pixels


@dataclass(frozen=True, slots=True)
class _Columns:
    """Places from left to right."""

    boxes: list[float]  # Left edges of the columns
    widths: list[float]  # Of their boxes
    labels: list[float]  # Left edges of the labels
    gutters: list[float]  # Left edges of the gutters
    right: float  # Where the last gutter ends


def lay_out(sketch: Sketch) -> Picture:
    """Give everything its place."""
    edges: dict[int, list[int]] = {i: [] for i in range(len(sketch.boxes))}
    for wire in sketch.wires:
        edges[wire.source] += [one for one in wire.targets if one not in edges[wire.source]]
    columns = layers_of(edges)
    column_of = {box: i for i, column in enumerate(columns) for box in column}
    strands = strands_of(sketch.wires, column_of)
    forms = {
        i: form_of(box, ports_right(strands, i), ports_left(strands, i, column_of[i]))
        for i, box in enumerate(sketch.boxes)
    }
    tops = tops_of(columns, forms)
    bends = bent_columns(strands, column_of, tops, forms)
    counts = [0, *map(len, columns), 0]
    gutters = [
        gutter_of(i, strands, counts[i], counts[i + 1], bends=i in bends)
        for i in range(len(columns) + 1)
    ]
    across = _across(columns, forms, gutters)
    rows = max((one.row + 1 for one in strands if one.way == "above"), default=0)
    highest = min((top - forms[box].back for box, top in tops.items()), default=0.0)
    down = MARGIN + (CLEAR + ROW * rows if rows else 0.0) - highest
    boxes = tuple(
        _box(
            sketch.boxes[i],
            across.boxes[column_of[i]],
            tops[i] + down,
            forms[i],
            across.widths[column_of[i]],
        )
        for i in range(len(sketch.boxes))
    )
    ground = RoutingPlan(
        boxes=tuple(one.rect for one in boxes),
        forms=forms,
        column_of=column_of,
        labels=across.labels,
        gutters=gutters,
        gutter_lefts=across.gutters,
        above=highest + down - CLEAR,
        below=max((one.rect.bottom for one in boxes), default=0.0) + CLEAR,
    )
    return _picture(sketch, boxes, strands, ground, across.right)


def layers_of(edges: Edges) -> list[list[int]]:
    """Columns of boxes from left to right: whoever hears stands right of whom it hears.

    Edges that go back to where they came from are not asked. The column is the length of the
    longest way to a box; within it, boxes are ordered by the mean place of their neighbours,
    which lessens crossings.

    Parameters
    ----------
    edges : map
        Every box, in the order in which the ways begin, to its listeners.
    """
    back = back_edges(edges)
    forward = {
        box: [target for target in targets if (box, target) not in back]
        for box, targets in edges.items()
    }
    depth = _depths(forward)
    columns: list[list[int]] = [[] for _ in range(max(depth.values(), default=-1) + 1)]
    for box in edges:
        columns[depth[box]].append(box)
    return _untangled(columns, forward)


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


def _depths(forward: Edges) -> dict[int, int]:
    """Edges of the longest way to each box."""
    depth = dict.fromkeys(forward, 0)
    waits = dict.fromkeys(forward, 0)
    for targets in forward.values():
        for target in targets:
            waits[target] += 1
    free = [box for box, number in waits.items() if number == 0]
    for box in free:
        for target in forward[box]:
            depth[target] = max(depth[target], depth[box] + 1)
            waits[target] -= 1
            if waits[target] == 0:
                free.append(target)
    return depth


def _untangled(columns: list[list[int]], forward: Edges) -> list[list[int]]:
    """The columns, ordered by the mean place of neighbours, rightwards and leftwards in turn."""
    before: dict[int, list[int]] = {box: [] for box in forward}
    for box, targets in forward.items():
        for target in targets:
            before[target].append(box)
    place = {box: spot for column in columns for box, spot in _spots(column).items()}
    for sweep in range(_SWEEPS):
        near = before if sweep % 2 == 0 else forward
        for column in columns if sweep % 2 == 0 else reversed(columns):
            mean = {
                box: sum(place[one] for one in near[box]) / len(near[box])
                for box in column
                if near[box]
            }
            column.sort(key=lambda box: mean.get(box, place[box]))
            place |= _spots(column)
    return columns


def _spots(column: Sequence[int]) -> dict[int, float]:
    """Places of a column's boxes, from 0 at its upper end to 1 at its lower."""
    return {box: (i + 0.5) / len(column) for i, box in enumerate(column)}


def tops_of(columns: Sequence[Sequence[int]], forms: Mapping[int, BoxForm]) -> dict[int, float]:
    """Height of the top of each box; a column is placed by what the one before sends it."""
    tops: dict[int, float] = {}
    for number, column in enumerate(columns):
        steps = [0.0]
        for upper, lower in pairwise(column):
            steps.append(steps[-1] + forms[upper].height + GAP + forms[lower].back)
        wanted = [_wanted(forms[box], number, tops, forms) for box in column]
        free = [0.0 if top is None else top - step for top, step in zip(wanted, steps, strict=True)]
        weights = [0.1 if top is None else 1.0 for top in wanted]
        for box, top, step in zip(column, _ascending(free, weights), steps, strict=True):
            tops[box] = top + step
    return tops


def _wanted(
    form: BoxForm, number: int, tops: Mapping[int, float], forms: Mapping[int, BoxForm]
) -> float | None:
    """Top at which lines from the column before are straight, in the mean; None without such.

    Lines that go to this column alone count; what forks has other branches, too.
    """
    straight = [one for one in form.left if one.way == "straight"]
    if not straight:
        straight = [one for one in form.left if one.way == "above" and one.column == number - 1]
    shifts = [_start_height(one, tops, forms) - form.left[one] for one in straight]
    return sum(shifts) / len(shifts) if shifts else None


def _ascending(values: Sequence[float], weights: Sequence[float]) -> list[float]:
    """The ascending numbers nearest to these, in the sense of weighted least squares."""
    blocks: list[tuple[float, float, int]] = []
    for value, weight in zip(values, weights, strict=True):
        blocks.append((value, weight, 1))
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, v, m), (b, w, n) = blocks[-2:]
            blocks[-2:] = [((a * v + b * w) / (v + w), v + w, m + n)]
    return [value for value, _, number in blocks for _ in range(number)]


def bent_columns(
    strands: Sequence[Strand],
    column_of: Mapping[int, int],
    tops: Mapping[int, float],
    forms: Mapping[int, BoxForm],
) -> set[int]:
    """Columns with a box that a line from the column before does not reach straight."""
    return {
        column_of[target]
        for one in strands
        if one.way != "below"
        for target in one.wire.targets
        if column_of[target] == one.column + 1
        and abs(_start_height(one, tops, forms) - tops[target] - forms[target].left[one]) > STRAIGHT
    }


def _start_height(strand: Strand, tops: Mapping[int, float], forms: Mapping[int, BoxForm]) -> float:
    return tops[strand.wire.source] + forms[strand.wire.source].right[strand]


def _across(
    columns: Sequence[Sequence[int]], forms: Mapping[int, BoxForm], gutters: Sequence[Gutter]
) -> _Columns:
    found = _Columns([], [], [], [], 0.0)
    x = MARGIN
    for i, column in enumerate(columns):
        found.gutters.append(x)
        x += gutters[i].width
        found.boxes.append(x)
        found.widths.append(max(forms[box].width for box in column))
        x += found.widths[-1] + max(forms[box].back for box in column) + UNDER
        found.labels.append(x)
        x += max(forms[box].labels for box in column)
    found.gutters.append(x)
    return _Columns(found.boxes, found.widths, found.labels, found.gutters, x + gutters[-1].width)


def _box(box: Box, left: float, top: float, form: BoxForm, width: float) -> DrawnBox:
    rect = Rect(left, top, left + width, top + form.height)
    cover = Rect(left, top - form.back, left + width + form.back, rect.bottom)
    return DrawnBox(box, rect, cover)


def _picture(
    sketch: Sketch,
    boxes: tuple[DrawnBox, ...],
    strands: Sequence[Strand],
    ground: RoutingPlan,
    right: float,
) -> Picture:
    rows = max((one.row + 1 for one in strands if one.way == "below"), default=0)
    foot = ground.below + ROW * rows + CLEAR
    signs, x = _signs(sketch, strands, foot)
    sinks, width = [], 0.0
    for sink in reversed(sketch.sinks):
        text = sink_text(sink)
        wide = text_width(text, TOPIC) + 2.0 * PAD
        width += wide + MARGIN
        sinks.append((sink, width, wide))
    right = max(right + MARGIN, x + width)
    placed = [
        DrawnBox(sink, rect, rect)
        for sink, back, wide in reversed(sinks)
        for rect in [Rect(right - back, foot, right - back + wide, foot + FOOT)]
    ]
    return Picture(
        width=right,
        height=foot + FOOT + MARGIN,
        boxes=boxes,
        strands=tuple(route_strands(strand, ground) for strand in strands),
        sinks=tuple(placed),
        signs=signs,
    )


def _signs(
    sketch: Sketch, strands: Sequence[Strand], foot: float
) -> tuple[dict[str, Label], float]:
    """The explanations of what there is in the picture, and where they end."""
    there = {
        "latched": any(one.wire.latched for one in strands),
        "below": any(one.way == "below" for one in strands),
        "ends": any(box.ends for box in sketch.boxes),
    }
    signs, x = {}, MARGIN
    middle = foot + FOOT / 2.0
    for name, text in SIGNS.items():
        if there[name]:
            left = x + _SAMPLE
            x = left + text_width(text, TOPIC)
            top, bottom = middle - LINE / 2.0, middle + LINE / 2.0
            signs[name] = Label(text, Rect(left, top, x, bottom))
            x += MARGIN
    return signs, x


def sink_text(sink: Box) -> str:
    """What stands in the box of one who hears everything."""
    return f"{name_text(sink)}: hears every topic"
