from __future__ import annotations

import numpy as np
import pytest

from palpate.core.explore.grasp.coarse_model import correct_solid, mass_properties
from palpate.core.poses import pose_of
from palpate.core.rebuild.reconstruction import fit_coarse
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.superquadrics import Superquadric

NOISE = 1e-4


def test_a_box_is_recovered_as_a_box(box, grasped) -> None:
    points, _ = grasped(PosedShape(box, pose_of(np.array([0.0, 0.0, 0.04]), np.eye(3))), 60)
    found = fit_coarse(points, NOISE)
    assert sorted(found.size) == pytest.approx([0.02, 0.03, 0.04], abs=2e-4)
    assert len(found.names) == 11 and found.exponents.max() < 0.2


def test_a_bend_is_taken_where_it_pays(grasped) -> None:
    base = Superquadric(np.array([0.02, 0.018, 0.045]), np.array([0.5, 0.7]))
    bent = DeformedSuperquadric(base, np.array([0.3, 0.3]), Bend(6.0))
    points, _ = grasped(PosedShape(bent, pose_of(np.array([0.0, 0.0, 0.045]), np.eye(3))), 60)
    found = fit_coarse(points, NOISE)
    assert abs(found.bend.curvature) == pytest.approx(6.0, rel=0.05)
    assert found.rms < NOISE


def test_contacts_that_are_too_few_give_an_ellipsoid_and_say_so() -> None:
    found = fit_coarse(np.random.default_rng(0).normal(size=(8, 3)), NOISE)
    assert not found.fitted
    assert found.warnings == ("too few points",)


@pytest.mark.parametrize(
    ("points", "noise", "words"),
    [
        (np.zeros((3, 2)), NOISE, r"points must have shape \(any, 3\), got \(3, 2\)"),
        (np.full((20, 3), np.nan), NOISE, "points must be finite"),
        (np.zeros((20, 3)), 0.0, "noise must be positive and finite, got 0.0 in the unit"),
    ],
)
def test_what_are_no_contacts_is_refused(points, noise, words) -> None:
    with pytest.raises(ValueError, match=words):
        fit_coarse(points, noise)


SPHEROID = Superquadric(np.array([0.03, 0.03, 0.045]), np.ones(2))
MESH = SPHEROID.mesh(4)


def test_contacts_on_the_solid_change_nothing() -> None:
    found = correct_solid(MESH, MESH.vertices[::40], np.zeros(len(MESH.vertices[::40])), 0.0, NOISE)
    assert np.array_equal(found.vertices, MESH.vertices)
    assert np.isfinite(found.tilts).all()


def test_a_solid_goes_through_its_contacts() -> None:
    points = MESH.vertices[::25]
    grown = 1.05 * points
    found = correct_solid(MESH, grown, np.linalg.norm(grown - points, axis=1), 1e-3, NOISE)
    assert np.linalg.norm(found.vertices[::25] - grown, axis=1).max() < 1e-3
    assert (
        found.mass.volume
        > 1.1 * correct_solid(MESH, points, 0 * points[:, 0], 0.0, NOISE).mass.volume
    )


def test_one_contact_speaks_for_its_neighbourhood_as_a_normal_distribution_does() -> None:
    reach = 0.2 * np.ptp(MESH.vertices, axis=0).max()
    found = correct_solid(MESH, MESH.vertices[:1], np.array([1e-4]), 1e-3, 1e-9)
    moved = np.linalg.norm(found.vertices - MESH.vertices, axis=1)
    away = np.linalg.norm(MESH.vertices - MESH.vertices[0], axis=1)
    assert moved == pytest.approx(1e-4 * np.exp(-0.5 * (away / reach) ** 2), abs=1e-9)


def test_what_was_not_touched_is_uncertain() -> None:
    upper = MESH.vertices[MESH.vertices[:, 2] > 0.0][::10]
    found = correct_solid(MESH, upper, np.zeros(len(upper)), 1e-3, NOISE)
    low, high = MESH.vertices[:, 2].argmin(), MESH.vertices[:, 2].argmax()
    assert found.deviation[low] > 10.0 * found.deviation[high]
    assert found.deviation[low] == pytest.approx(5e-3, rel=0.05)


def test_axes_of_like_extents_are_uncertain_and_others_are_not() -> None:
    points = MESH.vertices[::20]
    found = correct_solid(MESH, points, np.zeros(len(points)), 1e-4, NOISE)
    turns = np.sqrt(np.diagonal(found.tilts))
    assert turns[2] > 1.0  # about the long axis: nothing holds it
    assert turns[:2].max() < np.radians(1.0)


def test_more_contacts_make_it_more_certain() -> None:
    few, many = (
        correct_solid(MESH, MESH.vertices[::n], np.zeros(len(MESH.vertices[::n])), 1e-3, NOISE)
        for n in (80, 20)
    )
    assert many.shift < few.shift
    assert many.tilts[0, 0] < few.tilts[0, 0]


def test_contacts_that_would_turn_the_solid_inside_out_leave_it_as_it_is() -> None:
    points = MESH.vertices[::10]
    found = correct_solid(MESH, points, np.full(len(points), -0.1), 0.1, NOISE)
    assert np.array_equal(found.vertices, MESH.vertices)
    assert found.mass.sound


def test_an_ellipsoid_has_a_fifth_of_its_squared_semi_axes(rotations) -> None:
    vertices, faces = Superquadric(np.array([0.03, 0.02, 0.05]), np.ones(2)).mesh(5)
    turn = rotations(1)[0]
    body = mass_properties(vertices @ turn.T + [1.0, 2.0, 3.0], faces)
    assert body.volume == pytest.approx(4 / 3 * np.pi * 0.03 * 0.02 * 0.05, rel=3e-3)
    assert body.centroid == pytest.approx([1.0, 2.0, 3.0], abs=1e-9)
    assert body.spread == pytest.approx(np.square([0.02, 0.03, 0.05]) / 5.0, rel=3e-3)
    assert np.abs(body.axes.T @ turn[:, [1, 0, 2]]) == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(body.axes) == pytest.approx(1.0)


def test_a_tetrahedron_is_exact() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    body = mass_properties(vertices, faces)
    assert (body.volume, *body.centroid) == pytest.approx((1 / 6, 0.25, 0.25, 0.25))
    assert body.spread.sum() == pytest.approx(3 * (1 / 10 - 1 / 16))


def test_a_surface_that_is_inside_out_is_not_sound() -> None:
    vertices, faces = Superquadric(np.full(3, 0.03), np.ones(2)).mesh(3)
    assert mass_properties(vertices, faces).sound
    assert not mass_properties(vertices, faces[:, ::-1]).sound
