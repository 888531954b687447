from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.shapes.piecewise import straight_pieces
from palpate.core.shapes.profile_mesh import profile_mesh
from palpate.core.shapes.section import SuperellipseSection

CIRCLE = SuperellipseSection(np.array([0.03, 0.03]), 1.0)
STEPS = straight_pieces(np.array([0.0, 0.031, 0.05, 0.08]), np.array([1.0, 1.0, 0.4, 0.7]))


def test_rims_and_kinks_are_rings_of_the_mesh(is_closed: Callable[[Any], bool]) -> None:
    mesh = profile_mesh(CIRCLE.outline, STEPS, np.eye(3), 2)
    assert is_closed(mesh)
    height, radius = mesh.vertices[:, 2], np.hypot(*mesh.vertices[:, :2].T)
    for knot, scale in zip(STEPS.knots, (1.0, 1.0, 0.4, 0.7), strict=True):
        ring = radius[np.abs(height - knot) < 1e-15]
        assert ring.max() == pytest.approx(0.03 * scale)


def test_each_level_has_about_four_times_the_faces_and_a_quarter_of_the_error(
    signed_volume: Callable[[Any], float],
) -> None:
    true = 0.0
    for low, high, a, b in ((0, 0.031, 1, 1), (0.031, 0.05, 1, 0.4), (0.05, 0.08, 0.4, 0.7)):
        true += math.pi * 0.03**2 * (high - low) * (a * a + a * b + b * b) / 3
    meshes = [profile_mesh(CIRCLE.outline, STEPS, np.eye(3), level) for level in (2, 3, 4, 6)]
    faces = [len(mesh.faces) for mesh in meshes]
    errors = np.array([true - signed_volume(mesh) for mesh in meshes])
    assert (errors > 0).all()
    assert np.diff(np.log2(errors))[:2] == pytest.approx([-2, -2], abs=0.1)
    assert np.diff(np.log2(faces))[:2] == pytest.approx([2, 2], abs=0.3)
    assert 7e4 < faces[3] < 9e4


@pytest.mark.parametrize("scales", [(1.0, 0.0), (0.0, 1.0), (0.0, 0.5, 0.0)])
def test_an_apex_is_one_vertex(scales: tuple[float], is_closed: Callable[[Any], bool]) -> None:
    knots = np.linspace(0.0, 0.1, len(scales))
    for level in (0, 3):
        mesh = profile_mesh(
            CIRCLE.outline, straight_pieces(knots, np.array(scales)), np.eye(3), level
        )
        assert is_closed(mesh)
        for end in (knots[0], knots[-1]):
            on = np.abs(mesh.vertices[:, 2] - end) < 1e-15
            assert on.sum() == 1 or scales[0 if end == 0.0 else -1] > 0.0


def test_a_shear_moves_the_sections_sideways() -> None:
    shear = np.array([[1.0, 0, 0.5], [0, 1, 0], [0, 0, 0.8]])
    plain, leaning = (profile_mesh(CIRCLE.outline, STEPS, m, 2) for m in (np.eye(3), shear))
    assert np.allclose(leaning.vertices, plain.vertices @ shear.T, rtol=0, atol=1e-17)
    assert np.array_equal(leaning.faces, plain.faces)
