import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.explore.grasp.object_frame import (
    Contacts,
    correct_solid,
    extent_along,
    fit_object_frame,
    mass_properties,
    solid_on_platform,
)
from palpate.core.poses import pose_of, split_pose
from palpate.core.rebuild.reconstruction import fit_coarse
from palpate.core.shapes.deformed_superquadrics import DeformedSuperquadric
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.superquadrics import Superquadric

NOISE = 1e-4
ELLIPSOID = Superquadric(np.array([0.02, 0.028, 0.042]), np.ones(2))
TILE = Superquadric(np.array([0.04, 0.04, 0.012]), np.array([0.2, 1.0]))
BALL = Superquadric(np.full(3, 0.03), np.ones(2))


def about_x(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def contacts(shape, turn, place):
    """Contacts of a posed solid that none of its lower fifth has, and the platform's height."""
    vertices, faces = shape.mesh(3)
    a, b, c = (vertices[faces] @ turn.T + place).transpose(1, 0, 2)
    middles, normals = (a + b + c) / 3.0, np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # On the surface itself, not on its facets.
    local = (middles - place) @ turn
    points = (local / shape.gauge(local)[:, None]) @ turn.T + place
    chosen = np.random.default_rng(0).permutation(len(points))
    platform = float((vertices @ turn.T + place)[:, 2].min())
    seen = points[chosen, 2] > platform + 0.2 * np.ptp(points[:, 2])
    return points[chosen][seen][:60], normals[chosen][seen][:60], platform


def frame_of(shape, turn, place):
    points, normals, platform = contacts(shape, turn, place)
    return fit_object_frame(fit_coarse(points, NOISE), points, normals, platform, NOISE)


PLACE = np.array([0.03, -0.01, 0.05])


@pytest.mark.parametrize("degrees", [25.0, 60.0, 90.0, 140.0])
def test_a_tilted_object_is_sliced_along_its_longest_axis(degrees):
    turn = about_x(math.radians(degrees))
    found = frame_of(ELLIPSOID, turn, PLACE)
    origin, axes = split_pose(found.pose)
    assert found.axis == "longest"
    assert np.linalg.norm(np.cross(axes[:, 2], turn[:, 2])) < math.radians(0.5)
    assert origin == pytest.approx(PLACE, abs=3e-4)
    assert (found.low, found.high) == pytest.approx((-0.042, 0.042), abs=3e-4)
    assert found.radius == pytest.approx(0.028, abs=3e-4)
    assert axes[2, 2] > -1e-9  # it points up


def test_a_tile_is_sliced_along_its_shortest_axis_or_that_of_revolution():
    turn = about_x(0.5)
    found = frame_of(TILE, turn, PLACE)
    assert found.axis in ("shortest", "revolution")
    assert np.linalg.norm(np.cross(split_pose(found.pose)[1][:, 2], turn[:, 2])) < 0.01


def test_an_object_that_stands_upright_is_sliced_in_the_worlds_axes_and_heights():
    found = frame_of(ELLIPSOID, about_x(math.radians(0.4)), PLACE)
    origin, axes = split_pose(found.pose)
    assert np.array_equal(axes, np.eye(3))
    assert origin == pytest.approx([0.03, -0.01, 0.0], abs=3e-4)
    assert (found.low, found.high) == pytest.approx((0.008, 0.092), abs=3e-4)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_a_given_axis_is_taken(axis):
    points, normals, platform = contacts(ELLIPSOID, about_x(0.5), PLACE)
    fit = fit_coarse(points, NOISE)
    found = fit_object_frame(fit, points, normals, platform, NOISE, np.array(axis))
    assert (found.axis, found.axis_error) == ("given", 0.0)
    assert split_pose(found.pose)[1][:, 2] == pytest.approx(axis, abs=1e-12)
    reach = np.linalg.norm(about_x(0.5).T @ axis * [0.02, 0.028, 0.042])
    # Along an axis of no symmetry its ends are less certain, and it says so.
    assert abs(found.high - found.low - 2.0 * reach) < 2.0 * found.extent_error < 2e-3


def test_a_ball_has_no_axis_and_says_so():
    found = frame_of(BALL, about_x(0.5), PLACE)
    assert found.ambiguous
    assert np.array_equal(found.pose[3:], [0.0, 0.0, 0.0, 1.0])
    assert found.radius == pytest.approx(0.03, abs=3e-4)


def test_an_object_moved_and_turned_about_the_vertical_takes_its_frame_along():
    one = frame_of(ELLIPSOID, about_x(0.5), PLACE)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    other = frame_of(ELLIPSOID, quarter @ about_x(0.5), quarter @ PLACE + [0.1, 0.2, 0.3])
    axes = [split_pose(frame.pose)[1][:, 2] for frame in (one, other)]
    assert axes[1] == pytest.approx(quarter @ axes[0], abs=2e-3)
    assert other.pose[:3] == pytest.approx(quarter @ one.pose[:3] + [0.1, 0.2, 0.3], abs=2e-4)
    assert other.high - other.low == pytest.approx(one.high - one.low, abs=2e-4)


def test_a_lying_object_points_the_same_way_however_it_was_turned():
    for degrees in (90.0, -90.0):
        axes = split_pose(frame_of(ELLIPSOID, about_x(math.radians(degrees)), PLACE).pose)[1]
        assert abs(axes[1, 2]) == pytest.approx(1.0, abs=1e-4)
        assert np.linalg.det(axes) == pytest.approx(1.0)


def test_few_contacts_give_an_upright_frame_about_them():
    points, normals, platform = contacts(ELLIPSOID, np.eye(3), PLACE)
    few = points[:6]
    found = fit_object_frame(fit_coarse(few, NOISE), few, normals[:6], platform, NOISE)
    assert found.ambiguous
    assert (found.low, found.high) == (platform, few[:, 2].max())
    assert found.extent_error > 0.01


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_an_axis_is_taken_even_if_contacts_tell_nothing(axis):
    points, normals, platform = contacts(ELLIPSOID, np.eye(3), PLACE)
    few = points[:6]
    fit = fit_coarse(few, NOISE)
    found = fit_object_frame(fit, few, normals[:6], platform, NOISE, np.array(axis))
    assert found.axis == "given"
    assert split_pose(found.pose)[1][:, 2] == pytest.approx(np.abs(axis), abs=1e-12)
    assert found.high > found.low


def test_a_fit_that_came_to_a_bound_makes_the_axis_less_certain():
    points, normals, platform = contacts(ELLIPSOID, about_x(0.5), PLACE)
    found = fit_coarse(points, NOISE)
    strained = replace(found, warnings=("at a bound",))
    sure, unsure = (
        fit_object_frame(fit, points, normals, platform, NOISE) for fit in (found, strained)
    )
    assert unsure.ambiguous or unsure.axis_error == pytest.approx(6.0 * sure.axis_error)


def test_the_same_contacts_give_the_same_frame():
    one, two = (frame_of(ELLIPSOID, about_x(0.5), PLACE) for _ in range(2))
    assert one.pose.tobytes() == two.pose.tobytes()


@pytest.mark.parametrize(
    ("count", "normals", "noise", "words"),
    [
        (0, np.zeros((0, 3)), NOISE, "points must hold at least one contact, got none"),
        (20, np.zeros((3, 3)), NOISE, r"normals must have shape \(20, 3\), got \(3, 3\)"),
        (20, np.full((20, 3), np.inf), NOISE, "normals must be finite"),
        (20, np.zeros((20, 3)), -1.0, "noise must be positive and finite, got -1.0 m"),
    ],
)
def test_what_is_no_grasp_is_refused(count, normals, noise, words):
    points = contacts(ELLIPSOID, np.eye(3), PLACE)[0]
    found = fit_coarse(points, NOISE)
    with pytest.raises(ValueError, match=words):
        fit_object_frame(found, points[:count], normals, 0.0, noise)


def test_a_pose_of_the_world_is_the_worlds():
    found = frame_of(ELLIPSOID, np.eye(3), np.array([0.0, 0.0, 0.042]))
    assert found.pose == pytest.approx(pose_of(np.zeros(3), np.eye(3)), abs=3e-4)


HALF, RADIUS = 0.045, 0.025


def bottle(rng, count=60):
    """Contacts of the side of a body whose upper half is much narrower."""
    z, angle = rng.uniform(-0.8 * HALF, 0.9 * HALF, count), rng.uniform(0.0, 2 * np.pi, count)
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * z])
    radius = np.where(z > 0.0, 0.5 * RADIUS, RADIUS)
    return radius[:, None] * rim + z[:, None] * [0.0, 0.0, 1.0], rim


