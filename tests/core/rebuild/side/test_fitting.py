from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.side.fitting import (
    ContourFit,
    contour_rows,
    fit_axial_parameter,
    fit_rows,
)
from palpate.core.rebuild.side.surfaces import AxialParameter

ANGLE = 2 * np.pi * np.arange(24) / 24
RIM = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)
HEIGHTS = np.linspace(-0.95, 0.95, 12)


def fitted(radii: Floats, pole: tuple[bool, bool] = (False, False)) -> ContourFit:
    rows = contour_rows(HEIGHTS[: len(radii)], radii[:, None, None] * RIM, -1.0, 1.0, pole)
    return fit_rows(rows, -1.0, 1.0, None)


def test_a_ball_is_taken_as_round_and_a_cone_is_not():
    assert fitted(np.sqrt(1.0 - HEIGHTS**2)).axial_parameter.round == (True, True)
    assert fitted(2.0 - HEIGHTS).axial_parameter.round == (False, False)


def test_with_poles_a_ball_is_exact_and_closed():
    fit = fitted(np.sqrt(1.0 - HEIGHTS**2), (True, True))
    assert fit.axial_parameter.round == (True, True)
    assert np.abs(fit.control[[0, -1]]).max() < 1e-12
    assert len(fit.sites) == 14


def test_a_sharp_tip_is_not_rounded():
    fit = fitted(1.0 - HEIGHTS, (False, True))
    assert fit.axial_parameter.round == (False, False)
    assert np.ptp(fit.control[-1], axis=0).max() < 1e-12


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_contours_decide_nothing(count):
    for pole in ((False, False), (True, False)):
        fit = fitted(np.sqrt(1.0 - HEIGHTS[:count] ** 2), pole)
        if count + sum(pole) < 5:
            assert fit.axial_parameter.round == pole


def test_vectors_across_are_units_outwards_and_none_at_a_point():
    radii = np.sqrt(1.0 - HEIGHTS**2)
    radii[-1] = 0.0
    rows = contour_rows(HEIGHTS, radii[:, None, None] * RIM, -1.0, 1.0, (False, False))
    fit = fit_axial_parameter(rows, AxialParameter(-1.0, 1.0, (False, False)), None)
    across = fit.across()
    assert np.allclose(across[:-1], RIM, atol=1e-3)
    assert np.isfinite(across).all()
    point = fitted(np.zeros(6))
    assert np.array_equal(point.across(), np.zeros((6, 24, 2)))


def test_the_fitted_rows_stand_on_the_line_between_the_poles():
    lean = np.column_stack([HEIGHTS, 0.5 * HEIGHTS])
    grid = np.sqrt(1.0 - HEIGHTS**2)[:, None, None] * RIM + lean[:, None]
    rows = contour_rows(HEIGHTS, grid, -1.0, 1.0, (True, True))
    fit = fit_rows(rows, -1.0, 1.0, None)
    assert np.allclose(rows.size * fit.fitted() + rows.middle, grid, atol=1e-5)


def lobed(count: int) -> tuple[Floats, Floats]:
    """Heights, and rows of a lobed tube."""
    heights = np.linspace(-0.95, 0.95, count)
    radius = (1.0 + 0.2 * heights[:, None]) * (1.0 + 0.1 * np.cos(3.0 * ANGLE))
    return heights, radius[..., None] * RIM


def test_noise_that_neighbours_share_is_not_followed():
    heights, grid = lobed(27)
    plain, chosen = [], []
    for seed in range(8):
        noise = 0.02 * np.random.default_rng(seed).normal(size=grid.shape)
        noise = (noise + 0.4 * np.roll(noise, 1, 1)) / np.sqrt(1.16)
        rows = contour_rows(heights, grid + noise, -1.0, 1.0, (False, False))
        fit = fit_rows(rows, -1.0, 1.0, None)
        assert fit.caution > 1.0
        assert abs(fit.likeness(rows.grid)) < 0.25
        chosen.append(fit.smoothed.freedom)
        plain.append(fit_axial_parameter(rows, fit.axial_parameter, None).smoothed.freedom)
    assert max(chosen) < 0.25 * grid[..., 0].size
    assert np.mean(chosen) < 0.8 * np.mean(plain)


def test_a_clean_shape_that_takes_all_freedom_gets_it():
    heights = np.linspace(-0.95, 0.95, 20)
    corners = np.maximum(np.abs(RIM[:, 0]), np.abs(RIM[:, 1]))
    grid = np.repeat((RIM / corners[:, None])[None], 20, axis=0)
    rows = contour_rows(heights, grid, -1.0, 1.0, (False, False))
    fit = fit_rows(rows, -1.0, 1.0, None)
    assert fit.caution == 1.0
    assert np.abs(fit.fitted() - rows.grid).max() < 1e-4
    careful = fit_axial_parameter(rows, fit.axial_parameter, None, 1.2)
    assert careful.likeness(rows.grid) > 0.9


