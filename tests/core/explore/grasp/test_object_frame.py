"""The frame in which a grasped object is sliced: axis, ends, radius, and what each may err by."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import ObjectFrame, fit_object_frame, mass_properties
from palpate.core.geometry import areas_and_normals
from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.rebuild import fit_coarse
from palpate.core.shapes import Bend, FittedSuperquadric, Superquadric

NOISE = 1e-4
ELLIPSOID = Superquadric(np.array([0.02, 0.028, 0.042]), np.ones(2))
BALL = Superquadric(np.full(3, 0.03), np.ones(2))
BOX = Superquadric(np.array([0.024, 0.03, 0.045]), np.array([0.1, 0.1]))
PLACE = np.array([0.03, -0.01, 0.05])
UP = np.array([0.0, 0.0, 1.0])


def turn_of(*vector: float) -> Floats:
    return rotations_from_vectors(np.array([vector]))[0]


class Grasped(NamedTuple):
    """Contacts of a posed solid that none of its lower fifth has."""

    points: Floats
    normals: Floats
    platform: float
    fit: FittedSuperquadric  # The solid itself, as if it had been fitted

    def frame(self, axis: Floats | None = None, **changes: object) -> ObjectFrame:
        fit = replace(self.fit, **changes)
        return fit_object_frame(fit, self.points, self.normals, self.platform, NOISE, axis)

    def part(self, chosen: slice | Floats) -> Grasped:
        points, normals = self.points[chosen], self.normals[chosen]
        fit = replace(self.fit, residuals=self.fit.residuals[chosen])
        return Grasped(points, normals, self.platform, fit)


def grasp(shape: Superquadric, turn: Floats, place: Floats = PLACE, count: int = 60) -> Grasped:
    vertices, faces = shape.mesh(3)
    normals = areas_and_normals(vertices[faces])[1] @ turn.T
    middles = vertices[faces].mean(axis=1)  # onto the surface itself, not its facets
    points = (middles / shape.gauge(middles)[:, None]) @ turn.T + place
    order = np.random.default_rng(0).permutation(len(points))
    platform = float((vertices @ turn.T + place)[:, 2].min())
    order = order[points[order, 2] > platform + 0.2 * np.ptp(points[:, 2])][:count]
    fit = FittedSuperquadric(
        size=shape.size,
        exponents=shape.exponents,
        pose=Pose(place, turn).array,
        taper=np.zeros(2),
        bend=Bend(0.0),
        residuals=np.zeros(len(order)),
        rms=1e-5,
        warnings=(),
    )
    return Grasped(points[order], normals[order], platform, fit)


LEANING = grasp(ELLIPSOID, turn_of(0.5, 0.0, 0.0))


def ends(frame: ObjectFrame) -> tuple[float, float]:
    """Both ends along the slicing axis from the world's origin."""
    origin, axes = frame.pose
    return frame.low + origin @ axes[:, 2], frame.high + origin @ axes[:, 2]


@pytest.mark.parametrize("degrees", [25.0, -90.0, 140.0])
def test_tilted_object_is_sliced_along_longest_axis(degrees):
    turn = turn_of(math.radians(degrees), 0.0, 0.0)
    frame = grasp(ELLIPSOID, turn).frame()
    origin, axes = frame.pose
    assert frame.axis == "longest"
    assert np.linalg.norm(np.cross(axes[:, 2], turn[:, 2])) < math.radians(0.2)
    assert axes[2, 2] > -1e-9 and np.linalg.det(axes) == pytest.approx(1.0)  # it points up
    assert origin == pytest.approx(PLACE, abs=1e-4)
    assert (frame.low, frame.high) == pytest.approx((-0.042, 0.042), abs=1e-4)
    assert frame.radius == pytest.approx(0.028, abs=1e-4)
    assert 0.0 < frame.axis_error < math.radians(1.0)
    assert 0.0 < frame.place_error < 1e-3 and 0.0 < frame.extent_error < 2e-3


def test_upright_object_is_sliced_in_world_axes_and_heights():
    frame = grasp(ELLIPSOID, turn_of(math.radians(0.4), 0.0, 0.0)).frame()
    origin, axes = frame.pose
    assert np.array_equal(axes, np.eye(3))
    assert origin[2] == 0.0 and origin[:2] == pytest.approx(PLACE[:2], abs=1e-4)
    assert (frame.low, frame.high) == pytest.approx((0.008, 0.092), abs=1e-4)
    ball = grasp(BALL, turn_of(0.5, 0.0, 0.0)).frame()  # it has no axis
    assert ball.is_ambiguous and ball.axis_error == 0.0
    assert np.array_equal(ball.pose.axes, np.eye(3))
    assert (ball.low, ball.high, ball.radius) == pytest.approx((0.02, 0.08, 0.03), abs=1e-4)


