from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import pose_of
from palpate.core.rebuild.felt.edge_slopes import edge_slopes
from palpate.core.rebuild.felt.felt_points import felt_points
from palpate.core.touch.jet_fit import fit_jet
from palpate.core.touch.pad import Pad

PITCH = 1e-3
ALL = np.ones((16, 16), np.bool_)


def grid() -> tuple[Floats, Floats]:
    steps = PITCH * (np.arange(16) - 7.5)
    return np.meshgrid(steps, steps)


def roof(x: Floats) -> Floats:
    """Two planes that meet in an edge between two columns."""
    return np.minimum(0.2 * x, -0.5 * x)


@pytest.mark.parametrize("noise", [0.0, 5e-6])
def test_next_to_an_edge_each_taxel_leans_as_its_own_side(noise: float) -> None:
    x, _ = grid()
    surface = roof(x) + np.random.default_rng(0).normal(0.0, noise, x.shape)
    smooth = -0.15 * x - 0.04 * x**2 / 1e-2
    found = edge_slopes(surface, smooth, ALL, PITCH)
    near = found.edge & (np.abs(x) < 3e-3)
    assert near.sum() > 30
    assert found.slope_x[near] == pytest.approx(
        np.where(x < 0, 0.2, -0.5)[near], abs=5 * noise / PITCH + 1e-9
    )
    assert found.slope_y[near] == pytest.approx(np.zeros(near.sum()), abs=5 * noise / PITCH + 1e-9)


def test_a_smooth_surface_is_believed() -> None:
    x, y = grid()
    smooth = (x**2 - 0.5 * x * y) / 0.03
    rng = np.random.default_rng(1)
    for noise in (0.0, 1e-5, 1e-4):
        found = edge_slopes(smooth + rng.normal(0.0, noise, x.shape), smooth, ALL, PITCH)
        assert not found.edge.any()
        assert found.unknown.mean() < 0.01


def test_a_single_row_beyond_an_edge_leans_nobody_knows_how() -> None:
    x, _ = grid()
    touched = x > -1.6e-3
    surface = np.where(x < -1e-3, -1.2e-3, -0.2 * x)
    found = edge_slopes(surface, -0.2 * x - 2e-4, touched, PITCH)
    assert found.unknown[x == x[touched].min()].all()
    assert not found.unknown[x > 2e-3].any()


@pytest.mark.parametrize("noise", [2e-5, 1e-4])
def test_of_a_thin_contact_noise_takes_nothing(noise: float) -> None:
    x, _ = grid()
    touched = np.abs(x) < 1e-3
    surface = np.random.default_rng(2).normal(0.0, noise, x.shape)
    found = edge_slopes(surface, np.zeros(x.shape), touched, PITCH)
    assert touched.sum() == 32
    assert not found.unknown.any()


def test_an_array_without_a_square_says_nothing() -> None:
    found = edge_slopes(np.zeros((1, 12)), np.ones((1, 12)), np.ones((1, 12), np.bool_), PITCH)
    assert not (found.edge.any() or found.unknown.any())


def test_felt_points_have_the_normals_of_both_sides_of_an_edge(flat: Pad) -> None:
    x, _ = flat.grid()
    surface = roof(x)
    fitted = fit_jet(flat, surface, ALL)
    assert fitted is not None
    felt = felt_points(flat, pose_of(np.zeros(3), np.eye(3)), surface, ALL, fitted.jet)
    expected = np.where(felt.points[:, 0] < 0, 0.2, -0.5)
    normals = np.asarray(felt.normals)
    off = np.abs(-normals[:, 0] / normals[:, 2] - expected)
    assert len(off) > 240
    assert (off < 1e-9).mean() > 0.5
    assert off.max() < 0.1  # the jet alone is off by .35 in the middle
