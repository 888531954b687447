"""Drawings of graphs: nothing covers anything, and every subscriber is reached."""

import random
import re
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE
from palpate.tools.graph_drawing import (
    Box,
    Sketch,
    Wire,
    dot_text,
    draw_svg,
    mermaid_text,
    sketch_of,
)

SVG = "{http://www.w3.org/2000/svg}"
DOCS = Path(__file__).parents[2]


class Rect(NamedTuple):
    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other):
        across = self.left < other.right and other.left < self.right
        return across and self.top < other.bottom and other.top < self.bottom


@cache
def explore_graph(fingers):
    """The shipped graph with a number of fingers."""
    return describe(EXPLORE, {"fingers": SourceMapped(fingers, "")}, Path("out")).graph


def box(text, title="", **how):
    return Box(text=text, title=title, **how)


def random_sketch(seed):
    """Boxes with wires at random, to themselves and back as well."""
    rng = random.Random(seed)
    number = seed + 1
    boxes = [box("n" * rng.randint(1, 20), count=rng.randint(1, 8)) for _ in range(number)]
    wires = [
        Wire(
            source=rng.randrange(number),
            targets=tuple(sorted(rng.sample(range(number), rng.randint(0, min(4, number))))),
            labels=tuple(f"/{i}" + "/t" * rng.randint(0, 12) for _ in range(rng.randint(1, 3))),
            title="",
            latched=rng.random() < 0.3,
        )
        for i in range(rng.randint(0, 25))
    ]
    sinks = [box("sink") for _ in range(rng.randint(0, 2))]
    return Sketch((*boxes,), (*wires,), (*sinks,))


@cache
def sketch(name):
    return sketch_of(explore_graph(-name)) if name < 0 else random_sketch(name)


@cache
def drawing(name):
    return ElementTree.fromstring(draw_svg(sketch(name), "t"))


SKETCHES = pytest.mark.parametrize("name", [-1, -3, *range(12)])


def rect_of(one):
    x, y = float(one.get("x", "")), float(one.get("y", ""))
    if one.tag == f"{SVG}text":
        size = float(one.get("font-size", ""))
        return Rect(x, y - 0.75 * size, x + float(one.get("textLength", "")), y + 0.2 * size)
    return Rect(x, y, x + float(one.get("width", "")), y + float(one.get("height", "")))


def of_class(root, tag, *classes):
    return [one for one in root.iter(f"{SVG}{tag}") if one.get("class", "").split()[0] in classes]


def lines_of(group):
    """Corners of the lines of a group."""
    lines = []
    for one in of_class(group, "path", "line"):
        line = []
        for kind, value in re.findall(r"([MHV])([\d.,-]+)", one.get("d", "")):
            if kind == "M":
                x, y = map(float, value.split(","))
            else:
                x, y = (float(value), y) if kind == "H" else (x, float(value))
            line.append((x, y))
        lines.append(line)
    return lines


def pieces_of(root):
    """Straight pieces of all lines, and the number of their group."""
    groups = enumerate(root.iter(f"{SVG}g"))
    return [
        (n, *piece) for n, group in groups for line in lines_of(group) for piece in pairwise(line)
    ]


@SKETCHES
def test_nothing_covers_anything(name):
    root = drawing(name)
    page = Rect(0.0, 0.0, float(root.get("width", "")), float(root.get("height", "")))
    cards = [rect_of(one) for one in of_class(root, "rect", "card", "sink")]
    texts = [rect_of(one) for one in of_class(root, "text", "name", "small", "topic")]
    topics = [rect_of(one) for one in of_class(root, "text", "topic")]
    for one in (*cards, *texts):
        assert page.left < one.left and one.right < page.right
        assert page.top < one.top and one.bottom < page.bottom
    assert not [pair for pair in combinations(texts, 2) if pair[0].meets(pair[1])]
    for a, b in combinations(cards, 2):
        behind = (b.left - a.left, b.top - a.top) == pytest.approx((-4.0, 4.0), abs=0.11)
        assert behind or not a.meets(b)
    assert not [topic for topic in topics for card in cards if topic.meets(card)]
    fronts = cards if not any(one.count > 1 for one in sketch(name).boxes) else []
    for _, (ax, ay), (bx, by) in pieces_of(root):
        line = Rect(min(ax, bx) + 0.2, min(ay, by) - 0.1, max(ax, bx) - 0.2, max(ay, by) + 0.1)
        assert not [one for one in (*topics, *fronts) if line.meets(one)]


@SKETCHES
def test_lines_of_different_wires_never_overlap(name):
    for (m, a, b), (n, c, d) in combinations(pieces_of(drawing(name)), 2):
        for level in (0, 1) if m != n else ():
            if a[level] == b[level] and c[level] == d[level] and abs(a[level] - c[level]) < 1.5:
                along = 1 - level
                low = max(min(a[along], b[along]), min(c[along], d[along]))
                assert low >= min(max(a[along], b[along]), max(c[along], d[along]))


