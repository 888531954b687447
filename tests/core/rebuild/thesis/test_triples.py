from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.thesis.triples import interpolated_parameters
from palpate.core.splines.tensor import evaluate_grid


def box(rows: int, columns: int) -> Floats:
    """Triples on a rounded box, whose end rows are poles."""
    turn = np.linspace(-np.pi, np.pi, columns)
    x, y = np.cos(turn), np.sin(turn)
    outline = np.stack([x, y], axis=-1) / (x**12 + y**12)[:, None] ** (1 / 12)
    height = np.linspace(-1, 1, rows)
    width = (1 - np.abs(height) ** 12) ** (1 / 12)
    grid = np.empty((rows, columns, 3))
    grid[..., :2] = width[:, None, None] * outline
    grid[..., 2] = height[:, None]
    return np.asarray(0.5 * (grid + 1.0))


@pytest.mark.parametrize(("rows", "columns"), [(27, 81), (9, 13), (4, 5), (3, 9), (2, 9)])
def test_the_spline_passes_the_triples(rows: int, columns: int) -> None:
    grid = box(rows + 2, columns)[1:-1]
    spline = interpolated_parameters(grid)
    assert np.allclose(spline.at(*spline.sites), grid, rtol=0, atol=1e-12)
    assert spline.bases[0].degree == min(3, rows - 1)
    assert spline.condition < 1e3


def test_sites_go_by_the_square_root_of_the_chords() -> None:
    grid = np.zeros((4, 5, 3))
    grid[..., 2] = np.array([0.0, 0.01, 0.05, 0.14])[:, None]
    grid[..., 0] = np.linspace(0, 1, 5)
    eta, nu = interpolated_parameters(grid).sites
    assert np.allclose(eta, [0, 1 / 6, 3 / 6, 1])  # roots 0.1, 0.2, 0.3
    assert np.allclose(nu, np.linspace(0, 1, 5))


def test_sites_are_the_mean_over_the_rows_that_have_a_length() -> None:
    grid = box(9, 13)
    with_poles, without = interpolated_parameters(grid), interpolated_parameters(grid[1:-1])
    assert np.allclose(with_poles.sites[1], without.sites[1])
    poles = with_poles.at(np.array([0.0, 1.0]), np.linspace(0, 1, 50))
    assert np.allclose(poles, [[[0.5, 0.5, 0.0]], [[0.5, 0.5, 1.0]]], rtol=0, atol=1e-12)


def test_knots_average_three_sites_from_the_first_inner_one_on() -> None:
    spline = interpolated_parameters(box(12, 13)[1:-1])
    eta = spline.sites[0]
    assert np.allclose(spline.bases[0].knots[4:-4], [eta[i : i + 3].mean() for i in range(1, 7)])


def test_where_the_spline_overshoots_it_is_clipped() -> None:
    spline = interpolated_parameters(box(27, 81))
    fine = np.linspace(0, 1, 201)
    raw = evaluate_grid(spline.bases, spline.control, (fine, fine))
    assert raw.min() < -1e-5
    clipped = spline.at(fine, fine)
    assert clipped.min() == 0.0
    assert np.array_equal(clipped, np.clip(raw, 0.0, 1.0))


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (np.zeros((5, 9, 2)), r"parameters must have shape \(any, any, 3\), got \(5, 9, 2\)"),
        (box(1, 9), "at least 2 rows and 4 columns, got 1, 9"),
        (box(5, 3), "at least 2 rows and 4 columns, got 5, 3"),
        (np.full((5, 9, 3), np.nan), "parameters must be finite"),
        (np.repeat(box(5, 9), 2, axis=0), "parameters must differ between neighbouring rows"),
        (np.repeat(box(5, 9), 2, axis=1), "parameters must differ between neighbouring columns"),
        (np.full((5, 9, 3), 0.5), "parameters must differ between neighbouring rows"),
    ],
)
def test_triples_that_determine_no_spline_are_refused(grid: Floats, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        interpolated_parameters(grid)


def test_a_place_outside_is_refused() -> None:
    with pytest.raises(ValueError, match="x must lie in the domain"):
        interpolated_parameters(box(5, 9)).at(np.array([1.1]), np.array([0.5]))
