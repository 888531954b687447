import math

import mpmath
import numpy as np
import pytest
from scipy.stats import chi2

from palpate.core.geometry.meshes import areas_and_normals
from palpate.core.geometry.nearest import nearest_points, nearest_search
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.superquadric_measures import (
    area_samples,
    sampled_surface,
    superquadric_moments,
    superquadric_volume,
)
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.shapes.tessellations import icosphere

SIZE = np.array([0.3, 0.2, 0.4])


def by_tetrahedra(mesh):
    """Volume and second moments of a closed mesh, exactly."""
    corners = mesh.vertices[mesh.faces]
    six = np.einsum("mi,mi->m", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    total = corners.sum(axis=1)
    second = np.einsum("m,mci,mcj->ij", six, corners, corners)
    second += np.einsum("m,mi,mj->ij", six, total, total)
    return float(six.sum() / 6.0), second / 120.0


def test_volumes_of_known_solids():
    product = float(np.prod(SIZE))
    assert superquadric_volume(SIZE, [1.0, 1.0]) == pytest.approx(
        4 / 3 * math.pi * product, rel=1e-14
    )
    assert superquadric_volume(SIZE, [1e-12, 1e-12]) == pytest.approx(8 * product, rel=1e-11)
    assert superquadric_volume(SIZE, [2.0, 2.0]) == pytest.approx(4 / 3 * product, rel=1e-14)
    assert superquadric_volume(SIZE, [1e-12, 1.0]) == pytest.approx(
        2 * math.pi * product, rel=1e-11
    )


@pytest.mark.parametrize("exponents", [[1e-3, 1e-3], [0.02, 2.0], [0.3, 0.8], [2.0, 1.5]])
def test_the_volume_has_14_digits(exponents):
    with mpmath.workdps(40):
        e1, e2 = (mpmath.mpf(e) for e in exponents)
        beta = mpmath.beta
        shape = 2 * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2)
        wanted = float(shape * mpmath.fprod(SIZE.tolist()))
    assert superquadric_volume(SIZE, exponents) == pytest.approx(wanted, rel=2e-14)


def test_the_moments_of_a_ball_and_of_a_nearly_square_box():
    ball = superquadric_moments(Superquadric(np.full(3, 0.5), np.ones(2)))
    assert np.allclose(ball.second, 4 * math.pi / 15 * 0.5**5 * np.eye(3), rtol=1e-14)
    assert np.allclose(ball.inertia(), 8 * math.pi / 15 * 0.5**5 * np.eye(3), rtol=1e-14)
    box = superquadric_moments(Superquadric(SIZE, np.full(2, 0.02)))
    assert np.diagonal(box.second) == pytest.approx(8 * np.prod(SIZE) * SIZE**2 / 3, rel=5e-3)


@pytest.mark.parametrize("exponents", [[0.2, 0.2], [1.0, 1.0], [0.5, 1.6], [2.0, 2.0]])
@pytest.mark.parametrize("taper", [[0.0, 0.0], [0.6, -0.4], [-0.9, -0.9]])
def test_moments_are_those_of_a_fine_mesh(exponents, taper):
    shape = Superquadric(SIZE, np.array(exponents))
    found = superquadric_moments(shape, taper)
    coarse, fine = (
        by_tetrahedra(DeformedSuperquadric(shape, np.array(taper)).mesh(level)) for level in (5, 6)
    )
    # The facets' error falls with the square of their size, but at edges.
    content = fine[0] + (fine[0] - coarse[0]) / 3
    second = fine[1] + (fine[1] - coarse[1]) / 3
    assert found.volume == pytest.approx(content, rel=3e-5)
    assert np.allclose(found.second, second, rtol=5e-5, atol=5e-5 * np.abs(second).max())


def test_a_taper_adds_the_moment_that_its_polynomial_says():
    shape = Superquadric(SIZE, np.array([0.7, 1.2]))
    plain, tapered = superquadric_moments(shape), superquadric_moments(shape, [0.5, -0.6])
    assert plain.volume == pytest.approx(superquadric_volume(SIZE, [0.7, 1.2]), rel=1e-14)
    gain = 0.5 * -0.6 * plain.second[2, 2] / SIZE[2] ** 2
    assert tapered.volume == pytest.approx(plain.volume + gain, rel=1e-14)
    rise = (0.5 - 0.6) * plain.second[2, 2] / SIZE[2]
    assert tapered.centroid == pytest.approx([0.0, 0.0, rise / tapered.volume], rel=1e-13)


