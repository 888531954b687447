"""Tapers, bends and lattices: the maps, their inverses, and solids deformed by them."""

import math
from typing import Any

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import signed_volume, solidity
from palpate.core.shapes import INSIDE, MISS
from palpate.core.splines import LatticeLayer, layered_lattice
from tests.core.shapes.definitions import DOWN

POINTS = np.random.default_rng(0).uniform(-1, 1, (300, 3))
SIZE = np.array([0.03, 0.02, 0.05])
BALL = shapes.Superquadric(np.full(3, 0.03), np.ones(2))


def test_taper_widens_in_proportion_to_height_and_not_beyond_the_ends():
    heights = np.array([-3.0, -1.0, 0.0, 0.5, 1.0, 3.0])
    points = np.column_stack([np.full(6, 0.01), np.full(6, 0.02), heights])
    moved = shapes.Taper(0.4, -0.2, half_height=1.0)(points)
    assert np.allclose(moved[:, 0], 0.01 * np.array([0.6, 0.6, 1.0, 1.2, 1.4, 1.4]), rtol=1e-15)
    assert np.allclose(moved[:, 1], 0.02 * np.array([1.2, 1.2, 1.0, 0.9, 0.8, 0.8]), rtol=1e-15)
    assert np.array_equal(moved[:, 2], heights)
    assert np.array_equal(shapes.Taper(0.0, 0.0, 1.0)(POINTS), POINTS)
    for share in (0.4, -0.7, 0.999, 1 - 1e-12):
        taper = shapes.Taper(share, -share, 1.0)
        assert np.allclose(taper.inverse(taper(2 * POINTS)), 2 * POINTS, rtol=1e-15, atol=0)


