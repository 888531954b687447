from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry import nearest_points, nearest_search, self_intersection
from palpate.core.geometry.meshes import solidity
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Conic, Flat, Profile, Superellipse
from palpate.core.rebuild.surface.closed import Patch, Surface, close_surface
from palpate.core.rebuild.surface.meshing import (
    DEFAULT_TOLERANCE,
    SurfaceMesh,
    _places,
    mesh_surface,
    search_surface,
)

SIZE = np.array([0.05, 0.04, 0.03])
RIM = float(SIZE[2] * np.sin(1.0))
PROFILES = [Flat(0.0), Flat(-1.0), Conic(-0.9), Superellipse(0.4, 20.0, 30.0)]


class TwistedBox(Patch):
    """A prism of rounded square section that turns on its way up."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), or derivatives of them, by complex steps where that is exact."""
        if by == (0, 0):
            return np.asarray(self._points(v + 0j, turns + 0j).real)
        along, around = (1e-5, 0.0) if by[0] else (0.0, 1e-5)
        lower = (by[0] - 1, by[1]) if by[0] else (by[0], by[1] - 1)
        ahead = self.at(v + along, turns + around, lower)
        behind = self.at(v - along, turns - around, lower)
        return np.asarray((ahead - behind) / 2e-5)

    @staticmethod
    def _points(v: Any, turns: Any) -> Any:
        angle = 2 * np.pi * turns
        radius = (np.cos(angle) ** 8 + np.sin(angle) ** 8) ** -0.125
        turned = angle + 1.5 * v
        return 0.03 * np.stack(
            [radius * np.cos(turned), radius * np.sin(turned), 3 * v + 0 * angle], axis=-1
        )


def capped(side: Any, top: Profile, rim: tuple[float, float], gap: float) -> Surface:
    none = np.zeros(2)
    bottom = End("fan", rim[0], rim[0], 0.0, Flat(0.0), none, True)
    return close_surface(side, bottom, End("flat", rim[1], rim[1] + gap, 0.0, top, none, True))


def farthest(surface: Surface, mesh: SurfaceMesh) -> float:
    """Largest distance of points of the surface from the mesh."""
    rng = np.random.default_rng(0)
    points = surface.at(rng.random(8000), rng.random(8000))
    return float(nearest_points(nearest_search(mesh.vertices[mesh.faces]), points).distances.max())


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 2e-5])
def test_the_mesh_stays_within_the_tolerance_and_does_not_waste_it(ellipsoid_side, tolerance):
    surface = close_surface(ellipsoid_side(SIZE))
    off = farthest(surface, mesh_surface(surface, tolerance))
    assert 0.3 * tolerance < off <= tolerance


@pytest.mark.parametrize("profile", PROFILES)
def test_meshes_with_ends_are_closed_and_within_the_tolerance(ellipsoid_side, profile):
    surface = capped(ellipsoid_side(SIZE, -1.0, 1.0), profile, (-RIM, RIM), 0.01)
    mesh = mesh_surface(surface)
    found = solidity(mesh.vertices, mesh.faces)
    assert found[:3] == (True, 1, 0)
    assert found.volume > 0.0
    assert farthest(surface, mesh) <= DEFAULT_TOLERANCE * surface.size
    assert self_intersection(mesh.vertices, mesh.faces).count == 0


def test_a_twisted_side_with_corners_is_within_the_tolerance():
    surface = capped(TwistedBox(), Flat(0.0), (0.0, 0.09), 0.01)
    mesh = mesh_surface(surface, 1e-4)
    assert solidity(mesh.vertices, mesh.faces)[:3] == (True, 1, 0)
    assert farthest(surface, mesh) <= 1e-4


def test_a_quarter_of_the_tolerance_takes_four_times_the_vertices(ellipsoid_side):
    surface = close_surface(ellipsoid_side(SIZE))
    coarse, fine = (len(mesh_surface(surface, one).vertices) for one in (8e-5, 2e-5))
    assert fine / coarse == pytest.approx(4.0, rel=0.25)


def test_vertices_know_their_places(ellipsoid_side):
    surface = close_surface(ellipsoid_side(SIZE))
    mesh = mesh_surface(surface, 1e-4)
    np.testing.assert_allclose(surface.at(mesh.v, mesh.turns), mesh.vertices, atol=1e-15)


def test_triangles_at_the_poles_are_no_slivers(ellipsoid_side):
    mesh = mesh_surface(close_surface(ellipsoid_side(SIZE)), 2e-5)
    corners = mesh.vertices[mesh.faces]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    # In rings of equal numbers the edges at the poles would be some hundred times shorter.
    assert (edges.max(axis=1) / edges.min(axis=1)).max() < 15.0


@pytest.mark.parametrize("tolerance", [0.0, -1e-4, np.nan, np.inf])
def test_a_tolerance_that_is_none_is_refused(ellipsoid_side, tolerance):
    with pytest.raises(ValueError, match="tolerance must be positive and finite"):
        mesh_surface(close_surface(ellipsoid_side(SIZE)), tolerance)


def test_a_tolerance_that_needs_too_many_vertices_is_refused(ellipsoid_side):
    with pytest.raises(ValueError, match="tolerance must let 2000000 vertices suffice, got 1e-09"):
        mesh_surface(close_surface(ellipsoid_side(SIZE)), 1e-9)


Make = Callable[..., Any]
COARSE = 3e-4