def test_tile_is_sliced_along_short_axis_and_straight_sides_correct_fit():
    turn = turn_of(0.5, 0.0, 0.0)
    for e2, kind in ((1.0, "revolution"), (0.2, "shortest")):
        tile = Superquadric(np.array([0.04, 0.04, 0.012]), np.array([0.2, e2]))
        frame = grasp(tile, turn).frame()
        assert frame.axis == kind and 0.0 < frame.place_error < 1e-3
        assert np.linalg.norm(np.cross(frame.pose.axes[:, 2], turn[:, 2])) < 0.01
    box = grasp(BOX, turn, count=120)
    straight = box.part(np.abs(box.normals @ turn[:, 2]) < 0.2)
    frame = straight.frame(pose=Pose(PLACE, turn_of(0.53, 0.0, 0.0)).array)
    assert np.linalg.norm(np.cross(frame.pose.axes[:, 2], turn[:, 2])) < 0.01 < 0.03


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_given_axis_is_kept_and_its_ends_are_uncertain(axis):
    frame = LEANING.frame(np.array(axis))
    assert (frame.axis, frame.axis_error) == ("given", 0.0)
    assert frame.pose.axes[:, 2] == pytest.approx(axis, abs=1e-12)
    reach = np.linalg.norm(turn_of(0.5, 0.0, 0.0).T @ axis * ELLIPSOID.size)
    assert abs(frame.high - frame.low - 2.0 * reach) < 2.0 * frame.extent_error < 2e-3
    for end, side in zip(ends(frame), (-1.0, 1.0), strict=True):
        assert end == pytest.approx(PLACE @ axis + side * reach, abs=2.0 * frame.extent_error)


def test_frame_moves_and_turns_with_object_about_vertical():
    quarter, shift, one = turn_of(0.0, 0.0, math.pi / 2), [0.1, 0.2, 0.3], LEANING.frame()
    moved = grasp(ELLIPSOID, quarter @ turn_of(0.5, 0.0, 0.0), quarter @ PLACE + shift)
    assert moved.points == pytest.approx(LEANING.points @ quarter.T + shift, abs=1e-12)
    other = moved.frame()
    assert other.pose.axes[:, 2] == pytest.approx(quarter @ one.pose.axes[:, 2], abs=1e-5)
    assert other.pose.position == pytest.approx(quarter @ one.pose.position + shift, abs=1e-6)
    assert other[1:4] == pytest.approx(one[1:4], abs=1e-6)
    assert other[5:] == pytest.approx(one[5:], rel=1e-2)
    assert LEANING.frame().pose.array.tobytes() == one.pose.array.tobytes()


