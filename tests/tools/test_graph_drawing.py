import random
import re
from collections.abc import Callable
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE
from palpate.tools.cli import command_line as cli
from palpate.tools.graph_drawing import (
    Box,
    Sketch,
    Wire,
    back_edges,
    dot_text,
    draw_svg,
    joined,
    layers_of,
    mermaid_text,
    sketch_of,
)

SVG = "{http://www.w3.org/2000/svg}"
Point = tuple[float, float]


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
    """The shipped graph with so many fingers."""
    return describe(EXPLORE, {"fingers": SourceMapped(fingers, "")}, Path("out")).graph


def any_sketch(seed):
    """A graph of some boxes with wires at random, to themselves and back as well."""
    rng = random.Random(seed)
    number = seed + 1
    boxes = [
        Box(
            text="n" * rng.randint(1, 20),
            title="",
            count=rng.randint(1, 8),
        )
        for _ in range(number)
    ]
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
    sinks = [Box(text="sink", title="") for _ in range(rng.randint(0, 2))]
    return Sketch(tuple(boxes), tuple(wires), tuple(sinks))


SKETCHES: list[Callable[[], Sketch]] = [
    *(lambda fingers=n: sketch_of(explore_graph(fingers)) for n in (1, 3)),
    *(lambda seed=n: any_sketch(seed) for n in range(12)),
]


def rect_of(one):
    x, y = float(one.get("x", "")), float(one.get("y", ""))
    if one.tag == f"{SVG}text":
        size = float(one.get("font-size", ""))
        return Rect(x, y - 0.75 * size, x + float(one.get("textLength", "")), y + 0.2 * size)
    return Rect(x, y, x + float(one.get("width", "")), y + float(one.get("height", "")))


def of_class(root, tag, *classes):
    return [one for one in root.iter(f"{SVG}{tag}") if one.get("class", "").split()[0] in classes]


def ways_of(root):
    """Corners of all lines, those of one group together."""
    found = []
    for group in root.iter(f"{SVG}g"):
        ways = []
        for one in of_class(group, "path", "line"):
            way: list[Point] = []
            for kind, value in re.findall(r"([MHV])([\d.,-]+)", one.get("d", "")):
                if kind == "M":
                    x, y = map(float, value.split(","))
                else:
                    x, y = (float(value), y) if kind == "H" else (x, float(value))
                way.append((x, y))
            ways.append(way)
        found.append(ways)
    return found


@pytest.mark.parametrize("sketch", SKETCHES)
def test_nothing_covers_anything(sketch):
    root = ElementTree.fromstring(draw_svg(sketch(), "t"))
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
    fronts = cards if not any(box.count > 1 for box in sketch().boxes) else []
    for ways in ways_of(root):
        for (ax, ay), (bx, by) in (piece for way in ways for piece in pairwise(way)):
            line = Rect(min(ax, bx) + 0.2, min(ay, by) - 0.1, max(ax, bx) - 0.2, max(ay, by) + 0.1)
            assert not [one for one in (*topics, *fronts) if line.meets(one)]


@pytest.mark.parametrize("sketch", SKETCHES)
def test_lines_of_different_wires_cross_but_never_run_upon_each_other(sketch):
    pieces = []
    for number, ways in enumerate(ways_of(ElementTree.fromstring(draw_svg(sketch(), "t")))):
        pieces += [(number, *piece) for way in ways for piece in pairwise(way)]
    for (m, a, b), (n, c, d) in combinations(pieces, 2):
        for level in (0, 1) if m != n else ():
            if a[level] == b[level] and c[level] == d[level] and abs(a[level] - c[level]) < 1.5:
                along = 1 - level
                low = max(min(a[along], b[along]), min(c[along], d[along]))
                assert low >= min(max(a[along], b[along]), max(c[along], d[along]))


@pytest.mark.parametrize("sketch", SKETCHES)
def test_every_subscriber_is_reached_from_the_box_that_publishes(sketch):
    drawn = sketch()
    root = ElementTree.fromstring(draw_svg(drawn, "t"))
    boxes = []  # By their front cards, which are the last in their groups
    for group in root.iter(f"{SVG}g"):
        if (cards := of_class(group, "rect", "card")) and group.get("class") is None:
            boxes.append(rect_of(cards[-1]))
    found = set()
    for group in root.iter(f"{SVG}g"):
        labels = [text.text for text in of_class(group, "text", "topic")]
        for way in ways_of_group(group) if labels else ():
            [source] = [i for i, one in enumerate(boxes) if _beside(one.right, one, way[0])]
            end = (way[-1][0] + 8.0, way[-1][1])  # The head is drawn by itself
            for target in [i for i, one in enumerate(boxes) if _beside(one.left, one, end)]:
                found |= {(source, target, label) for label in labels}
    assert found == {
        (wire.source, target, label)
        for wire in drawn.wires
        for target in wire.targets
        for label in wire.labels
    }


