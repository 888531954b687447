from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from palpate.core.arrays import Floats
from palpate.core.measure.nearest import nearest_points, search_of
from palpate.core.measure.triangles import areas_and_normals
from palpate.core.shapes.area_samples import area_samples, surface_of
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.icosphere import icosphere
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper
from palpate.core.shapes.warped import WarpedSuperquadric

SIZE = np.array([0.3, 0.2, 0.4])
COUNT = 20_000
STRAIGHT = np.zeros(2)


def unlikely(sampled: Floats, base: Superquadric, taper: Floats, bend: Bend) -> float:
    """Probability of a scatter as wide, if the samples are even over the facets of a fine mesh.

    Facets are put together by the 80 facets of a coarse one that they stand over.
    """
    mesh = WarpedSuperquadric(base, taper, bend).mesh(6)
    areas = areas_and_normals(mesh.vertices[mesh.faces])[0].reshape(80, -1).sum(axis=1)
    tapering = Taper(float(taper[0]), float(taper[1]), float(base.size[2]))
    before = tapering.inverse(bend.inverse(sampled)) / base.size
    directions, faces = icosphere(4)
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    cells = nearest_points(search_of(directions[faces]), before).faces // (len(faces) // 80)
    expected = COUNT * areas / areas.sum()
    counts = np.bincount(cells, minlength=80)
    return float(chi2.sf(((counts - expected) ** 2 / expected).sum(), 79))


@pytest.mark.parametrize("exponent", [0.1, 1.0, 2.0])
@pytest.mark.parametrize(
    ("taper", "curvature"), [((0.0, 0.0), 0.0), ((0.7, -0.5), 0.0), ((0.4, 0.2), 1.8)]
)
def test_samples_are_even_over_the_surface(
    exponent: float, taper: tuple[float, float], curvature: float
) -> None:
    base, bend = Superquadric(SIZE, np.full(2, exponent)), Bend(curvature, 0.7)
    surface = surface_of(base, np.array(taper), bend)
    sampled = area_samples(surface, COUNT, np.random.default_rng(0))
    solid = WarpedSuperquadric(base, np.array(taper), bend)
    assert np.abs(solid.gauge(sampled) - 1.0).max() < 1e-12
    assert unlikely(sampled, base, np.array(taper), bend) > 1e-3


def test_even_in_the_parameters_is_not_even_and_the_test_sees_it() -> None:
    base = Superquadric(SIZE, np.full(2, 0.1))
    rng = np.random.default_rng(0)
    eta = np.arcsin(rng.uniform(-1, 1, COUNT))
    omega = rng.uniform(-math.pi, math.pi, COUNT)
    radii = np.column_stack([np.cos(eta) * np.cos(omega), np.cos(eta) * np.sin(omega), np.sin(eta)])
    by_rays = SIZE * radii / base.gauge(SIZE * radii)[:, None]
    assert unlikely(by_rays, base, STRAIGHT, Bend(0.0)) < 1e-9


def test_the_area_is_that_of_known_solids() -> None:
    ball = surface_of(Superquadric(np.full(3, 0.5), np.ones(2)))
    assert ball.area == pytest.approx(math.pi, rel=1e-5)
    octahedron = surface_of(Superquadric(np.full(3, 0.5), np.full(2, 2.0)))
    assert octahedron.area == pytest.approx(math.sqrt(3), rel=5e-3)
    box = surface_of(Superquadric(np.full(3, 0.5), np.full(2, 0.02)))
    assert box.area == pytest.approx(6.0, rel=0.03)


def test_samples_depend_on_the_generator_alone() -> None:
    surface = surface_of(Superquadric(SIZE, np.ones(2)))
    first, again, other = (
        area_samples(surface, 50, np.random.default_rng(seed)) for seed in (3, 3, 4)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert area_samples(surface, 0, np.random.default_rng(3)).shape == (0, 3)


def test_a_solid_that_its_bend_folds_is_refused() -> None:
    with pytest.raises(ValueError, match="all that is bent must be nearer"):
        surface_of(Superquadric(SIZE, np.ones(2)), STRAIGHT, Bend(5.0, 0.0))
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        surface_of(Superquadric(SIZE, np.ones(2)), np.array([1.0, 0.0]))
