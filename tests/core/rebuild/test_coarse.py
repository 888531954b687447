from __future__ import annotations

import numpy as np
import pytest

from palpate.core.frames import pose_of
from palpate.core.rebuild.coarse import coarse_patch, fit_coarse
from palpate.core.rebuild.surface.surface import closed_surface
from palpate.core.rebuild.surface.surface_measures import measure_surface
from palpate.core.shapes.area_samples import area_samples, surface_of
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.warped import WarpedSuperquadric

BASE = Superquadric(np.array([30.0, 20.0, 50.0]), np.array([0.6, 0.9]))


def test_taper_and_bend_are_fitted_where_the_points_ask_for_them() -> None:
    rng = np.random.default_rng(3)
    plain = area_samples(surface_of(BASE), 900, rng)
    tapered = area_samples(surface_of(BASE, taper=np.array([-0.3, -0.2])), 900, rng)

    straight, narrowed = fit_coarse(plain + 0.1 * rng.normal(size=plain.shape)), fit_coarse(tapered)

    assert "taper x" not in straight.names
    assert narrowed.taper == pytest.approx([-0.3, -0.2], abs=1e-3)


def test_its_patch_is_the_surface_of_the_solid_where_it_stands() -> None:
    bend = Bend(0.005, 0.7)
    warped = PosedShape(
        WarpedSuperquadric(BASE, np.array([0.2, -0.1]), bend),
        pose_of(np.array([5.0, -3.0, 8.0]), np.eye(3)),
    )
    mesh = warped.mesh(5)

    found = fit_coarse(mesh.vertices)
    surface = closed_surface((coarse_patch(found),))

    triangles = mesh.vertices[mesh.faces]
    volume = (
        np.einsum("ni,ni->n", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
    )
    assert measure_surface(surface).moments.volume == pytest.approx(volume, rel=5e-3)
