from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.side.equations import fit_axis_curve, normal_band, tensor_rows
from palpate.core.splines import PeriodicBasis, clamped_basis


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
def test_the_axis_passes_through_middles_that_lie_on_a_polynomial(count):
    heights = np.linspace(0.01, 0.07, count)
    degree = min(3, count - 1)
    x = sum(0.001 * (heights / 0.03) ** k for k in range(degree + 1))
    middles = np.column_stack([x, -2 * np.asarray(x)])
    axis_curve = fit_axis_curve(heights, middles)
    assert np.allclose(axis_curve.at(heights), middles, rtol=0, atol=1e-15)


def test_beyond_the_contours_the_axis_goes_straight_up():
    axis_curve = fit_axis_curve(np.array([0.01, 0.03]), np.array([[0.0, 0.0], [0.004, 0.002]]))
    assert np.allclose(axis_curve.at(np.array([0.02])), [[0.002, 0.001]])
    assert np.allclose(axis_curve.at(np.array([-1.0, 0.01])), 0.0, atol=1e-17)
    assert np.allclose(axis_curve.at(np.array([0.03, 9.0])), [0.004, 0.002])


def test_repeated_heights_share_one_middle():
    axis_curve = fit_axis_curve(
        np.full(3, 0.02), np.array([[0.0, 0.0], [0.003, 0.0], [0.0, 0.003]])
    )
    assert np.allclose(axis_curve.at(np.array([0.0, 0.02, 1.0])), 0.001, atol=1e-17)


def test_the_axis_is_the_same_in_millimetres():
    rng = np.random.default_rng(0)
    heights, middles = np.sort(rng.random(7)), rng.random((7, 2))
    there = fit_axis_curve(1e3 * heights, 1e3 * middles).at(1e3 * heights)
    assert np.allclose(there, 1e3 * fit_axis_curve(heights, middles).at(heights), rtol=1e-12)


def test_an_axis_that_is_bent_at_one_end_alone_passes_through_all_middles():
    heights = np.linspace(0.0, 0.1, 9)
    middles = np.column_stack([0.03 * (heights > 0.09), np.zeros(9)])
    axis_curve = fit_axis_curve(heights, middles)
    assert np.allclose(axis_curve.at(heights), middles, rtol=0, atol=1e-15)
    step = 1e-6
    between = np.array([0.033, 0.095])
    slope = (axis_curve.at(between + step) - axis_curve.at(between - step)) / (2 * step)
    assert np.allclose(axis_curve.slope(between), slope, rtol=0, atol=1e-6)
    beyond = np.array([-0.01, 0.11])
    assert np.array_equal(axis_curve.at(beyond), axis_curve.at(heights[[0, -1]]))
    assert not axis_curve.slope(beyond).any()


def test_a_straight_axis_does_not_follow_noise():
    heights = np.linspace(0.0, 0.1, 9)
    noise = 1e-4 * np.random.default_rng(0).normal(size=(9, 2))
    assert fit_axis_curve(heights, noise).bent is None


def test_the_band_summed_cell_by_cell_is_that_of_the_product_of_the_matrices():
    rng = np.random.default_rng(0)
    along, around = clamped_basis(7), PeriodicBasis(9)
    bases = along.matrix(rng.random(80)), around.matrix(rng.random(80))
    weights = rng.random(80)
    rows = weights[:, None] * tensor_rows(*bases).toarray()
    whole, band = rows.T @ rows, normal_band(*bases, weights)
    lower = [np.append(np.diagonal(whole, -down), np.zeros(down)) for down in range(len(band))]
    np.testing.assert_allclose(band, lower, atol=1e-15)
    assert not np.diagonal(whole, -len(band)).any()