def ends(points, normals, lean=0.0, rim=RADIUS):
    """Of a body that leans on its platform by its lower rim."""
    c, s = math.cos(lean), math.sin(lean)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    platform = -HALF * c - rim * s
    points, normals = points @ turn.T, normals @ turn.T
    found = fit_coarse(points, NOISE)
    solid = correct_solid(found.shape().mesh(3), points, found.residuals, found.rms, NOISE)
    pose = pose_of(np.zeros(3), turn)
    return extent_along(pose, solid, found, Contacts(points, normals), platform)


@pytest.mark.parametrize("lean", [0.0, 0.4, 0.8])
def test_an_end_that_was_not_touched_is_where_the_platform_cuts_it_off(lean):
    low, _, radius, error = ends(*bottle(np.random.default_rng(0)), lean)
    assert low == pytest.approx(-HALF, abs=1.5e-3)
    assert radius == pytest.approx(RADIUS, abs=1e-3)
    assert error > 2e-3


def test_an_end_that_was_touched_is_where_it_was_touched():
    points, normals = bottle(np.random.default_rng(1))
    top = np.array([[0.003, 0.0, HALF], [-0.004, 0.002, HALF]])
    found = ends(np.vstack([points, top]), np.vstack([normals, [[0.0, 0.0, 1.0]] * 2]))
    assert found[1] == pytest.approx(HALF, abs=1e-9)


