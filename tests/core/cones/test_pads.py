"""Features of cones that a pad has pressed, from tactile image to axis and apex."""

import math
from dataclasses import replace

import numpy as np

from palpate.core.cones import (
    feature_of_contact,
    interpretations,
    residual_sigma,
    solve_orientation,
    solve_origin,
)
from palpate.core.poses import pad_rotation, pose_of, transform_points
from palpate.core.shapes import GeneralisedCylinder, SuperellipseSection
from palpate.core.touch import fit_patch, guarded_move

HEIGHTS, SCALES = np.array([0.0, 0.06]), np.array([1.0, 0.4])
APEX, RADIUS = np.array([0.0, 0.0, 0.1]), 0.03
CONTACT, DEPTH, REACH = 0.05e-3, 2e-3, 0.03
ROUND, RHOMBUS = 1.0, 2.0


def touch(pad, exponent, point, heading, tilt):
    """What one press at a place reads as."""
    cone = GeneralisedCylinder(SuperellipseSection(np.full(2, RADIUS), exponent), HEIGHTS, SCALES)
    axes = pad_rotation(heading, tilt)
    start = pose_of(np.asarray(point) - 0.02 * axes[:, 2], axes)
    end = guarded_move(cone, pad, start, REACH, DEPTH)
    touched = end.compression > CONTACT
    height = pad.surface(end.compression, touched)
    patch = fit_patch(pad, height, touched, np.array([0.0, 1.0, 0.0]), 0.0)
    rows, cols = np.nonzero(touched)
    across = (cols - (pad.cols - 1) / 2) * pad.pitch
    up = (rows - (pad.rows - 1) / 2) * pad.pitch
    points = transform_points(end.pose, np.column_stack([across, up, height[touched]]))
    return feature_of_contact(
        patch.kind,
        points,
        axes @ patch.normal,
        principal=patch.principal,
        principal_error=patch.principal_error,
        principal_direction=axes @ patch.principal_direction,
    )


def side(height, azimuth, share=1.0):
    """A place on the cone's side; `share`: of the round cone's radius."""
    radius = share * RADIUS * (1.0 - height / APEX[2])
    return [radius * math.cos(azimuth), radius * math.sin(azimuth), height]


SLOPE, FLAT = math.atan(RADIUS / APEX[2]), math.sqrt(0.5)  # Of the middle of a rhombus's side


def test_parabolic_points_of_a_round_cone_meet_in_its_apex(flat):
    touched = [
        replace(touch(flat, ROUND, side(height, azimuth), azimuth, SLOPE).feature, place="M")
        for azimuth, height in ((0.3, 0.02), (2.0, 0.03), (4.0, 0.035))
    ]
    assert [one.group for one in touched] == ["P", "P", "P"]
    found = solve_origin(touched)
    assert np.linalg.norm(found.point - APEX) < 3e-4  # A jet's curvature lies between its rows
    assert found.residual_sigma < 1.0


def pyramid_touches(pad):
    """Two sides, two meridians, an edge and a vertex of the top, exact."""
    lean, quarter = math.radians(50.0), 0.25 * math.pi
    return [
        touch(pad, RHOMBUS, side(0.03, quarter, FLAT), quarter, SLOPE).feature,
        touch(pad, RHOMBUS, side(0.03, 3 * quarter, FLAT), 3 * quarter, SLOPE).feature,
        touch(pad, RHOMBUS, side(0.03, 0.0), 0.0, SLOPE).feature,
        touch(pad, RHOMBUS, side(0.03, math.pi), math.pi, SLOPE).feature,
        touch(pad, RHOMBUS, side(0.06, -quarter, FLAT), -quarter, lean).feature,
        touch(pad, RHOMBUS, side(0.06, 2 * quarter), 2 * quarter, lean).feature,
    ]


def test_touches_of_a_pyramid_give_axis_and_apex_exactly(flat):
    touched = pyramid_touches(flat)
    assert [one.group for one in touched] == ["F", "F", "E", "E", "E", "V"]
    placed = [replace(one, place=place) for one, place in zip(touched, "SSMMTT", strict=True)]
    axis, apex = solve_orientation(placed), solve_origin(placed)
    assert np.linalg.norm(axis.axis - [0.0, 0.0, 1.0]) < 1e-9
    assert np.linalg.norm(apex.point - APEX) < 1e-9 * APEX[2]
    assert residual_sigma(axis, apex) < 1e-9


def test_the_places_of_touches_of_a_pyramid_are_told_from_each_other(flat):
    touched = pyramid_touches(flat)
    found = interpretations([touched[0], *touched[2:5]])
    standing = {one.name for one in found if one.stands}
    assert "F_S E_m E_m E_T" in standing
    assert not any(name.startswith("F_T") for name in standing)
