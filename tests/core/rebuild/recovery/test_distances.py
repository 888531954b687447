from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.distances import (
    Triple,
    Warps,
    distances_alone,
    normal_distances,
    turned_back,
    unbend,
    untaper,
)
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend, Taper
from palpate.core.shapes.superquadrics import Superquadric

KINDS = [Warps(taper, bend) for taper in (False, True) for bend in (False, True)]
SOLIDS, POINTS = 8, 40


def drawn(warps: Warps, seed: int = 0) -> tuple[Floats, Floats, Floats]:
    """Parameters, points and frames."""
    rng = np.random.default_rng(seed)
    parameters = np.zeros((SOLIDS, warps.total))
    parameters[:, :3] = np.log(rng.uniform(0.3, 1.0, (SOLIDS, 3)))
    parameters[:, 3:5] = rng.uniform(0.1, 1.9, (SOLIDS, 2))
    parameters[:, 5:11] = rng.uniform(-0.5, 0.5, (SOLIDS, 6))
    parameters[:, warps.bend_columns] = 0.0
    if warps.taper:
        parameters[:, warps.taper_columns] = rng.uniform(-0.8, 0.8, (SOLIDS, 2))
    if warps.bend:
        parameters[:, warps.bend_columns] = rng.uniform(-0.6, 0.6, (SOLIDS, 2))
    frames = np.linalg.qr(rng.normal(size=(SOLIDS, 3, 3)))[0]
    return parameters, rng.normal(size=(POINTS, 3)), frames


@pytest.mark.parametrize("warps", KINDS)
@pytest.mark.parametrize("bend", [0.6, 1e-9, 0.0])
def test_the_jacobian_is_that_of_central_differences(warps, bend):
    parameters, points, frames = drawn(warps)
    if warps.bend:
        parameters[:, warps.bend_columns] *= bend / 0.6
    distances, jacobian = normal_distances(parameters, points, frames, warps)
    assert np.array_equal(distances, distances_alone(parameters, points, frames, warps))
    for column in range(warps.total):
        step = 1e-6 * np.eye(warps.total)[column]
        ahead, back = (
            distances_alone(parameters + way * step, points, frames, warps) for way in (1, -1)
        )
        wanted = (ahead - back) / 2e-6
        error = np.abs(jacobian[:, :, column] - wanted) / (1.0 + np.abs(wanted))
        # But for the few points next to a crease, where derivatives have no bound.
        assert np.quantile(error, 0.98) < 2e-8
        assert np.median(error) < 1e-9


def test_distances_from_a_ball_a_box_and_an_octahedron_are_exact_or_those_of_their_faces():
    frames, rigid = np.eye(3)[None], Warps(False, False)
    points = np.random.default_rng(1).normal(size=(200, 3))
    size = np.log([0.5, 0.5, 0.5])
    for exponents, wanted in (
        ([1.0, 1.0], np.linalg.norm(points, axis=1) - 0.5),
        ([2.0, 2.0], (np.abs(points).sum(axis=1) - 0.5) / np.sqrt(3.0)),
    ):
        parameters = np.concatenate([size, exponents, np.zeros(6)])[None]
        found = distances_alone(parameters, points, frames, rigid)[0]
        assert np.allclose(found, wanted, rtol=0, atol=1e-14)


def test_the_distance_from_a_thin_disc_is_measured_across_it_not_along_the_radius():
    parameters = np.concatenate([np.log([1.0, 1.0, 0.05]), [1.0, 1.0], np.zeros(6)])[None]
    above = np.array([[0.5, 0.0, 0.05 * np.sqrt(0.75) + 1e-4]])
    found = distances_alone(parameters, above, np.eye(3)[None], Warps(False, False))[0, 0]
    assert found == pytest.approx(1e-4, rel=0.01)
    shape = Superquadric(np.array([1.0, 1.0, 0.05]), np.ones(2))
    radial = np.linalg.norm(above) * (1 - 1 / shape.gauge(above)[0])
    assert radial > 5 * found