def test_a_round_end_that_was_touched_beside_its_pole_reaches_beyond():
    points, normals = bottle(np.random.default_rng(2))
    beside, radius = 0.3, 0.5 * RADIUS
    normal = np.array([[math.sin(beside), 0.0, math.cos(beside)]])
    top = radius * normal + [[0.0, 0.0, HALF - radius]]
    _, high, _, _ = ends(np.vstack([points, top]), np.vstack([normals, normal]))
    assert high == pytest.approx(HALF, abs=0.1e-3)
    assert high > top[0, 2]


def test_a_leaning_contact_may_be_of_an_edge_and_the_error_says_so():
    points, normals = bottle(np.random.default_rng(3))
    normal = np.array([[math.sqrt(0.5), 0.0, math.sqrt(0.5)]])
    top = np.array([[0.5 * RADIUS, 0.0, HALF]])
    _, high, _, error = ends(np.vstack([points, top]), np.vstack([normals, normal]))
    assert HALF < high < HALF + 0.5 * RADIUS
    assert error > 0.5 * (high - HALF)


def test_a_solid_that_fits_tells_where_its_untouched_ends_are():
    shape = Superquadric(np.array([0.02, 0.028, 0.042]), np.ones(2))
    vertices, faces = shape.mesh(3)
    middles = vertices[faces].mean(axis=1)
    points = middles / shape.gauge(middles)[:, None]
    normals = points / np.square([0.02, 0.028, 0.042])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    side = np.flatnonzero(np.abs(points[:, 2]) < 0.03)[::8]
    found = fit_coarse(points[side], NOISE)
    solid = correct_solid(found.shape().mesh(4), points[side], found.residuals, found.rms, NOISE)
    seen = Contacts(points[side], normals[side])
    *given, _, error = extent_along(pose_of(np.zeros(3), np.eye(3)), solid, found, seen, -0.042)
    assert given == pytest.approx([-0.042, 0.042], abs=2e-4)
    assert error < 1.5e-3


@pytest.mark.parametrize("degrees", range(0, 360, 45))
def test_a_level_foot_that_leans_a_little_draws_no_solid_aside(degrees):
    shape = Superquadric(np.array([0.024, 0.028, 0.032]), np.array([0.02, 1.0]))
    vertices = shape.mesh(3).vertices
    side = vertices[np.abs(vertices[:, 2]) < 0.03][::12]
    lean = math.radians(0.2)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    spun = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    found = replace(
        fit_coarse(side, NOISE),
        size=shape.size,
        exponents=shape.exponents,
        pose=pose_of(np.zeros(3), spun @ about_x(lean) @ spun.T),
        residuals=np.zeros(len(side)),
        rms=1e-3,
    )
    solid = solid_on_platform(found, side, -0.048, NOISE)
    axis = solid.mass.axes[:, 2]
    assert abs(axis[2]) > math.cos(math.radians(3.0))


def test_a_box_is_recovered_as_a_box(box, grasped):
    points, _ = grasped(PosedShape(box, pose_of(np.array([0.0, 0.0, 0.04]), np.eye(3))), 60)
    found = fit_coarse(points, NOISE)
    assert sorted(found.size) == pytest.approx([0.02, 0.03, 0.04], abs=2e-4)
    assert len(found.names) == 11 and found.exponents.max() < 0.2


def test_a_bend_is_taken_where_it_pays(grasped):
    base = Superquadric(np.array([0.02, 0.018, 0.045]), np.array([0.5, 0.7]))
    bent = DeformedSuperquadric(base, np.array([0.3, 0.3]), Bend(6.0))
    points, _ = grasped(PosedShape(bent, pose_of(np.array([0.0, 0.0, 0.045]), np.eye(3))), 60)
    found = fit_coarse(points, NOISE)
    assert abs(found.bend.curvature) == pytest.approx(6.0, rel=0.05)
    assert found.rms < NOISE


