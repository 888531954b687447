"""Hyperquadrics and half-spaces: enclosures, tips and bumps, signed distances."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog

from palpate.core import shapes
from tests.core.shapes.definitions import AXES, DOWN, SIZE as SIDES

SIZE = np.array(SIDES)
FORMS = np.array([[40.0, 0.0, 0.0, -1.0], [0.0, 30.0, 10.0, 0.5]])


def test_enclosures_are_exact_far_thin_and_with_tips():
    far = AXES - np.array([[0, 0, 0, 250.0], [0, 0, 0, 0], [0, 0, 0, 0]])
    box = shapes.Hyperquadric(far, np.full(3, 2.0)).enclosure()
    assert np.allclose(box, [[9.96, -0.03, -0.05], [10.04, 0.03, 0.05]])
    thin = np.column_stack([np.diag([1e6, 1.0, 1e-6]), np.zeros(3)])
    low, high = shapes.Hyperquadric(thin, np.full(3, 2.0)).enclosure()
    assert np.allclose(high - low, [2e-6, 2.0, 2e6], rtol=1e-12)
    # The tips of a star, where three creases meet, are vertices of its mesh.
    star = shapes.Hyperquadric(AXES, np.array([0.5, 0.6, 0.8]))
    vertices = star.mesh(3).vertices
    assert np.allclose([vertices.min(axis=0), vertices.max(axis=0)], [-SIZE, SIZE], atol=1e-12)
    # What swells a solid widens its box: in the middle of the bump by a factor of 2^(1/4).
    bump = shapes.Dent(-1.0, np.column_stack([np.eye(3), np.zeros(3)]), np.full(3, 2.0))
    shape = shapes.Hyperquadric(AXES, np.full(3, 4.0), (bump,))
    assert np.allclose(shape.enclosure(), 2**0.25 * np.array([-SIZE, SIZE]), rtol=1e-12)
    assert shape.mesh(4).vertices[:, 2].max() == pytest.approx(2**0.25 * 0.05, rel=5e-3)
    assert shapes.Hyperquadric(AXES, np.full(3, 4.0)).convex
    assert not shape.convex and not star.convex
    # In creases and far off, slopes are finite.
    star = shapes.Hyperquadric(
        AXES, np.array([0.5, 1.0, 0.1]), (shapes.Dent(0.2, FORMS, np.array([0.5, 1])),)
    )
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.01, 0.0], [10.0, 10.0, 10.0], [1e300, 0.0, 0.0]])
    assert np.isfinite(star.inside_out(points, np.ones((4, 3)))).all()


def test_half_space_is_a_distance_with_one_end_on_a_ray():
    slanted = shapes.HalfSpace(np.array([0.0, 3.0, 4.0]), 0.1)
    points = np.array([[9.0, 0.06, 0.08], [0.0, 0.0, 0.0]])
    value, slope = slanted.inside_out(points, np.array([[1.0, 0, 0], [0, 1, 1]]))
    assert np.allclose(value, [0.0, -0.1], rtol=0, atol=1e-16)
    assert np.allclose(slope, [0.0, 1.4], rtol=0, atol=1e-15)
    other = slanted.complement().inside_out(points, points)[0]
    assert np.allclose(value, -other, rtol=0, atol=1e-15)
    origins, inf = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), np.inf
    for towards, wanted in (
        (DOWN, [[0.875, inf], [-inf, inf]]),
        (-DOWN, [[inf, inf], [-inf, 1.125]]),
        (np.array([1.0, 0.0, 0.0]), [[inf, inf], [-inf, inf]]),
    ):
        assert np.allclose(slanted.spans(origins, towards)[:, 0], wanted)
    box = shapes.HalfSpace(np.array([0.0, 0.0, -2.0]), 0.3).enclosure()
    assert box[0, 2] == pytest.approx(-0.3) and np.isinf(box).sum() == 5
    assert np.isinf(slanted.enclosure()).all()
    for length in (5e-324, 1e-300, 1e300):
        normal = shapes.HalfSpace(np.array([length, 0.0, -length]), 0.0).normal
        assert np.allclose(normal, [math.sqrt(0.5), 0.0, -math.sqrt(0.5)], rtol=1e-15)


@pytest.mark.parametrize("count", [4, 5, 7, 9])
def test_enclosures_of_half_spaces_agree_with_linear_programming(count):
    rng = np.random.default_rng(count)
    for _ in range(4):
        normals = rng.normal(size=(count, 3)) * 10 ** rng.uniform(-2, 2, (count, 1))
        offsets = rng.uniform(0.1, 2.0, count)
        wanted = np.zeros((2, 3))
        units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        for axis, row, sign in ((a, r, s) for a in range(3) for r, s in ((0, 1.0), (1, -1.0))):
            least = linprog(sign * np.eye(3)[axis], units, offsets, bounds=(None, None))
            wanted[row, axis] = -sign * np.inf if least.status == 3 else sign * least.fun
        parts = [shapes.HalfSpace(*one) for one in zip(normals, offsets, strict=True)]
        if np.isfinite(wanted).all():
            result = shapes.BooleanShape(shapes.Intersection(tuple(parts))).enclosure()
            assert np.allclose(result, wanted, rtol=1e-7)
        else:
            with pytest.raises(ValueError, match="the intersection that is the tree is unbounded"):
                shapes.BooleanShape(shapes.Intersection(tuple(parts)))
