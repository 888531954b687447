from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.shapes.deformed import DeformedShape
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper

FACETS = 10e-6
"""How far the facets of a 0.1 m object stand off at most, m."""
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def cone() -> DeformedShape:
    """A sharp cylinder, tapered to a truncated cone from 12.5 to 37.5 mm of radius."""
    base = Superquadric(np.array([0.025, 0.025, 0.04]), np.array([0.1, 1.0]))
    return DeformedShape(base, (Taper(0.5, 0.5, 0.04),))


@pytest.mark.parametrize("height", [-0.03, 0.0, 0.02])
def test_rays_meet_the_deformed_surface(cone: DeformedShape, height: float) -> None:
    base = Superquadric(np.array([0.025, 0.025, 0.04]), np.array([0.1, 1.0]))
    origin, inwards = np.array([[0.1, 0.0, height]]), np.array([-1.0, 0.0, 0.0])
    radius = 0.1 - base.cast(origin, inwards, 1.0)[0]
    found = cone.cast(origin, inwards, 1.0)[0]
    assert found == pytest.approx(0.1 - radius * (1.0 + 0.5 * height / 0.04), abs=FACETS)


def test_hit_miss_and_inside_are_told_apart(cone: DeformedShape) -> None:
    origins = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.06], [0.045, 0.0, 0.06]])
    found = cone.cast(origins, DOWN, 1.0)
    assert found[0] == INSIDE
    assert found[1] == pytest.approx(0.02, abs=1e-3)
    assert found[2] == MISS
    assert cone.cast(origins[1:2], DOWN, 0.01)[0] == MISS


def test_without_deformations_it_is_its_base(ball: Superquadric) -> None:
    same = DeformedShape(ball, ())
    origins = np.random.default_rng(0).uniform(-0.02, 0.02, (50, 3)) + np.array([0.0, 0.0, 0.1])
    assert np.allclose(same.cast(origins, DOWN, 1.0), ball.cast(origins, DOWN, 1.0), atol=FACETS)
    assert np.allclose(same.bounds(), ball.bounds(), atol=FACETS)


def test_deformations_are_applied_one_after_the_other(ball: Superquadric) -> None:
    def shift(points: Floats) -> Floats:
        return np.asarray(points + np.array([0.0, 0.0, 0.03]))

    taper = Taper(0.5, 0.5, 0.06)
    top = ball.mesh(1).vertices
    moved = DeformedShape(ball, (shift, taper)).mesh(1).vertices
    assert np.array_equal(moved, taper(shift(top)))
    assert not np.allclose(moved, shift(taper(top)))


def test_the_mesh_is_closed_and_turned_outwards(
    cone: DeformedShape, is_closed: Callable[[Mesh], bool], signed_volume: Callable[[Mesh], float]
) -> None:
    mesh = cone.mesh(4)
    assert is_closed(mesh)
    # Tapering both ways by k adds the second moment: 1 + k^2 / 3 for a straight side.
    base = Superquadric(np.array([0.025, 0.025, 0.04]), np.array([0.1, 1.0])).mesh(4)
    assert signed_volume(mesh) == pytest.approx(signed_volume(base) * (1 + 0.25 / 3), rel=0.01)
