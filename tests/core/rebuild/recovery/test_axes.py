from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.axes import principal_axes, suggested_axes
from palpate.core.shapes.superquadric import Superquadric

Draw = Callable[[int], Floats]


def nearest_turn(axes: Floats, wanted: Floats) -> float:
    """How far the nearest of some axes (k, 3, 3) are from the wanted ones or their opposites."""
    agreement = np.abs(np.einsum("kji,jl->kil", axes, wanted)).max(axis=2).min(axis=1)
    return float(np.arccos(np.clip(agreement.max(), 0, 1)))


def test_they_are_rotations() -> None:
    axes = suggested_axes(np.random.default_rng(0).normal(size=(30, 3)))
    assert axes.shape == (12, 3, 3)
    assert np.allclose(axes @ axes.transpose(0, 2, 1), np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(axes), 1.0)


def test_the_edges_of_a_cube_are_among_them_however_it_is_turned(rotations: Draw) -> None:
    cube = Superquadric(np.ones(3), np.full(2, 0.1)).mesh(2).vertices
    for turn in rotations(20):
        assert nearest_turn(suggested_axes(cube @ turn.T), turn) < 0.02
        assert nearest_turn(principal_axes(cube @ turn.T)[None], turn) < 0.96


def test_they_turn_with_the_points(rotations: Draw) -> None:
    points = np.random.default_rng(1).normal(size=(40, 3)) * [1.0, 0.6, 0.3]
    before = suggested_axes(points)
    for turn in rotations(10):
        after = suggested_axes(points @ turn.T + [1.0, 2.0, 3.0])
        alike = np.abs(np.einsum("kji,jl,klm->kim", after, turn, before))
        # Some of these sets are named with other signs or in another order.
        assert (np.abs(np.sort(alike, axis=2)[:, :, 2] - 1.0) < 1e-9).mean() > 0.5
