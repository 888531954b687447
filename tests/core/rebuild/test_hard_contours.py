"""Contours on which rebuilding went wrong: blades, half turns, over-declared noise, rods."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruction import reconstruct

LEVELS = np.linspace(-0.04, 0.04, 9)
LENGTH = LEVELS[-1] - LEVELS[0]


def ellipses(
    wide: float, narrow: float, count: int, turns: float = 1.0, *, by_length: bool = False
) -> list[Floats]:
    """Contours of an elliptic cylinder, of points at even angles or even steps along it, m."""
    angles = 2.0 * np.pi * turns * np.arange(count) / count
    if by_length:
        fine = np.linspace(0.0, 2.0 * np.pi, 20_001)
        steps = np.hypot(wide * np.diff(np.cos(fine)), narrow * np.diff(np.sin(fine)))
        way = np.concatenate([[0.0], np.cumsum(steps)])
        angles = np.interp(np.arange(count) / count * way[-1], way, fine)
    x, y = wide * np.cos(angles), narrow * np.sin(angles)
    return [np.column_stack([x, y, np.full(count, z)]) for z in LEVELS]


@pytest.mark.parametrize("by_length", [False, True])
@pytest.mark.parametrize(
    ("ratio", "count"), [(20.0, 24), (20.0, 60), (20.0, 200), (50.0, 24), (50.0, 60)]
)
def test_a_blade_has_the_volume_that_it_has(ratio, count, by_length):
    solid = reconstruct(ellipses(0.05, 0.05 / ratio, count, by_length=by_length))
    volume = np.pi * 0.05**2 / ratio * LENGTH
    assert solid.volume == pytest.approx(volume, rel=6e-3)
    assert solid.health()["outlying_points"] == 0.0


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-3])
def test_exact_points_are_no_outliers_however_much_noise_is_declared(noise):
    solid = reconstruct(ellipses(0.03, 0.02, 40), noise=noise)
    assert solid.health()["outlying_points"] == 0.0
    volume = np.pi * 0.03 * 0.02 * LENGTH
    assert solid.volume == pytest.approx(volume, rel=3e-3)


def test_contours_that_cover_half_a_turn_are_said_to_gape():
    assert reconstruct(ellipses(0.03, 0.03, 30, 0.5)).health()["gaping"] == len(LEVELS)
    assert reconstruct(ellipses(0.03, 0.03, 30)).health()["gaping"] == 0.0
    square = [np.array([[1, 1, z], [-1, 1, z], [-1, -1, z], [1, -1, z]]) * 0.02 for z in (0, 1, 2)]
    assert reconstruct(square).health()["gaping"] == 0.0


def test_a_rod_is_as_good_as_what_is_thick():
    rod = [one + [0.1 * one[0, 2], 0.0, 0.0] for one in ellipses(3e-4, 3e-4, 40)]
    solid = reconstruct(rod)
    assert solid.method == "lattice"
    assert solid.volume == pytest.approx(np.pi * 3e-4**2 * LENGTH, rel=3e-3)