def test_a_bend_keeps_the_volume():
    shape = Superquadric(SIZE, np.array([0.7, 1.2]))
    taper = np.array([0.3, -0.2])
    straight, bent = (
        by_tetrahedra(DeformedSuperquadric(shape, taper, Bend(k, 0.4)).mesh(6))[0]
        for k in (0.0, 1.5)
    )
    assert bent == pytest.approx(straight, rel=2e-4)


def test_what_has_no_volume_is_refused():
    with pytest.raises(ValueError, match=r"size must be positive, got \[0.0, 1.0, 1.0\] m"):
        superquadric_volume([0.0, 1.0, 1.0], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"exponents must be positive, got \[0.0, 1.0\]"):
        superquadric_volume(SIZE, [0.0, 1.0])
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        superquadric_moments(Superquadric(SIZE, np.ones(2)), [1.0, 0.0])


COUNT = 20_000
STRAIGHT = np.zeros(2)


def unlikely(sampled, base, taper, bend):
    """Probability of a scatter as wide, if the samples are even over the facets of a fine mesh.

    Facets are put together by the 80 facets of a coarse one that they stand over.
    """
    mesh = DeformedSuperquadric(base, taper, bend).mesh(6)
    areas = areas_and_normals(mesh.vertices[mesh.faces])[0].reshape(80, -1).sum(axis=1)
    tapering = Taper(float(taper[0]), float(taper[1]), float(base.size[2]))
    before = tapering.inverse(bend.inverse(sampled)) / base.size
    directions, faces = icosphere(4)
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    cells = nearest_points(nearest_search(directions[faces]), before).faces // (len(faces) // 80)
    expected = COUNT * areas / areas.sum()
    counts = np.bincount(cells, minlength=80)
    return float(chi2.sf(((counts - expected) ** 2 / expected).sum(), 79))


@pytest.mark.parametrize("exponent", [0.1, 1.0, 2.0])
@pytest.mark.parametrize(
    ("taper", "curvature"), [((0.0, 0.0), 0.0), ((0.7, -0.5), 0.0), ((0.4, 0.2), 1.8)]
)
def test_samples_are_even_over_the_surface(exponent, taper, curvature):
    base, bend = Superquadric(SIZE, np.full(2, exponent)), Bend(curvature, 0.7)
    surface = sampled_surface(base, np.array(taper), bend)
    sampled = area_samples(surface, COUNT, np.random.default_rng(0))
    solid = DeformedSuperquadric(base, np.array(taper), bend)
    assert np.abs(solid.gauge(sampled) - 1.0).max() < 1e-12
    assert unlikely(sampled, base, np.array(taper), bend) > 1e-3


def test_even_in_the_parameters_is_not_even_and_the_test_sees_it():
    base = Superquadric(SIZE, np.full(2, 0.1))
    rng = np.random.default_rng(0)
    eta = np.arcsin(rng.uniform(-1, 1, COUNT))
    omega = rng.uniform(-math.pi, math.pi, COUNT)
    radii = np.column_stack([np.cos(eta) * np.cos(omega), np.cos(eta) * np.sin(omega), np.sin(eta)])
    by_rays = SIZE * radii / base.gauge(SIZE * radii)[:, None]
    assert unlikely(by_rays, base, STRAIGHT, Bend(0.0)) < 1e-9


def test_the_area_is_that_of_known_solids():
    ball = sampled_surface(Superquadric(np.full(3, 0.5), np.ones(2)))
    assert ball.area == pytest.approx(math.pi, rel=1e-5)
    octahedron = sampled_surface(Superquadric(np.full(3, 0.5), np.full(2, 2.0)))
    assert octahedron.area == pytest.approx(math.sqrt(3), rel=5e-3)
    box = sampled_surface(Superquadric(np.full(3, 0.5), np.full(2, 0.02)))
    assert box.area == pytest.approx(6.0, rel=0.03)


def test_samples_depend_on_the_generator_alone():
    surface = sampled_surface(Superquadric(SIZE, np.ones(2)))
    first, again, other = (
        area_samples(surface, 50, np.random.default_rng(seed)) for seed in (3, 3, 4)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert area_samples(surface, 0, np.random.default_rng(3)).shape == (0, 3)


def test_a_solid_that_its_bend_folds_is_refused():
    with pytest.raises(ValueError, match="all that is bent must be nearer"):
        sampled_surface(Superquadric(SIZE, np.ones(2)), STRAIGHT, Bend(5.0, 0.0))
    with pytest.raises(ValueError, match="taper must lie between -1 and 1"):
        sampled_surface(Superquadric(SIZE, np.ones(2)), np.array([1.0, 0.0]))
