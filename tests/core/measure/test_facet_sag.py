from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.facet_sag import facet_sag
from palpate.core.measure.triangles import areas_and_normals
from palpate.core.measure.vertex_normals import corner_normals
from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.protocol import Mesh


def cylinder(count: int) -> tuple[Floats, Floats]:
    """Of radius 1 and height 2, each side a single rectangle."""
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    low, high = (np.column_stack([ring, np.full(count, z)]) for z in (-1.0, 1.0))
    here, after = np.arange(count), (np.arange(count) + 1) % count
    faces = np.concatenate(
        [
            np.column_stack([here, after, after + count]),
            np.column_stack([here, after + count, here + count]),
            np.column_stack([after, here, np.full(count, 2 * count)]),
            np.column_stack([here + count, after + count, np.full(count, 2 * count + 1)]),
        ]
    )
    return np.concatenate([low, high, [[0, 0, -1], [0, 0, 1]]]), faces.astype(np.int32)


@pytest.mark.parametrize("level", [2, 3, 4])
def test_the_sag_of_a_sphere_is_its_mean_distance_from_the_facets(level: int) -> None:
    directions, faces = icosphere(level)
    corners = directions[faces]
    shares = np.random.default_rng(0).dirichlet([1, 1, 1], 200)
    off = 1.0 - np.linalg.norm(np.einsum("bi,fij->fbj", shares, corners), axis=2)
    mean = np.average(off.mean(axis=1), weights=areas_and_normals(corners)[0])

    assert facet_sag(0.05 * directions, faces) == pytest.approx(0.05 * mean, rel=0.05)


def test_a_box_has_no_sag(box: Mesh) -> None:
    assert facet_sag(box.vertices, box.faces) == pytest.approx(0.0, abs=1e-15)


def test_the_sharp_rim_of_a_cylinder_does_not_hide_the_sag_of_its_side() -> None:
    vertices, faces = cylinder(48)
    # A chord of angle 2 pi / 48 leaves its circle by two thirds of the sagitta on average.
    side = 2.0 / 3.0 * (1.0 - np.cos(np.pi / 48))
    share = 4.0 * np.pi / (4.0 * np.pi + 2.0 * np.pi)  # of the side in the area

    assert facet_sag(vertices, faces) == pytest.approx(side * share, rel=0.05)


def test_normals_are_shared_across_blunt_edges_alone(box: Mesh) -> None:
    apart = corner_normals(box.vertices, box.faces, np.radians(30))
    shared = corner_normals(box.vertices, box.faces, np.pi)

    flat = areas_and_normals(box.vertices[box.faces])[1]
    np.testing.assert_allclose(apart, np.repeat(flat[:, None], 3, axis=1), atol=1e-15)
    outwards = (box.vertices - 0.5) / np.sqrt(0.75)
    np.testing.assert_allclose(shared, outwards[box.faces], atol=1e-12)


def test_a_single_face_has_its_own_normal() -> None:
    found = corner_normals(np.eye(3), np.array([[0, 1, 2]], np.int32), np.pi)

    np.testing.assert_allclose(found, np.full((1, 3, 3), np.sqrt(1 / 3)))