def ways_of_group(group):
    outer = ElementTree.Element("svg")
    outer.append(group)
    return ways_of(outer)[0]


def _beside(side, box, point):
    return abs(point[0] - side) < 0.2 and box.top < point[1] < box.bottom


def test_a_line_to_the_only_box_of_the_next_column_is_straight():
    boxes = tuple(Box(text=name, title="") for name in "abc")
    wires = tuple(Wire(source=i, targets=(i + 1,), labels=(f"/{i}",), title="") for i in range(2))
    for ways in ways_of(ElementTree.fromstring(draw_svg(Sketch(boxes, wires, ()), "t"))):
        assert all(len({y for _, y in way}) == 1 for way in ways)


@pytest.mark.parametrize(
    ("edges", "back"),
    [
        ({0: [1], 1: [2], 2: []}, set()),
        ({0: [1], 1: [2], 2: [0]}, {(2, 0)}),
        ({0: [0]}, {(0, 0)}),
        ({0: [1, 2], 1: [2], 2: [1]}, {(2, 1)}),
        ({0: [], 1: [2], 2: [1]}, {(2, 1)}),
    ],
)
def test_an_edge_goes_back_if_the_way_has_come_from_there(edges, back):
    assert back_edges(edges) == back


@pytest.mark.parametrize(
    ("edges", "columns"),
    [
        ({}, []),
        ({0: [1, 2], 1: [2], 2: [0]}, [[0], [1], [2]]),
        ({0: [2], 1: [2], 2: []}, [[0, 1], [2]]),
        ({0: [3], 1: [2], 2: [], 3: []}, [[0, 1], [3, 2]]),
        # Drawn in the order of the file, every one of these three lines would cross the others.
        ({0: [5], 1: [4], 2: [3], 3: [], 4: [], 5: []}, [[0, 1, 2], [5, 4, 3]]),
        ({i: [(i + 1) % 5000] for i in range(5000)}, [[i] for i in range(5000)]),
    ],
)
def test_the_column_is_the_length_of_the_longest_way(edges, columns):
    assert layers_of(edges) == columns


def wires_of(sketch):
    names = [box.text for box in sketch.boxes]
    return {
        wire.labels[0]: (names[wire.source], [names[target] for target in wire.targets])
        for wire in sketch.wires
    }


def test_the_sketch_has_every_node_and_every_topic():
    graph, sketch = explore_graph(1), sketch_of(explore_graph(1))
    assert {box.text for box in (*sketch.boxes, *sketch.sinks)} == {e.name for e in graph.entries}
    assert [sink.text for sink in sketch.sinks] == ["recorder"]
    assert "recorder" not in {box.text for box in sketch.boxes}
    assert [box.text for box in sketch.boxes if box.ends] == ["evaluator"]
    wires = wires_of(sketch)
    assert set(wires) == set(graph.topics())
    assert wires["/touch/patch"] == ("curvature", ["tracer", "reconstructor"])
    assert wires["/score"] == ("evaluator", [])
    latched = {wire.labels[0] for wire in sketch.wires if wire.latched}
    assert latched == {"/world", "/truth", "/touch/info"}
    together = joined(sketch.wires)
    assert ("/contour/traced", "/probe/traced") in [wire.labels for wire in together]
    assert sum(len(wire.labels) for wire in together) == len(graph.topics())


def test_a_driver_is_a_node_that_publishes():
    frames = SourceMapped(str(Path(__file__).parents[2] / "examples" / "frames.csv"), "")
    arguments = {"path": frames, "scale": SourceMapped(0.001, "")}
    graph = describe(EXPLORE.with_name("driver.yaml"), arguments, Path("out")).graph
    sketch = sketch_of(graph)
    assert [sink.text for sink in sketch.sinks] == ["recorder"]
    assert wires_of(sketch)["/touch/raw"] == ("driver", ["filter"])


def test_the_nodes_of_several_fingers_are_stacks():
    sketch = sketch_of(explore_graph(3))
    kinds = ("simulator", "filter", "curvature", "tracer")
    for box in sketch.boxes:
        assert box.count == (3 if box.text in kinds else 1)
        assert box.name == box.text + (" × 3" if box.text in kinds else "")
    wires = wires_of(sketch)
    assert wires["/touch/raw × 3"] == ("simulator", ["filter"])
    assert wires["/contour/goal"] == ("planner", ["tracer"])


