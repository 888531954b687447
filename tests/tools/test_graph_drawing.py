"""Drawings of graphs: nothing covers anything, and every topic stands where it is read."""

import random
from functools import cache
from itertools import combinations, pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from palpate.launch.files.source_map import SourceMapped
from palpate.launch.launch_file import describe
from palpate.launch.launch_source import EXPLORE
from palpate.tools.graph_drawing import draw_chart, draw_svg, reading_order
from palpate.tools.graph_sketch import Box, Sketch, Wire, dot_text, mermaid_text, sketch_of

SVG = "{http://www.w3.org/2000/svg}"
DOCS = Path(__file__).parents[2]


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
def chart(name):
    """The panel of a sketch, and its front boxes by index; all places in points."""
    figure, _ = draw_chart(sketch(name))
    [axes] = figure.axes
    boxes = {
        int(one.get_gid().removeprefix("box")): span(one)
        for one in axes.patches if (one.get_gid() or "").startswith("box")
    }  # fmt: skip
    return axes, boxes


def span(artist):
    """Left, upper, right and lower end of something drawn."""
    box = artist.get_window_extent().transformed(artist.axes.transData.inverted())
    return np.concatenate([box.min, box.max])


def topics(axes):
    return [one for one in axes.texts if (one.get_gid() or "").startswith("topic")]


def is_within(inner, outer):
    low, high = outer[:2] - 0.1, outer[2:] + 0.1
    return (low <= inner[:2]).all() and (inner[2:] <= high).all()


def meet(first, second):
    return (np.maximum(first[:2], second[:2]) < np.minimum(first[2:], second[2:]) - 0.1).all()


LARGER = [pytest.param(name, marks=pytest.mark.slow) for name in range(4, 12)]
SKETCHES = pytest.mark.parametrize("name", [-1, -3, *range(4), *LARGER])


@SKETCHES
def test_nothing_covers_anything(name):
    axes, boxes = chart(name)
    (right, bottom), texts = (axes.get_xlim()[1], axes.get_ylim()[0]), [*map(span, axes.texts)]
    assert all(is_within(one, np.array([0.0, 0.0, right, bottom])) for one in texts)
    assert not [pair for pair in combinations(texts, 2) if meet(*pair)]
    assert not [pair for pair in combinations(boxes.values(), 2) if meet(*pair)]
    lines = [one for one in axes.lines if one.get_gid()]
    # A line runs behind its topics: each has a box, or a cell of its own, over the lines.
    over = [one for one in axes.patches if all(one.zorder > line.zorder for line in lines)]
    cells = [span(one) for one in over if one.get_gid() is None] + [*boxes.values()]
    for one in topics(axes):
        assert any(is_within(span(one), cell) for cell in cells)
    for line in lines:
        for start, end in pairwise(line.get_xydata()):
            piece = np.concatenate([np.minimum(start, end) - 0.05, np.maximum(start, end) + 0.05])
            assert not [one for one in boxes.values() if meet(piece, one)]


@SKETCHES
def test_topics_and_lines_lead_from_publishers_to_subscribers(name):
    axes, boxes = chart(name)
    drawn = set()
    for text in topics(axes):
        (left, top, right, bottom), label = span(text), text.get_text()
        [row] = [i for i, box in boxes.items() if box[1] < (top + bottom) / 2 < box[3]]
        column = [i for i, box in boxes.items() if box[0] < (left + right) / 2 < box[2]]
        drawn.add((row, *column, label))
    wires = [(wire, label) for wire in sketch(name).wires for label in wire.labels]
    assert drawn == {
        (wire.source, *to, label)
        for wire, label in wires for to in ([[text] for text in wire.targets] or [[]])
    }  # fmt: skip
    ways = set()
    for line in (one for one in axes.lines if (one.get_gid() or "").startswith("line")):
        (x, y), *_, (to_x, to_y) = line.get_xydata()
        [source] = [
            i for i, (left, top, right, bottom) in boxes.items()
            if top < y < bottom and min(abs(x - left), abs(x - right)) < 1.5
        ]  # fmt: skip
        ends = [
            i for i, (left, top, right, bottom) in boxes.items()
            if left < to_x < right and min(abs(to_y - top), abs(to_y - bottom)) < 4.5
        ]  # fmt: skip
        ways.add((source, *ends))
    wires = sketch(name).wires
    onward = {(w.source, to) for w in wires for to in w.targets if to != w.source}
    assert ways == onward | {(w.source,) for w in wires if not w.targets}


