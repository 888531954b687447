"""Grasping by containment: superquadrics, tapered and bent, from a hand's contacts."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.geometry import compare_surfaces, prepare_surface
from palpate.core.procedures.containment import containment

from .conftest import NOISES, NOISY, VASE, block, cup, drive, posed, turned

EGG = shapes.DeformedSuperquadric(
    shapes.Superquadric(np.array([0.03, 0.025, 0.045]), np.array([0.4, 0.8])),
    np.array([0.2, 0.1]),
    shapes.Bend(5.0, 0.0),
)


@pytest.mark.parametrize("noise", NOISES)
def test_a_tapered_and_bent_superquadric_is_recovered(noise):
    found = drive(containment, posed(EGG, 0.046), NOISES[noise]).findings
    assert found.status == "done", found.reason
    assert 60 <= found.figures["contacts"] <= 100
    close, alike = (1e-5, 1e-3) if noise == "exact" else (0.5e-3, 0.06)
    assert np.sort(found.shape.size) == pytest.approx([0.025, 0.03, 0.045], abs=close)
    assert found.shape.exponents == pytest.approx([0.4, 0.8], abs=alike)
    assert found.shape.bend.curvature != 0.0 and found.shape.taper.any()


def test_as_many_contacts_are_made_as_are_asked_for():
    found = drive(containment, posed(EGG, 0.046), contacts=30).findings
    assert 30 <= found.figures["contacts"] < 60
    for number in (29, 101):
        with pytest.raises(ValueError, match=f"contacts must be from 30 to 100, got {number}"):
            drive(containment, EGG, contacts=number)


@pytest.mark.parametrize("noise", NOISES)
def test_what_no_superquadric_contains_is_refused_with_its_residual(noise):
    found = drive(containment, turned(VASE, smooth=True), NOISES[noise]).findings
    assert found.status == "unsuited" and "no superquadric contains it" in found.reason
    assert found.shape is None and found.mesh is None
    assert found.figures["residual_rms_m"] > 3e-4


SOLIDS = {
    "block": block(),
    "cone": turned([[0.0, 1.0], [0.08, 0.4]]),
    "can": posed(
        shapes.Superquadric(np.array([0.025, 0.025, 0.045]), np.array([0.05, 1.0])), 0.045
    ),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", SOLIDS)
def test_what_no_contact_tells_is_not_made_up(name, noise):
    solid = SOLIDS[name]
    found = drive(containment, solid, NOISES[noise]).findings
    if found.status != "done":
        assert found.status == "incomplete" and found.mesh is None
        assert "do not determine a superquadric" in found.reason
        return
    surfaces = [prepare_surface(*one) for one in (solid.mesh(4), found.mesh)]
    assert compare_surfaces(*surfaces).rms < 0.3e-3
    assert found.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=0.3e-3)  # on the platform
    assert found.figures["foretold_worst_m"] <= 0.5e-3


@pytest.mark.parametrize("seed", range(4))
def test_a_plate_whose_rim_is_too_low_to_be_touched_is_not_made_longer(seed):
    plate = block(0.06, 0.06, 0.008)
    found = drive(containment, plate, NOISY, seed=seed).findings
    if found.status == "done":
        surfaces = [prepare_surface(*one) for one in (plate.mesh(4), found.mesh)]
        assert compare_surfaces(*surfaces).rms < 0.3e-3
    else:
        assert found.status == "incomplete" and found.mesh is None


@pytest.mark.parametrize("noise", NOISES)
def test_what_is_hollow_under_the_palm_is_not_contained(noise):
    found = drive(containment, cup(), NOISES[noise]).findings
    assert found.status in ("unsuited", "incomplete") and found.mesh is None


def test_a_hand_that_meets_nothing_says_so():
    far = shapes.PosedShape(EGG, np.array([1.0, 0, 0.046, 0, 0, 0, 1.0]))
    found = drive(containment, far).findings
    assert found.status == "incomplete" and "0 contacts" in found.reason
