from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.prism import LAYERS, SIDE, fit_prism

HEIGHTS = np.linspace(0.01, 0.07, 97)
TURNS = np.arange(160) / 160
AZIMUTH = 2 * np.pi * TURNS


def side_of(radius: Floats) -> Floats:
    """Side surface (m, n, 2) from radii (m, n) about an upright axis."""
    rim = np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH)], axis=-1)
    return np.asarray(radius[:, :, None] * rim)


def test_an_elliptic_prism_is_not_deformed() -> None:
    rim = np.stack([0.04 * np.cos(AZIMUTH), 0.02 * np.sin(AZIMUTH)], axis=-1)
    fit = fit_prism(HEIGHTS, TURNS, np.broadcast_to(rim, (97, 160, 2)))
    assert fit.rms < 1e-12
    assert np.allclose(fit.half_extent, [0.04, 0.02])
    assert fit.folded_share() == 0.0
    points = fit.frame.points(np.random.default_rng(0).random((50, 3)))
    assert np.allclose(fit.lattice.deform(points), points, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("bulge", "bound", "folds"), [(0.0, 2e-6, 0.0), (0.1, 2e-6, 0.0), (0.3, 5e-6, 0.1)]
)
def test_a_given_smooth_side_is_reproduced(bulge: float, bound: float, folds: float) -> None:
    share = (HEIGHTS[:, None] - 0.04) / 0.03
    radius = 0.03 * np.sqrt(1.2 - share**2) * (1 + bulge * np.cos(3 * AZIMUTH + share))
    side = side_of(radius)
    fit = fit_prism(HEIGHTS, TURNS, side)
    assert fit.rms < bound
    given = fit.side(HEIGHTS, TURNS)
    assert np.sqrt(np.mean(np.sum((given[..., :2] - side) ** 2, axis=-1))) == pytest.approx(fit.rms)
    assert np.allclose(given[..., 2], HEIGHTS[:, None], rtol=0, atol=1e-15)
    assert fit.folded_share() <= folds


def test_the_side_is_the_deformed_prism() -> None:
    radius = 0.03 + 0.005 * np.cos(2 * AZIMUTH)[None, :] * np.sin(40 * HEIGHTS)[:, None]
    fit = fit_prism(HEIGHTS, TURNS, side_of(radius) + np.array([0.1, -0.2]))
    middle = fit.frame.points(np.full(3, 0.5))[:2]
    rim = middle + fit.half_extent * np.stack([np.cos(AZIMUTH), np.sin(AZIMUTH)], axis=-1)
    for row in (0, 40, 96):
        undeformed = np.column_stack([rim, np.full(160, HEIGHTS[row])])
        there = fit.lattice.deform(undeformed)
        assert np.allclose(fit.side(HEIGHTS[[row]], TURNS)[0], there, rtol=0, atol=1e-14)


def test_a_leaning_side_is_sheared_not_refused() -> None:
    lean = np.array([0.3, -0.2]) * HEIGHTS[:, None, None]
    fit = fit_prism(HEIGHTS, TURNS, side_of(np.full((97, 160), 0.02)) + lean)
    assert fit.rms < 1e-6


def test_control_points_stay_near_the_object() -> None:
    rounded = 0.02 / (np.cos(AZIMUTH) ** 4 + np.sin(AZIMUTH) ** 4) ** 0.25
    fit = fit_prism(HEIGHTS, TURNS, side_of(np.broadcast_to(rounded, (97, 160))))
    assert fit.lattice.control.shape == (SIDE, SIDE, LAYERS, 3)
    assert np.abs(fit.lattice.control[..., :2]).max() < 4 * 0.02
    assert fit.rms < 1e-3 * 0.02


def test_a_square_side_is_reproduced_to_the_width_of_its_corners() -> None:
    square = 0.02 / np.maximum(np.abs(np.cos(AZIMUTH)), np.abs(np.sin(AZIMUTH)))
    fit = fit_prism(HEIGHTS, TURNS, side_of(np.broadcast_to(square, (97, 160))))
    assert fit.rms < 0.01 * 0.02


def test_a_side_turned_inside_out_is_a_fold() -> None:
    fit = fit_prism(HEIGHTS, TURNS, side_of(np.full((97, 160), 0.02))[:, ::-1])
    assert fit.folded_share() > 0.9


def test_the_fit_is_the_same_in_micrometres_and_kilometres() -> None:
    side = side_of(0.03 + 0.004 * np.cos(3 * AZIMUTH)[None, :] * (HEIGHTS / 0.07)[:, None])
    metres = fit_prism(HEIGHTS, TURNS, side)
    for scale in (1e6, 1e-3):
        other = fit_prism(scale * HEIGHTS, TURNS, scale * side)
        given, wanted = other.side(scale * HEIGHTS, TURNS), scale * metres.side(HEIGHTS, TURNS)
        assert np.allclose(given, wanted, rtol=0, atol=1e-10 * scale)
        assert other.rms == pytest.approx(scale * metres.rms, rel=1e-3)
