from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Conic, Flat, Profile, Superellipse
from palpate.core.rebuild.surface.closed import (
    Patch,
    Surface,
    close_surface,
    closed_surface,
    curvatures_of,
    measure_surface,
    sampled_patch,
)
from palpate.core.shapes.superquadrics import Superquadric, regular_points
from palpate.core.touch.forms import principal_curvatures
from tests.core.touch.parametric import shape_operator

Make = Callable[..., Any]
SIZE = np.array([0.05, 0.04, 0.03])
LATITUDE = 1.0
RIM = SIZE[2] * np.sin(LATITUDE)


def end(profile: Profile, gap: float, *, upper: bool = True, shift: float = 0.0) -> End:
    sign = 1.0 if upper else -1.0
    height = sign * (RIM + gap)
    return End("flat", sign * RIM, height, 0.0, profile, np.array([shift, 0.0]), True)


@pytest.fixture
def whole(ellipsoid_side: Make) -> Surface:
    return close_surface(ellipsoid_side(SIZE))


@pytest.fixture
def capped(ellipsoid_side: Make) -> Callable[..., Surface]:
    def make(above: Profile, gap: float = 0.01, shift: float = 0.0) -> Surface:
        side = ellipsoid_side(SIZE, -LATITUDE, LATITUDE)
        return close_surface(side, end(Flat(0.0), 0.0, upper=False), end(above, gap, shift=shift))

    return make


def places(count: int = 400) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(1)
    return rng.uniform(0.001, 0.999, count), rng.uniform(-1.0, 2.0, count)


def test_points_lie_on_the_surface_and_normals_across_it(whole):
    v, turns = places()
    points, normals = whole.at(v, turns), whole.normals(v, turns)
    np.testing.assert_allclose(np.linalg.norm(points / SIZE, axis=1), 1.0, atol=1e-14)
    across = points / SIZE**2
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(normals, across, atol=1e-9)


def test_curvatures_are_those_of_an_ellipsoid(whole):
    v, turns = places()
    x = whole.at(v, turns)
    found = whole.curvatures(v, turns)
    support = 1.0 / np.linalg.norm(x / SIZE**2, axis=1)
    gauss = support**4 / np.prod(SIZE) ** 2
    mean = support**3 * (np.sum(SIZE**2) - np.sum(x**2, axis=1)) / (2.0 * np.prod(SIZE) ** 2)
    np.testing.assert_allclose(found.k1 * found.k2, gauss, rtol=1e-9)
    np.testing.assert_allclose(0.5 * (found.k1 + found.k2), mean, rtol=1e-9)


def test_at_a_pole_normals_and_curvatures_are_the_limit(whole):
    poles = np.array([0.0, 1.0])
    found = whole.curvatures(poles, np.zeros(2))
    np.testing.assert_allclose(whole.normals(poles, [0.1, 0.7]), [[0, 0, -1], [0, 0, 1]], atol=1e-4)
    np.testing.assert_allclose(found.k1, SIZE[2] / SIZE[1] ** 2, rtol=1e-6)
    np.testing.assert_allclose(found.k2, SIZE[2] / SIZE[0] ** 2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(found.directions[:, 1]), 1.0, atol=1e-3)