def test_contacts_that_are_too_few_give_an_ellipsoid_and_say_so():
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
def test_what_are_no_contacts_is_refused(points, noise, words):
    with pytest.raises(ValueError, match=words):
        fit_coarse(points, noise)


SPHEROID = Superquadric(np.array([0.03, 0.03, 0.045]), np.ones(2))
MESH = SPHEROID.mesh(4)


def test_contacts_on_the_solid_change_nothing():
    found = correct_solid(MESH, MESH.vertices[::40], np.zeros(len(MESH.vertices[::40])), 0.0, NOISE)
    assert np.array_equal(found.vertices, MESH.vertices)
    assert np.isfinite(found.tilts).all()


def test_a_solid_goes_through_its_contacts():
    points = MESH.vertices[::25]
    grown = 1.05 * points
    found = correct_solid(MESH, grown, np.linalg.norm(grown - points, axis=1), 1e-3, NOISE)
    assert np.linalg.norm(found.vertices[::25] - grown, axis=1).max() < 1e-3
    assert (
        found.mass.volume
        > 1.1 * correct_solid(MESH, points, 0 * points[:, 0], 0.0, NOISE).mass.volume
    )


def test_one_contact_speaks_for_its_neighbourhood_as_a_normal_distribution_does():
    reach = 0.2 * np.ptp(MESH.vertices, axis=0).max()
    found = correct_solid(MESH, MESH.vertices[:1], np.array([1e-4]), 1e-3, 1e-9)
    moved = np.linalg.norm(found.vertices - MESH.vertices, axis=1)
    away = np.linalg.norm(MESH.vertices - MESH.vertices[0], axis=1)
    assert moved == pytest.approx(1e-4 * np.exp(-0.5 * (away / reach) ** 2), abs=1e-9)


def test_what_was_not_touched_is_uncertain():
    upper = MESH.vertices[MESH.vertices[:, 2] > 0.0][::10]
    found = correct_solid(MESH, upper, np.zeros(len(upper)), 1e-3, NOISE)
    low, high = MESH.vertices[:, 2].argmin(), MESH.vertices[:, 2].argmax()
    assert found.deviation[low] > 10.0 * found.deviation[high]
    assert found.deviation[low] == pytest.approx(5e-3, rel=0.05)


def test_axes_of_like_extents_are_uncertain_and_others_are_not():
    points = MESH.vertices[::20]
    found = correct_solid(MESH, points, np.zeros(len(points)), 1e-4, NOISE)
    turns = np.sqrt(np.diagonal(found.tilts))
    assert turns[2] > 1.0  # about the long axis: nothing holds it
    assert turns[:2].max() < np.radians(1.0)


def test_more_contacts_make_it_more_certain():
    few, many = (
        correct_solid(MESH, MESH.vertices[::n], np.zeros(len(MESH.vertices[::n])), 1e-3, NOISE)
        for n in (80, 20)
    )
    assert many.shift < few.shift
    assert many.tilts[0, 0] < few.tilts[0, 0]


def test_contacts_that_would_turn_the_solid_inside_out_leave_it_as_it_is():
    points = MESH.vertices[::10]
    found = correct_solid(MESH, points, np.full(len(points), -0.1), 0.1, NOISE)
    assert np.array_equal(found.vertices, MESH.vertices)
    assert found.mass.sound


def test_an_ellipsoid_has_a_fifth_of_its_squared_semi_axes(rotations):
    vertices, faces = Superquadric(np.array([0.03, 0.02, 0.05]), np.ones(2)).mesh(5)
    turn = rotations(1)[0]
    body = mass_properties(vertices @ turn.T + [1.0, 2.0, 3.0], faces)
    assert body.volume == pytest.approx(4 / 3 * np.pi * 0.03 * 0.02 * 0.05, rel=3e-3)
    assert body.centroid == pytest.approx([1.0, 2.0, 3.0], abs=1e-9)
    assert body.spread == pytest.approx(np.square([0.02, 0.03, 0.05]) / 5.0, rel=3e-3)
    assert np.abs(body.axes.T @ turn[:, [1, 0, 2]]) == pytest.approx(np.eye(3), abs=1e-6)
    assert np.linalg.det(body.axes) == pytest.approx(1.0)


def test_a_tetrahedron_is_exact():
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    body = mass_properties(vertices, faces)
    assert (body.volume, *body.centroid) == pytest.approx((1 / 6, 0.25, 0.25, 0.25))
    assert body.spread.sum() == pytest.approx(3 * (1 / 10 - 1 / 16))


def test_a_surface_that_is_inside_out_is_not_sound():
    vertices, faces = Superquadric(np.full(3, 0.03), np.ones(2)).mesh(3)
    assert mass_properties(vertices, faces).sound
    assert not mass_properties(vertices, faces[:, ::-1]).sound
