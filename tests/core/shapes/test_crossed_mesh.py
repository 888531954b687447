from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.core.arrays import Floats
from palpate.core.shapes.crossed_mesh import CrossedMesh
from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.protocol import INSIDE

H = 0.025
CORNERS = H * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
SQUARES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
TRIANGLES = np.array(
    [part for a, b, c, d in SQUARES for part in ((a, b, c), (a, c, d))], dtype=np.int32
)
CUBE = CrossedMesh(CORNERS, TRIANGLES)
DOWN = np.array([0.0, 0.0, -1.0])
STEPS = st.integers(-4, 4).map(lambda n: n * H / 2)


def in_cube(origin: Floats, direction: Floats) -> tuple[float, float]:
    """Where a line is in the closed cube, by its three slabs."""
    begin, end = -np.inf, np.inf
    for place, slope in zip(origin, direction, strict=True):
        if slope == 0.0:
            if abs(place) > H:
                return np.inf, -np.inf
        else:
            ways = sorted(((-H - place) / slope, (H - place) / slope))
            begin, end = max(begin, ways[0]), min(end, ways[1])
    return begin, end


@given(
    st.tuples(STEPS, STEPS, STEPS),
    st.tuples(*[st.integers(-2, 2)] * 3).filter(any),
)
@settings(max_examples=50, derandomize=True, deadline=None)
def test_rays_through_corners_and_edges_count_them_once(
    place: tuple[float, float, float], towards: tuple[int, int, int]
) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    origin = np.array(place) - 0.2 * direction
    spans = CUBE.spans(origin[None], direction)
    begin, end = in_cube(origin, direction)
    assert spans.shape == (1, 1, 2)
    flat = (np.isclose(np.abs(place), H) & (direction == 0.0)).any()  # runs along a face
    if end - begin > 1e-9 and not flat:
        assert np.allclose(spans[0, 0], [begin, end], rtol=0, atol=1e-14)
    elif np.isfinite(spans[0, 0, 0]) and not flat:
        assert spans[0, 0, 1] - spans[0, 0, 0] < 1e-15


def test_rays_at_the_corners_of_a_ball_miss_none_of_its_faces() -> None:
    vertices, faces = icosphere(3)
    ball = CrossedMesh(vertices, faces)
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(5, 3)):
        towards = direction / np.linalg.norm(direction)
        inner = vertices[np.linalg.norm(np.cross(vertices, towards), axis=1) < 0.95]
        spans = ball.spans(inner - 2.0 * (inner @ towards)[:, None] * towards, -towards)
        assert spans.shape[1] == 1
        assert np.isfinite(spans[:, 0, 1]).sum() == (inner @ towards < 0.0).sum()


def test_a_start_inside_is_told_and_what_lies_behind_is_not() -> None:
    origins = np.array([[0.0, 0.01, z] for z in (0.1, 0.01, -H, -0.1)])
    spans = CUBE.spans(origins, DOWN)[:, 0]
    assert np.allclose(spans[0], [0.075, 0.125], rtol=0, atol=1e-15)
    assert spans[1, 0] == INSIDE
    assert spans[1, 1] == pytest.approx(0.035, abs=1e-15)
    assert np.isinf(spans[2:]).all()


def test_many_rays_are_taken_in_parts_and_none_at_all_are_no_spans() -> None:
    rng = np.random.default_rng(1)
    origins = np.column_stack([rng.uniform(-0.03, 0.03, (60_000, 2)), np.full(60_000, 0.1)])
    met = np.isfinite(CUBE.spans(origins, DOWN)[:, 0, 0])
    assert np.array_equal(met, (np.abs(origins[:, :2]) < H).all(axis=1))
    assert CUBE.spans(np.zeros((0, 3)), DOWN).shape == (0, 1, 2)
