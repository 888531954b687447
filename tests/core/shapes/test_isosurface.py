from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.solidity import solidity
from palpate.core.shapes.isosurface import isosurface
from palpate.core.shapes.winding import is_closed, is_inside_out

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


def balls(*middles: list[float], radius: float = 1.0) -> Callable[[Floats, Floats], Any]:
    def inside_out(points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        away = points - np.array(middles)[:, None]
        nearest = (away**2).sum(axis=2).argmin(axis=0)
        one = away[nearest, np.arange(len(points))]
        return (one**2).sum(axis=1) - radius**2, 2 * (one * directions).sum(axis=1)

    return inside_out


def ring(points: Floats, directions: Floats) -> tuple[Floats, Floats]:
    x, y, z = points.T
    round_, away = np.hypot(x, y), np.stack([x, y, z])
    value = (round_ - 0.7) ** 2 + z * z - 0.2**2
    by = 2 * (away - 0.7 * np.stack([x, y, 0 * z]) / np.maximum(round_, 1e-9))
    return value, (by * directions.T).sum(axis=0)


def test_a_balls_vertices_lie_on_it_and_the_error_falls_fourfold_with_each_level(
    signed_volume: Callable[[Any], float], is_closed: Callable[[Any], bool]
) -> None:
    errors, faces = [], []
    for level in (4, 5, 6):
        mesh = isosurface(balls([0.0, 0, 0]), BOX, level)
        assert is_closed(mesh)
        assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 1e-11
        errors.append(4 / 3 * np.pi - signed_volume(mesh))
        faces.append(len(mesh.faces))
    assert np.diff(np.log2(errors)) == pytest.approx([-2, -2], abs=0.2)
    assert np.diff(np.log2(faces)) == pytest.approx([2, 2], abs=0.2)


def test_two_parts_and_a_hole_are_meshed_as_such() -> None:
    two = isosurface(balls([-0.5, 0, 0], [0.5, 0, 0], radius=0.4), BOX, 5)
    assert solidity(*two).components == 2
    torus = isosurface(ring, BOX * [[1, 1, 0.25]], 5)
    assert (solidity(*torus).components, solidity(*torus).genus) == (1, 1)
    for mesh in (two, torus):
        assert is_closed(mesh.faces)
        assert not is_inside_out(*mesh)


def test_every_face_looks_outwards() -> None:
    vertices, faces = isosurface(balls([0.0, 0, 0]), BOX, 4)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) >= -1e-12).all()


def test_a_surface_through_the_grids_own_nodes_is_closed(
    is_closed: Callable[[Any], bool],
) -> None:
    def box(points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        axis = np.abs(points).argmax(axis=1)
        rows = np.arange(len(points))
        value = np.abs(points).max(axis=1) - 0.5
        return value, np.sign(points[rows, axis]) * directions[rows, axis]

    # Without the uneven margins half of all nodes would lie in its faces.
    for stretch in (1.0, 1.0 / (1 + 0.0231 + 0.0257)):
        assert is_closed(isosurface(box, BOX * stretch, 3))
