"""On a grid every piece says what it says at each of its places."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.geometry import solidity
from palpate.core.rebuild import LatticeSolid, reconstruct
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Flat
from palpate.core.rebuild.ends.relief import with_relief
from palpate.core.rebuild.surface.closed import Surface, close_surface
from palpate.core.rebuild.surface.meshing import grid_mesh
from tests.core.rebuild.ends.test_relief import BULGE, POSE, ROW, Wall, level_end, touched

ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
HEIGHTS = np.linspace(-0.8, 0.8, 9)
KINDS = ["skin", "lattice", "weighted", "thesis", "ends", "relief"]
Make = Callable[..., Any]


@pytest.fixture
def contours(traced: Make, sections: Any) -> Any:
    return traced(sections["kidney"]).contours(HEIGHTS, 60)


def made(kind: str, contours: Any) -> Surface:
    if kind == "relief":
        end = with_relief(level_end(), touched(BULGE, 0), ROW, POSE)
        bottom = End("flat", 0.0, 0.0, 0.0, Flat(0.0), np.zeros(2), True)
        return close_surface(Wall(), bottom, end)
    if kind == "ends":
        return reconstruct(contours, tops=[[0, 0, -1], [0, 0, 1]], method="skin").surface
    solid: LatticeSolid = reconstruct(contours, method="lattice" if kind == "weighted" else kind)
    if kind == "weighted":
        solid = solid.refined(contours[4] * [1.01, 1.0, 1.0], weights=True)
    return solid.surface


@pytest.mark.parametrize("by", ORDERS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_grid_is_the_same_as_its_places(kind, by, contours):
    surface = made(kind, contours)
    v, turns = np.linspace(0.0, 1.0, 23), np.linspace(-0.5, 1.0, 17)
    each = surface.at(v[:, None], turns, by)
    np.testing.assert_allclose(
        surface.on_grid(v, turns, by), each, rtol=1e-9, atol=1e-9 * np.abs(each).max()
    )


@pytest.mark.parametrize("kind", KINDS)
def test_an_even_grid_makes_a_closed_mesh_on_the_surface(kind, contours):
    surface = made(kind, contours)
    mesh = grid_mesh(surface)
    found = solidity(mesh.vertices, mesh.faces)
    assert found.watertight and found.genus == 0 and found.volume > 0.0
    inner = slice(1, -1)
    on = surface.at(mesh.v[inner], mesh.turns[inner])
    np.testing.assert_allclose(mesh.vertices[inner], on, atol=1e-12 * surface.size)
