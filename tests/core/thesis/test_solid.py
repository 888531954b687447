from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import solidity
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.splines.bases import clamped_basis
from palpate.core.splines.inversion import invert_points
from palpate.core.splines.spline_volumes import SplineVolume, upright_parallelepiped
from palpate.core.splines.tensor_products import evaluate_grid
from palpate.core.thesis.rebuilding import rebuild_thesis
from palpate.core.thesis.solid import (
    ModelTriples,
    ThesisSolid,
    interpolated_parameters,
    latitude_points,
    level_points,
    triples_of,
)
from palpate.core.thesis.spline_methods import invert_thesis

Vase = Callable[..., Floats]


@pytest.fixture(scope="module", params=[False, True], ids=["corrected", "program"])
def solid(request: pytest.FixtureRequest, vase: Vase) -> ThesisSolid:
    return rebuild_thesis(vase(), faithful=request.param)


def test_a_mesh_has_the_rows_and_columns_asked_for_and_faces_outwards(solid: ThesisSolid) -> None:
    mesh = solid.mesh(20, 30)
    assert mesh.vertices.shape == (20 * 30 + 2, 3)
    found = solidity(*mesh)
    assert found.watertight
    assert found.components == 1
    assert found.volume > 0.0


def test_the_rows_of_a_mesh_are_rows_of_the_surface(solid: ThesisSolid) -> None:
    eta = np.linspace(0, 1, 22)[1:-1] if solid.cap is None else np.linspace(0, 1, 20)
    rings = solid.mesh(20, 30).vertices[1:-1].reshape(20, 30, 3)
    assert np.allclose(rings, solid.surface(eta, np.arange(30) / 30), rtol=0, atol=1e-12)


def test_the_surface_rises_with_eta(solid: ThesisSolid) -> None:
    surface = solid.surface(np.linspace(0, 1, 9), np.linspace(0, 1, 5))
    assert surface.shape == (9, 5, 3)
    assert (np.diff(surface[..., 2].mean(axis=1)) > 0.0).all()


@pytest.mark.parametrize("counts", [(1, 10), (10, 2)])
def test_a_mesh_of_too_few_points_is_refused(solid: ThesisSolid, counts: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="at least 2 rows and 3 columns, got"):
        solid.mesh(*counts)


@pytest.mark.parametrize("place", [-0.1, 1.1, np.nan])
def test_a_place_beyond_the_surface_is_refused(solid: ThesisSolid, place: float) -> None:
    with pytest.raises(ValueError, match="eta must"):
        solid.surface(np.array([place]), np.array([0.5]))
    with pytest.raises(ValueError, match="nu must"):
        solid.surface(np.array([0.5]), np.array([place]))
    assert solid.surface(np.zeros(0), np.array([0.5])).shape == (0, 1, 3)


AZIMUTHS = np.linspace(-np.pi, np.pi, 25)
CUBE = upright_parallelepiped(np.full(3, -1.0), np.full(3, 2.0))
EVEN = SplineVolume(
    CUBE.even_control((5, 5, 9)), (clamped_basis(5), clamped_basis(5), clamped_basis(9))
)


def model(e1: float, e2: float) -> Superquadric:
    return Superquadric(np.ones(3), np.array([e1, e2]))


@pytest.mark.parametrize("exponents", [(0.15, 0.15), (1.0, 0.3), (0.4, 1.7), (2.0, 2.0)])
def test_level_points_are_level_and_on_the_model_from_pole_to_pole(
    exponents: tuple[float, float],
) -> None:
    shape, heights = model(*exponents), np.linspace(-1.0, 1.0, 13)
    points = level_points(shape, heights, AZIMUTHS)
    assert np.array_equal(points[..., 2], np.repeat(heights[:, None], 25, axis=1))
    assert np.allclose(shape.gauge(points.reshape(-1, 3)), 1.0, rtol=0, atol=1e-12)
    assert not points[[0, -1], :, :2].any()
    azimuth = np.arctan2(points[6, 1:-1, 1], points[6, 1:-1, 0])
    assert np.allclose(azimuth, AZIMUTHS[1:-1], rtol=0, atol=1e-12)


def test_rows_by_latitude_are_not_level_where_the_section_is_no_circle() -> None:
    latitudes = np.arctan([-1.0, 0.0, 1.0])
    square = latitude_points(model(0.15, 0.15), latitudes, AZIMUTHS)
    assert np.ptp(square[2, :, 2]) > 0.04
    assert np.allclose(square[1, :, 2], 0.0)
    ball = latitude_points(model(1.0, 1.0), latitudes, AZIMUTHS)
    assert np.ptp(ball[2, :, 2]) < 1e-12
    assert ball[2, 0, 2] == pytest.approx(np.sqrt(0.5))  # the rest is left out


@pytest.mark.parametrize(("invert", "off"), [(invert_points, 1e-14), (invert_thesis, 5e-6)])
def test_triples_give_back_the_points_in_the_undeformed_lattice(invert: Any, off: float) -> None:
    points = level_points(model(0.15, 0.15), np.linspace(-1.0, 1.0, 9), AZIMUTHS)
    triples = triples_of(EVEN, points, invert)
    back = EVEN.at(triples.reshape(-1, 3)).reshape(points.shape)
    assert np.abs(back - points).max() < off


def test_the_model_knows_its_triples_everywhere() -> None:
    shape = model(0.3, 0.8)
    triples = ModelTriples(shape, EVEN).at(np.linspace(0, 1, 7), np.linspace(0, 1, 9))
    points = EVEN.at(triples.reshape(-1, 3)).reshape(7, 9, 3)
    assert np.allclose(shape.gauge(points.reshape(-1, 3)), 1.0, rtol=0, atol=1e-12)
    assert np.allclose(points[0], [0, 0, -1], rtol=0, atol=1e-12)
    assert np.allclose(points[-1], [0, 0, 1], rtol=0, atol=1e-12)
    assert np.allclose(points[3, 0], [-1, 0, 0], rtol=0, atol=1e-12)
    assert np.allclose(points[:, 0], points[:, -1], rtol=0, atol=1e-12)
    assert np.allclose(points[3, 6], [0, 1, 0], rtol=0, atol=1e-12)


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
