import numpy as np
import pytest

from palpate.core.geometry import signed_area
from palpate.core.poses import rotations_from_vectors
from palpate.core.shapes import cut_faces


def star(rng, count):
    turns = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    while np.diff(turns, append=turns[0] + 2.0 * np.pi).max() > 3.0:
        turns = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    radius = rng.uniform(0.1, 1.0, count)
    return radius[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])


def areas(vertices, triangles):
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize("repeated", [False, True])
def test_any_simple_outline_is_covered_once_from_any_first_corner(straight, repeated):
    rng = np.random.default_rng(5)
    for count in rng.integers(4, 30, 40):
        outline = star(rng, count)
        if straight:
            middle = 0.5 * (outline + np.roll(outline, -1, axis=0))
            outline = np.stack([outline, middle], axis=1).reshape(-1, 2)
        places = np.column_stack([outline, 0.01 * rng.normal(size=len(outline)) * (not straight)])
        places = places @ rotations_from_vectors(rng.normal(size=(1, 3)))[0].T + rng.normal(size=3)
        places = np.roll(np.repeat(places, 1 + repeated, axis=0), rng.integers(count), axis=0)
        found = cut_faces(places, np.array([len(places)]), np.arange(len(places)))
        expected = signed_area(outline)
        assert areas(places, found).sum() == pytest.approx(expected, rel=1e-9 if straight else 0.2)


@pytest.mark.parametrize("first", range(8))
def test_corners_on_straight_edges_make_no_flat_triangle(first):
    square = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]], float)
    places = np.column_stack([np.roll(square, first, axis=0), np.ones(8)])
    found = areas(places, cut_faces(places, np.array([8]), np.arange(8)))
    assert found.sum() == pytest.approx(4.0)
    assert found.min() > 0.1


def test_an_outline_that_crosses_itself_is_refused_by_number():
    places = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1, 0]], float)
    with pytest.raises(ValueError, match="has a face, number 2, that lies in no plane or whose"):
        cut_faces(places, np.array([3, 4]), np.array([0, 1, 2, 0, 1, 2, 3]))