@pytest.fixture
def capped_solid(ellipsoid_side: Make) -> Surface:
    """With a disc below and a square shoulder above."""
    none = np.zeros(2)
    return close_surface(
        ellipsoid_side(SIZE, -1.0, 1.0),
        End("fan", -RIM, -RIM, 0.0, Flat(0.0), none, True),
        End("superellipse", RIM, 1.3 * RIM, 0.0, Superellipse(0.4, 12.0, 20.0), none, True),
    )


def test_distances_from_an_ellipsoid_are_exact_though_the_mesh_is_coarse(ellipsoid_side):
    search = search_surface(close_surface(ellipsoid_side(SIZE)), COARSE)
    points = np.random.default_rng(0).normal(size=(3000, 3)) * 0.04
    foot = search.nearest(points)
    assert foot.converged.all()
    np.testing.assert_allclose(np.linalg.norm(foot.points / SIZE, axis=1), 1.0, atol=1e-14)
    across = foot.points / SIZE**2
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(np.cross(points - foot.points, across), 0.0, atol=1e-7)
    inside = np.linalg.norm(points / SIZE, axis=1) < 1.0
    np.testing.assert_array_equal(foot.distances < 0.0, inside)
    np.testing.assert_array_equal(search.inside(points), inside)
    np.testing.assert_allclose(search.surface.at(foot.v, foot.turns), foot.points, atol=1e-15)


def test_with_edges_no_fine_mesh_finds_a_nearer_point_than_the_coarse_one_could(
    capped_solid,
):
    points = np.random.default_rng(1).normal(size=(3000, 3)) * 0.03
    foot = search_surface(capped_solid, COARSE).nearest(points)
    tolerance = 1e-5
    fine = mesh_surface(capped_solid, tolerance)
    near = nearest_points(nearest_search(fine.vertices[fine.faces]), points)
    assert foot.converged.all()
    worse = np.abs(foot.distances) - near.distances
    assert worse.min() >= -tolerance
    assert worse.max() <= COARSE
    # Only about the middle, where places far apart are almost equally near.
    assert np.mean(worse > tolerance) < 0.005


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_next_to_the_surface_the_distance_keeps_its_digits_and_its_sign(capped_solid, off, sign):
    rng = np.random.default_rng(2)
    v, turns = rng.random(1000), rng.random(1000)
    apart = np.abs(v[:, None] - capped_solid.seams).min(axis=1) > 0.02  # an edge's inside is wider
    v, turns = v[apart], turns[apart]
    points = capped_solid.at(v, turns) + sign * off * capped_solid.normals(v, turns)
    foot = search_surface(capped_solid, COARSE).nearest(points)
    np.testing.assert_allclose(foot.distances, sign * off, rtol=1e-6, atol=1e-16)


def test_outside_an_edge_points_are_outside(capped_solid):
    turns = np.arange(40) / 40
    edge = capped_solid.at(np.full(40, capped_solid.seams[1]), turns)
    away = edge / np.linalg.norm(edge, axis=1, keepdims=True)
    search = search_surface(capped_solid, COARSE)
    for off in (1e-8, 1e-5, 1e-2):
        assert not search.inside(edge + off * away).any()
        assert search.inside(edge - min(off, 1e-3) * away).all()


def test_the_middle_of_a_sphere_has_a_nearest_point_although_every_one_is(ellipsoid_side):
    search = search_surface(close_surface(ellipsoid_side([0.03, 0.03, 0.03])), COARSE)
    foot = search.nearest([[0.0, 0.0, 0.0]])
    assert foot.distances == pytest.approx(-0.03)


def test_a_point_on_the_axis_finds_the_pole(ellipsoid_side):
    search = search_surface(close_surface(ellipsoid_side(SIZE)), COARSE)
    foot = search.nearest([[0.0, 0.0, 0.2], [0.0, 0.0, -0.2]])
    np.testing.assert_allclose(foot.distances, 0.17, rtol=1e-12)
    np.testing.assert_allclose(foot.points[:, 2], [0.03, -0.03])


def test_the_turn_of_a_triangle_at_a_pole_is_between_its_other_corners(ellipsoid_side):
    search = search_surface(close_surface(ellipsoid_side(SIZE)), 1e-3)
    faces, last = search.mesh.faces, len(search.mesh.vertices) - 1
    at_pole = ((faces == 0) | (faces == last)).any(axis=1)
    centres = search.mesh.vertices[faces[at_pole]].mean(axis=1)
    _, turns = _places(search.mesh, nearest_points(search.search, centres))
    off = turns - np.arctan2(*(centres[:, :2] / SIZE[:2]).T[::-1]) / (2 * np.pi)
    assert np.abs(off - np.round(off)).max() < 1e-9


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_nearest_points_do_not_depend_on_the_unit(ellipsoid_side, unit):
    points = np.random.default_rng(3).normal(size=(200, 3)) * 0.04
    plain, scaled = (
        search_surface(close_surface(ellipsoid_side(SIZE * one)), COARSE * one).nearest(
            points * one
        )
        for one in (1.0, unit)
    )
    np.testing.assert_allclose(scaled.distances / unit, plain.distances, rtol=1e-9, atol=1e-12)
    assert scaled.converged.all()


def test_a_point_that_is_not_finite_is_refused(ellipsoid_side):
    search = search_surface(close_surface(ellipsoid_side(SIZE)), 1e-3)
    with pytest.raises(ValueError, match="points must be finite"):
        search.nearest([[np.nan, 0.0, 0.0]])
