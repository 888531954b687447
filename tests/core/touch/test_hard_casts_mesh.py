"""Presses at meshes at which a cast can go wrong: sharp edges, holes, faces turned inwards."""

from __future__ import annotations

import math
from importlib.util import find_spec

import numpy as np
import pytest

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.triangle_meshes import TriangleShape
from palpate.core.touch.pad import guarded_move

REACH = 0.1
EXACT = 1e-12
NO_EMBREE = pytest.mark.skipif(find_spec("embreex") is None, reason="no Embree here")
BACKENDS = [pytest.param(True, marks=NO_EMBREE), False]


def above(height: float) -> Floats:
    return pose_of(np.array([0.0, 0.0, height]), FACING_DOWN)


def slab(half: Floats) -> tuple[Floats, Ints]:
    """A box with sharp edges, of twelve faces."""
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)]
    return corners, np.array(faces, np.int32)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sharp_plate_of_1_mm_pressed_by_2_mm_is_felt_exactly(backend, flat) -> None:
    plate = TriangleShape(*slab(np.array([0.03, 0.03, 0.0005])), backend)
    end = guarded_move(plate, flat, above(0.05), REACH, 2e-3)
    assert end.outcome == "hit"
    assert np.allclose(end.compression, 2e-3, rtol=0, atol=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_nothing_is_felt_through_a_hole_but_the_wall_behind_it(backend, flat) -> None:
    corners, faces = slab(np.array([0.03, 0.03, 0.02]))
    top = (corners[faces][:, :, 2] > 0).all(axis=1)
    assert top.sum() == 2
    whole = TriangleShape(corners, faces, backend)
    holed = TriangleShape(corners, faces[~top], backend)
    assert (whole.closed, holed.closed) == (True, False)
    assert guarded_move(whole, flat, above(0.05), REACH, 1e-3).outcome == "hit"
    # The bottom is seen from behind: it is no surface that could be met from there.
    assert guarded_move(holed, flat, above(0.05), REACH, 1e-3).outcome == "miss"
    assert guarded_move(holed, flat, above(0.0), REACH, 1e-3).outcome == "miss"
    # The side is met as ever, and from within the open box the far side is not.
    into = np.array([-1.0, 0.0, 0.0])
    axes = np.column_stack([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], into])
    end = guarded_move(holed, flat, pose_of(np.array([0.05, 0.0, 0.0]), axes), REACH, 1e-3)
    assert end.outcome == "hit"
    assert end.advance == pytest.approx(0.021, abs=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_through_a_hole_a_ray_goes_on_to_the_next_front_face(backend, flat) -> None:
    corners, faces = slab(np.array([0.03, 0.03, 0.01]))
    top = (corners[faces][:, :, 2] > 0).all(axis=1)
    lower = corners - [0.0, 0.0, 0.04]
    both = np.concatenate([corners, lower]), np.concatenate([faces[~top], faces + 8])
    end = guarded_move(TriangleShape(*both, backend), flat, above(0.05), REACH, 1e-3)
    assert end.outcome == "hit"
    assert end.advance == pytest.approx(0.05 + 0.03 + 1e-3, abs=EXACT)
    assert np.allclose(end.compression, 1e-3, rtol=0, atol=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_mesh_that_is_inside_out_is_turned(backend, ball, flat, signed_volume) -> None:
    vertices, faces = ball.mesh(4)
    right = TriangleShape(vertices, faces, backend)
    turned = TriangleShape(vertices, faces[:, ::-1], backend)
    assert (right.flipped, turned.flipped) == (False, True)
    assert signed_volume(turned.mesh(0)) == pytest.approx(signed_volume(right.mesh(0)))
    for height, outcome in ((0.05, "hit"), (0.0, "inside")):
        first, second = (guarded_move(s, flat, above(height), REACH, 1e-3) for s in (right, turned))
        assert first.outcome == second.outcome == outcome
        assert np.allclose(first.compression, second.compression, rtol=0, atol=EXACT)


@pytest.mark.parametrize("backend", BACKENDS)
def test_rays_along_the_silhouette_of_a_mesh_do_not_start_inside(backend, flat) -> None:
    """Edges and side faces seen edge-on show a back face as near as a front face."""
    box = TriangleShape(*slab(np.array([0.0075, 0.0035, 0.02])), backend)
    for aside in (0.0, 0.5e-3, 1e-3, 7e-3, 15e-3):  # taxels run exactly along the sides
        start = pose_of(np.array([aside, 0.0, 0.05]), FACING_DOWN)
        assert guarded_move(box, flat, start, REACH, 1e-3).outcome == "hit"
    for turn in np.linspace(0.0, 3.0, 40):
        cosine, sine = math.cos(turn), math.sin(turn)
        axes = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]])
        posed = PosedShape(box, pose_of(np.zeros(3), axes))
        assert guarded_move(posed, flat, above(0.05), REACH, 1e-3).outcome == "hit"


@NO_EMBREE
def test_embree_and_the_z_buffer_feel_the_same(ball, domed) -> None:
    corners, faces = slab(np.array([0.03, 0.02, 0.01]))
    shapes: list[tuple[Floats, Ints]] = [tuple(ball.mesh(4)), (corners, faces)]  # type: ignore
    shapes += [(corners, faces[:, ::-1]), (corners, faces[1:]), (corners, faces[4:, ::-1])]
    rng, outcomes = np.random.default_rng(1), set()
    for vertices, some in shapes:
        first, second = TriangleShape(vertices, some, True), TriangleShape(vertices, some, False)
        assert (first.closed, first.flipped) == (second.closed, second.flipped)
        for _ in range(25):
            matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            matrix[:, 0] *= np.linalg.det(matrix)
            away = rng.choice([0.0, 0.06])
            start = pose_of(rng.uniform(-0.02, 0.02, 3) - away * matrix[:, 2], matrix)
            ends = [guarded_move(shape, domed, start, REACH, 1e-3) for shape in (first, second)]
            assert ends[0].outcome == ends[1].outcome
            assert np.allclose(ends[0].compression, ends[1].compression, rtol=0, atol=1e-9)
            outcomes.add(ends[0].outcome)
    assert outcomes == {"hit", "miss", "inside"}
