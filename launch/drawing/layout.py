"""Where everything stands: columns of boxes with their labels, gutters between them, and lanes.

All that a box says leaves at its right, under its label; all that it hears enters at its left.
Lines run between columns, above all boxes, or below all. So no line meets a box, and no label
anything but its own line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from palpate.launch.drawing import sizes
from palpate.launch.drawing.form import Form, form_of, name_text
from palpate.launch.drawing.gutters import Gutter, gutter_of
from palpate.launch.drawing.heights import bent, tops_of
from palpate.launch.drawing.layers import layers_of
from palpate.launch.drawing.picture import DrawnBox, Label, Picture, Rect
from palpate.launch.drawing.sketch import Box, Sketch
from palpate.launch.drawing.strands import Strand, ports_left, ports_right, strands_of
from palpate.launch.drawing.text_width import text_width
from palpate.launch.drawing.threads import Ground, drawn

SIGNS = {
    "latched": "latched: heard before all else",
    "below": "feedback",
    "ends": "ends the graph",
}
"""What is explained, and how."""
_SAMPLE = 34.0


@dataclass(frozen=True, slots=True)
class _Columns:
    """Places from left to right."""

    boxes: list[float]
    """Left edges of the columns."""
    widths: list[float]
    """Of their boxes."""
    labels: list[float]
    """Left edges of the labels."""
    gutters: list[float]
    """Left edges of the gutters."""
    right: float
    """Where the last gutter ends."""


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
    bends = bent(strands, column_of, tops, forms)
    counts = [0, *map(len, columns), 0]
    gutters = [
        gutter_of(i, strands, counts[i], counts[i + 1], bends=i in bends)
        for i in range(len(columns) + 1)
    ]
    across = _across(columns, forms, gutters)
    rows = max((one.row + 1 for one in strands if one.way == "above"), default=0)
    highest = min((top - forms[box].back for box, top in tops.items()), default=0.0)
    down = sizes.MARGIN + (sizes.CLEAR + sizes.ROW * rows if rows else 0.0) - highest
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
    ground = Ground(
        boxes=tuple(one.rect for one in boxes),
        forms=forms,
        column_of=column_of,
        labels=across.labels,
        gutters=gutters,
        gutter_lefts=across.gutters,
        above=highest + down - sizes.CLEAR,
        below=max((one.rect.bottom for one in boxes), default=0.0) + sizes.CLEAR,
    )
    return _picture(sketch, boxes, strands, ground, across.right)


def _across(
    columns: Sequence[Sequence[int]], forms: Mapping[int, Form], gutters: Sequence[Gutter]
) -> _Columns:
    found = _Columns([], [], [], [], 0.0)
    x = sizes.MARGIN
    for i, column in enumerate(columns):
        found.gutters.append(x)
        x += gutters[i].width
        found.boxes.append(x)
        found.widths.append(max(forms[box].width for box in column))
        x += found.widths[-1] + max(forms[box].back for box in column) + sizes.UNDER
        found.labels.append(x)
        x += max(forms[box].labels for box in column)
    found.gutters.append(x)
    return _Columns(found.boxes, found.widths, found.labels, found.gutters, x + gutters[-1].width)


def _box(box: Box, left: float, top: float, form: Form, width: float) -> DrawnBox:
    rect = Rect(left, top, left + width, top + form.height)
    cover = Rect(left, top - form.back, left + width + form.back, rect.bottom)
    return DrawnBox(box, rect, cover)


def _picture(
    sketch: Sketch,
    boxes: tuple[DrawnBox, ...],
    strands: Sequence[Strand],
    ground: Ground,
    right: float,
) -> Picture:
    rows = max((one.row + 1 for one in strands if one.way == "below"), default=0)
    foot = ground.below + sizes.ROW * rows + sizes.CLEAR
    signs, x = _signs(sketch, strands, foot)
    sinks, width = [], 0.0
    for sink in reversed(sketch.sinks):
        text = sink_text(sink)
        wide = text_width(text, sizes.TOPIC) + 2.0 * sizes.PAD
        width += wide + sizes.MARGIN
        sinks.append((sink, width, wide))
    right = max(right + sizes.MARGIN, x + width)
    placed = [
        DrawnBox(sink, rect, rect)
        for sink, back, wide in reversed(sinks)
        for rect in [Rect(right - back, foot, right - back + wide, foot + sizes.FOOT)]
    ]
    return Picture(
        width=right,
        height=foot + sizes.FOOT + sizes.MARGIN,
        boxes=boxes,
        strands=tuple(drawn(strand, ground) for strand in strands),
        sinks=tuple(placed),
        signs=signs,
    )


def sink_text(sink: Box) -> str:
    """What stands in the box of one who hears everything."""
    return f"{name_text(sink)}: hears every topic"


def _signs(
    sketch: Sketch, strands: Sequence[Strand], foot: float
) -> tuple[dict[str, Label], float]:
    """The explanations of what there is in the picture, and where they end."""
    there = {
        "latched": any(one.wire.latched for one in strands),
        "below": any(one.way == "below" for one in strands),
        "ends": any(box.ends for box in sketch.boxes),
    }
    signs, x = {}, sizes.MARGIN
    middle = foot + sizes.FOOT / 2.0
    for name, text in SIGNS.items():
        if there[name]:
            left = x + _SAMPLE
            x = left + text_width(text, sizes.TOPIC)
            top, bottom = middle - sizes.LINE / 2.0, middle + sizes.LINE / 2.0
            signs[name] = Label(text, Rect(left, top, x, bottom))
            x += sizes.MARGIN
    return signs, x
