from __future__ import annotations

import numpy as np
import pytest

from palpate.core.explore.grasp.misfit import corrected
from palpate.core.shapes.superquadric import Superquadric

SPHEROID = Superquadric(np.array([0.03, 0.03, 0.045]), np.ones(2))
MESH = SPHEROID.mesh(4)
NOISE = 1e-4


def test_contacts_on_the_solid_change_nothing() -> None:
    found = corrected(MESH, MESH.vertices[::40], np.zeros(len(MESH.vertices[::40])), 0.0, NOISE)

    assert np.array_equal(found.vertices, MESH.vertices)
    assert np.isfinite(found.tilts).all()


def test_a_solid_goes_through_its_contacts() -> None:
    points = MESH.vertices[::25]
    grown = 1.05 * points
    found = corrected(MESH, grown, np.linalg.norm(grown - points, axis=1), 1e-3, NOISE)

    assert np.linalg.norm(found.vertices[::25] - grown, axis=1).max() < 1e-3
    assert (
        found.body.volume > 1.1 * corrected(MESH, points, 0 * points[:, 0], 0.0, NOISE).body.volume
    )


def test_what_was_not_touched_is_uncertain() -> None:
    upper = MESH.vertices[MESH.vertices[:, 2] > 0.0][::10]
    found = corrected(MESH, upper, np.zeros(len(upper)), 1e-3, NOISE)

    low, high = MESH.vertices[:, 2].argmin(), MESH.vertices[:, 2].argmax()
    assert found.deviation[low] > 10.0 * found.deviation[high]
    assert found.deviation[low] == pytest.approx(5e-3, rel=0.05)


def test_axes_of_like_extents_are_uncertain_and_others_are_not() -> None:
    points = MESH.vertices[::20]
    found = corrected(MESH, points, np.zeros(len(points)), 1e-4, NOISE)
    turns = np.sqrt(np.diagonal(found.tilts))

    assert turns[2] > 1.0  # about the long axis: nothing holds it
    assert turns[:2].max() < np.radians(1.0)


def test_more_contacts_make_it_more_certain() -> None:
    few, many = (
        corrected(MESH, MESH.vertices[::n], np.zeros(len(MESH.vertices[::n])), 1e-3, NOISE)
        for n in (80, 20)
    )

    assert many.shift < few.shift
    assert many.tilts[0, 0] < few.tilts[0, 0]


def test_contacts_that_would_turn_the_solid_inside_out_leave_it_as_it_is() -> None:
    points = MESH.vertices[::10]
    found = corrected(MESH, points, np.full(len(points), -0.1), 0.1, NOISE)

    assert np.array_equal(found.vertices, MESH.vertices)
    assert found.body.sound