@SKETCHES
def test_every_subscriber_is_reached_from_its_publisher(name):
    boxes, found = [], set()
    for group in drawing(name).iter(f"{SVG}g"):
        if (cards := of_class(group, "rect", "card")) and group.get("class") is None:
            boxes.append(rect_of(cards[-1]))  # the front one of a stack

    def beside(point, side):
        return [
            i for i, one in enumerate(boxes)
            if abs(point[0] - getattr(one, side)) < 0.2 and one.top < point[1] < one.bottom
        ]  # fmt: skip

    for group in drawing(name).iter(f"{SVG}g"):
        labels = [text.text for text in of_class(group, "text", "topic")]
        for line in lines_of(group) if labels else ():
            [source] = beside(line[0], "right")
            end = (line[-1][0] + 8.0, line[-1][1])  # the head is drawn by itself
            found |= {(source, to, label) for to in beside(end, "left") for label in labels}
    wires = sketch(name).wires
    assert found == {(w.source, to, label) for w in wires for to in w.targets for label in w.labels}


def columns_of(edges, number):
    """Boxes drawn above each other, by the order of their columns and within them."""
    names = [f"b{i}" for i in range(number)]
    wires = tuple(
        Wire(source=i, targets=(to,), labels=(f"/{i}_{to}",), title="")
        for i, many in edges.items() for to in many
    )  # fmt: skip
    boxes = tuple(box(name) for name in names)
    root = ElementTree.fromstring(draw_svg(Sketch(boxes, wires, ()), "t"))
    at = {}
    for group in root.iter(f"{SVG}g"):
        cards = of_class(group, "rect", "card")
        texts = [one.text for one in of_class(group, "text", "name")]
        if cards and texts and group.get("class") is None:
            rect = rect_of(cards[-1])
            at[texts[0]] = (rect.left, rect.top)
    lefts = sorted({left for left, _ in at.values()})
    return [
        [names.index(n) for n in sorted(at, key=lambda n: at[n][1]) if at[n][0] == x] for x in lefts
    ]


@pytest.mark.parametrize(
    ("edges", "columns"),
    [
        ({0: [1], 1: [2]}, [[0], [1], [2]]),
        ({0: [1, 2], 1: [2], 2: [0]}, [[0], [1], [2]]),  # an edge goes back
        ({0: [2], 1: [2]}, [[0, 1], [2]]),
        ({0: [3], 1: [2]}, [[0, 1], [3, 2]]),
        # In the order of the file every one of these three lines would cross the others.
        ({0: [5], 1: [4], 2: [3]}, [[0, 1, 2], [5, 4, 3]]),
    ],
)
def test_column_is_the_length_of_the_longest_path(edges, columns):
    assert columns_of(edges, 1 + max(max(columns, key=max))) == columns


def test_line_to_the_only_box_of_the_next_column_is_straight():
    boxes = tuple(box(name) for name in "abc")
    wires = tuple(Wire(source=i, targets=(i + 1,), labels=(f"/{i}",), title="") for i in range(2))
    root = ElementTree.fromstring(draw_svg(Sketch(boxes, wires, ()), "t"))
    assert all(a[1] == b[1] for _, a, b in pieces_of(root))


def wires_of(one):
    names = [box.text for box in one.boxes]
    return {
        wire.labels[0]: (names[wire.source], [names[target] for target in wire.targets])
        for wire in one.wires
    }


def test_sketch_has_every_node_and_every_topic():
    graph, one = explore_graph(1), sketch(-1)
    assert {box.text for box in (*one.boxes, *one.sinks)} == {e.name for e in graph.entries}
    assert [sink.text for sink in one.sinks] == ["recorder"]
    assert [box.text for box in one.boxes if box.ends] == ["evaluator"]
    wires = wires_of(one)
    assert {*wires} == {*graph.topics()} and wires["/score"] == ("evaluator", [])
    assert wires["/touch/patch"] == ("curvature", ["tracer", "reconstructor"])
    latched = {wire.labels[0] for wire in one.wires if wire.latched}
    assert latched == {"/world", "/truth", "/touch/info"}
    frames = SourceMapped(str(DOCS / "examples" / "frames.csv"), "")
    arguments = {"path": frames, "scale": SourceMapped(0.001, "")}
    driver = describe(EXPLORE.with_name("driver.yaml"), arguments, Path("out")).graph
    assert wires_of(sketch_of(driver))["/touch/raw"] == ("driver", ["filter"])


