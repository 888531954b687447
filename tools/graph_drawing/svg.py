"""The laid-out wiring of a graph written as SVG, into a file or to standard output."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

from palpate.launch import Graph
from palpate.launch.files import InputError, write_atomically
from palpate.tools.graph_drawing.layout import lay_out, sink_text
from palpate.tools.graph_drawing.routing import (
    DrawnBox,
    DrawnStrand,
    Label,
    Picture,
    Point,
    Rect,
    name_text,
    small_text,
)
from palpate.tools.graph_drawing.sizes import CARD, HEAD, NAME, SMALL, TOPIC, UNDER, text_width
from palpate.tools.graph_drawing.sketch import Sketch, sketch_of

_CORNER = 7.0
_ROUND = 7.0
_FORK = 2.6
_DESCENT = 3.5
_SAMPLE = 26.0
_UNFIT = re.compile("[^\t\n\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_STYLE = """
text { font-family: system-ui, "Segoe UI", Helvetica, Arial, "DejaVu Sans", sans-serif; }
.page { fill: #ffffff; stroke: #d0d7de; }
.name { font-weight: 600; fill: #1f2328; }
.small { fill: #59636e; }
.card { fill: #eef2f7; stroke: #57606a; stroke-width: 1.3; }
.ends { stroke: #1a7f37; stroke-width: 2.6; }
.sink { fill: none; stroke: #57606a; stroke-dasharray: 2 3; }
.line { fill: none; stroke: #2f6fb5; stroke-width: 1.5; }
.head { fill: #2f6fb5; }
.topic { fill: #1b4b80; }
.below .line { stroke: #c2571a; }
.below .head { fill: #c2571a; }
.below .topic { fill: #8f3d0d; }
.latched .line { stroke-dasharray: 6 3; }
@media (prefers-color-scheme: dark) {
.page { fill: #0d1117; stroke: #30363d; }
.name { fill: #e6edf3; }
.small { fill: #9da7b3; }
.card { fill: #1c2430; stroke: #8b949e; }
.ends { stroke: #3fb950; }
.sink { fill: none; stroke: #8b949e; }
.line { stroke: #58a6ff; }
.head { fill: #58a6ff; }
.topic { fill: #a5d0ff; }
.below .line { stroke: #f0883e; }
.below .head { fill: #f0883e; }
.below .topic { fill: #ffc599; }
}
"""


def write_picture(graph: Graph, path: Path, title: str) -> None:
    """Draw the resolved wiring as SVG.

    Parameters
    ----------
    graph : Graph
        The graph.
    path : Path
        A file whose name ends in .svg, or ``-`` for standard output.
    title : str
        What the picture shows.

    Raises
    ------
    InputError
        If the graph could not run, or the file cannot be written; then none has changed.
    """
    to_screen = str(path) == "-"
    if not to_screen and path.suffix != ".svg":
        raise InputError(f"--graph: {path}: the picture is SVG, and its name must end in .svg")
    text = draw(sketch_of(graph), title)
    if to_screen:
        sys.stdout.write(text)
    else:
        write_atomically({path: lambda part: part.write_text(text, encoding="utf-8")})


def draw(sketch: Sketch, title: str) -> str:
    """The wiring as the text of an SVG file.

    Parameters
    ----------
    sketch : Sketch
        The graph.
    title : str
        What the picture shows, for who cannot see it.
    """
    picture = lay_out(sketch)
    wide, high = math.ceil(picture.width), math.ceil(picture.height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}" width="{wide}" '
        f'height="{high}" role="img" aria-label={quoteattr(_UNFIT.sub("?", title))}>',
        f"<title>{_safe(title)}</title>",
        f"<style>{_STYLE}</style>",
        f'<rect class="page" x="0.5" y="0.5" width="{wide - 1}" height="{high - 1}" rx="8"/>',
        *_content(picture),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _content(picture: Picture) -> Iterator[str]:
    # What is near the boxes is drawn last, so that its colour is on top where lines cross.
    for strand in sorted(picture.strands, key=lambda one: -one.strand.row):
        yield from _strand(strand)
    for box in picture.boxes:
        yield from _box(box)
    for sink in picture.sinks:
        yield from _sink(sink)
    for name, label in picture.signs.items():
        yield from _sign(name, label)


def _strand(drawn: DrawnStrand) -> Iterator[str]:
    strand = drawn.strand
    names = ["below" if strand.way == "below" else "ahead"]
    names += ["latched"] if strand.wire.latched else []
    yield f'<g class="{" ".join(names)}">'
    yield f"<title>{_safe(strand.wire.title)}</title>"
    for line in drawn.lines:
        yield f'<path class="line" d="{_path(line, head=strand.way != "loose")}"/>'
        if strand.way == "loose":
            yield _dot(line[-1])
        else:
            yield _head(line[-1])
    yield from map(_dot, drawn.forks)
    for label in drawn.labels:
        yield _text("topic", label.text, label.rect, TOPIC)
    yield "</g>"


def _dot(place: Point) -> str:
    return f'<circle class="head" cx="{_number(place[0])}" cy="{_number(place[1])}" r="{_FORK}"/>'


def _box(drawn: DrawnBox) -> Iterator[str]:
    box, rect = drawn.box, drawn.rect
    yield "<g>"
    yield f"<title>{_safe(box.title)}</title>"
    steps = round((drawn.cover.right - rect.right) / CARD)
    for step in range(steps, -1, -1):
        out = step * CARD
        card = Rect(rect.left + out, rect.top - out, rect.right + out, rect.bottom - out)
        yield _rect("card ends" if box.ends else "card", card)
    middle = (rect.top + rect.bottom) / 2.0
    small = small_text(box)
    base = middle + 0.36 * NAME - (SMALL / 2.0 + 1.0 if small else 0.0)
    yield _middle("name", name_text(box), rect, base, NAME)
    if small:
        yield _middle("small", small, rect, base + SMALL + UNDER, SMALL)
    yield "</g>"


def _sink(drawn: DrawnBox) -> Iterator[str]:
    rect = drawn.rect
    base = (rect.top + rect.bottom) / 2.0 + 0.36 * TOPIC
    yield "<g>"
    yield f"<title>{_safe(drawn.box.title)}</title>"
    yield _rect("sink", rect)
    yield _middle("small", sink_text(drawn.box), rect, base, TOPIC)
    yield "</g>"


def _middle(name: str, text: str, rect: Rect, base: float, size: float) -> str:
    """A text in the middle of a rectangle that is wide enough for it."""
    wide = text_width(text, size, bold=name == "name")
    left = (rect.left + rect.right - wide) / 2.0
    return _text(name, text, Rect(left, base - size, left + wide, base + _DESCENT), size)


def _sign(name: str, label: Label) -> Iterator[str]:
    left, y = label.rect.left - _SAMPLE - 4.0, (label.rect.top + label.rect.bottom) / 2.0
    yield f'<g class="{name if name != "ends" else "sign"}">'
    if name == "ends":
        yield _rect("card ends", Rect(left, y - 7.0, left + _SAMPLE, y + 7.0))
    else:
        end = (left + _SAMPLE, y)
        yield f'<path class="line" d="{_path(((left, y), end), head=True)}"/>'
        yield _head(end)
    yield _text("small", label.text, label.rect, TOPIC)
    yield "</g>"


def _rect(name: str, rect: Rect) -> str:
    return (
        f'<rect class="{name}" x="{_number(rect.left)}" y="{_number(rect.top)}" '
        f'width="{_number(rect.right - rect.left)}" '
        f'height="{_number(rect.bottom - rect.top)}" rx="{_CORNER}"/>'
    )


def _path(line: Sequence[Point], *, head: bool) -> str:
    """A way with rounded corners; what is neither level nor upright becomes a double bend."""
    corners = list(line)
    if head:
        x, y = corners[-1]
        corners[-1] = (x - HEAD + 1.0, y)
    parts = [f"M{_point(corners[0])}"]
    for i, (here, there) in enumerate(pairwise(corners)):
        if here[0] != there[0] and here[1] != there[1]:
            middle = (here[0] + there[0]) / 2.0
            bend = [(middle, here[1]), (middle, there[1]), there]
            parts.append("C" + " ".join(map(_point, bend)))
        elif i + 2 < len(corners) and _turns(here, there, corners[i + 2]):
            after = corners[i + 2]
            radius = min(_ROUND, math.dist(here, there) / 2.0, math.dist(there, after) / 2.0)
            parts.append(f"L{_point(_towards(there, here, radius))}")
            parts.append(f"Q{_point(there)} {_point(_towards(there, after, radius))}")
        else:
            parts.append(f"L{_point(there)}")
    return " ".join(parts)


def _turns(before: Point, corner: Point, after: Point) -> bool:
    """Whether a level way becomes an upright one here, or the other way round."""
    level, upright = before[1] == corner[1], before[0] == corner[0]
    return (level and corner[0] == after[0]) or (upright and corner[1] == after[1])


def _towards(start: Point, end: Point, way: float) -> Point:
    length = math.dist(start, end)
    share = way / length if length > 0.0 else 0.0
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


def _head(end: Point) -> str:
    x, y = end
    back, half = x - HEAD, 0.42 * HEAD
    return f'<path class="head" d="M{_point((x, y))} L{_point((back, y - half))} ' + (
        f'L{_point((back, y + half))} Z"/>'
    )


def _point(point: Point) -> str:
    return f"{_number(point[0])},{_number(point[1])}"


def _text(name: str, text: str, rect: Rect, size: float) -> str:
    """A text that is as wide as its rectangle, whatever font there is."""
    return (
        f'<text class="{name}" x="{_number(rect.left)}" y="{_number(rect.bottom - _DESCENT)}" '
        f'font-size="{size}" textLength="{_number(rect.right - rect.left)}" '
        f'lengthAdjust="spacingAndGlyphs">{_safe(text)}</text>'
    )


def _number(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _safe(text: str) -> str:
    """Text for XML, without the signs that XML cannot hold."""
    return escape(_UNFIT.sub("?", text))
