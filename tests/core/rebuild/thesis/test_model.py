from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.thesis.model import (
    ModelTriples,
    latitude_points,
    level_points,
    triples_of,
)
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.frame import upright_frame
from palpate.core.splines.volume import Volume

AZIMUTHS = np.linspace(-np.pi, np.pi, 25)
CUBE = upright_frame(np.full(3, -1.0), np.full(3, 2.0))
EVEN = Volume(CUBE.even_control((5, 5, 9)), (clamped_basis(5), clamped_basis(5), clamped_basis(9)))


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


@pytest.mark.parametrize("method", ["auto", "thesis"])
def test_triples_give_back_the_points_in_the_undeformed_lattice(method: str) -> None:
    points = level_points(model(0.15, 0.15), np.linspace(-1.0, 1.0, 9), AZIMUTHS)
    triples = triples_of(EVEN, points, "thesis" if method == "thesis" else "auto")
    back = EVEN.at(triples.reshape(-1, 3)).reshape(points.shape)
    assert np.abs(back - points).max() < (5e-6 if method == "thesis" else 1e-14)


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
