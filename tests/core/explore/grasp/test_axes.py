"""Axes from normals: of revolution, of straight sides, of an end face."""

import math

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import end_face_axis, revolution_axis
from palpate.core.poses import rotations_from_vectors

UP = np.array([0.0, 0.0, 1.0])
TURNS = rotations_from_vectors(np.random.default_rng(5).normal(size=(3, 3)))
LEAN = rotations_from_vectors(np.array([[0.0, 0.3, 0.0]]))[0]
NO_AXES = np.zeros((0, 3))
ROUND = np.random.default_rng(0).normal(size=(60, 3))
ROUND /= np.linalg.norm(ROUND, axis=1)[:, None]


def leaning(degrees: float) -> Floats:
    return np.array([math.sin(math.radians(degrees)), 0.0, math.cos(math.radians(degrees))])


def sides(turns: Floats, lean: float = 0.0, taper: float = 0.0) -> Floats:
    """Normals of sides that lean up and down by as much, and taper."""
    leans = lean * np.linspace(-1.0, 1.0, len(turns)) + taper
    level = np.column_stack([np.cos(turns), np.sin(turns)])
    return np.column_stack([np.cos(leans)[:, None] * level, np.sin(leans)])


QUARTERS = 0.5 * math.pi * (np.arange(24) % 4)
# The sides of a box, some of its corners, and its top.
BOX = np.concatenate([sides(QUARTERS), sides(np.arange(6.0), 0.3), np.tile(UP, (6, 1))])


def test_end_face_is_axis_if_level_or_square_to_straight_sides():
    assert np.array_equal(end_face_axis(leaning(20.0), leaning(0.5), ROUND), UP)
    assert end_face_axis(UP, leaning(2.0), BOX) is None  # level already
    for turn in (LEAN, *TURNS):
        face = turn @ UP
        assert end_face_axis(turn @ leaning(4.0), face, BOX @ turn.T) == pytest.approx(face)
        assert end_face_axis(turn @ leaning(0.5), face, BOX @ turn.T) is None  # nothing new
    assert end_face_axis(UP, leaning(12.0), BOX) is None  # the oblique top of an upright column


@pytest.mark.parametrize(
    "normals",
    [ROUND, sides(np.arange(40.0), 1.2), sides(QUARTERS, taper=0.1)]
    + [sides(math.pi * np.arange(24)), BOX[:8]],
    ids=["round", "barrel", "taper", "two faces", "few"],
)
def test_end_face_not_square_to_sides_is_no_axis(normals):
    assert end_face_axis(UP, LEAN @ UP, normals @ LEAN.T) is None


def vase(count: int, seed: int) -> tuple[Floats, Floats]:
    """Points and normals of a vase about the z axis."""
    rng = np.random.default_rng(seed)
    z, angle = rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * math.pi, count)
    radius, slope = 0.5 + 0.2 * np.sin(4.0 * z), 0.8 * np.cos(4.0 * z)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    normals = np.column_stack([rim, -slope]) / np.hypot(1.0, slope)[:, None]
    return np.column_stack([radius[:, None] * rim, z]), normals


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_axis_of_vase_is_exact_from_few_contacts_in_any_pose(scale):
    points, normals = vase(12, 1)
    for turn in TURNS:
        moved = scale * (points @ turn.T + [3.0, 1.0, 2.0])
        axis = revolution_axis(moved, normals @ turn.T, NO_AXES)
        assert np.linalg.norm(np.cross(axis.axis, turn[:, 2])) < 1e-6
        away = axis.point - scale * np.array([3.0, 1.0, 2.0])
        assert np.linalg.norm(np.cross(away, turn[:, 2])) < 1e-6 * scale
        assert abs((axis.point - moved.mean(axis=0)) @ axis.axis) < 1e-6 * scale
        assert axis.share == 1.0 and axis.rms < 1e-3 and axis.lift > 0.1
    points, normals = vase(80, 2)
    side = points[:, 0] > 0.2  # one side of it is enough
    assert np.linalg.norm(revolution_axis(points[side], normals[side], TURNS[0]).axis[:2]) < 1e-6


def test_outlying_normals_are_left_out_and_lower_share():
    points, normals = vase(50, 3)
    normals[:12] = np.linalg.qr(np.random.default_rng(3).normal(size=(12, 3, 3)))[0][:, 0]
    axis = revolution_axis(points, normals, NO_AXES)
    assert np.linalg.norm(axis.axis[:2]) < 1e-3 and 0.7 < axis.share < 0.9
    points, normals = vase(50, 8)
    size = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    aside = np.cross(normals[::5], UP)
    for missed, share in ((0.01, 1.0), (0.02, 0.8)):  # of the size: 0.015 is near enough
        moved = points.copy()
        moved[::5] += missed * size * aside / (aside**2).sum(axis=1)[:, None]
        assert revolution_axis(moved, normals, NO_AXES).share == pytest.approx(share)


def test_axis_error_is_that_of_noisy_normals():
    rng, errors, stated = np.random.default_rng(4), [], []
    for seed in range(12):
        points, normals = vase(40, 100 + seed)
        normals += 3e-3 * rng.normal(size=normals.shape)
        axis = revolution_axis(points, normals / np.linalg.norm(normals, axis=1)[:, None], NO_AXES)
        errors.append(np.linalg.norm(axis.axis[:2]))
        stated.append(axis.error)
    # Each of two directions has at most the standard deviation that is stated.
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) / np.mean(stated) < 2.0
    ball = revolution_axis(0.03 * ROUND, ROUND, NO_AXES)  # it has no axis
    assert ball.lift < 1e-3 and ball.error > 1.0


def test_fewer_than_six_contacts_are_refused():
    with pytest.raises(ValueError, match="points must be at least 6, got 5"):
        revolution_axis(*vase(5, 7), NO_AXES)
    revolution_axis(*vase(6, 7), NO_AXES)
