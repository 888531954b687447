from __future__ import annotations

import numpy as np

from palpate.core.shapes.bend import Bend
from palpate.core.shapes.boolean import BooleanShape
from palpate.core.shapes.boolean_tree import difference
from palpate.core.shapes.polyhedron import Polyhedron
from palpate.core.shapes.posed_solid import PosedSolid
from palpate.core.shapes.protocol import INSIDE
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.warped import WarpedSuperquadric
from palpate.core.shapes.winding import is_closed

DOWN = np.array([0.0, 0.0, -1.0])
CORNERS = 0.04 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SQUARES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def test_polyhedra_and_warped_superquadrics_are_combined() -> None:
    box = Polyhedron(CORNERS, SQUARES)
    pear = WarpedSuperquadric(
        Superquadric(np.array([0.02, 0.02, 0.03]), np.ones(2)), np.array([0.3, 0.3]), Bend(5.0)
    )
    ball = PosedSolid(
        Superquadric(np.full(3, 0.01), np.ones(2)), np.array([0.04, 0.04, 0.04, 0, 0, 0, 1.0])
    )
    shape = BooleanShape(difference(box, pear, ball))
    rng = np.random.default_rng(6)
    points = rng.uniform(-0.005, 0.045, (400, 3))
    level = shape.inside_out(points, np.zeros_like(points))[0]
    for towards in (DOWN, np.array([0.48, 0.6, 0.64])):
        inside = shape.cast(points, towards, 1.0) == INSIDE
        assert np.array_equal(inside, level < 0.0)
    vertices, faces = shape.mesh(4)
    assert is_closed(faces)
    assert np.abs(shape.inside_out(vertices, vertices)[0]).max() < 0.02
