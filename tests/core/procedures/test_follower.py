"""The contour follower: axes that are found, cones that fit, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.geometry import compare_surfaces, prepare_surface
from palpate.core.procedures.follower import follower
from palpate.core.procedures.generalised_cones import fit_cone

from .conftest import NOISES, VASE, cup, drive, posed, turned

UP = np.array([0.0, 0.0, 1.0])
STRAIGHT, SLOPED = [[0.0, 1.0], [0.09, 1.0]], [[0.0, 1.0], [0.08, 0.4]]
CENTRED = [[-0.045, 1.0], [0.045, 1.0]]


def lean(axis: np.ndarray, true: np.ndarray) -> float:
    """Angle between two axes, degrees."""
    return float(np.degrees(np.arcsin(min(np.linalg.norm(np.cross(axis, true)), 1.0))))


REVOLVED = {
    "cylinder": turned(STRAIGHT, (0.025, 0.025)),
    "cone": turned(SLOPED),
    "vase": turned(VASE, smooth=True),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", REVOLVED)
def test_surfaces_of_revolution_are_found_with_their_axis(name, noise):
    found = drive(follower, REVOLVED[name], NOISES[noise], fingers=2).findings
    assert found.status == "done", found.reason
    assert found.shape.kind == "revolution" and lean(found.shape.axis, UP) < 0.2
    assert found.figures["residual_rms_m"] < (5e-5 if noise == "exact" else 1.5e-4)


@pytest.mark.parametrize("name", ["cylinder", "cone"])
def test_a_solid_without_noise_is_within_a_twentieth_of_a_millimetre(name):
    found = drive(follower, REVOLVED[name], fingers=2).findings
    surfaces = [prepare_surface(*one) for one in (REVOLVED[name].mesh(5), found.mesh)]
    assert compare_surfaces(*surfaces).rms < 5e-5


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("turn", [20.0, 90.0])
def test_an_axis_that_leans_or_lies_is_found(turn, noise):
    height = 0.055 if turn < 90.0 else 0.025
    solid = posed(turned(CENTRED, (0.025, 0.025)), height, np.radians(turn))
    axis = np.sin(np.radians(turn)) * np.array([0.3, -1.0, 0.0]) / np.hypot(1.0, 0.3)
    axis[2] = np.cos(np.radians(turn))
    found = drive(follower, solid, NOISES[noise], fingers=2).findings
    assert found.status == "done", found.reason
    assert lean(found.shape.axis, axis) < 0.3


@pytest.mark.parametrize("noise", NOISES)
def test_the_axis_of_a_cone_that_is_not_round_comes_from_its_end(noise):
    solid = turned([[0.0, 1.0], [0.08, 0.6]], (0.035, 0.025))
    found = drive(follower, solid, NOISES[noise], fingers=2).findings
    assert found.status == "done" and found.shape.kind == "linear", found.reason
    assert lean(found.shape.axis, UP) < 0.2
    azimuths = np.linspace(0.0, 2.0 * np.pi, 40)
    radii = found.shape.radius(np.zeros(40), azimuths)
    assert radii.max() / radii.min() == pytest.approx(1.4, abs=0.01 if noise == "exact" else 0.08)


def test_a_round_end_is_closed_as_it_was_touched():
    solid = posed(shapes.Superquadric(np.array([0.03, 0.03, 0.04]), np.ones(2)), 0.04)
    found = drive(follower, solid, fingers=2).findings
    assert found.status == "done" and found.mesh is not None
    top = found.mesh.vertices[found.mesh.vertices[:, 2] > 0.045]
    gauge = np.linalg.norm((top - [0, 0, 0.04]) / [0.03, 0.03, 0.04], axis=1)
    assert np.abs(gauge - 1.0).max() * 0.03 < 0.3e-3
    assert found.figures["untouched_m"] > 5e-3 and "not touched" in found.reason  # its foot


UNSUITED = {
    "bent": shapes.DeformedSuperquadric(
        shapes.Superquadric(np.array([0.02, 0.02, 0.05]), np.array([0.1, 1.0])),
        np.zeros(2),
        shapes.Bend(6.0, 0.0),
    ),
    "box": shapes.Superquadric(np.array([0.035, 0.025, 0.045]), np.array([0.1, 0.1])),
}


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("name", UNSUITED)
def test_what_is_no_cone_is_refused_with_its_residuals(name, noise):
    solid = posed(UNSUITED[name], 0.05)
    found = drive(follower, solid, NOISES[noise], fingers=2).findings
    assert found.status == "unsuited" and found.mesh is None and found.shape is None
    assert "no generalised cone fits: residuals in mm rms are revolution" in found.reason
    assert found.figures["residual_revolution_m"] > 3e-4


@pytest.mark.parametrize("noise", NOISES)
def test_an_end_into_which_a_finger_falls_is_no_end(noise):
    found = drive(follower, cup(), NOISES[noise], fingers=2).findings
    assert found.status == "unsuited" and "it is hollow" in found.reason and found.mesh is None


def test_a_bore_narrower_than_the_pad_and_a_slanted_end_are_refused():
    rod = turned([[0.0, 1.0], [0.06, 1.0]], (0.03, 0.03))
    bore = turned([[-0.01, 1.0], [0.07, 1.0]], (0.005, 0.005))
    tube = shapes.BooleanShape(shapes.difference(rod, bore))
    found = drive(follower, tube, fingers=2).findings
    assert found.status == "unsuited" and "touch nothing" in found.reason
    slope = shapes.HalfSpace(np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0), 0.05)
    cut = shapes.BooleanShape(shapes.Intersection([rod, slope]))
    found = drive(follower, cut, fingers=2).findings
    assert found.status == "unsuited" and "its end leans by 17 degrees" in found.reason


def test_one_finger_is_no_pair():
    found = drive(follower, REVOLVED["cylinder"], fingers=1)
    assert found.findings.status == "unsuited" and "two fingers" in found.findings.reason
    assert found.touches == 0


def test_a_cone_is_fitted_exactly_from_an_axis_that_is_off():
    rng = np.random.default_rng(1)
    touches = []
    for height in np.linspace(0.0, 0.08, 12):
        azimuths, heights = rng.uniform(0, 2 * np.pi, 40), height + rng.uniform(-5e-3, 5e-3, 40)
        radii = 0.02 + 0.1 * heights
        touches.append(
            np.column_stack([radii * np.cos(azimuths), radii * np.sin(azimuths), heights])
        )
    start = np.array([0.05, -0.03, 1.0]) / np.linalg.norm([0.05, -0.03, 1.0])
    for kind in ("revolution", "linear"):
        cone = fit_cone(touches, kind, np.array([1e-3, -2e-3, 0.0]), start, 1e-4)
        assert cone.rms < 1e-7
        if kind == "revolution":
            assert lean(cone.axis, UP) < 1e-3


def test_the_stated_error_of_an_axis_is_what_it_scatters_by():
    rng = np.random.default_rng(2)
    leans, stated = [], []
    for _ in range(60):
        touches = []
        for number in range(24):
            azimuth = number * 2.4 + rng.uniform(-0.2, 0.2, 40)
            heights = 0.08 * number / 23 + rng.uniform(-5e-3, 5e-3, 40)
            ring = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * 0.025
            touches.append(np.column_stack([ring, heights]) + rng.normal(0.0, 1e-4, 3))
        cone = fit_cone(touches, "linear", np.zeros(3), UP, 1e-4, 0)
        leans.append(np.linalg.norm(cone.axis[:2]))
        stated.append(cone.axis_error)
    assert np.sqrt(np.mean(np.square(leans))) == pytest.approx(np.mean(stated), rel=0.3)


def test_a_cone_of_three_touches_is_refused():
    with pytest.raises(ValueError, match="4 touches, got 3"):
        fit_cone([np.zeros((5, 3))] * 3, "linear", np.zeros(3), UP, 1e-4)
