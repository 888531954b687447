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


def test_it_can_be_undone_below_1() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (100, 3))
    moved = Taper(0.999, -0.999, 1.0)(points)
    widths = 1.0 + np.outer(moved[:, 2], [0.999, -0.999])
    assert np.allclose(moved[:, :2] / widths, points[:, :2], atol=1e-12)


@pytest.mark.parametrize("share", [1.0, -1.0, 1.5, math.nan])
def test_a_taper_that_collapses_a_section_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match=rf"taper must lie between -1 and 1, got \[{share}, 0.0\]"):
        Taper(share, 0.0, 1.0)
    with pytest.raises(ValueError, match=rf"taper must lie between -1 and 1, got \[0.0, {share}\]"):
        Taper(0.0, share, 1.0)
