from __future__ import annotations

import numpy as np
import pytest

from palpate.core.shapes.superquadric import Superquadric

SIZE = np.array([0.03, 0.02, 0.04])


@pytest.mark.parametrize("exponents", [[0.1, 0.1], [1.0, 1.0], [0.4, 1.6], [2.0, 2.0]])
def test_normals_are_unit_point_outwards_and_are_square_to_the_surface(
    exponents: list[float],
) -> None:
    shape = Superquadric(SIZE, np.array(exponents))
    points = shape.mesh(3).vertices
    normals = shape.normals(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-15)
    assert (np.einsum("ni,ni->n", normals, points) > 0).all()
    rng = np.random.default_rng(0)
    tangent = np.cross(normals, rng.normal(size=points.shape))
    slope = shape.inside_out(points, tangent)[1]
    clear = np.abs(points / SIZE).min(axis=1) > 1e-3
    assert np.abs(slope[clear]).max() < 1e-12


@pytest.mark.parametrize("exponents", [[2.0, 2.0], [1.0, 2.0]])
def test_normals_on_creases_poles_and_at_the_centre_are_what_is_promised(
    exponents: list[float],
) -> None:
    shape = Superquadric(SIZE, np.array(exponents))
    points = np.array([[0.0, 0.0, 0.04], [0.0, 0.01, 0.02], [0.0, 0.0, 0.0], [0.03, 0.0, 0.0]])
    normals = shape.normals(points)
    assert normals[0].tolist() == [0.0, 0.0, 1.0]
    assert normals[1, 0] == 0.0
    assert normals[2].tolist() == [0.0, 0.0, 1.0]
    assert normals[3].tolist() == [1.0, 0.0, 0.0]
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
