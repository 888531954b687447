"""The wiring of a graph drawn as an N2 chart (Lano, 1977), or written for Mermaid and Graphviz.

The nodes are on the diagonal. A topic is in the row of its publisher and in the column of its
subscriber: above the diagonal if it leads onward, below it if it is feedback. So every topic has a
place of its own, and only the order of the nodes has to be chosen.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch, Patch, Rectangle

from palpate.launch import charts
from palpate.launch.files.file_access import write_or_print
from palpate.launch.files.source_map import InputError
from palpate.launch.graph import Graph
from palpate.tools.graph_sketch import Box, Sketch, Wire, dot_text, mermaid_text, sketch_of

ONWARD, BACK = charts.BLUE, charts.VERMILION


@dataclass(frozen=True, slots=True, kw_only=True)
class ChartSizes:
    """Sizes in a chart [pt]."""

    node_font: float = 10.5
    topic_font: float = 9.0
    line_height: float = 12.0  # from one topic to the next
    padding: float = 6.0  # in a cell, around its texts
    cell_gap: float = 7.0  # between two cells
    margin: float = 8.0  # around the chart
    topic_gap: float = 2.0  # between a topic and its line
    stack_offset: float = 3.0  # of the second box of a stack, upwards and to the right
    arrow_head: float = 6.0  # diameter
    end_dot: float = 4.0  # diameter of the end of a line without a subscriber
    legend_sign: float = 40.0  # width of a sign of the legend


SIZES = ChartSizes()


def write_picture(graph: Graph, path: Path, title: str) -> None:
    """Draw the resolved wiring into a file: .svg, .mmd (Mermaid) or .dot (Graphviz).

    ``-`` is SVG on standard output. Raises InputError if the graph could not run, or the file
    cannot be written; the file is then left as it was.
    """
    kind = ".svg" if str(path) == "-" else path.suffix
    writers: dict[str, Callable[[Sketch], str]] = {
        ".svg": partial(draw_svg, title=title),
        **{".mmd": mermaid_text, ".dot": dot_text},
    }
    if kind not in writers:
        raise InputError(f"--graph: {path}: must end in one of {', '.join(writers)}")
    write_or_print(path, writers[kind](sketch_of(graph)))


class Layout(NamedTuple):
    """Places of a chart [pt], to the right and down."""

    order: Sequence[int]  # of the boxes along the diagonal
    cells: Mapping[tuple[int, int], Sequence[Wire]]  # by row and column; last: no subscriber
    columns: Sequence[tuple[float, float]]  # middle and width
    rows: Sequence[tuple[float, float]]  # middle and height
    sizes: ChartSizes


@charts.styled
def draw_svg(sketch: Sketch, title: str) -> str:
    """The wiring as the text of an SVG file."""
    figure, notes = draw_chart(sketch)
    return charts.svg_text(figure, title, notes)


@charts.styled
def draw_chart(sketch: Sketch, sizes: ChartSizes = SIZES) -> tuple[Figure, dict[str, str]]:
    """The chart, and the tooltips of boxes, lines and topics by their ``gid``."""
    layout, signs, notes = lay_out(sketch, sizes), _signs(sketch, sizes), dict[str, str]()
    right, low = (sum(some[-1]) if some else sizes.margin for some in (layout.columns, layout.rows))
    texts = (_width(str(sign.get_label()), sizes.topic_font) for sign in signs)
    right = max([right, *(width + sizes.legend_sign for width in texts)])
    bottom = low + 1.2 * sizes.line_height * len(signs) + 3.0 * sizes.margin
    figure = charts.new_figure(*(side * charts.PIXELS_PER_INCH / 72.0 for side in (right, bottom)))
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, right), ylim=(bottom, 0.0))
    axes.set_axis_off()
    for cell, wires in layout.cells.items():
        notes |= _draw_cell(axes, layout, cell, wires)
    for place, index in enumerate(layout.order):
        _draw_box(axes, layout, place, sketch.boxes[index])
        notes[f"box{index}"] = sketch.boxes[index].title
    font = sizes.topic_font
    legend = axes.legend(handles=signs, loc="lower left", fontsize=font, labelcolor=charts.DIM)
    for number, sink in enumerate(sketch.sinks[::-1], 1):
        legend.get_texts()[-number].set_gid(f"sink{number}")
        notes[f"sink{number}"] = sink.title
    return figure, notes


def lay_out(sketch: Sketch, sizes: ChartSizes = SIZES) -> Layout:
    """Order of the boxes, and rows and columns with room for their texts."""
    edges: dict[int, list[int]] = {i: [] for i in range(len(sketch.boxes))}
    for wire in sketch.wires:
        edges[wire.source] += wire.targets
    order = reading_order(edges)
    place = {box: i for i, box in enumerate(order)}
    cells: dict[tuple[int, int], list[Wire]] = {}
    for wire in sketch.wires:
        for column in [place[target] for target in wire.targets] or [len(order)]:
            cells.setdefault((place[wire.source], column), []).append(wire)
    names = [sketch.boxes[i].name for i in order]
    widths = [_width(name, sizes.node_font, "bold") for name in names] + [0.0]
    heights = [sizes.node_font] * len(order)
    for (row, column), wires in cells.items():
        labels = [label for wire in wires for label in wire.labels]
        own = (row == column) * (sizes.node_font + sizes.padding)
        widths[column] = max(widths[column], *(_width(text, sizes.topic_font) for text in labels))
        heights[row] = max(heights[row], sizes.line_height * len(labels) + own)
    return Layout(order, cells, _spread(widths, sizes), _spread(heights, sizes), sizes)


def reading_order(edges: Mapping[int, Iterable[int]]) -> list[int]:
    """Order of boxes with few wires that lead back, and none if the graph has no loop.

    The greedy order of Eades, Lin and Smyth (1993): boxes without targets come last, boxes without
    sources first, and otherwise that with the largest excess of targets over sources; ties are in
    the order of the launch file.
    """
    targets = {box: {*to} - {box} for box, to in edges.items()}
    first, last, rest = list[int](), list[int](), dict.fromkeys(edges)
    while rest:
        out = {box: sum(to in rest for to in targets[box]) for box in rest}
        into = Counter(to for box in rest for to in targets[box])
        sink = next((box for box in rest if not out[box]), None)
        if sink is not None:
            last.append(sink)
            del rest[sink]
        else:
            chosen = max(rest, key=lambda box: (not into[box], out[box] - into[box]))
            first.append(chosen)
            del rest[chosen]
    return first + last[::-1]


def _spread(extents: Sequence[float], sizes: ChartSizes) -> list[tuple[float, float]]:
    """Middle and size of cells beside each other, from the extents of their texts."""
    padded = [extent + 2.0 * sizes.padding if extent else 0.0 for extent in extents]
    ends = accumulate((size + sizes.cell_gap for size in padded), initial=sizes.margin)
    return [(end + 0.5 * size, size) for end, size in zip(ends, padded, strict=False)]


def _draw_cell(
    axes: Axes, layout: Layout, place: tuple[int, int], wires: Sequence[Wire]
) -> dict[str, str]:
    """Draw the topics from one box to another on their line; returns their tooltips."""
    (row, column), gid, sizes = place, "line{}_{}".format(*place), layout.sizes
    (x, width), (y, _) = layout.columns[column], layout.rows[row]
    side = 1.0 if column > row else -1.0
    color = ONWARD if column > row else BACK
    labels = [(label, wire) for wire in wires for label in wire.labels]
    text_width = max(_width(label, sizes.topic_font) for label, _ in labels)
    text_height = sizes.line_height * len(labels)
    begin = layout.columns[row][0] + side * 0.5 * layout.columns[row][1]
    look: dict[str, Any] = {"color": color, "markevery": [-1], "gid": gid, "zorder": 1.0}
    if row == column:
        y += 0.5 * (sizes.node_font + sizes.padding)  # below the name of the box
    elif column == len(layout.order):
        axes.plot([begin, x - 0.5 * width], [y, y], marker="o", markersize=sizes.end_dot, **look)
        x += 0.5 * (text_width - width) + sizes.padding
    else:
        middle, height = layout.rows[column]
        end = middle - side * 0.5 * (height + sizes.arrow_head)
        mark = "v" if side > 0.0 else "^"
        axes.plot([begin, x, x], [y, y, end], marker=mark, markersize=sizes.arrow_head, **look)
    gap = sizes.topic_gap
    corner = (x - 0.5 * text_width - gap, y - 0.5 * text_height)
    if row != column:
        size = text_width + 2.0 * gap, text_height
        axes.add_patch(Rectangle(corner, *size, fc=charts.PAGE, zorder=2.0))
    notes = {gid: "\n".join(wire.title for wire in wires)}
    for number, (label, wire) in enumerate(labels):
        up = y + sizes.line_height * (number - 0.5 * (len(labels) - 1))
        notes[topic := f"topic{row}_{column}_{number}"] = wire.title
        style = "italic" if wire.latched else "normal"
        look = {"size": sizes.topic_font, "style": style, "color": color, "gid": topic}
        _draw_text(axes, (x, up), label, **look)
    return notes


def _draw_box(axes: Axes, layout: Layout, place: int, box: Box) -> None:
    (x, width), (y, height) = layout.columns[place], layout.rows[place]
    gid, sizes = f"box{layout.order[place]}", layout.sizes
    look: dict[str, Any] = {"ec": charts.GOOD, "lw": 2.0} if box.ends else {"ec": charts.DIM}
    for behind in (True, False) if box.count > 1 else (False,):
        offset = sizes.stack_offset * behind
        corner = x - 0.5 * width + offset, y - 0.5 * height - offset
        style, zorder = "round,pad=0,rounding_size=4", 0.5 if behind else 3.0
        axes.add_patch(FancyBboxPatch(corner, width, height, boxstyle=style, fc=charts.PANEL,
                                      gid=gid, zorder=zorder, **look))  # fmt: skip
    loops = layout.cells.get((place, place), ())
    up = y - 0.5 * sizes.line_height * sum(len(wire.labels) for wire in loops)
    _draw_text(axes, (x, up), box.name, gid=gid, size=sizes.node_font, weight="bold")


def _signs(sketch: Sketch, sizes: ChartSizes) -> list[Artist]:
    """Entries of the legend: lines, letters and boxes, and the sinks."""
    onward = "a node publishes the topics in its row; an arrow leads to the subscriber"
    signs: list[Artist] = [Line2D([], [], color=ONWARD, label=onward)]
    signs.append(Line2D([], [], color=BACK, label="feedback"))
    if any(wire.latched for wire in sketch.wires):
        label = "in italics: latched, received before other topics"
        signs.append(Line2D([], [], linewidth=0.0, label=label))
    if any(not wire.targets for wire in sketch.wires):
        label = "no node subscribes"
        signs.append(Line2D([], [], linewidth=0.0, marker="o", ms=sizes.end_dot, color=ONWARD,
                            label=label))  # fmt: skip
    if any(box.ends for box in sketch.boxes):
        signs.append(Patch(fc=charts.PANEL, ec=charts.GOOD, lw=2.0, label="ends the graph"))
    for _, text in sketch.labels()[len(sketch.boxes) :]:
        label = charts.xml_text(text)
        signs.append(Patch(fc=charts.PANEL, ec=charts.DIM, ls=":", label=label))
    return signs


def _draw_text(axes: Axes, place: tuple[float, float], text: str, **look: Any) -> None:
    look = {"ha": "center", "va": "center_baseline", "zorder": 4.0, **look}
    axes.text(*place, charts.xml_text(text), **look)


def _width(text: str, size: float, weight: str = "normal") -> float:
    return charts.text_width(charts.xml_text(text), size, weight)