@pytest.mark.parametrize("axis", [None, (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_few_contacts_give_frame_about_them(axis):
    few = grasp(ELLIPSOID, np.eye(3), count=6)
    frame = few.frame(None if axis is None else np.array(axis), warnings=("too few points",))
    assert frame.axis == ("none" if axis is None else "given")
    direction = UP if axis is None else np.abs(axis)
    assert frame.pose.axes[:, 2] == pytest.approx(direction, abs=1e-12)
    along = few.points @ direction
    low = few.platform if direction[2] else along.min()
    assert ends(frame) == pytest.approx((low, along.max()))
    assert frame.extent_error == pytest.approx(np.ptp(few.points, axis=0).max())
    away = np.linalg.norm(few.points - np.outer(along, direction) - frame.pose.position, axis=1)
    assert frame.radius <= away.max() + 1e-9 or direction[2]


def test_fit_at_bound_is_less_certain_and_many_contacts_more_so():
    sure, unsure = LEANING.frame(), LEANING.frame(warnings=("at a bound",))
    assert unsure.is_ambiguous or unsure.axis_error > 3.0 * sure.axis_error
    few = LEANING.part(slice(None, 20)).frame(UP, rms=1e-3)
    many = LEANING.frame(UP, rms=1e-3)
    assert many.place_error < few.place_error
    body = grasp(ELLIPSOID, turn_of(math.pi, 0.0, 0.0))
    upper = body.part(body.points[:, 2] > PLACE[2])  # an untouched end is less certain
    assert upper.frame(UP, rms=1e-3).extent_error > 2.0 * body.frame(UP, rms=1e-3).extent_error


def test_level_foot_that_leans_little_draws_no_solid_aside():
    shape = Superquadric(np.array([0.024, 0.028, 0.032]), np.array([0.02, 1.0]))
    body = grasp(shape, turn_of(*math.radians(0.2) * np.array([-0.7, 0.7, 0.0])), count=100)
    side = body.part(np.abs(body.points[:, 2] - PLACE[2]) < 0.03)
    frame = side._replace(platform=side.platform - 0.016).frame(rms=1e-3)
    assert np.array_equal(frame.pose.axes, np.eye(3))
    assert np.hypot(*(frame.pose.position - side.fit.pose[:3])[:2]) < 1e-3


HALF, RADIUS = 0.045, 0.025


def neck(top: list[tuple[Floats, Floats]] = (), lean: float = 0.0) -> ObjectFrame:
    """A body with a narrow upper half, leaning on its lower rim; its fit does not show ends."""
    rng = np.random.default_rng(0)
    z, angle = rng.uniform(-0.8 * HALF, 0.9 * HALF, 60), rng.uniform(0.0, 2.0 * math.pi, 60)
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * z])
    points = np.where(z > 0.0, 0.5 * RADIUS, RADIUS)[:, None] * rim + z[:, None] * UP
    points = np.vstack([points, *(point for point, _ in top)])
    normals = np.vstack([rim, *(normal for _, normal in top)])
    turn = turn_of(0.0, lean, 0.0)
    fit = replace(
        LEANING.fit,
        size=np.array([RADIUS, RADIUS, HALF]),
        exponents=np.array([0.1, 1.0]),
        pose=Pose(np.zeros(3), turn).array,
        residuals=np.zeros(len(points)),
        rms=5e-3,
    )
    platform = -HALF * math.cos(lean) - RADIUS * math.sin(lean)
    return fit_object_frame(fit, points @ turn.T, normals @ turn.T, platform, NOISE, turn[:, 2])


@pytest.mark.parametrize("lean", [0.0, 0.4, 0.8])
def test_untouched_end_is_where_platform_cuts_it_off(lean):
    frame = neck(lean=lean)
    assert ends(frame)[0] == pytest.approx(-HALF, abs=1.5e-3)
    assert frame.radius == pytest.approx(RADIUS, abs=1e-3)
    assert frame.extent_error > 2e-3


def test_touched_end_is_where_its_contacts_have_it():
    level = neck([(np.array([x, 0.002, HALF]), UP) for x in (0.003, -0.004)])
    assert ends(level)[1] == pytest.approx(HALF, abs=1e-9)
    normal, radius = np.array([math.sin(0.3), 0.0, math.cos(0.3)]), 0.5 * RADIUS
    point = radius * normal + (HALF - radius) * UP  # beside the pole of a round end
    high = ends(neck([(point, normal)]))[1]
    assert high == pytest.approx(HALF, abs=0.2e-3) and high > point[2]
    normal = np.array([math.sqrt(0.5), 0.0, math.sqrt(0.5)])  # it may be that of an edge
    frame = neck([(np.array([radius, 0.0, HALF]), normal)])
    assert HALF < ends(frame)[1] < HALF + radius
    assert frame.extent_error > 0.5 * (ends(frame)[1] - HALF)


def test_coarse_fit_gives_frame_of_true_solid():
    points, normals, platform, _ = LEANING
    frame = fit_object_frame(fit_coarse(points, NOISE), points, normals, platform, NOISE)
    assert frame.pose.axes[:, 2] == pytest.approx(turn_of(0.5, 0.0, 0.0)[:, 2], abs=5e-3)
    assert (frame.low, frame.high) == pytest.approx((-0.042, 0.042), abs=3e-4)
    grown = PLACE + 1.05 * (points - PLACE)  # a solid goes through contacts that its fit misses
    residuals = 0.05 * np.sum((points - PLACE) * normals, axis=1)
    fit = replace(LEANING.fit, residuals=residuals, rms=1.2e-3)
    frame = fit_object_frame(fit, grown, normals, platform - 2e-3, NOISE)
    assert (frame.low, frame.high) == pytest.approx((-0.0441, 0.0441), abs=5e-4)
    few = fit_coarse(np.random.default_rng(0).normal(size=(8, 3)), NOISE)
    assert (few.fitted, few.warnings) == (False, ("too few points",))


ZEROS = np.zeros((20, 3))


@pytest.mark.parametrize(
    ("points", "normals", "noise", "words"),
    [
        (ZEROS[:0], ZEROS[:0], NOISE, "points must hold at least one contact, got none"),
        (ZEROS, ZEROS[:3], NOISE, r"normals must have shape \(20, 3\), got \(3, 3\)"),
        (ZEROS, ZEROS + np.inf, NOISE, "normals must be finite"),
        (ZEROS, ZEROS, -1.0, "noise must be positive and finite, got -1.0 m"),
    ],
)
def test_invalid_contacts_are_refused(points, normals, noise, words):
    with pytest.raises(ValueError, match=words):
        fit_object_frame(LEANING.fit, points, normals, 0.0, noise)


def test_moments_are_those_of_ellipsoid_and_tetrahedron():
    vertices, faces = Superquadric(np.array([0.03, 0.02, 0.05]), np.ones(2)).mesh(5)
    turn = turn_of(0.4, -0.7, 0.2)
    body = mass_properties(vertices @ turn.T + [1.0, 2.0, 3.0], faces)
    assert body.volume == pytest.approx(4 / 3 * math.pi * 0.03 * 0.02 * 0.05, rel=3e-3)
    assert body.centroid == pytest.approx([1.0, 2.0, 3.0], abs=1e-9)
    assert body.variances == pytest.approx(np.square([0.02, 0.03, 0.05]) / 5.0, rel=3e-3)
    assert np.abs(body.axes.T @ turn[:, [1, 0, 2]]) == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(body.axes) == pytest.approx(1.0)
    assert body.is_sound and not mass_properties(vertices, faces[:, ::-1]).is_sound
    vertices = np.vstack([np.zeros(3), np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    body = mass_properties(vertices, faces)
    assert (body.volume, *body.centroid) == pytest.approx((1 / 6, 0.25, 0.25, 0.25))
    assert body.variances.sum() == pytest.approx(3 * (1 / 10 - 1 / 16))
