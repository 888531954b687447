"""The wiring of a graph drawn as an N2 chart (Lano, 1977), or written for Mermaid and Graphviz.

The nodes stand on the diagonal. What a node publishes stands in its row, under or over the node
that subscribes: over the diagonal is what goes on, under it what goes back. So every topic has a
place of its own, and nothing has to be laid out but the order of the nodes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
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

NAME, TOPIC = 10.5, 9.0  # sizes of the texts [pt]
LINE = 12.0  # from one topic to the next [pt]
PAD, GAP, MARGIN = 6.0, 7.0, 8.0  # within a cell, between two cells, around all [pt]
CLEAR = 2.0  # between a topic and its line [pt]
STACK = 3.0  # offset of the second box of a stack [pt]
HEAD, DOT = 6.0, 4.0  # length of an arrow head, diameter of the end of a line to nobody [pt]
LEGEND_SIGN = 40.0  # what a sign of the legend takes beside its text [pt]
ONWARD, BACK = charts.BLUE, charts.VERMILION


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
    write_or_print(path, writers[kind](sketch_of(graph)))


class Layout(NamedTuple):
    """Where everything stands; places are in points, to the right and down."""

    order: Sequence[int]  # of the boxes along the diagonal
    cells: Mapping[tuple[int, int], Sequence[Wire]]  # by row and column; the last: to nobody
    columns: Sequence[tuple[float, float]]  # middle and width
    rows: Sequence[tuple[float, float]]  # middle and height


@charts.styled
def draw_svg(sketch: Sketch, title: str) -> str:
    """The wiring as the text of an SVG file."""
    figure, notes = draw_chart(sketch)
    return charts.svg_text(figure, title, notes)


@charts.styled
def draw_chart(sketch: Sketch) -> tuple[Figure, dict[str, str]]:
    """The chart; and what is told of boxes, lines and topics, by their ``gid``."""
    layout, signs, notes = lay_out(sketch), _signs(sketch), dict[str, str]()
    right, low = (sum(some[-1]) if some else MARGIN for some in (layout.columns, layout.rows))
    right = max([right, *(_width(str(sign.get_label())) + LEGEND_SIGN for sign in signs)])
    bottom = low + 1.2 * LINE * len(signs) + 3.0 * MARGIN
    figure = charts.new_figure(*(side * charts.PIXELS_PER_INCH / 72.0 for side in (right, bottom)))
    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, right), ylim=(bottom, 0.0))
    axes.set_axis_off()
    for cell, wires in layout.cells.items():
        notes |= _draw_cell(axes, layout, cell, wires)
    for place, index in enumerate(layout.order):
        _draw_box(axes, layout, place, sketch.boxes[index])
        notes[f"box{index}"] = sketch.boxes[index].title
    legend = axes.legend(handles=signs, loc="lower left", fontsize=TOPIC, labelcolor=charts.DIM)
    for number, sink in enumerate(sketch.sinks[::-1], 1):
        legend.get_texts()[-number].set_gid(f"sink{number}")
        notes[f"sink{number}"] = sink.title
    return figure, notes


def lay_out(sketch: Sketch) -> Layout:
    """Order of the boxes, and rows and columns that have room for what stands in them."""
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
    widths = [_width(name, NAME, "bold") for name in names] + [0.0]
    heights = [NAME] * len(order)
    for (row, column), wires in cells.items():
        labels = [label for wire in wires for label in wire.labels]
        widths[column] = max(widths[column], *map(_width, labels))
        heights[row] = max(heights[row], LINE * len(labels) + (row == column) * (NAME + PAD))
    return Layout(order, cells, _spread(widths), _spread(heights))


def reading_order(edges: Mapping[int, Iterable[int]]) -> list[int]:
    """Boxes so that few wires go back: none, if nothing leads in a circle.

    The greedy order of Eades, Lin and Smyth (1993): who has nobody to tell comes last, who hears
    from nobody first, and else who tells the most more than hears from; ties as in the launch file.
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


def _spread(sizes: Sequence[float]) -> list[tuple[float, float]]:
    """Middle and size of each of some cells beside each other."""
    padded = [size + 2.0 * PAD if size else 0.0 for size in sizes]
    ends = accumulate((size + GAP for size in padded), initial=MARGIN)
    return [(end + 0.5 * size, size) for end, size in zip(ends, padded, strict=False)]