@pytest.mark.parametrize("seed", range(20))
def test_subscriber_follows_its_publishers_in_any_order_unless_in_a_loop(seed):
    rng, number = random.Random(seed), 2 + seed
    names = rng.sample(range(number), number)
    ahead = {names[i]: [names[k] for k in range(i + 1, number) if rng.random() < 0.2]
             for i in range(number)}  # fmt: skip
    place = {box: i for i, box in enumerate(reading_order(ahead))}
    assert all(place[box] < place[to] for box, targets in ahead.items() for to in targets)
    assert reading_order({0: [1, 2], 1: [2], 2: [0]}) == [0, 1, 2]  # only the last goes back
    shipped = sketch(-1)
    order = rng.sample(range(len(shipped.boxes)), len(shipped.boxes))
    edges = {i: [to for w in shipped.wires if w.source == i for to in w.targets] for i in order}
    names = [shipped.boxes[i].text for i in reading_order(edges)]
    assert names[:4] == ["simulator", "filter", "curvature", "tracer"]
    assert {*names[4:6]} == {"planner", "reconstructor"} and names[6:] == ["evaluator"]


def wires_of(drawn):
    names = [box.text for box in drawn.boxes]
    return {
        wire.labels[0]: (names[wire.source], [names[target] for target in wire.targets])
        for wire in drawn.wires
    }


def test_sketch_has_every_node_and_every_topic():
    graph, shipped = explore_graph(1), sketch(-1)
    assert {box.text for box in (*shipped.boxes, *shipped.sinks)} == {e.name for e in graph.entries}
    assert [sink.text for sink in shipped.sinks] == ["recorder"]
    assert [box.text for box in shipped.boxes if box.ends] == ["evaluator"]
    wires = wires_of(shipped)
    assert {*wires} == {*graph.topics()} and wires["/score"] == ("evaluator", [])
    assert wires["/touch/patch"] == ("curvature", ["tracer", "reconstructor"])
    latched = {wire.labels[0] for wire in shipped.wires if wire.latched}
    assert latched == {"/world", "/truth", "/touch/info"}
    frames = SourceMapped(str(DOCS / "examples" / "frames.csv"), "")
    arguments = {"path": frames, "scale": SourceMapped(0.001, "")}
    driver = describe(EXPLORE.with_name("driver.yaml"), arguments, Path("out")).graph
    assert wires_of(sketch_of(driver))["/touch/raw"] == ("driver", ["filter"])


def test_nodes_of_several_fingers_are_stacks_with_titles():
    shipped, kinds = sketch(-3), ("simulator", "filter", "curvature", "tracer")
    for box in shipped.boxes:
        assert box.count == (3 if box.text in kinds else 1)
        assert box.name == box.text + (" × 3" if box.text in kinds else "")
    assert wires_of(shipped)["/touch/raw × 3"] == ("simulator", ["filter"])
    [tracer] = [box for box in shipped.boxes if box.text == "tracer"]
    names = [line.partition(":")[0] for line in tracer.title.splitlines()]
    assert names == ["tracer_1", "tracer_2", "tracer_3"] and '"most_touches": 150' in tracer.title
    [raw] = [wire for wire in shipped.wires if wire.labels[0].startswith("/touch/raw")]
    second = "/finger_2/touch/raw: TactileFrame, simulator_2 to filter_2, recorder"
    assert raw.title.splitlines()[1] == second
    assert {tracer.title, raw.title} < {
        title.text for title in ElementTree.fromstring(draw_svg(shipped, "t")).iter(f"{SVG}title")
    }


def test_no_name_breaks_the_picture():
    for text in ('<b> & "c"', "\x00\x1b", "\ud800", "]]>", "\ufffe", "$a$ $b", "触"):
        only = box(text, text)
        wire = Wire(source=0, targets=(0,), labels=(text,), title=text, latched=True)
        ElementTree.fromstring(draw_svg(Sketch((only,), (wire,), (only,)), text))


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


def test_launch_with_graph_draws_and_starts_nothing(here, call, refusal):
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
    page = (DOCS / "docs" / "figures" / "graph.svg").read_text(encoding="utf-8")
    printed = call("launch explore.yaml --graph").out
    shown, wanted = (
        [text.text for text in ElementTree.fromstring(picture).iter(f"{SVG}text")]
        for picture in (printed, page)
    )
    assert shown == wanted
    assert {"simulator", "/touch/raw", "recorder: subscribes to every topic"} < {*shown}