def test_many_points_have_the_curvatures_that_each_of_them_has():
    rng = np.random.default_rng(3)
    derivatives = rng.normal(size=(5, 20, 3))
    found = curvatures_of(*derivatives)
    for row in range(20):
        by_v, by_t, *seconds = derivatives[:, row]
        outward = np.cross(by_t, by_v)
        one = principal_curvatures(shape_operator(by_v, by_t, *seconds, outward))
        assert found.k1[row] == pytest.approx(one.k1)
        assert found.k2[row] == pytest.approx(one.k2)
        assert abs(found.directions[row] @ one.direction) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "profile", [Flat(0.0), Flat(-0.3), Flat(-1.0), Conic(-0.4), Superellipse(0.3, 8.0, 5.0)]
)
@pytest.mark.parametrize("by", [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_derivatives_are_those_of_central_differences(capped, profile, by):
    surface, step = capped(profile, shift=0.004), 1e-6
    v, turns = places(200)
    away = np.abs(v[:, None] - surface.seams).min(axis=1) > 2 * step
    v, turns = v[away], turns[away]
    axis = 0 if by[0] else 1
    lower = (by[0] - 1, by[1]) if axis == 0 else (by[0], by[1] - 1)
    moved = (step, 0.0) if axis == 0 else (0.0, step)
    ahead = surface.at(v + moved[0], turns + moved[1], lower)
    behind = surface.at(v - moved[0], turns - moved[1], lower)
    told = surface.at(v, turns, by)
    seen = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(told, seen, atol=1e-6 * max(np.abs(told).max(), surface.size))


@pytest.mark.parametrize("profile", [Flat(-0.3), Conic(0.0), Superellipse(0.3, 20.0, 30.0)])
def test_pieces_meet_at_their_seams(capped, profile):
    surface = capped(profile, shift=0.004)
    turns = np.arange(50) / 50
    for piece, seam in enumerate(surface.seams[1:-1]):
        at = np.full(50, seam)
        below, above = (surface.piece_at(one, at, turns) for one in (piece, piece + 1))
        np.testing.assert_allclose(below, above, atol=1e-15)


def test_an_end_reaches_the_height_and_the_middle_that_it_tells(capped):
    surface = capped(Superellipse(0.3, 8.0, 5.0), gap=0.01, shift=0.004)
    np.testing.assert_allclose(surface.at(1.0, 0.3), [0.004, 0.0, RIM + 0.01], atol=1e-15)
    np.testing.assert_allclose(surface.at(0.0, 0.3), [0.0, 0.0, -RIM], atol=1e-15)


def test_a_flat_end_has_an_edge_and_normals_on_both_sides_of_it(capped):
    surface = capped(Flat(0.0))
    edge = surface.seams[-2]
    wall, disc = surface.normals(np.array([edge - 1e-9, edge]), np.zeros(2))
    np.testing.assert_allclose(wall, [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(disc, [0, 0, 1], atol=1e-9)


def test_a_surface_has_no_unit(ellipsoid_side):
    small, large = (close_surface(ellipsoid_side(SIZE * unit)) for unit in (1e-6, 1e6))
    v, turns = places(50)
    np.testing.assert_allclose(small.normals(v, turns), large.normals(v, turns), atol=1e-12)


def test_places_are_broadcast(whole):
    assert whole.at(np.zeros((4, 1)), np.zeros(5)).shape == (4, 5, 3)
    assert whole.at(0.5, 0.25).shape == (3,)
    assert whole.normals(np.zeros((4, 1)), np.zeros(5)).shape == (4, 5, 3)


@pytest.mark.parametrize(
    ("v", "turns", "by", "words"),
    [
        (1.1, 0.0, (0, 0), "v must lie between 0 and 1, got 1.1 to 1.1"),
        (np.nan, 0.0, (0, 0), "v must be finite"),
        (0.5, np.inf, (0, 0), "turns must be finite"),
        (0.5, 0.0, (2, 1), "by must be 0 or more and together at most 2"),
        (0.5, 0.0, (-1, 0), "by must be 0 or more"),
    ],
)
def test_places_that_are_none_are_refused(whole, v, turns, by, words):
    with pytest.raises(ValueError, match=words):
        whole.at(v, turns, by)


def test_normals_beyond_the_poles_are_refused(whole):
    with pytest.raises(ValueError, match=r"v must lie between 0 and 1, got -0\.5"):
        whole.normals(-0.5, 0.0)


def test_a_side_that_does_not_close_needs_an_end(ellipsoid_side):
    side = ellipsoid_side(SIZE, -0.5 * np.pi, LATITUDE)
    with pytest.raises(ValueError, match="top must be given, for the side does not close there"):
        close_surface(side)
    with pytest.raises(ValueError, match="bottom must be given"):
        close_surface(ellipsoid_side(SIZE, -LATITUDE, 0.5 * np.pi))


def test_a_clockwise_side_is_refused(ellipsoid_side):
    with pytest.raises(ValueError, match="side must run counter-clockwise"):
        close_surface(ellipsoid_side(SIZE * [1.0, -1.0, 1.0]))


VOLUME = 4.0 / 3.0 * np.pi * float(np.prod(SIZE))


class Moved(Patch):
    """A side somewhere else."""

    def __init__(self, side: Any, shift: Floats):
        self.side, self.shift = side, shift

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), or derivatives of them."""
        return np.asarray(self.side.at(v, turns, by) + self.shift * (by == (0, 0)))


def test_an_ellipsoid_has_its_volume_and_its_inertia(ellipsoid_side):
    found = measure_surface(close_surface(ellipsoid_side(SIZE)))
    a, b, c = SIZE**2
    assert found.moments.volume == pytest.approx(VOLUME, rel=1e-12)
    np.testing.assert_allclose(found.moments.centroid, 0.0, atol=1e-15)
    np.testing.assert_allclose(
        found.inertia(), VOLUME / 5.0 * np.diag([b + c, a + c, a + b]), atol=1e-12 * VOLUME
    )
    assert found.error < 1e-9


def test_the_area_of_a_sphere_is_exact(ellipsoid_side):
    found = measure_surface(close_surface(ellipsoid_side([0.03, 0.03, 0.03])))
    assert found.area == pytest.approx(4 * np.pi * 0.03**2, rel=1e-12)


def test_far_from_the_origin_nothing_is_lost(ellipsoid_side):
    shift = np.array([100.0, -200.0, 300.0])
    here = measure_surface(close_surface(ellipsoid_side(SIZE)))
    there = measure_surface(close_surface(Moved(ellipsoid_side(SIZE), shift)))
    assert there.moments.volume == pytest.approx(here.moments.volume, rel=1e-9)
    np.testing.assert_allclose(there.moments.centroid, shift, rtol=1e-12)
    expected = here.moments.second + VOLUME * np.outer(shift, shift)
    np.testing.assert_allclose(there.moments.second, expected, rtol=1e-9)


def test_ends_count_and_the_pieces_between_edges_are_exact(ellipsoid_side):
    low, high = -1.0, 0.5
    heights = 0.03 * np.sin([low, high])
    none = np.zeros(2)
    surface = close_surface(
        ellipsoid_side([0.03, 0.03, 0.03], low, high),
        End("fan", heights[0], heights[0], 0.0, Flat(0.0), none, True),
        End("flat", heights[1], heights[1] + 0.02, 0.0, Flat(-0.5), none, True),
    )
    found = measure_surface(surface)

    def ball(z: float) -> float:
        return float(np.pi * (0.03**2 * z - z**3 / 3.0))

    rim = 0.03 * np.cos(high)
    frustum = np.pi * 0.02 / 3.0 * rim**2 * (1.0 + 0.5 + 0.25)
    volume = ball(heights[1]) - ball(heights[0]) + frustum
    shear = np.hypot(0.02, 0.5 * rim)
    sphere = 2 * np.pi * 0.03 * (heights[1] - heights[0])
    discs = np.pi * ((0.03 * np.cos(low)) ** 2 + (0.5 * rim) ** 2)
    assert found.moments.volume == pytest.approx(volume, rel=1e-10)
    assert found.area == pytest.approx(sphere + np.pi * 1.5 * rim * shear + discs, rel=1e-10)


def ball(v: Floats, turns: Floats) -> Floats:
    """Of radius 2, its places crowded at one side of the turn and at the lower pole."""
    eta = np.pi * (v**2 - 0.5)[:, None]
    omega = 2 * np.pi * (turns + 0.1 * np.sin(2 * np.pi * turns))[None]
    points = np.cos(eta) * np.cos(omega), np.cos(eta) * np.sin(omega), np.sin(eta + 0 * omega)
    return 2.0 * np.stack(points, axis=-1)


def test_its_points_and_derivatives_are_those_of_the_surface():
    patch = sampled_patch(ball, rows=81, turns=96)
    v, turns = np.linspace(0.05, 0.95, 40), np.linspace(0.0, 2.0, 40)
    points, up = patch.at(v, turns), patch.at(v, turns, (1, 0))
    step = 1e-5
    differences = (patch.at(v + step, turns) - patch.at(v - step, turns)) / (2 * step)
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.full(40, 2.0), abs=1e-5)
    assert up == pytest.approx(differences, abs=1e-5)
    assert np.abs(np.einsum("ni,ni->n", up, points)).max() < 1e-3


def test_its_places_lie_evenly_whatever_the_parameters():
    patch = sampled_patch(ball)
    ring = patch.at(np.full(64, 0.5), np.arange(64) / 64)
    steps = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    assert steps.max() < 1.4 * steps.min()


def test_it_tells_how_far_it_leaves_what_was_sampled():
    def box(v: Floats, turns: Floats) -> Floats:
        eta, omega = np.meshgrid(np.pi * (v - 0.5), 2 * np.pi * turns, indexing="ij")
        shape = Superquadric(np.ones(3), np.array([0.1, 0.1]))
        return regular_points(shape, eta.ravel(), omega.ravel()).points.reshape(*eta.shape, 3)

    coarse, fine = sampled_patch(box, 41, 64), sampled_patch(box)
    assert 0.0 < fine.miss < 2e-4 < coarse.miss


def test_a_sampled_ball_is_a_closed_surface():
    surface = closed_surface((sampled_patch(ball),))
    assert np.ptp(surface.at(np.zeros(5), np.linspace(0, 1, 5)), axis=0).max() < 1e-12
