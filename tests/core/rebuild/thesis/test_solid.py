from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.measure.solidity import solidity
from palpate.core.rebuild.thesis.rebuild import rebuild_thesis
from palpate.core.rebuild.thesis.solid import ThesisSolid

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