def test_bend_makes_the_axis_an_arc_and_stretches_fibres_beside_it():
    heights = np.linspace(-2.0, 2.0, 10_001)
    arc = shapes.Bend(0.5)(np.column_stack([0 * heights, 0 * heights, heights]))
    assert np.linalg.norm(np.diff(arc, axis=0), axis=1).sum() == pytest.approx(4.0, abs=1e-7)
    assert np.allclose(np.linalg.norm(arc - [2.0, 0.0, 0.0], axis=1), 2.0, rtol=0, atol=1e-14)
    assert arc[-1] == pytest.approx([2 * (1 - math.cos(1)), 0.0, 2 * math.sin(1)], abs=1e-15)
    for azimuth in (0.0, 1.0, 2.5, -2.0):
        towards = np.array([math.cos(azimuth), math.sin(azimuth)])
        for curvature in (0.4, -0.4):
            moved = shapes.Bend(curvature, azimuth)(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
            wanted = np.outer([1, 1], towards) * (1 - math.cos(0.4)) / curvature
            assert np.allclose(moved[:, :2], wanted, rtol=0, atol=1e-15)
    # Fibres are stretched by their distance from the centre.
    bend, step = shapes.Bend(0.6, 0.4), 1e-6
    columns = [(bend(POINTS + step * e) - bend(POINTS - step * e)) / (2 * step) for e in np.eye(3)]
    wanted = 1.0 - 0.6 * (POINTS[:, :2] @ bend.towards)
    assert np.allclose(np.linalg.det(np.stack(columns, axis=2)), wanted, atol=1e-9)


@pytest.mark.parametrize(
    "curvature", [0.0, 1e-310, 1e-200, 1e-16, 1e-9, 1e-6, 1e-4, 1e-3, 0.1, 0.6, -0.6]
)
def test_bend_of_any_size_has_its_inverse_and_its_series(curvature):
    for azimuth in (0.0, 1.0, -2.5):
        bend = shapes.Bend(curvature, azimuth)
        assert np.allclose(bend.inverse(bend(POINTS)), POINTS, rtol=0, atol=2e-15)
    x, y, z = POINTS.T
    first_order = np.column_stack([x + curvature * z * z / 2, y, z - curvature * x * z])
    off = np.abs(shapes.Bend(curvature)(POINTS) - first_order).max()
    assert off <= curvature**2 + 4e-16


def deformed(pair: Any, taper: Any, bend: shapes.Bend) -> shapes.ImplicitShape:
    base = shapes.Superquadric(SIZE, np.array(pair))
    return shapes.DeformedSuperquadric(base, np.array(taper), bend)


def test_largest_curvature_leaves_the_inner_side_some_length():
    slim = shapes.Superquadric(np.array([0.001, 0.001, 0.1]), np.ones(2))
    assert shapes.largest_curvature(slim, np.zeros(2), 0.0) == pytest.approx(0.98 * math.pi / 0.1)
    wide = shapes.Superquadric(np.array([0.03, 0.01, 0.01]), np.array([1.0, 2.0]))
    # Of a rhombus, the reach towards an azimuth is that of its nearer corner.
    for azimuth, reach in ((0.0, 0.03), (math.pi / 2, 0.01), (math.pi / 4, 0.03 / math.sqrt(2))):
        assert shapes.largest_curvature(wide, np.zeros(2), azimuth) == pytest.approx(0.98 / reach)
    assert shapes.largest_curvature(wide, np.array([0.5, 0.0]), 0.0) == pytest.approx(0.98 / 0.045)
    ellipse = shapes.Superquadric(np.array([0.03, 0.01, 0.01]), np.ones(2))
    reach = math.hypot(0.03, 0.01) / math.sqrt(2)
    result = shapes.largest_curvature(ellipse, np.zeros(2), math.pi / 4)
    assert result == pytest.approx(0.98 / reach)


def test_bend_and_taper_of_next_to_nothing_leave_the_base():
    base, rng = shapes.Superquadric(SIZE, np.array([0.4, 0.7])), np.random.default_rng(0)
    origins, left = rng.uniform(-0.04, 0.04, (200, 3)) + [0.2, 0.0, 0.0], np.array([-1.0, 0.0, 0.0])
    wanted = base.cast(origins, left, 1.0)
    met = np.isfinite(wanted)
    assert met.sum() > 50
    for curvature in (0.0, 1e-300, -1e-300, 1e-201, 1e-150, 1e-16, -1e-16, 1e-12):
        solid = deformed((0.4, 0.7), (0.0, 0.0), shapes.Bend(curvature, 2.0))
        result = solid.cast(origins, left, 1.0)
        assert np.array_equal(np.isfinite(result), met)
        assert np.allclose(result[met], wanted[met], rtol=0, atol=1e-13)


@pytest.mark.parametrize("azimuth", [0.0, 0.7, math.pi / 2, 4.0])
def test_enclosure_is_near_the_bounds_and_bends_keep_the_volume(azimuth):
    volumes = []
    for curvature in (0.0, 10.0, -10.0, 24.0):
        solid = deformed((0.1, 0.1), (0.1, -0.2), shapes.Bend(curvature, azimuth))
        vertices, faces = solid.mesh(5)
        smallest, largest = vertices.min(axis=0), vertices.max(axis=0)
        low, high = solid.enclosure()
        assert (low <= smallest).all() and (high >= largest).all()
        assert (high - low <= 2.0 * (largest - smallest)).all()
        volumes.append(signed_volume(vertices[faces]))
    assert volumes == pytest.approx([volumes[0]] * 4, rel=1e-3)  # facets of level 5


FACETS = 10e-6  # how far the facets of a 0.1 m object stand off at most [m]


@pytest.mark.parametrize("exact", [pytest.param(False, marks=pytest.mark.slow), True])
def test_widened_ball_is_met_missed_and_begun_inside(exact):
    box, inside = BALL.enclosure(), 1e-14 if exact else 3 * FACETS
    wide = shapes.DeformedShape(BALL, layered_lattice(box, [LatticeLayer(1.5)] * 4), exact)
    origins = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.06], [0.046, 0.0, 0.06]])
    height = 0.03 * math.sqrt(1 - (0.04 / 0.045) ** 2)
    result = wide.cast(origins, DOWN, 1.0)
    assert (result[0], result[2]) == (INSIDE, MISS)
    assert result[1] == pytest.approx(0.06 - height, abs=inside)
    assert wide.cast(origins[1:2], DOWN, 0.01)[0] == MISS
    assert wide.cast(origins[:1], DOWN, 1e-9)[0] == INSIDE
    assert np.allclose(wide.bounds(), [[-0.045] * 2 + [-0.03], [0.045] * 2 + [0.03]], atol=FACETS)
    mesh, base = wide.mesh(4), BALL.mesh(4)
    body = solidity(*mesh)
    assert body.watertight and body.genus == 0
    assert body.volume == pytest.approx(2.25 * solidity(*base).volume)


