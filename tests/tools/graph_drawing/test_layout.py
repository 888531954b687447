from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations, pairwise

import pytest

from palpate.launch.graph import Graph
from palpate.tools.graph_drawing.layout import Edges, back_edges, lay_out, layers_of
from palpate.tools.graph_drawing.routing import Picture, Point, Rect
from palpate.tools.graph_drawing.sketch import Box, Sketch, Wire, sketch_of


def texts_and_boxes(picture: Picture) -> list[Rect]:
    labels = [label.rect for strand in picture.strands for label in strand.labels]
    labels += [label.rect for label in picture.signs.values()]
    return labels + [box.cover for box in (*picture.boxes, *picture.sinks)]


def faults(picture: Picture) -> list[str]:
    """Whatever covers something else, or leaves the picture."""
    covers = texts_and_boxes(picture)
    found = [f"{a} meets {b}" for a, b in combinations(covers, 2) if a.meets(b)]
    page = Rect(0.0, 0.0, picture.width, picture.height)
    for one in covers:
        if one.left < page.left or one.top < page.top:
            found.append(f"{one} begins outside")
        if one.right > page.right or one.bottom > page.bottom:
            found.append(f"{one} ends outside")
    return found


def pieces(picture: Picture) -> Iterator[tuple[Point, Point]]:
    for strand in picture.strands:
        for line in strand.lines:
            yield from pairwise(line)


def crossed(picture: Picture) -> list[str]:
    """Boxes and labels that a line runs through."""
    found = []
    for here, there in pieces(picture):
        way = Rect(
            min(here[0], there[0]),
            min(here[1], there[1]),
            max(here[0], there[0]),
            max(here[1], there[1]),
        )
        thin = Rect(way.left + 0.1, way.top - 0.1, way.right - 0.1, way.bottom + 0.1)
        rects = [one.rect for one in picture.boxes]
        rects += [label.rect for strand in picture.strands for label in strand.labels]
        found += [f"{thin} through {rect}" for rect in rects if thin.meets(rect)]
    return found


@pytest.mark.parametrize("fingers", [1, 2, 3, 8])
def test_nothing_covers_anything_in_the_shipped_graph(
    explore_graph: Callable[[int], Graph], fingers: int
) -> None:
    picture = lay_out(sketch_of(explore_graph(fingers)))
    assert faults(picture) == []
    assert crossed(picture) == []


@pytest.mark.parametrize("seed", range(20))
def test_nothing_covers_anything_in_any_graph(
    any_sketch: Callable[[int], Sketch], seed: int
) -> None:
    picture = lay_out(any_sketch(seed))
    assert faults(picture) == []
    assert crossed(picture) == []


def test_what_covers_something_would_be_seen() -> None:
    picture = lay_out(Sketch((Box(text="a", title=""),), (), ()))
    [box] = picture.boxes
    twice = Picture(picture.width, picture.height, (box, box), (), (), {})
    assert len(faults(twice)) == 1
    beyond = Picture(picture.width / 2.0, picture.height, (box,), (), (), {})
    assert len(faults(beyond)) == 1


@pytest.mark.parametrize("seed", range(20))
def test_every_listener_is_reached_from_the_box_that_speaks(
    any_sketch: Callable[[int], Sketch], seed: int
) -> None:
    sketch = any_sketch(seed)
    picture = lay_out(sketch)
    reached = set()
    for strand in picture.strands:
        source = picture.boxes[strand.strand.wire.source].rect
        known = set(strand.lines[0])
        assert strand.lines[0][0][0] == source.right
        for line in strand.lines[1:]:
            assert any(_on(line[0], piece) for one in strand.lines for piece in pairwise(one))
            known |= set(line)
        for i, box in enumerate(picture.boxes):
            if any(x == box.rect.left and box.rect.top < y < box.rect.bottom for x, y in known):
                reached |= {(strand.strand.wire.source, i, label.text) for label in strand.labels}
    assert reached == {
        (wire.source, target, label)
        for wire in sketch.wires
        for target in wire.targets
        for label in wire.labels
    }


def _on(point: Point, piece: tuple[Point, Point]) -> bool:
    (x, y), ((a, b), (c, d)) = point, piece
    return min(a, c) <= x <= max(a, c) and min(b, d) <= y <= max(b, d) and (a == c or b == d)


def test_what_goes_back_runs_below_all_boxes_and_what_goes_far_above(
    explore_graph: Callable[[int], Graph],
) -> None:
    picture = lay_out(sketch_of(explore_graph(1)))
    lowest = max(box.rect.bottom for box in picture.boxes)
    highest = min(box.rect.top for box in picture.boxes)
    for one in picture.strands:
        heights = [y for line in one.lines for _, y in line]
        if one.strand.way == "below":
            assert max(heights) > lowest
        if one.strand.way == "above":
            assert min(heights) < highest


def test_a_line_to_the_only_box_of_the_next_column_is_straight() -> None:
    boxes = tuple(Box(text=name, title="") for name in "abc")
    wires = tuple(Wire(source=i, targets=(i + 1,), labels=(f"/{i}",), title="") for i in range(2))
    for strand in lay_out(Sketch(boxes, wires, ())).strands:
        assert len({y for line in strand.lines for _, y in line}) == 1


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
def test_an_edge_goes_back_if_the_way_has_come_from_there(
    edges: Edges, back: set[tuple[int, int]]
) -> None:
    assert back_edges(edges) == back


@pytest.mark.parametrize(
    ("edges", "columns"),
    [
        ({}, []),
        ({0: [1, 2], 1: [2], 2: [0]}, [[0], [1], [2]]),
        ({0: [2], 1: [2], 2: []}, [[0, 1], [2]]),
        ({0: [3], 1: [2], 2: [], 3: []}, [[0, 1], [3, 2]]),
    ],
)
def test_the_column_is_the_length_of_the_longest_way(
    edges: Edges, columns: list[list[int]]
) -> None:
    assert layers_of(edges) == columns


def test_a_long_chain_is_no_trouble() -> None:
    edges = {i: [i + 1] for i in range(5000)} | {5000: [0]}
    assert [len(column) for column in layers_of(edges)] == [1] * 5001


def test_boxes_stand_where_their_neighbours_do() -> None:
    # Drawn in the order of the file, every one of these three lines would cross the others.
    first, second = layers_of({0: [5], 1: [4], 2: [3], 3: [], 4: [], 5: []})
    assert [second.index(5 - box) for box in first] == [0, 1, 2]
