"""Level ends of contours that their centroid does not see whole."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruct import reconstruct

ANGLE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
CLAMP = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4.0]])


def stack(corners: Floats) -> list[Floats]:
    closed = np.concatenate([corners, corners[:1]])
    ways = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = ways[-1] * np.arange(96) / 96
    ring = np.column_stack([np.interp(at, ways, closed[:, axis]) for axis in range(2)])
    return [np.column_stack([ring, np.full(96, height)]) for height in np.linspace(0.0, 5.0, 6)]


@pytest.mark.parametrize("tops", [None, [[1, 1, -1.0], [1, 1, 6.0]]])
def test_an_angle_has_ends_without_folds(tops: list[list[float]] | None) -> None:
    solid = reconstruct(stack(ANGLE), tops=tops, method="skin")

    assert (solid.health()["folded_below"], solid.health()["folded_above"]) == (0.0, 0.0)
    mesh = solid.mesh()
    corners = mesh.vertices[mesh.faces]
    high = np.ptp(corners[:, :, 2], axis=1) < 1e-9
    sides = corners[high, 1:, :2] - corners[high, :1, :2]
    turned = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    upper = corners[high, 0, 2] > 2.5
    assert upper.any() and (~upper).any()
    assert turned[upper].min() > -1e-12
    assert turned[~upper].max() < 1e-12


def test_a_clamp_says_that_its_ends_lie_on_themselves() -> None:
    for method in ("skin", "lattice"):
        health = reconstruct(stack(CLAMP), method=method).health()

        assert health["folded_below"] == pytest.approx(health["folded_above"], rel=0.01)
        assert health["folded_above"] > 0.2
