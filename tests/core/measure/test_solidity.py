from __future__ import annotations

import numpy as np
import pytest

from palpate.core.measure.solidity import solidity
from palpate.core.shapes.protocol import Mesh


def joined(*meshes: Mesh) -> Mesh:
    """All meshes as one, no vertex shared."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
    )


def test_a_cube_is_a_solid_of_unit_volume(box: Mesh) -> None:
    assert solidity(*box) == (True, 1, 0, pytest.approx(1.0, rel=1e-12))


def test_a_torus_has_one_handle_and_the_volume_of_pappus(torus: Mesh) -> None:
    found = solidity(*torus)

    assert found[:3] == (True, 1, 1)
    section = 20 / 2 * np.sin(2 * np.pi / 20)  # of the polygon, for a circle of radius 1
    assert found.volume == pytest.approx(2 * np.pi * 3 * section, rel=0.01)


def test_handles_and_pieces_add_up(torus: Mesh, box: Mesh) -> None:
    far = Mesh(torus.vertices + 10.0, torus.faces)

    found = solidity(*joined(torus, far, box))

    assert found[:3] == (True, 3, 2)


def test_two_cubes_that_touch_in_a_vertex_are_two_spheres(box: Mesh) -> None:
    # The far corner of one is vertex 0 of the other.
    second = np.where(box.faces == 0, 6, box.faces + 8)
    vertices = np.concatenate([box.vertices, box.vertices + 1.0])

    found = solidity(vertices, np.concatenate([box.faces, second]))

    assert found == (True, 2, 0, pytest.approx(2.0))


def test_turned_inside_out_the_volume_is_negative(box: Mesh) -> None:
    found = solidity(box.vertices, box.faces[:, ::-1])

    assert found == (True, 1, 0, pytest.approx(-1.0))


def test_far_from_the_origin_the_volume_stays(box: Mesh) -> None:
    assert solidity(box.vertices + 1e6, box.faces).volume == pytest.approx(1.0, rel=1e-9)


def test_vertices_that_no_face_names_are_ignored(box: Mesh) -> None:
    vertices = np.concatenate([box.vertices, [[9.0, 9.0, 9.0]]])

    assert solidity(vertices, box.faces)[:3] == (True, 1, 0)


def test_a_missing_face_opens_the_surface(box: Mesh) -> None:
    assert solidity(box.vertices, box.faces[1:])[:3] == (False, 1, None)


def test_a_face_turned_the_wrong_way_is_not_watertight(box: Mesh) -> None:
    faces = box.faces.copy()
    faces[3] = faces[3, ::-1]

    assert not solidity(box.vertices, faces).watertight


def test_a_face_given_twice_is_not_watertight(box: Mesh) -> None:
    assert not solidity(box.vertices, np.concatenate([box.faces, box.faces[:1]])).watertight


def test_two_solids_that_share_an_edge_are_not_watertight(box: Mesh) -> None:
    # Edge 2-6 of one becomes edge 0-4 of the other: four faces at one edge.
    second = box.faces + 8
    second[box.faces == 0], second[box.faces == 4] = 2, 6
    vertices = np.concatenate([box.vertices, box.vertices + np.array([1.0, 1.0, 0.0])])

    assert not solidity(vertices, np.concatenate([box.faces, second])).watertight


def test_a_face_with_a_doubled_corner_is_not_watertight() -> None:
    assert not solidity(np.eye(3), [[0, 1, 1], [1, 0, 0]]).watertight


def test_the_order_of_faces_does_not_matter(torus: Mesh) -> None:
    shuffled = np.random.default_rng(0).permutation(torus.faces)

    assert solidity(torus.vertices, shuffled)[:3] == (True, 1, 1)
