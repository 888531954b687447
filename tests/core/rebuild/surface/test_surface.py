"""Closed exact surfaces: points, curvatures, integrals, meshes, nearest points."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry import nearest_points, nearest_search, self_intersection, solidity
from palpate.core.rebuild import reconstruct, surface as surfaces
from palpate.core.rebuild.ends import End, close_ends
from palpate.core.rebuild.surface import Surface, close_surface, mesh_surface
from tests.core.rebuild import objects
from tests.core.rebuild.objects import Traced, assert_derivatives, at_height, circle, slow

SIZE = np.array([0.05, 0.04, 0.03])
RIM = float(SIZE[2] * np.sin(1.0))
NOWHERE = np.zeros(3)
VOLUME = 4.0 / 3.0 * np.pi * float(np.prod(SIZE))


class EllipsoidSide(surfaces.Patch):
    """The side of an ellipsoid between two latitudes, in closed form."""

    def __init__(
        self, size: Floats, low: float = -np.pi / 2, high: float = np.pi / 2, at: Floats = NOWHERE
    ):
        self.size, self.low, self.high, self.place = np.asarray(size, float), low, high, at

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        step = self.high - self.low
        latitude = self.low + step * np.asarray(v) + 0.5 * np.pi * by[0]
        angle = 2 * np.pi * np.asarray(turns) + 0.5 * np.pi * by[1]
        across = np.cos(latitude) * step ** by[0] * (2 * np.pi) ** by[1]
        up = np.sin(latitude) * step ** by[0] * (by[1] == 0)
        unit = np.column_stack([across * np.cos(angle), across * np.sin(angle), up])
        return np.asarray(self.size * unit + self.place * (by == (0, 0)))


def end_of(radius: Callable[[Floats], Floats], gap: float, shift: float = 0.0) -> End:
    heights = np.linspace(0.0, 0.9, 27)
    end = close_ends(heights, radius(heights)[:, None, None] * circle(80), top=1.0)[1]
    return replace(end, rim=RIM, height=RIM + gap, middle=np.array([shift, 0.0]), apart=True)


PROFILES: dict[str, Callable[[Floats], Floats]] = {
    "wall": lambda z: 1.0 + 0.0 * z,
    "frustum": lambda z: 4.0 - 3.0 * z,
    "cone": lambda z: 1.0001 - z,
    "conic": lambda z: np.sqrt(1.0 - z**2),
    "shoulder": lambda z: (1.0 - z**10) ** 0.1,
}
FAN = replace(end_of(PROFILES["wall"], 0.0), rim=-RIM, height=-RIM)


@cache
def whole() -> Surface:
    return close_surface(EllipsoidSide(SIZE))


@cache
def capped(name: str = "shoulder", shift: float = 0.0) -> Surface:
    side = EllipsoidSide(SIZE, -1.0, 1.0)
    return close_surface(side, FAN, end_of(PROFILES[name], 0.01, shift))


@cache
def searched(surface: Callable[[], Surface]) -> surfaces.SurfaceSearch:
    return surfaces.search_surface(surface(), 3e-4)


def places(count: int = 400, seed: int = 1) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.001, 0.999, count), rng.uniform(-1.0, 2.0, count)


def units(vectors: Floats) -> Floats:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_points_normals_and_curvatures_are_those_of_ellipsoid():
    v, turns = places()
    x, normals = whole().at(v, turns), whole().normals(v, turns)
    np.testing.assert_allclose(np.linalg.norm(x / SIZE, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(normals, units(x / SIZE**2), atol=1e-9)
    curvatures = whole().curvatures(v, turns)
    support = 1.0 / np.linalg.norm(x / SIZE**2, axis=1)
    gauss = support**4 / np.prod(SIZE) ** 2
    mean = support**3 * (np.sum(SIZE**2) - np.sum(x**2, axis=1)) / (2.0 * np.prod(SIZE) ** 2)
    np.testing.assert_allclose(curvatures.k1 * curvatures.k2, gauss, rtol=1e-9)
    np.testing.assert_allclose(0.5 * (curvatures.k1 + curvatures.k2), mean, rtol=1e-9)
    limit, ends = whole().curvatures([0.0, 1.0], [0.0, 0.0]), whole().normals([0, 1], [0.1, 0.7])
    np.testing.assert_allclose(ends, [[0, 0, -1], [0, 0, 1]], atol=1e-4)
    np.testing.assert_allclose(limit.k1, SIZE[2] / SIZE[1] ** 2, rtol=1e-6)
    np.testing.assert_allclose(limit.k2, SIZE[2] / SIZE[0] ** 2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(limit.directions[:, 1]), 1.0, atol=1e-3)
    assert whole().at(np.zeros((4, 1)), np.zeros(5)).shape == (4, 5, 3)
    assert whole().normals(0.5, 0.25).shape == (3,)


@pytest.mark.parametrize("name", PROFILES)
def test_derivatives_are_those_of_differences_and_pieces_meet(name):
    surface = capped(name, 0.004)
    v, turns = places(100)
    away = np.abs(v[:, None] - surface.seams).min(axis=1) > 1e-4
    v, turns = v[away], turns[away]
    assert_derivatives(surface.at, v, turns, 1e-4, 1.0, surface.on_grid)
    turns = np.arange(50) / 50
    for piece, seam in enumerate(surface.seams[1:-1]):
        at = np.full(50, seam)
        below, above = (surface.piece_at(one, at, turns) for one in (piece, piece + 1))
        np.testing.assert_allclose(below, above, atol=1e-15)
    np.testing.assert_allclose(surface.at(1.0, 0.3), [0.004, 0.0, RIM + 0.01], atol=1e-15)
    disc = surface.normals(np.full(9, 0.5 * surface.seams[1]), np.arange(9) / 9)
    np.testing.assert_allclose(disc, np.tile([0, 0, -1], (9, 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: whole().at(1.1, 0.0), "v must lie between 0 and 1, got 1.1 to 1.1"),
        (lambda: whole().at(np.nan, 0.0), "v must be finite"),
        (lambda: whole().at(0.5, np.inf), "turns must be finite"),
        (lambda: whole().at(0.5, 0.0, (2, 1)), "by must be 0 or more and together at most 2"),
        (lambda: whole().normals(-0.5, 0.0), r"v must lie between 0 and 1, got -0\.5"),
        (lambda: close_surface(EllipsoidSide(SIZE, high=1.0)), "top must be given, for the side"),
        (lambda: close_surface(EllipsoidSide(SIZE, low=-1.0)), "bottom must be given"),
        (lambda: close_surface(EllipsoidSide(SIZE * [1, -1, 1])), "must run counter-clockwise"),
        (lambda: mesh_surface(whole(), 0.0), "tolerance must be positive and finite"),
        (lambda: mesh_surface(whole(), np.inf), "tolerance must be positive and finite"),
        (lambda: mesh_surface(whole(), 1e-9), "tolerance must need at most 2000000 vertices, got"),
        (lambda: searched(whole).nearest([[np.nan, 0.0, 0.0]]), "points must be finite"),
    ],
)
def test_surfaces_reject_invalid_arguments(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


def test_integrals_are_exact_anywhere_and_in_any_unit():
    measures = surfaces.measure_surface(whole())
    a, b, c = SIZE**2
    inertia = VOLUME / 5.0 * np.diag([b + c, a + c, a + b])
    assert measures.moments.volume == pytest.approx(VOLUME, rel=1e-12)
    np.testing.assert_allclose(measures.moments.centroid, 0.0, atol=1e-15)
    np.testing.assert_allclose(measures.inertia(), inertia, atol=1e-12 * VOLUME)
    assert measures.error < 1e-9
    sphere = surfaces.measure_surface(close_surface(EllipsoidSide(np.full(3, 0.03))))
    assert sphere.area == pytest.approx(4 * np.pi * 0.03**2, rel=1e-12)
    shift = np.array([100.0, -200.0, 300.0])
    there = surfaces.measure_surface(close_surface(EllipsoidSide(SIZE, at=shift)))
    assert there.moments.volume == pytest.approx(VOLUME, rel=1e-9)
    np.testing.assert_allclose(there.moments.centroid, shift, rtol=1e-12)
    expected = measures.moments.second + VOLUME * np.outer(shift, shift)
    np.testing.assert_allclose(there.moments.second, expected, rtol=1e-9)


def test_integrals_of_pieces_between_edges_are_exact():
    size, low, high = np.full(3, 0.03), -1.0, 0.5
    bottom, rim = 0.03 * np.sin([low, high])
    frustum = end_of(lambda z: 4.0 - 3.0 * z, 0.02)  # Its profile narrows from 1.3 to 1
    share = float(frustum.profile.radius_ratios(np.ones(1))[0])
    top = replace(frustum, rim=rim, height=rim + 0.02)
    below = replace(FAN, rim=bottom, height=bottom)
    measures = surfaces.measure_surface(close_surface(EllipsoidSide(size, low, high), below, top))
    wide, narrow = 0.03 * np.cos(high), 0.03 * np.cos(high) * share
    ball = np.pi * (0.03**2 * (rim - bottom) - (rim**3 - bottom**3) / 3.0)
    volume = ball + np.pi * 0.02 / 3.0 * (wide**2 + wide * narrow + narrow**2)
    discs = np.pi * ((0.03 * np.cos(low)) ** 2 + narrow**2)
    wall = np.pi * (wide + narrow) * np.hypot(0.02, wide - narrow)
    area = 2 * np.pi * 0.03 * (rim - bottom) + wall + discs
    assert share == pytest.approx(1.0 / 1.3)
    assert measures.moments.volume == pytest.approx(volume, rel=1e-10)
    assert measures.area == pytest.approx(area, rel=1e-10)


def off_mesh(points: Floats, mesh: surfaces.SurfaceMesh) -> Floats:
    """Distances of points from a mesh."""
    return nearest_points(nearest_search(mesh.vertices[mesh.faces]), points).distances


def farthest(surface: Surface, mesh: surfaces.SurfaceMesh) -> float:
    return float(off_mesh(surface.at(*np.random.default_rng(0).random((2, 4000))), mesh).max())


def test_mesh_meets_tolerance_with_few_vertices():
    counts = []
    for tolerance in (1e-3, 8e-5, 2e-5):
        mesh = mesh_surface(whole(), tolerance)
        assert 0.3 * tolerance < farthest(whole(), mesh) <= tolerance
        np.testing.assert_allclose(whole().at(mesh.v, mesh.turns), mesh.vertices, atol=1e-15)
        counts.append(len(mesh.vertices))
    assert counts[2] / counts[1] == pytest.approx(4.0, rel=0.25)
    corners = mesh.vertices[mesh.faces]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    # If all rings had as many points, edges at the poles would be a hundred times shorter.
    assert (edges.max(axis=1) / edges.min(axis=1)).max() < 15.0


def twisted(v: Floats, turns: Floats) -> Floats:
    """A prism of rounded square section that turns on its way up."""
    section = objects.superellipse(turns, 0.25, 0.03, 0.03)
    return np.stack([at_height(objects.turned(section, 1.5 * x), RIM * (2.0 * x - 1.0)) for x in v])


@pytest.mark.parametrize("name", [*PROFILES, slow("twisted")])
def test_meshes_with_ends_are_closed_and_within_tolerance(name):
    if name == "twisted":
        end = end_of(PROFILES["wall"], 0.01)
        surface = close_surface(surfaces.sampled_patch(twisted), FAN, end)
    else:
        surface = capped(name)
    mesh = mesh_surface(surface)
    body = solidity(mesh.vertices, mesh.faces)
    assert body[:3] == (True, 1, 0) and body.volume > 0.0
    assert farthest(surface, mesh) <= surfaces.MeshSettings().default_tolerance * surface.size
    assert self_intersection(mesh.vertices, mesh.faces).count == 0


def test_nearest_points_of_ellipsoid_are_exact_in_any_unit():
    points = 0.04 * np.random.default_rng(0).normal(size=(1000, 3))
    foot = searched(whole).nearest(points)
    assert foot.converged.all()
    np.testing.assert_allclose(np.linalg.norm(foot.points / SIZE, axis=1), 1.0, atol=1e-14)
    across = np.cross(points - foot.points, units(foot.points / SIZE**2))
    np.testing.assert_allclose(across, 0.0, atol=1e-7)
    inside = np.linalg.norm(points / SIZE, axis=1) < 1.0
    np.testing.assert_array_equal(foot.distances < 0.0, inside)
    np.testing.assert_array_equal(searched(whole).inside(points), inside)
    np.testing.assert_allclose(whole().at(foot.v, foot.turns), foot.points, atol=1e-15)
    on_axis = searched(whole).nearest([[0.0, 0.0, 0.2], [0.0, 0.0, -0.2]])
    np.testing.assert_allclose(on_axis.distances, 0.17, rtol=1e-12)
    np.testing.assert_allclose(on_axis.points[:, 2], [0.03, -0.03])
    sphere = surfaces.search_surface(close_surface(EllipsoidSide(np.full(3, 0.03))), 3e-4)
    assert sphere.nearest([[0.0, 0.0, 0.0]]).distances == pytest.approx(-0.03)
    for unit in (1e-6, 1e6):
        scaled = surfaces.search_surface(close_surface(EllipsoidSide(SIZE * unit)), 3e-4 * unit)
        there, normals = scaled.nearest(unit * points[:200]), scaled.surface.normals(*places(50))
        np.testing.assert_allclose(there.distances / unit, foot.distances[:200], rtol=1e-9)
        np.testing.assert_allclose(normals, whole().normals(*places(50)), atol=1e-12)


def test_nearest_points_across_edges_are_no_farther_than_fine_mesh():
    points = 0.03 * np.random.default_rng(1).normal(size=(2000, 3))
    foot = searched(capped).nearest(points)
    worse = np.abs(foot.distances) - off_mesh(points, mesh_surface(capped(), 1e-5))
    assert foot.converged.all()
    assert worse.min() >= -1e-5 and worse.max() <= 3e-4
    # Only near the middle, where places far apart are almost equally near.
    assert np.mean(worse > 1e-5) < 0.005


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-4, -1e-9, -1e-6, -1e-4])
def test_distances_next_to_surface_keep_digits_and_sign(off):
    v, turns = np.random.default_rng(2).random((2, 500))
    apart = np.abs(v[:, None] - capped().seams).min(axis=1) > 0.02  # normals meet inside an edge
    v, turns = v[apart], turns[apart]
    points = capped().at(v, turns) + off * capped().normals(v, turns)
    np.testing.assert_allclose(searched(capped).nearest(points).distances, off, rtol=1e-6)
    turns = np.arange(40) / 40
    edge = capped().at(np.full(40, capped().seams[1]), turns)
    beyond = edge + 10.0 * off * units(edge)
    assert (searched(capped).inside(beyond) == (off < 0.0)).all()


def test_sampled_patch_interpolates_function():
    def ball(v: Floats, turns: Floats) -> Floats:
        eta, uneven = np.pi * (v**2 - 0.5), turns + 0.1 * np.sin(2 * np.pi * turns)
        return np.stack([2 * at_height(objects.polar(uneven, np.cos(x)), np.sin(x)) for x in eta])

    patch, step = surfaces.sampled_patch(ball, rows=81, turns=96), 1e-5
    v, turns = np.linspace(0.05, 0.95, 40), np.linspace(0.0, 2.0, 40)
    up = patch.at(v, turns, (1, 0))
    slopes = (patch.at(v + step, turns) - patch.at(v - step, turns)) / (2 * step)
    assert np.linalg.norm(patch.at(v, turns), axis=1) == pytest.approx(np.full(40, 2.0), abs=1e-5)
    assert up == pytest.approx(slopes, abs=1e-5)
    ring = surfaces.sampled_patch(ball).at(np.full(64, 0.5), np.arange(64) / 64)
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    assert steps.max() < 1.4 * steps.min()  # even, whatever the parameters
    surface = surfaces.closed_surface((patch,))
    assert np.ptp(surface.at(np.zeros(5), np.linspace(0, 1, 5)), axis=0).max() < 1e-12
    volume = surfaces.measure_surface(surface).moments.volume
    assert volume == pytest.approx(32 / 3 * np.pi, rel=1e-5)
    coarse, fine = (surfaces.sampled_patch(twisted, n, n) for n in (41, 161))
    assert 0.0 < fine.miss < 0.2 * coarse.miss < 1e-4


@pytest.mark.parametrize("kind", ["skin", "lattice", slow("thesis"), slow("weighted")])
def test_grid_evaluation_equals_evaluation_at_places(kind):
    rings = Traced("kidney").contours(np.linspace(-0.8, 0.8, 7), 40)
    solid = reconstruct(rings, method="lattice" if kind == "weighted" else kind)
    if kind == "weighted":
        solid = solid.refined(rings[4] * [1.01, 1.0, 1.0], weights=True)
    surface, v, turns = solid.surface, np.linspace(0.01, 0.99, 23), np.linspace(-0.5, 1.0, 23)
    assert_derivatives(surface.at, v, turns, 1e-2, 0.7, surface.on_grid)  # except at knots
    mesh = surfaces.grid_mesh(surface)
    body = solidity(mesh.vertices, mesh.faces)
    assert body.watertight and body.genus == 0 and body.volume > 0.0
    on = surface.at(mesh.v[1:-1], mesh.turns[1:-1])
    np.testing.assert_allclose(mesh.vertices[1:-1], on, atol=1e-12 * surface.size)
