from __future__ import annotations

import numpy as np
import pytest

from palpate.core.shapes.winged_edge import WingedEdges, winged_edges

CUBE = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]


def other(faces: list[list[int]], by: int) -> list[list[int]]:
    return [[corner + by for corner in face] for face in faces]


def frame() -> list[list[int]]:
    """A square ring with a square hole: 16 vertices, genus 1."""
    found = []
    for k in range(4):
        i, j = k, (k + 1) % 4
        # Corners 0 to 3 outside below, 4 to 7 inside below, and 8 more for the same above.
        found += [[i, j, j + 8, i + 8], [j + 4, i + 4, i + 12, j + 12]]
        found += [[j, i, i + 4, j + 4], [i + 8, j + 8, j + 12, i + 12]]
    return found


@pytest.fixture
def cube() -> WingedEdges:
    return winged_edges(CUBE, 8)


def test_a_cube_has_its_twelve_edges_each_with_two_faces(cube: WingedEdges) -> None:
    assert len(cube.ends) == 12
    assert cube.euler == 2
    assert (cube.genus, cube.shells) == (0, 1)
    assert (cube.faces[:, 0] != cube.faces[:, 1]).all()
    assert np.bincount(cube.faces.ravel()).tolist() == [4] * 6


def test_wings_go_around_the_faces(cube: WingedEdges) -> None:
    for edge, (ends, faces) in enumerate(zip(cube.ends, cube.faces, strict=True)):
        for side, face in enumerate(faces):
            around = cube.edges_of_face(int(face)).tolist()
            place = around.index(edge)
            assert cube.after[edge, side] == around[(place + 1) % 4]
            assert cube.before[edge, side] == around[place - 1]
            corners = cube.vertices_of_face(int(face)).tolist()
            first, last = ends if side == 0 else ends[::-1]
            assert corners[(corners.index(first) + 1) % 4] == last


def test_a_faces_edges_and_neighbours_are_told_in_order(cube: WingedEdges) -> None:
    assert cube.vertices_of_face(2).tolist() == [0, 1, 5, 4]
    ends = [set(pair) for pair in cube.ends[cube.edges_of_face(2)].tolist()]
    assert ends == [{0, 1}, {1, 5}, {5, 4}, {4, 0}]
    assert cube.neighbours_of_face(2).tolist() == [0, 5, 1, 4]


def test_edges_and_faces_around_a_vertex_are_told_in_order(cube: WingedEdges) -> None:
    for vertex in range(8):
        edges, faces = cube.edges_of_vertex(vertex), cube.faces_of_vertex(vertex)
        assert len(edges) == len(faces) == 3
        assert (cube.ends[edges] == vertex).any(axis=1).all()
        for i in range(3):
            # The face between two edges that follow each other has both.
            between = set(cube.edges_of_face(int(faces[i])).tolist())
            assert {int(edges[i - 1]), int(edges[i])} <= between
    ring = cube.ends[cube.edges_of_vertex(0)]
    ends = ring[ring != 0].tolist()
    start = ends.index(1)
    # Seen from outside a corner at the origin, x, z, y is counter-clockwise.
    assert [ends[(start + i) % 3] for i in range(3)] == [1, 4, 2]


def test_a_ring_has_a_hole_and_two_cubes_are_two_shells() -> None:
    ring = winged_edges(frame(), 16)
    assert (ring.euler, ring.genus, ring.shells) == (0, 1, 1)
    two = winged_edges(CUBE + other(CUBE, 8), 16)
    assert (two.euler, two.genus, two.shells) == (4, 0, 2)


def test_many_faces_hang_together() -> None:
    from palpate.core.shapes.icosphere import icosphere

    directions, faces = icosphere(4)
    ball = winged_edges(faces.tolist(), len(directions))
    assert (ball.euler, ball.shells, len(ball.ends)) == (2, 1, 7680)
    assert sorted({len(ball.edges_of_vertex(v)) for v in range(50)}) == [5, 6]


@pytest.mark.parametrize(
    ("faces", "vertices", "sentence"),
    [
        ([*CUBE, [0, 1]], 8, r"faces\[6\] must have at least 3 corners, got 2"),
        ([[0, 2, 3, 9], *CUBE[1:]], 8, r"faces\[0\] names vertex 9, but there are only 8"),
        ([[0, 2, 3, -1], *CUBE[1:]], 8, r"faces\[0\] names vertex -1"),
        ([[0, 2, 2, 1], *CUBE[1:]], 8, r"faces\[0\] has the corner 2 twice"),
        (CUBE, 9, r"vertices\[8\] belongs to no face"),
        (CUBE[1:], 8, r"faces\[1\] has no neighbour at the edge from vertex 0 to 1"),
        (
            [CUBE[0][::-1], *CUBE[1:]],
            8,
            r"faces\[0\] and faces\[2\] both walk the edge from vertex 0 to 1 in this direction",
        ),
        (
            [*CUBE, *[[c and c + 7 for c in face] for face in CUBE]],
            15,
            r"vertices\[0\] joins 2 parts of the surface that only touch there",
        ),
    ],
)
def test_what_is_no_closed_surface_is_refused(
    faces: list[list[int]], vertices: int, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        winged_edges(faces, vertices)
