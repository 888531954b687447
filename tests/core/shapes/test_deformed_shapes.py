from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.protocol import INSIDE, MISS
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.shapes.triangle_meshes import DeformedShape, polish
from palpate.core.splines.lattices import LatticeLayer, layered_lattice

FACETS = 10e-6  # How far the facets of a 0.1 m object stand off at most, m
DOWN = np.array([0.0, 0.0, -1.0])
VASE = [
    LatticeLayer(0.75),
    LatticeLayer(1.15),
    LatticeLayer(1.3, 0.2),
    LatticeLayer(0.75, 0.3, (0.002, -0.003)),
    LatticeLayer(0.7, 0.4),
    LatticeLayer(1.0, 0.4),
]
NOTHING = [LatticeLayer()] * 4


def superquadric(e1, e2):
    return Superquadric(np.array([0.032, 0.028, 0.05]), np.array([e1, e2]))


def bent(e1, e2):
    return DeformedSuperquadric(superquadric(e1, e2), np.array([0.3, 0.1]), Bend(5.0, 0.6))


def deformed(base, layers, exact):
    return DeformedShape(base, layered_lattice(base.enclosure(), layers), exact)


def heights_before(lattice, base, near, points):
    """The base's function where points were before the lattice, by Newton from a near vertex."""
    found: Floats = near[cKDTree(lattice.deform(near)).query(points)[1]]
    for _ in range(8):
        left = points - lattice.deform(found)
        found = found + np.linalg.solve(lattice.jacobian(found), left[:, :, None])[:, :, 0]
        found = np.clip(found, *base.enclosure())
    there = np.abs(lattice.deform(found) - points).max(axis=1) < 1e-14
    # Nothing of the lattice's box goes to the others, thus nothing of the solid.
    return np.where(there, base.inside_out(found, np.zeros_like(found))[0], 1.0)


