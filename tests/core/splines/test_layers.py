from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.splines.layers import Layer, flattened_share, layered_lattice

BOX = np.array([[-0.03, -0.02, -0.05], [0.03, 0.02, 0.07]])
POINTS = BOX[0] + (BOX[1] - BOX[0]) * np.random.default_rng(0).random((50, 3))


def test_layers_that_are_left_alone_move_nothing() -> None:
    lattice = layered_lattice(BOX, [Layer()] * 5)
    assert lattice.control.shape == (4, 4, 5, 3)
    assert np.allclose(lattice.deform(POINTS), POINTS, rtol=0, atol=1e-16)
    assert flattened_share(lattice) == 0.0


def test_layers_that_are_all_alike_scale_turn_then_shift() -> None:
    moved = layered_lattice(BOX, [Layer(1.5, math.pi / 2, (0.01, 0.02))] * 4).deform(POINTS)
    x, y, z = POINTS.T
    wanted = np.column_stack([-1.5 * y + 0.01, 1.5 * x + 0.02, z])
    assert np.allclose(moved, wanted, rtol=0, atol=1e-16)


def test_layers_are_taken_from_the_bottom_to_the_top() -> None:
    lattice = layered_lattice(BOX, [Layer(), Layer(), Layer(), Layer(2.0)])
    bottom, top = lattice.deform(np.array([BOX[0], BOX[1]]))
    assert bottom == pytest.approx(BOX[0])
    assert top == pytest.approx([0.06, 0.04, 0.07])


def test_a_fold_is_seen_and_its_share_told() -> None:
    turned = [Layer(), Layer(turn=3.0), Layer(turn=-3.0), Layer()]
    assert 0.0 < flattened_share(layered_lattice(BOX, turned)) < 1.0
    lattice = layered_lattice(BOX, [Layer()] * 4)
    mirrored = lattice.with_control(lattice.control[:, :, ::-1])
    assert flattened_share(mirrored) == 1.0
    assert flattened_share(layered_lattice(BOX, [Layer(0.05)] * 4)) == 1.0
