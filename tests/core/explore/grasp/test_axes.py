import math

import numpy as np
import pytest

from palpate.core.explore.grasp.axes import (
    LEAST,
    ROUND as NEAR,
    end_face_axis,
    extrusion_axis,
    revolution_axis,
)
from palpate.core.poses import rotations_from_vectors

UP = np.array([0.0, 0.0, 1.0])
ROUND = np.random.default_rng(0).normal(size=(60, 3))


ROUND /= np.linalg.norm(ROUND, axis=1, keepdims=True)


def leaning(degrees):
    lean = math.radians(degrees)
    return np.array([math.sin(lean), 0.0, math.cos(lean)])


def box(degrees):
    """Normals of the sides of a box that leans."""
    across, along = leaning(degrees + 90.0), np.array([0.0, 1.0, 0.0])
    return np.concatenate([np.tile(one, (8, 1)) for one in (across, -across, along, -along)])


def test_a_level_face_of_an_object_whose_middles_lean_says_the_vertical():
    found = end_face_axis(leaning(20.0), leaning(0.5), ROUND)
    assert found is not None
    assert np.array_equal(found, UP)


def test_the_face_of_a_box_says_its_axis():
    found = end_face_axis(UP, leaning(12.0), box(12.0))
    assert found == pytest.approx(leaning(12.0))


def test_the_oblique_top_of_an_upright_column_does_not():
    assert end_face_axis(UP, leaning(12.0), box(0.0)) is None


def test_the_flank_of_a_round_object_does_not():
    assert end_face_axis(UP, leaning(30.0), ROUND) is None


@pytest.mark.parametrize("degrees", [0.0, 25.0])
def test_a_face_square_to_the_axis_says_nothing_new(degrees):
    assert end_face_axis(leaning(degrees), leaning(degrees + 0.5), box(degrees)) is None
    assert end_face_axis(UP, leaning(2.0), box(2.0)) is None


GUESS = np.array([math.sin(0.05), 0.0, math.cos(0.05)])


def _sides(turns, lean=0.0):
    """Normals that lean up and down by as much."""
    turns = np.asarray(turns, np.float64)
    leans = lean * np.linspace(-1.0, 1.0, len(turns))
    level = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.column_stack([np.cos(leans)[:, None] * level, np.sin(leans)])


def _box(count=24):
    sides = _sides(0.5 * np.pi * (np.arange(count) % 4))
    corners = _sides(np.arange(6.0), lean=0.3)
    return np.concatenate([sides, corners, np.tile(UP, (6, 1))])


def test_the_axis_of_a_box_is_found_beside_a_guess():
    turn = rotations_from_vectors(np.array([[0.4, -0.7, 0.2]]))[0]
    found = extrusion_axis(_box() @ turn.T, turn @ GUESS)
    assert found is not None
    assert found == pytest.approx(turn @ UP, abs=2e-3)


def test_a_round_surface_has_no_straight_sides():
    assert extrusion_axis(_sides(np.arange(40.0), lean=1.2), GUESS) is None


def test_sides_that_taper_evenly_are_not_straight():
    turns = 0.5 * np.pi * (np.arange(24) % 4)
    tapered = np.column_stack([np.cos(turns), np.sin(turns), np.full(24, 0.1)])
    tapered /= np.linalg.norm(tapered, axis=1)[:, None]
    assert extrusion_axis(tapered, UP) is None


def test_two_opposite_faces_leave_the_axis_free_to_turn():
    assert extrusion_axis(_sides(np.pi * np.arange(24)), UP) is None


def test_a_few_contacts_say_nothing():
    assert extrusion_axis(_box(8), GUESS) is None


NO_AXES = np.zeros((0, 3))


def turned(count, rng):
    """Points and normals of a vase about the z axis."""
    z, angle = rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    radius, slope = 0.5 + 0.2 * np.sin(4.0 * z), 0.8 * np.cos(4.0 * z)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    normals = np.column_stack([rim, -slope]) / np.hypot(1.0, slope)[:, None]
    return np.column_stack([radius[:, None] * rim, z]), normals


def test_the_axis_of_a_vase_is_exact_from_few_contacts(rotations):
    points, normals = turned(12, np.random.default_rng(1))
    for turn in rotations(5):
        found = revolution_axis(points @ turn.T + [3.0, 1.0, 2.0], normals @ turn.T, NO_AXES)
        assert np.linalg.norm(np.cross(found.axis, turn[:, 2])) < 1e-6
        away = np.cross(found.point - [3.0, 1.0, 2.0], turn[:, 2])
        assert np.linalg.norm(away) < 1e-6
        assert found.share == 1.0


def test_only_one_side_is_enough():
    points, normals = turned(80, np.random.default_rng(2))
    side = points[:, 0] > 0.2
    found = revolution_axis(points[side], normals[side], NO_AXES)
    assert np.linalg.norm(found.axis[:2]) < 1e-6


def test_wrong_normals_are_left_out():
    rng = np.random.default_rng(3)
    points, normals = turned(50, rng)
    normals[:12] = np.linalg.qr(rng.normal(size=(12, 3, 3)))[0][:, 0]
    found = revolution_axis(points, normals, NO_AXES)
    assert np.linalg.norm(found.axis[:2]) < 1e-3
    assert 0.7 < found.share < 0.9


def test_the_error_is_as_large_as_it_says():
    rng, errors, stated = np.random.default_rng(4), [], []
    for _ in range(60):
        points, normals = turned(40, rng)
        normals += 3e-3 * rng.normal(size=normals.shape)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        found = revolution_axis(points, normals, NO_AXES)
        errors.append(np.linalg.norm(found.axis[:2]))
        stated.append(found.error)
    # Each of two directions has at most the standard deviation that is stated.
    assert np.sqrt(np.mean(np.square(errors))) < 2.0 * np.mean(stated)
    assert np.sqrt(np.mean(np.square(errors))) > 0.4 * np.mean(stated)


def test_a_ball_has_no_axis():
    normals = np.random.default_rng(5).normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    assert revolution_axis(0.03 * normals, normals, NO_AXES).lift < 1e-3


def test_millimetres_and_metres_give_the_same():
    points, normals = turned(40, np.random.default_rng(6))
    one, other = (revolution_axis(scale * points, normals, NO_AXES) for scale in (1e-3, 1.0))
    assert (one.rms, one.share) == pytest.approx((other.rms, other.share), rel=1e-6)
    assert np.abs(one.axis @ other.axis) == pytest.approx(1.0, abs=1e-12)


def test_too_few_contacts_are_refused():
    points, normals = turned(LEAST - 1, np.random.default_rng(7))
    with pytest.raises(ValueError, match=f"points must be at least {LEAST}, got {LEAST - 1}"):
        revolution_axis(points, normals, NO_AXES)
    revolution_axis(*turned(LEAST, np.random.default_rng(7)), NO_AXES)


@pytest.mark.parametrize(("missed", "share"), [(0.9, 1.0), (1.1, 0.8)])
def test_the_share_is_of_the_normals_that_pass_the_axis_near_enough(missed, share):
    points, normals = turned(50, np.random.default_rng(8))
    size = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    aside = np.cross(normals[::5], UP)
    aside /= (aside**2).sum(axis=1)[:, None]
    points[::5] += missed * NEAR * size * aside
    assert revolution_axis(points, normals, NO_AXES).share == pytest.approx(share)
