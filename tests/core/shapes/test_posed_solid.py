from __future__ import annotations

import numpy as np

from palpate.core.shapes.posed_solid import PosedSolid
from palpate.core.shapes.superquadric import Superquadric

DOWN = np.array([0.0, 0.0, -1.0])


def test_a_posed_solid_is_where_it_stands() -> None:
    turn = np.array([0.0, np.sin(0.4), 0.0, np.cos(0.4)])
    egg = Superquadric(np.array([0.02, 0.03, 0.05]), np.array([0.7, 1.2]))
    posed = PosedSolid(egg, np.concatenate([[0.1, 0.2, 0.3], turn]))
    vertices, _ = posed.mesh(3)
    low, high = posed.enclosure()
    assert ((vertices >= low) & (vertices <= high)).all()
    value, slope = posed.inside_out(vertices, vertices - [0.1, 0.2, 0.3])
    assert np.abs(value).max() < 1e-12
    assert np.allclose(slope, 1.0)  # the gauge grows evenly from the middle
    spans = posed.spans(np.array([[0.1, 0.2, 1.0]]), DOWN)[0, 0]
    assert np.allclose(posed.inside_out(np.array([[0.1, 0.2, 1.0 - s] for s in spans]),
                                        np.zeros((2, 3)))[0], 0.0, atol=1e-12)  # fmt: skip