def test_nodes_of_several_fingers_are_stacks_with_titles():
    one, kinds = sketch(-3), ("simulator", "filter", "curvature", "tracer")
    for box in one.boxes:
        assert box.count == (3 if box.text in kinds else 1)
        assert box.name == box.text + (" × 3" if box.text in kinds else "")
    assert wires_of(one)["/touch/raw × 3"] == ("simulator", ["filter"])
    [tracer] = [box for box in one.boxes if box.text == "tracer"]
    names = [line.partition(":")[0] for line in tracer.title.splitlines()]
    assert names == ["tracer_1", "tracer_2", "tracer_3"] and '"most_touches": 150' in tracer.title
    [raw] = [wire for wire in one.wires if wire.labels[0].startswith("/touch/raw")]
    second = "/finger_2/touch/raw: TactileFrame, simulator_2 to filter_2, recorder"
    assert raw.title.splitlines()[1] == second
    assert {tracer.title, raw.title} < {title.text for title in drawing(-3).iter(f"{SVG}title")}


def test_picture_is_self_contained_for_light_and_dark_pages():
    text = draw_svg(sketch(-3), "Wiring of explore.yaml")
    assert ElementTree.fromstring(text).findtext(f"{SVG}title") == "Wiring of explore.yaml"
    assert text.count("http") == 1  # its own namespace
    assert not re.search(r"<image|<script|@import|url\(|@font-face", text)
    light, dark = text.split("@media (prefers-color-scheme: dark)")
    coloured = re.compile(r"^(\.[\w. ]+) \{[^}]*#", re.MULTILINE)
    assert {*coloured.findall(light)} == {*coloured.findall(dark.partition("</style>")[0])}


@pytest.mark.parametrize("text", ['<b> & "c"', "\x00\x1b", "\ud800", "]]>", "\ufffe"])
def test_no_name_breaks_the_picture(text):
    one = box(text, text)
    wire = Wire(source=0, targets=(0,), labels=(text,), title=text, latched=True)
    ElementTree.fromstring(draw_svg(Sketch((one,), (wire,), (one,)), text))
    root = ElementTree.fromstring(draw_svg(Sketch((box("a"),), (), ()), "t"))
    assert [one.text for one in root.iter(f"{SVG}text")] == ["a"]


TWO = Sketch(
    (box('a "b"', count=2), box("c", ends=True)),
    (
        Wire(source=0, targets=(1,), labels=("/x",), title="", latched=True),
        Wire(source=0, targets=(1,), labels=("/y",), title="", latched=True),
        Wire(source=1, targets=(), labels=("/z",), title=""),
    ),
    (box("r"),),
)


def test_wiring_is_written_for_mermaid_and_graphviz():
    assert mermaid_text(TWO).splitlines() == [
        "flowchart LR",
        '  n0["a #quot;b#quot; × 2"]',
        '  n1["c"]',
        "  style n1 stroke-width:3px",
        '  n2["r: subscribes to every topic"]',
        '  n0 -.->|"/x, /y"| n1',
        '  n1 -->|"/z"| nowhere1(( ))',
    ]
    assert dot_text(TWO).splitlines() == [
        "digraph {",
        "  rankdir=LR",
        "  node [shape=box]",
        r'  n0 [label="a \"b\" × 2"]',
        '  n1 [label="c", penwidth=3]',
        '  n2 [label="r: subscribes to every topic", style=dashed]',
        r'  n0 -> n1 [label="/x\n/y", style=dashed]',
        "  nowhere1 [shape=point]",
        '  n1 -> nowhere1 [label="/z"]',
        "}",
    ]


def test_launch_verb_draws_and_starts_nothing(here, call, refusal):
    begins = {"w.svg": "<svg ", "w.mmd": "flowchart LR\n", "w.dot": "digraph {\n"}
    for name, begin in begins.items():
        assert call("launch explore.yaml fingers:=2 --graph", name).code == 0
        text = (here / name).read_text(encoding="utf-8")
        assert text.startswith(begin) and "simulator × 2" in text
    assert call("launch explore.yaml --graph -").out == call("launch explore.yaml --graph").out
    assert "fingers" in call("launch explore.yaml -s").out
    for name, words in (
        ("wiring.png", "wiring.png: must end in one of .svg, .mmd, .dot"),
        ("none/wiring.svg", "none/wiring.svg: cannot be written: there is no folder none"),
    ):
        assert words in refusal("launch explore.yaml --graph", name)
    assert {path.name for path in here.iterdir()} == {*begins}


def test_documentation_shows_the_shipped_graph(call):
    printed = call("launch explore.yaml --graph").out
    page = (DOCS / "docs" / "figures" / "graph.svg").read_text(encoding="utf-8")
    # Titles name the run directory, which is another each time.
    one, other = (re.sub(r"<title>.*?</title>", "", x, flags=re.DOTALL) for x in (printed, page))
    assert one == other
