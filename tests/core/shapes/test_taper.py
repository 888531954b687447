from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.core.shapes.taper import Taper


def test_it_widens_the_top_and_narrows_the_bottom_in_proportion_to_the_height() -> None:
    taper = Taper(0.4, -0.2, half_height=0.05)
    points = np.array([[0.01, 0.02, z] for z in (-0.05, 0.0, 0.025, 0.05)])
    moved = taper(points)
    assert np.allclose(moved[:, 0], 0.01 * np.array([0.6, 1.0, 1.2, 1.4]))
    assert np.allclose(moved[:, 1], 0.02 * np.array([1.2, 1.0, 0.9, 0.8]))
    assert np.array_equal(moved[:, 2], points[:, 2])


def test_no_taper_moves_nothing() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert np.array_equal(Taper(0.0, 0.0, 1.0)(points), points)


@pytest.mark.parametrize("share", [0.0, 0.4, -0.7, 0.999, -0.999, 1 - 1e-9])
def test_it_can_be_undone_below_1(share: float) -> None:
    points = np.random.default_rng(0).uniform(-2, 2, (200, 3))
    taper = Taper(share, -share, 1.0)
    assert np.allclose(taper.inverse(taper(points)), points, rtol=1e-15, atol=0)


def test_beyond_the_ends_the_widths_are_those_of_the_ends() -> None:
    moved = Taper(0.5, -0.5, 1.0)(np.array([[1.0, 1.0, 3.0], [1.0, 1.0, -3.0]]))
    assert moved.tolist() == [[1.5, 0.5, 3.0], [0.5, 1.5, -3.0]]


@pytest.mark.parametrize("share", [1.0, -1.0, 1.5, math.nan])
def test_a_taper_that_collapses_a_section_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match=rf"taper must lie between -1 and 1, got \[{share}, 0.0\]"):
        Taper(share, 0.0, 1.0)
    with pytest.raises(ValueError, match=rf"taper must lie between -1 and 1, got \[0.0, {share}\]"):
        Taper(0.0, share, 1.0)
