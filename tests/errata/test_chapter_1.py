import math

import numpy as np
import pytest

from palpate.core.poses import quaternion_from_matrix, rotation_angle, rotation_matrix
from palpate.core.shapes.generalised_cylinders import GeneralisedCylinder, SuperellipseSection

PHI, PSI = 0.7, 0.4


def printed_rotation(phi, psi, corner):
    """(1.6) with what stands in the third row, first column."""
    c, s = math.cos, math.sin
    return np.array(
        [
            [c(phi) * c(psi), -s(phi), c(phi) * s(psi)],
            [s(phi) * c(psi), c(phi), s(phi) * s(psi)],
            [corner, 0.0, c(psi)],
        ]
    )


def about_z(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def about_y(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def test_the_printed_matrix_is_no_rotation():
    printed = printed_rotation(PHI, PSI, -math.sin(PHI))
    assert np.linalg.det(printed) == pytest.approx(1.099, abs=5e-4)
    assert np.abs(printed.T @ printed - np.eye(3)).max() == pytest.approx(0.263, abs=5e-4)
    right = printed_rotation(PHI, PSI, -math.sin(PSI))
    ours = rotation_matrix(quaternion_from_matrix(right))
    assert np.allclose(ours, right, rtol=0, atol=1e-15)
    assert np.abs(ours.T @ ours - np.eye(3)).max() < 1e-15


def test_the_matrix_turns_about_y_first():
    right = printed_rotation(PHI, PSI, -math.sin(PSI))
    assert np.allclose(right, about_z(PHI) @ about_y(PSI), rtol=0, atol=1e-15)
    assert rotation_angle(right, about_y(PSI) @ about_z(PHI)) > 0.25


def test_two_angles_cannot_express_every_rotation():
    # (1.6) has a 0 in its third row: no body turned about x has one.
    turned = rotation_matrix(np.array([math.sin(0.25), 0.0, 0.0, math.cos(0.25)]))
    assert turned[2, 1] == pytest.approx(math.sin(0.5))
    nearest = min(
        rotation_angle(about_z(phi) @ about_y(psi), turned)
        for phi in np.linspace(-math.pi, math.pi, 61)
        for psi in np.linspace(-math.pi, math.pi, 61)
    )
    assert nearest > 0.45


def test_a_linear_cylinder_has_an_apex_where_its_scale_vanishes():
    scale, offset = 0.5, 0.02  # (1.4): the radius A z + B is negative below z = -B / A
    heights = np.array([-0.06, 0.06])
    assert (scale * heights + offset)[0] < 0.0
    section = SuperellipseSection(np.ones(2), 1.0)
    with pytest.raises(ValueError, match="scale"):
        GeneralisedCylinder(section, heights, scale * heights + offset)
    cone = np.array([-offset / scale, 0.06])
    assert GeneralisedCylinder(section, cone, scale * cone + offset).bounds()[0, 2] == -0.04
