from __future__ import annotations

import pytest

from palpate.launch.drawing.layers import Edges, back_edges, layers_of


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