def test_of_very_many_contours_and_points_some_share_coefficients():
    angle = 2 * np.pi * np.arange(300) / 300
    heights = np.linspace(-0.95, 0.95, 200)
    radius = np.sqrt(1.0 - heights**2)[:, None] * (1.0 + 0.1 * np.cos(3.0 * angle))
    grid = radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rows = contour_rows(heights, grid, -1.0, 1.0, (False, False))
    fit = fit_rows(rows, -1.0, 1.0, None)
    assert fit.control.shape == (128, 128, 2)
    assert np.abs(fit.fitted() - rows.grid).max() < 1e-5


ANGLE_12 = 2 * np.pi * np.arange(12) / 12
RIM_12 = np.stack([np.cos(ANGLE_12), np.sin(ANGLE_12)], axis=-1)


def rings(radii: Floats, middles: Floats | None = None) -> Floats:
    grid = np.asarray(radii)[:, None, None] * RIM_12
    return grid if middles is None else grid + middles[:, None]


def test_rows_rise_in_a_unit_of_their_own():
    grid = rings(np.array([3.0, 1.0, 2.0])) + np.array([100.0, -7.0])
    rows = contour_rows(np.array([0.3, 0.1, 0.2]), grid, 0.0, 1.0, (False, False))
    assert rows.heights.tolist() == [0.1, 0.2, 0.3]
    assert rows.owner.tolist() == [2, 0, 1]
    assert np.allclose(rows.middle, [100.0, -7.0])
    assert rows.size == pytest.approx(3.0)
    assert np.abs(rows.grid).max() == pytest.approx(1.0)
    assert np.allclose(rows.grid[0] * rows.size + rows.middle, grid[1])
    assert rows.spacing == pytest.approx(0.1)


def test_contours_at_one_height_are_averaged_and_count_as_many():
    heights = np.array([0.0, 0.5, 0.5 + 1e-6, 1.0, 0.5])
    rows = contour_rows(heights, rings(np.array([1, 1, 2, 1, 3.0])), 0.0, 1.0, (False, False))
    assert rows.weights.tolist() == [1.0, 3.0, 1.0]
    assert rows.owner.tolist() == [0, 1, 1, 2, 1]
    assert np.allclose(rows.grid[1] * rows.size, 2.0 * RIM_12)


def test_a_pole_lies_where_the_middles_lead_or_where_it_is_put():
    heights = np.linspace(0.0, 1.0, 6)
    lean = np.column_stack([0.2 * heights, -0.1 * heights])
    grid = rings(np.ones(6), lean)
    rows = contour_rows(heights, grid, -0.5, 2.0, (np.array([1.0, 1.0]), True))
    below, above = rows.poles
    assert below is not None
    assert above is not None
    assert np.allclose(below * rows.size + rows.middle, [1.0, 1.0])
    assert np.allclose(above * rows.size + rows.middle, [0.4, -0.2])
    assert rows.with_poles.shape == (8, 12, 2)
    assert np.allclose(rows.with_poles[-1], above)


def test_points_in_one_place_have_a_size_of_1():
    rows = contour_rows([0.0], np.full((1, 5, 2), 3.0), -1.0, 1.0, (True, False))
    assert rows.size == 1.0
    assert rows.spacing == 0.0
    assert np.array_equal(rows.with_poles, np.zeros((2, 5, 2)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heights": [0.0, np.inf]}, "heights must be finite"),
        ({"grid": np.ones((3, 12, 2))}, r"grid must have shape \(2, any, 2\), got \(3, 12, 2\)"),
        ({"low": 0.3}, "heights must lie from low 0.3 to high 1 m, got 0.25 to 0.75"),
        ({"high": 0.75, "pole": (False, True)}, "a pole must lie beyond the last contour"),
        ({"pole": (np.ones(3), False)}, r"pole must have shape \(2\), got \(3,\)"),
    ],
)
def test_what_is_no_stack_of_contours_is_refused(change, words):
    given = {"heights": [0.25, 0.75], "low": 0.0, "high": 1.0, "pole": (False, False)} | change
    grid = given.pop("grid", np.ones((len(given["heights"]), 12, 2)))
    with pytest.raises(ValueError, match=words):
        contour_rows(grid=grid, **given)