def test_titles_tell_nodes_parameters_and_types():
    sketch = sketch_of(explore_graph(3))
    [tracer] = [box for box in sketch.boxes if box.text == "tracer"]
    names = [line.partition(":")[0] for line in tracer.title.splitlines()]
    assert names == ["tracer_1", "tracer_2", "tracer_3"]
    assert '"most_touches": 150' in tracer.title
    [raw] = [wire for wire in sketch.wires if wire.labels[0].startswith("/touch/raw")]
    assert raw.title.splitlines()[1] == (
        "/finger_2/touch/raw: TactileFrame, simulator_2 to filter_2, recorder"
    )
    root = ElementTree.fromstring(draw_svg(sketch, "t"))
    titles = [title.text for title in root.iter(f"{SVG}title")]
    assert {tracer.title, raw.title} < {*titles}


def test_the_picture_is_one_file_of_valid_xml_for_light_and_dark_pages():
    text = draw_svg(sketch_of(explore_graph(3)), "Wiring of explore.yaml")
    root = ElementTree.fromstring(text)
    assert root.findtext(f"{SVG}title") == "Wiring of explore.yaml"
    assert text.count("http") == 1  # its own namespace: nothing is fetched
    assert not re.search(r"<image|<script|@import|url\(|@font-face", text)
    light, dark = text.split("@media (prefers-color-scheme: dark)")
    coloured = re.compile(r"^(\.[\w. ]+) \{[^}]*#", re.MULTILINE)
    assert set(coloured.findall(light)) == set(coloured.findall(dark.partition("</style>")[0]))


@pytest.mark.parametrize("text", ['<b> & "c"', "\x00\x1b", "\ud800", "]]>", "\ufffe"])
def test_no_name_breaks_the_picture(text):
    box = Box(text=text or "a", title=text)
    wire = Wire(source=0, targets=(0,), labels=(text,), title=text, latched=True)
    ElementTree.fromstring(draw_svg(Sketch((box,), (wire,), (box,)), text))


def test_a_graph_without_wires_is_drawn():
    root = ElementTree.fromstring(draw_svg(Sketch((Box(text="a", title=""),), (), ()), "t"))
    assert [text.text for text in root.iter(f"{SVG}text")] == ["a"]


TWO = Sketch(
    (Box(text='a "b"', title="", count=2), Box(text="c", title="", ends=True)),
    (
        Wire(source=0, targets=(1,), labels=("/x",), title="", latched=True),
        Wire(source=0, targets=(1,), labels=("/y",), title="", latched=True),
        Wire(source=1, targets=(), labels=("/z",), title=""),
    ),
    (Box(text="r", title=""),),
)


def test_the_wiring_as_text_for_mermaid():
    assert mermaid_text(TWO).splitlines() == [
        "flowchart LR",
        '  n0["a #quot;b#quot; × 2"]',
        '  n1["c"]',
        "  style n1 stroke-width:3px",
        '  n2["r: subscribes to every topic"]',
        '  n0 -.->|"/x, /y"| n1',
        '  n1 -->|"/z"| nowhere1(( ))',
    ]


def test_the_wiring_as_text_for_graphviz():
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


def test_the_picture_is_written_and_nothing_is_started(here):
    begins = {"w.svg": "<svg ", "w.mmd": "flowchart LR\n", "w.dot": "digraph {\n"}
    for name, begin in begins.items():
        assert cli.run(["launch", "explore.yaml", "fingers:=2", "--graph", name]) == 0
        text = (here / name).read_text(encoding="utf-8")
        assert text.startswith(begin) and "simulator × 2" in text
    assert {path.name for path in here.iterdir()} == {*begins}


@pytest.mark.parametrize("arguments", [["--graph"], ["--graph", "-"]])
def test_without_a_file_the_picture_goes_to_standard_output(capsys, arguments):
    assert cli.run(["launch", "explore.yaml", *arguments]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("<svg ") and printed.endswith("</svg>\n")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wiring.png", "wiring.png: must end in one of .svg, .mmd, .dot"),
        ("none/wiring.svg", "none/wiring.svg: cannot be written: there is no folder none"),
    ],
)
def test_a_file_that_cannot_be_is_refused(here, capsys, name, words):
    assert cli.run(["launch", "explore.yaml", "--graph", name]) == 2
    assert words in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_the_arguments_are_shown_and_nothing_is_started(here, capsys):
    assert cli.run(["launch", "explore.yaml", "-s"]) == 0
    assert "fingers" in capsys.readouterr().out
    assert list(here.iterdir()) == []


def test_the_picture_in_the_documentation_is_that_of_the_shipped_graph(capsys):
    page = Path(__file__).parents[2] / "docs" / "figures" / "graph.svg"
    assert cli.run(["launch", "explore.yaml", "--graph"]) == 0
    printed = capsys.readouterr().out
    # Titles name the run directory, which is another each time.
    assert _without_titles(printed) == _without_titles(page.read_text(encoding="utf-8"))


def _without_titles(text):
    return "".join(part.rpartition("</title>")[2] for part in text.split("<title>"))