def _draw_cell(
    axes: Axes, layout: Layout, place: tuple[int, int], wires: Sequence[Wire]
) -> dict[str, str]:
    """The topics from one box to another, on the line that leads there."""
    (row, column), gid = place, "line{}_{}".format(*place)
    (x, width), (y, _) = layout.columns[column], layout.rows[row]
    way = 1.0 if column > row else -1.0
    color = ONWARD if column > row else BACK
    labels = [(label, wire) for wire in wires for label in wire.labels]
    wide, high = max(_width(label) for label, _ in labels), LINE * len(labels)
    begin = layout.columns[row][0] + way * 0.5 * layout.columns[row][1]
    look: dict[str, Any] = {"color": color, "markevery": [-1], "gid": gid, "zorder": 1.0}
    if row == column:
        y += 0.5 * (NAME + PAD)  # under the name of the box
    elif column == len(layout.order):
        axes.plot([begin, x - 0.5 * width], [y, y], marker="o", markersize=DOT, **look)
        x += 0.5 * (wide - width) + PAD
    else:
        middle, height = layout.rows[column]
        end = middle - way * 0.5 * (height + HEAD)
        mark = "v" if way > 0.0 else "^"
        axes.plot([begin, x, x], [y, y, end], marker=mark, markersize=HEAD, **look)
    corner = (x - 0.5 * wide - CLEAR, y - 0.5 * high)
    if row != column:
        axes.add_patch(Rectangle(corner, wide + 2.0 * CLEAR, high, fc=charts.PAGE, zorder=2.0))
    notes = {gid: "\n".join(wire.title for wire in wires)}
    for number, (label, wire) in enumerate(labels):
        up = y + LINE * (number - 0.5 * (len(labels) - 1))
        notes[topic := f"topic{row}_{column}_{number}"] = wire.title
        style = "italic" if wire.latched else "normal"
        _draw_text(axes, (x, up), label, style=style, color=color, gid=topic)
    return notes


def _draw_box(axes: Axes, layout: Layout, place: int, box: Box) -> None:
    (x, width), (y, height) = layout.columns[place], layout.rows[place]
    gid = f"box{layout.order[place]}"
    look: dict[str, Any] = {"ec": charts.GOOD, "lw": 2.0} if box.ends else {"ec": charts.DIM}
    for behind in (True, False) if box.count > 1 else (False,):
        corner = x - 0.5 * width + STACK * behind, y - 0.5 * height - STACK * behind
        style, zorder = "round,pad=0,rounding_size=4", 0.5 if behind else 3.0
        axes.add_patch(FancyBboxPatch(corner, width, height, boxstyle=style, fc=charts.PANEL,
                                      gid=gid, zorder=zorder, **look))  # fmt: skip
    loops = layout.cells.get((place, place), ())
    up = y - 0.5 * LINE * sum(len(wire.labels) for wire in loops)
    _draw_text(axes, (x, up), box.name, gid=gid, size=NAME, weight="bold")


def _signs(sketch: Sketch) -> list[Artist]:
    """The legend: what lines, letters and boxes mean, and the sinks."""
    onward = "what a node publishes stands in its row; an arrow leads to who subscribes"
    signs: list[Artist] = [Line2D([], [], color=ONWARD, label=onward)]
    signs.append(Line2D([], [], color=BACK, label="feedback"))
    if any(wire.latched for wire in sketch.wires):
        label = "in italics: latched, received before all else"
        signs.append(Line2D([], [], linewidth=0.0, label=label))
    if any(not wire.targets for wire in sketch.wires):
        label = "no node subscribes"
        signs.append(Line2D([], [], linewidth=0.0, marker="o", ms=DOT, color=ONWARD, label=label))
    if any(box.ends for box in sketch.boxes):
        signs.append(Patch(fc=charts.PANEL, ec=charts.GOOD, lw=2.0, label="ends the graph"))
    for _, text in sketch.labels()[len(sketch.boxes) :]:
        label = charts.xml_text(text)
        signs.append(Patch(fc=charts.PANEL, ec=charts.DIM, ls=":", label=label))
    return signs


def _draw_text(axes: Axes, place: tuple[float, float], text: str, **look: Any) -> None:
    look = {"ha": "center", "va": "center_baseline", "size": TOPIC, "zorder": 4.0, **look}
    axes.text(*place, charts.xml_text(text), **look)


def _width(text: str, size: float = TOPIC, weight: str = "normal") -> float:
    return charts.text_width(charts.xml_text(text), size, weight)