def test_points_of_a_warped_solid_have_no_distance_from_it():
    warps = Warps(True, True)
    size, exponents = np.array([0.3, 0.2, 0.6]), np.array([0.4, 1.3])
    bend = np.array([0.8, -0.5])
    solid = DeformedSuperquadric(
        Superquadric(size, exponents),
        np.array([0.5, -0.3]),
        Bend(float(np.hypot(*bend)), float(np.arctan2(bend[1], bend[0]))),
    )
    parameters = np.concatenate([np.log(size), exponents, np.zeros(6), [0.5, -0.3], bend])[None]
    found = distances_alone(parameters, solid.mesh(3).vertices, np.eye(3)[None], warps)
    assert np.abs(found).max() < 1e-14


@pytest.mark.parametrize("warps", KINDS)
def test_distances_and_derivatives_are_finite_on_axes_creases_and_at_the_centre(warps):
    parameters, _, _ = drawn(warps, 3)
    parameters[:, 5:11] = 0.0
    parameters[:4, 3:5] = [[2.0, 2.0], [0.02, 0.02], [0.02, 2.0], [2.0, 0.02]]
    places = [*np.eye(3), *-np.eye(3), [0, 0, 0], [0, 1, 1], [1, 0, 1], [1e-200, 1, 0], [9, 9, 9]]
    frames = np.broadcast_to(np.eye(3), (SOLIDS, 3, 3))
    distances, jacobian = normal_distances(parameters, np.array(places), frames, warps)
    assert np.isfinite(distances).all()
    assert np.isfinite(jacobian).all()


STRAIGHTENING_POINTS = np.random.default_rng(0).uniform(-0.6, 0.6, (300, 3))


def triple(rows: int) -> Triple:
    x, y, z = (
        np.broadcast_to(STRAIGHTENING_POINTS[:, i], (rows, len(STRAIGHTENING_POINTS)))
        for i in range(3)
    )
    return x, y, z


def test_unbending_is_that_of_the_bend_however_small():
    bends = np.array(
        [[0.0, 0.0], [1e-200, 0.0], [1e-16, 1e-16], [1e-9, -1e-9], [0.6, 0.5], [-1, 0]]
    )
    at = unbend(triple(len(bends)), bends)
    found = np.stack(turned_back(at, (at.inwards, at.across, at.along)), axis=-1)
    for mine, (kx, ky) in zip(found, bends, strict=True):
        wanted = Bend(float(np.hypot(kx, ky)), float(np.arctan2(ky, kx))).inverse(
            STRAIGHTENING_POINTS
        )
        assert np.allclose(mine, wanted, rtol=0, atol=4e-15)


def test_places_at_the_centre_of_curvature_are_finite():
    centre = (np.array([[0.5]]), np.array([[0.0]]), np.array([[0.0]]))
    found = unbend(centre, np.array([[2.0, 0.0]]))
    straight = turned_back(found, (found.inwards, found.across, found.along))
    assert np.isfinite(straight).all()
    assert found.stretch.min() > 0


@pytest.mark.parametrize("taper", [[0.0, 0.0], [0.7, -0.5], [-0.95, 0.95]])
def test_untapering_is_that_of_the_taper_between_the_ends(taper):
    size = np.array([[0.3, 0.2, 0.6]])
    found = np.stack(untaper(triple(1), size, np.array([taper])).place, axis=-1)[0]
    wanted = Taper(taper[0], taper[1], 0.6).inverse(STRAIGHTENING_POINTS) / size
    assert np.allclose(found, wanted, rtol=1e-14)


def test_beyond_the_ends_no_taper_within_bounds_collapses():
    far = (np.ones((2, 1)), np.ones((2, 1)), np.array([[-50.0], [50.0]]))
    widths = untaper(far, np.ones((2, 3)), np.array([[0.95, -0.95], [0.95, -0.95]])).width
    assert min(width.min() for width in widths) > 0
