from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.geometry.nearest import nearest_points, nearest_search
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Flat, Superellipse
from palpate.core.rebuild.surface.closed import Surface, close_surface
from palpate.core.rebuild.surface.meshing import mesh_surface
from palpate.core.rebuild.surface.nearest import search_surface

Make = Callable[..., Any]
SIZE = np.array([0.05, 0.04, 0.03])
RIM = float(SIZE[2] * np.sin(1.0))
COARSE = 3e-4


@pytest.fixture
def capped(ellipsoid_side: Make) -> Surface:
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


def test_with_edges_no_fine_mesh_finds_a_nearer_point_but_by_what_the_coarse_one_could_miss(capped):
    points = np.random.default_rng(1).normal(size=(3000, 3)) * 0.03
    foot = search_surface(capped, COARSE).nearest(points)
    tolerance = 1e-5
    fine = mesh_surface(capped, tolerance)
    near = nearest_points(nearest_search(fine.vertices[fine.faces]), points)
    assert foot.converged.all()
    worse = np.abs(foot.distances) - near.distances
    assert worse.min() >= -tolerance
    assert worse.max() <= COARSE
    # Only about the middle, where places far apart are almost equally near.
    assert np.mean(worse > tolerance) < 0.005


@pytest.mark.parametrize("off", [1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_next_to_the_surface_the_distance_keeps_its_digits_and_its_sign(capped, off, sign):
    rng = np.random.default_rng(2)
    v, turns = rng.random(1000), rng.random(1000)
    apart = np.abs(v[:, None] - capped.seams).min(axis=1) > 0.02  # an edge's inside is wider
    v, turns = v[apart], turns[apart]
    points = capped.at(v, turns) + sign * off * capped.normals(v, turns)
    foot = search_surface(capped, COARSE).nearest(points)
    np.testing.assert_allclose(foot.distances, sign * off, rtol=1e-6, atol=1e-16)


def test_outside_an_edge_points_are_outside(capped):
    turns = np.arange(40) / 40
    edge = capped.at(np.full(40, capped.seams[1]), turns)
    away = edge / np.linalg.norm(edge, axis=1, keepdims=True)
    search = search_surface(capped, COARSE)
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