SAME = layered_lattice(BALL.enclosure(), [LatticeLayer()] * 4)


UNDEFORMED = shapes.DeformedShape(BALL, SAME, exact=True)
MATRIX = np.array([[0.9, 0.2, -0.1], [-0.1, 1.1, 0.3], [0.2, -0.2, 0.8]])


class Warp:
    """Moves x with the square of z, then all by a matrix."""

    def deform(self, points: Floats) -> Floats:
        x, y, z = points.T
        return np.column_stack([x + 3.0 * z * z, y, z]) @ MATRIX.T

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        slopes = np.tile(np.eye(3), (len(points), 1, 1))
        slopes[:, 0, 2] = 6.0 * points[:, 2]
        return self.deform(points), MATRIX @ slopes


BASES = {
    "box": shapes.Superquadric(0.03 * np.ones(3), np.array([0.05, 0.05])),
    "bent": deformed((0.3, 0.8), (0.3, 0.1), shapes.Bend(5.0, 0.6)),
}


@pytest.mark.parametrize("name", ["bent", pytest.param("box", marks=pytest.mark.slow)])
def test_exact_casts_agree_with_a_formula_and_facets_nearly(name):
    y, z = np.random.default_rng(0).uniform(-0.022, 0.022, (2, 60))
    left, base = np.array([-1.0, 0.0, 0.0]), BASES[name]
    origins = np.column_stack([np.full(60, 0.1), y, z])
    # Along x the warp only shifts, and the matrix stretches.
    stretch = float(np.linalg.norm(MATRIX @ left))
    wanted = stretch * (base.cast(origins, left, 1.0) - 3.0 * z * z)
    met = np.isfinite(wanted)
    rays = origins @ MATRIX.T, MATRIX @ left / stretch
    result = shapes.DeformedShape(base, Warp(), exact=True).cast_exactly(*rays, 1.0)
    assert np.array_equal(np.isfinite(result.ranges), met) and met.sum() > 20
    assert (result.met, result.kept) == (met.sum(), 0)
    assert np.allclose(result.ranges[met], wanted[met], rtol=0, atol=1e-13)
    if name == "bent":
        off = np.abs(shapes.DeformedShape(base, Warp()).cast(*rays, 1.0)[met] - wanted[met])
        assert np.median(off) < FACETS and off.max() > 1e-9


def test_start_between_facet_and_exact_surface_is_inside():
    vertices, faces = BALL.mesh(6)
    middle = vertices[faces[1000]].mean(axis=0)
    depth, out = 0.03 - float(np.linalg.norm(middle)), middle / np.linalg.norm(middle)
    starts = middle + np.array([[0.3], [0.9], [1.1]]) * depth * out
    origins = np.random.default_rng(0).uniform(-0.02, 0.02, (50, 3)) + [0.0, 0.0, 0.1]
    off = UNDEFORMED.cast(origins, DOWN, 1.0) - BALL.cast(origins, DOWN, 1.0)
    assert np.abs(off).max() < 1e-14
    result = UNDEFORMED.cast(starts, -out, 1.0)
    assert result[:2].tolist() == [INSIDE, INSIDE]
    assert result[2] == pytest.approx(0.1 * depth, abs=1e-12)


def test_rays_that_do_not_converge_keep_their_facets_and_are_counted():
    class Shy(shapes.Superquadric):
        """A ball whose function has no root: there is nothing to converge to."""

        def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
            value, slope = super().inside_out(points, directions)
            return np.sqrt(value**2 + 1e-4), value * slope / np.sqrt(value**2 + 1e-4)

    shy = shapes.DeformedShape(Shy(BALL.size, BALL.exponents), SAME, True)
    origins = np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.1], [0.2, 0.0, 0.1]])
    result, exact = shy.cast_exactly(origins, DOWN, 1.0), UNDEFORMED
    assert (result.met, result.kept) == (2, 2)
    assert np.allclose(result.ranges[:2], BALL.cast(origins[:2], DOWN, 1.0), rtol=0, atol=FACETS)
    assert exact.cast_exactly(origins, DOWN, 1.0)[1:] == (2, 0)
    nothing = exact.cast_exactly(origins[2:], DOWN, 1.0)
    assert nothing[1:] == (0, 0) and nothing.ranges[0] == MISS
