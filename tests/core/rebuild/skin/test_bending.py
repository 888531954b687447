from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.skin.bending import bending_along, bending_around
from palpate.core.splines.basis import Basis, clamped_basis


def test_the_bending_along_is_the_integral_of_the_squared_second_derivative() -> None:
    basis = Basis(np.array([0, 0, 0, 0, 0.2, 0.7, 1, 1, 1, 1.0]), 3)
    control = np.random.default_rng(0).normal(size=basis.count)
    fine = (np.arange(200_000) + 0.5) / 200_000
    wanted = np.mean(np.square(basis.matrix(fine, 2) @ control))
    assert np.sum(np.square(bending_along(basis) @ control)) == pytest.approx(wanted, rel=1e-6)


def test_straight_lines_do_not_bend_along() -> None:
    basis = clamped_basis(9)
    line = 3.0 + 2.0 * basis.greville()
    assert np.abs(bending_along(basis) @ line).max() < 1e-11
    assert np.abs(bending_along(basis, 1) @ np.ones(9)).max() < 1e-12
    assert np.abs(bending_along(basis, 1) @ line).max() > 0.1


@pytest.mark.parametrize("count", [4, 7, 24, 128])
def test_points_and_ellipses_do_not_bend_around_and_lobes_do(count: int) -> None:
    angle = 2 * np.pi * np.arange(count) / count
    root = bending_around(count)
    ellipse = np.column_stack([4.0 + 3.0 * np.cos(angle + 1.0), np.sin(angle)])
    assert np.abs(root @ ellipse).max() < 1e-13
    assert np.abs(root @ np.cos(2 * angle)).max() > 1e-8
