from __future__ import annotations

from collections.abc import Callable

from palpate.launch.graph import Graph
from palpate.tools.graph_drawing.sketch import Sketch, joined, sketch_of


def wires_of(sketch: Sketch) -> dict[str, tuple[str, list[str]]]:
    return {
        wire.labels[0]: (
            sketch.boxes[wire.source].text,
            [sketch.boxes[target].text for target in wire.targets],
        )
        for wire in sketch.wires
    }


def test_the_sketch_has_every_node_and_every_topic(explore_graph: Callable[[int], Graph]) -> None:
    graph = explore_graph(1)
    sketch = sketch_of(graph)
    assert {box.text for box in (*sketch.boxes, *sketch.sinks)} == {e.name for e in graph.entries}
    wires = wires_of(sketch)
    assert set(wires) == set(graph.topics())
    assert wires["/touch/patch"] == ("curvature", ["tracer", "reconstructor"])
    assert wires["/score"] == ("evaluator", [])


def test_who_hears_everything_has_no_wires(explore_graph: Callable[[int], Graph]) -> None:
    sketch = sketch_of(explore_graph(1))
    assert [sink.text for sink in sketch.sinks] == ["recorder"]
    assert "recorder" not in {box.text for box in sketch.boxes}


def test_the_nodes_of_several_fingers_are_stacks(explore_graph: Callable[[int], Graph]) -> None:
    sketch = sketch_of(explore_graph(3))
    assert {box.text: box.count for box in sketch.boxes} == {
        "simulator": 3,
        "filter": 3,
        "curvature": 3,
        "tracer": 3,
        "planner": 1,
        "reconstructor": 1,
        "evaluator": 1,
    }
    wires = wires_of(sketch)
    assert wires["/touch/raw × 3"] == ("simulator", ["filter"])
    assert wires["/contour/goal"] == ("planner", ["tracer"])


def test_what_is_pointed_at_says_everything(explore_graph: Callable[[int], Graph]) -> None:
    sketch = sketch_of(explore_graph(3))
    [tracer] = [box for box in sketch.boxes if box.text == "tracer"]
    assert [line.partition(":")[0] for line in tracer.title.splitlines()] == [
        "tracer_1",
        "tracer_2",
        "tracer_3",
    ]
    assert '"most_touches": 150' in tracer.title
    [raw] = [wire for wire in sketch.wires if wire.labels[0].startswith("/touch/raw")]
    assert raw.title.splitlines()[1] == (
        "/finger_2/touch/raw: TactileFrame, simulator_2 to filter_2, recorder"
    )


def test_a_topic_is_latched_if_somebody_needs_it_first(
    explore_graph: Callable[[int], Graph],
) -> None:
    latched = {wire.labels[0] for wire in sketch_of(explore_graph(1)).wires if wire.latched}
    assert latched == {"/world", "/truth", "/touch/info"}


def test_the_box_that_ends_the_graph_is_known(explore_graph: Callable[[int], Graph]) -> None:
    assert [box.text for box in sketch_of(explore_graph(1)).boxes if box.ends] == ["evaluator"]


def test_topics_between_the_same_boxes_become_one_wire(
    explore_graph: Callable[[int], Graph],
) -> None:
    wires = joined(sketch_of(explore_graph(1)).wires)
    assert ("/contour/traced", "/probe/traced") in [wire.labels for wire in wires]
    assert sum(len(wire.labels) for wire in wires) == len(explore_graph(1).topics())