def rays_at(shape, seed):
    """Rays through places within the solid, from one side."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    surface = shape.mesh(3).vertices
    targets = surface[rng.integers(len(surface), size=64)] * rng.uniform(0.3, 1.0, (64, 1))
    return targets - 0.15 * direction, direction


@pytest.mark.parametrize(
    "base",
    [
        pytest.param(superquadric(0.3, 0.8), id="vase"),
        pytest.param(superquadric(1.0, 1.0), id="ball", marks=pytest.mark.slow),
        pytest.param(superquadric(0.05, 0.05), id="box"),
        pytest.param(superquadric(1.8, 1.3), id="octahedron", marks=pytest.mark.slow),
        pytest.param(bent(0.3, 0.8), id="bent", marks=pytest.mark.slow),
        pytest.param(bent(0.1, 0.1), id="bent box"),
    ],
)
def test_exact_casts_agree_with_the_inverse_of_the_deformation(base):
    lattice, near = layered_lattice(base.enclosure(), VASE), base.mesh(3).vertices
    shape = DeformedShape(base, lattice, exact=True)
    compared = 0
    for seed in range(3):
        origins, direction = rays_at(shape, seed)
        found = shape.cast_exactly(origins, direction, 0.4)
        assert found.kept == 0
        met = np.isfinite(found.ranges)
        origins, ranges = origins[met], found.ranges[met]
        # A ray that only grazes may leave the solid again: those are left out.
        low, high = ranges - 1e-6, ranges + 1e-6

        def outside(ways, origins=origins, d=direction):
            return heights_before(lattice, base, near, origins + ways[:, None] * d)

        for share in (0.5, 0.8, 0.95, 0.99):
            assert (outside(share * ranges) > 0).all()
        clear = (outside(low) > 0) & (outside(high) < 0)
        for _ in range(30):
            middle = 0.5 * (low + high)
            out = outside(middle) > 0
            low, high = np.where(out, middle, low), np.where(out, high, middle)
        assert np.abs(low - ranges)[clear].max() < 1e-11
        compared += int(clear.sum())
        assert clear.sum() > 0.9 * len(clear)
    assert compared > 150


def test_facets_are_near_the_exact_surface():
    base = superquadric(0.3, 0.8)
    facets, exact = deformed(base, VASE, False), deformed(base, VASE, True)
    for seed in range(5):
        rays = rays_at(exact, seed)
        first, second = facets.cast(*rays, 0.4), exact.cast(*rays, 0.4)
        met = np.isfinite(first)
        assert np.array_equal(met, np.isfinite(second))
        off = np.abs(first - second)[met]
        assert np.median(off) < FACETS
        assert 1e-8 < off.max() < 1e-3


@pytest.mark.parametrize("exact", [False, True])
def test_without_a_deformation_it_is_its_base(exact, ball):
    same = deformed(ball, NOTHING, exact)
    origins = np.random.default_rng(0).uniform(-0.02, 0.02, (50, 3)) + np.array([0.0, 0.0, 0.1])
    off = np.abs(same.cast(origins, DOWN, 1.0) - ball.cast(origins, DOWN, 1.0)).max()
    assert off < (1e-14 if exact else FACETS)
    assert np.allclose(same.bounds(), ball.bounds(), atol=FACETS)


@pytest.mark.parametrize("exact", [False, True])
def test_hit_miss_and_inside_are_told_apart(exact, ball):
    wide = deformed(ball, [LatticeLayer(1.5)] * 4, exact)
    origins = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.06], [0.046, 0.0, 0.06]])
    found = wide.cast(origins, DOWN, 1.0)
    assert found[0] == INSIDE
    height = 0.03 * math.sqrt(1 - (0.04 / 0.045) ** 2)
    assert found[1] == pytest.approx(0.06 - height, abs=1e-14 if exact else 3 * FACETS)
    assert found[2] == MISS
    assert wide.cast(origins[1:2], DOWN, 0.01)[0] == MISS
    assert wide.cast(origins[:1], DOWN, 1e-9)[0] == INSIDE


def test_a_ray_that_starts_between_facet_and_surface_starts_inside(ball):
    exact = deformed(ball, NOTHING, True)
    mesh = ball.mesh(6)
    middle = mesh.vertices[mesh.faces[1000]].mean(axis=0)
    depth = 0.03 - float(np.linalg.norm(middle))
    outwards = middle / np.linalg.norm(middle)
    origins = middle + np.array([[0.3], [0.9], [1.1]]) * depth * outwards
    found = exact.cast(origins, -outwards, 1.0)
    assert found[:2].tolist() == [INSIDE, INSIDE]
    assert found[2] == pytest.approx(0.1 * depth, abs=1e-12)


def test_a_ray_that_cannot_be_taken_to_the_surface_keeps_its_facet_and_is_counted(ball):
    class Shy(Superquadric):
        """A ball whose function has no root: there is nothing to converge to."""

        def inside_out(self, points, directions):
            value, slope = super().inside_out(points, directions)
            return np.sqrt(value**2 + 1e-4), value * slope / np.sqrt(value**2 + 1e-4)

    shy = deformed(Shy(ball.size, ball.exponents), NOTHING, True)
    origins = np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.1], [0.2, 0.0, 0.1]])
    found = shy.cast_exactly(origins, DOWN, 1.0)
    assert (found.met, found.kept) == (2, 2)
    facets = deformed(ball, NOTHING, False).cast(origins, DOWN, 1.0)
    assert np.array_equal(found.ranges, facets)
    assert deformed(ball, NOTHING, True).cast_exactly(origins, DOWN, 1.0)[1:] == (2, 0)


def test_the_mesh_is_closed_and_turned_outwards(is_closed, signed_volume):
    mesh = deformed(bent(0.3, 0.8), VASE, False).mesh(4)
    assert is_closed(mesh)
    assert signed_volume(mesh) > 0.0
    # Widening every layer alike widens the solid.
    base = superquadric(0.3, 0.8)
    wide = deformed(base, [LatticeLayer(1.2)] * 5, False).mesh(4)
    assert signed_volume(wide) == pytest.approx(1.44 * signed_volume(base.mesh(4)))


class Shear:
    """Moves x with the square of z."""

    def deform(self, points):
        x, y, z = points.T
        return np.column_stack([x + 3.0 * z * z, y, z])

    def deform_with_jacobian(self, points):
        slopes = np.tile(np.eye(3), (len(points), 1, 1))
        slopes[:, 0, 2] = 6.0 * points[:, 2]
        return self.deform(points), slopes


def test_rays_come_to_the_surface_from_above_and_from_below(ball):
    rng = np.random.default_rng(0)
    exact = rng.normal(size=(40, 3))
    exact[:, 2] = np.abs(exact[:, 2]) + 0.5
    exact *= 0.03 / np.linalg.norm(exact, axis=1, keepdims=True)
    near = exact * rng.uniform(0.99, 1.01, (40, 1))
    surface = Shear().deform(exact)
    wanted = rng.uniform(-1e-4, 1e-4, 40)
    ways, done = polish(ball, Shear(), near, surface - wanted[:, None] * DOWN, DOWN)
    assert done.all()
    assert np.allclose(ways, wanted, rtol=0, atol=1e-15)


def test_a_ray_that_has_nothing_to_meet_is_not_believed(ball):
    places = np.array([[0.0299, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.0, -0.03], [0.0, 0.0, 0.0]])
    starts = Shear().deform(places) + np.array([[0.01, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    ways, done = polish(ball, Shear(), places, starts, DOWN)
    # It passes by; it is there; it looks at the back; it starts too far away.
    assert done.tolist() == [False, True, False, False]
    assert ways[1] == 0.0
    assert np.isfinite(ways).all()
