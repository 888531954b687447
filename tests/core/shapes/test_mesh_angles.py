from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.shapes.parametric import grid_of_angles, regular
from palpate.core.shapes.superquadric import Superquadric

EXPONENTS = [[0.1, 0.1], [1.0, 1.0], [2.0, 2.0], [0.1, 1.0], [1.0, 0.1], [2.0, 0.1]]


def smallest_angles(corners: Floats) -> Floats:
    """Of triangles (m, 3, 3), in degrees."""
    found = []
    for i in range(3):
        one, other = (corners[:, (i + k) % 3] - corners[:, i] for k in (1, 2))
        sine = np.linalg.norm(np.cross(one, other), axis=1)
        found.append(np.degrees(np.arctan2(sine, np.einsum("mi,mi->m", one, other))))
    return np.asarray(np.min(found, axis=0))


def rings(shape: Superquadric, rows: int, columns: int) -> Floats:
    """Triangles between rings of latitude, those without an area at the poles left out."""
    points = regular(shape, *grid_of_angles(rows, columns)).points
    here = np.arange((rows - 1) * columns)
    beside = here // columns * columns + (here % columns + 1) % columns
    lower = np.column_stack([here, beside, beside + columns])[columns:]
    upper = np.column_stack([here, beside + columns, here + columns])[:-columns]
    return np.asarray(points[np.concatenate([lower, upper])])


@pytest.mark.parametrize("exponents", EXPONENTS)
def test_no_facet_of_a_solid_of_equal_semi_axes_is_a_sliver(exponents: list[float]) -> None:
    shape = Superquadric(np.ones(3), np.array(exponents))
    for level in (3, 4):
        mesh = shape.mesh(level)
        assert smallest_angles(mesh.vertices[mesh.faces]).min() > 30.0
    assert smallest_angles(rings(shape, 37, 72)).min() < 5.0


@pytest.mark.parametrize("size", [[1.0, 1.0, 0.05], [0.05, 0.05, 1.0]])
@pytest.mark.parametrize("exponents", EXPONENTS)
def test_a_flat_or_slender_solid_has_no_sharper_facets_than_its_shape_makes(
    size: list[float], exponents: list[float]
) -> None:
    shape = Superquadric(np.array(size), np.array(exponents))
    mesh = shape.mesh(4)
    sharpest = smallest_angles(mesh.vertices[mesh.faces]).min()
    # An equilateral triangle, squeezed to a twentieth, has an angle of 2.5 degrees.
    assert sharpest > 2.2
    assert sharpest > smallest_angles(rings(shape, 37, 72)).min()
