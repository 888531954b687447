from __future__ import annotations

import numpy as np
import pytest

from palpate.core.measure.distance import compare, prepare
from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.protocol import Mesh


def test_a_surface_is_at_no_distance_from_itself(sphere: Mesh) -> None:
    same = prepare(*sphere)

    distances = compare(same, same)

    assert distances.hausdorff < 1e-16
    assert distances.normal_deg < 1e-9


def test_two_shifted_squares_are_at_their_shift() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])

    distances = compare(prepare(square, faces), prepare(square + np.array([0, 0, 0.25]), faces))

    assert distances == pytest.approx((0.25, 0.25, 0.25, 0.25, 0.0), abs=1e-12)


def test_concentric_spheres_are_as_far_apart_as_their_radii() -> None:
    directions, faces = icosphere(5)

    distances = compare(prepare(0.040 * directions, faces), prepare(0.041 * directions, faces))

    # The facets stand off by up to 0.04 * 0.035**2 / 8 = 6 um.
    assert distances[:4] == pytest.approx((1e-3,) * 4, abs=7e-6)
    assert distances.normal_deg < 1.0


def test_each_figure_has_its_own_definition() -> None:
    # A square, and the same with a small flap one metre up: only one way sees the flap.
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    flap = np.array([[0.4, 0.4, 1], [0.6, 0.4, 1], [0.6, 0.6, 1], [0.4, 0.6, 1]])
    both = np.concatenate([square, flap])

    distances = compare(
        prepare(square, faces), prepare(both, np.concatenate([faces, faces + len(square)]))
    )

    share = 0.04 / 1.04  # of the samples of the surface with the flap
    assert distances.chamfer == pytest.approx(0.5 * share, rel=1e-3)
    assert distances.rms == pytest.approx((0.5 * share) ** 0.5, rel=1e-3)
    assert distances.p95 < 1e-15
    assert distances.hausdorff == pytest.approx(1.0)


def test_turned_normals_are_seen(sphere: Mesh) -> None:
    inside_out = prepare(sphere.vertices, sphere.faces[:, ::-1])

    # 180 degrees, but for the samples whose nearest point is on a neighbouring facet.
    assert compare(prepare(*sphere), inside_out).normal_deg == pytest.approx(180.0, abs=0.5)


def test_both_ways_count_alike(sphere: Mesh, box: Mesh) -> None:
    one, other = prepare(*sphere), prepare(0.05 * box.vertices, box.faces)

    assert compare(one, other) == compare(other, one)


def test_the_same_meshes_give_the_same_bits(sphere: Mesh, box: Mesh) -> None:
    first, second = (compare(prepare(*sphere), prepare(*box)) for _ in range(2))

    assert first == second


def test_millimetres_and_metres_agree(sphere: Mesh, box: Mesh) -> None:
    metres = compare(prepare(*sphere), prepare(0.05 * box.vertices, box.faces))
    millimetres = compare(
        prepare(1e3 * sphere.vertices, sphere.faces), prepare(50.0 * box.vertices, box.faces)
    )

    assert np.array(millimetres[:4]) / 1e3 == pytest.approx(metres[:4], rel=1e-9)
    assert millimetres.normal_deg == pytest.approx(metres.normal_deg, rel=1e-3)


def test_moving_both_changes_nothing(sphere: Mesh) -> None:
    squashed = sphere.vertices * [1.0, 0.9, 1.1]
    here = compare(prepare(*sphere), prepare(squashed, sphere.faces))

    shift = np.array([1.0, -2.0, 3.0])
    there = compare(
        prepare(sphere.vertices + shift, sphere.faces), prepare(squashed + shift, sphere.faces)
    )

    assert there[:4] == pytest.approx(here[:4], rel=1e-9)


def test_faces_without_area_are_left_out(sphere: Mesh) -> None:
    plain = prepare(*sphere)
    extra = np.concatenate([[[0, 0, 1], [5, 5, 5]], sphere.faces])

    assert compare(plain, prepare(sphere.vertices, extra)) == compare(plain, plain)


def test_a_surface_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match="must have an area, but all 2 faces have none"):
        prepare(np.zeros((3, 3)), [[0, 1, 2], [2, 1, 0]])
