from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.explore.slicing_frame import SlicingFrame, slicing_frame
from palpate.core.frames import pose_of, split_pose
from palpate.core.rebuild.coarse import fit_coarse
from palpate.core.shapes.superquadric import Superquadric

NOISE = 1e-4
ELLIPSOID = Superquadric(np.array([0.02, 0.028, 0.042]), np.ones(2))
TILE = Superquadric(np.array([0.04, 0.04, 0.012]), np.array([0.2, 1.0]))
BALL = Superquadric(np.full(3, 0.03), np.ones(2))


def about_x(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def contacts(shape: Superquadric, turn: Floats, place: Floats) -> tuple[Floats, Floats, float]:
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


def frame_of(shape: Superquadric, turn: Floats, place: Floats) -> SlicingFrame:
    points, normals, platform = contacts(shape, turn, place)
    return slicing_frame(fit_coarse(points, NOISE), points, normals, platform, NOISE)


PLACE = np.array([0.03, -0.01, 0.05])


@pytest.mark.parametrize("degrees", [25.0, 60.0, 90.0, 140.0])
def test_a_tilted_object_is_sliced_along_its_longest_axis(degrees: float) -> None:
    turn = about_x(math.radians(degrees))
    found = frame_of(ELLIPSOID, turn, PLACE)
    origin, axes = split_pose(found.pose)

    assert found.axis == "longest"
    assert np.linalg.norm(np.cross(axes[:, 2], turn[:, 2])) < math.radians(0.5)
    assert origin == pytest.approx(PLACE, abs=3e-4)
    assert (found.low, found.high) == pytest.approx((-0.042, 0.042), abs=3e-4)
    assert found.radius == pytest.approx(0.028, abs=3e-4)
    assert axes[2, 2] > -1e-9  # it points up


def test_a_tile_is_sliced_along_its_shortest_axis_or_that_of_revolution() -> None:
    turn = about_x(0.5)
    found = frame_of(TILE, turn, PLACE)

    assert found.axis in ("shortest", "revolution")
    assert np.linalg.norm(np.cross(split_pose(found.pose)[1][:, 2], turn[:, 2])) < 0.01


def test_an_object_that_stands_upright_is_sliced_in_the_worlds_axes_and_heights() -> None:
    found = frame_of(ELLIPSOID, about_x(math.radians(0.4)), PLACE)
    origin, axes = split_pose(found.pose)

    assert np.array_equal(axes, np.eye(3))
    assert origin == pytest.approx([0.03, -0.01, 0.0], abs=3e-4)
    assert (found.low, found.high) == pytest.approx((0.008, 0.092), abs=3e-4)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.6, 0.0, 0.8)])
def test_a_given_axis_is_taken(axis: tuple[float, float, float]) -> None:
    points, normals, platform = contacts(ELLIPSOID, about_x(0.5), PLACE)
    fit = fit_coarse(points, NOISE)
    found = slicing_frame(fit, points, normals, platform, NOISE, np.array(axis))

    assert (found.axis, found.axis_error) == ("given", 0.0)
    assert split_pose(found.pose)[1][:, 2] == pytest.approx(axis, abs=1e-12)
    reach = np.linalg.norm(about_x(0.5).T @ axis * [0.02, 0.028, 0.042])
    # Along an axis of no symmetry its ends are less certain, and it says so.
    assert abs(found.high - found.low - 2.0 * reach) < 2.0 * found.extent_error < 2e-3


def test_a_ball_has_no_axis_and_says_so() -> None:
    found = frame_of(BALL, about_x(0.5), PLACE)

    assert found.ambiguous
    assert np.array_equal(found.pose[3:], [0.0, 0.0, 0.0, 1.0])
    assert found.radius == pytest.approx(0.03, abs=3e-4)


def test_an_object_moved_and_turned_about_the_vertical_takes_its_frame_along() -> None:
    one = frame_of(ELLIPSOID, about_x(0.5), PLACE)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    other = frame_of(ELLIPSOID, quarter @ about_x(0.5), quarter @ PLACE + [0.1, 0.2, 0.3])

    axes = [split_pose(frame.pose)[1][:, 2] for frame in (one, other)]
    assert axes[1] == pytest.approx(quarter @ axes[0], abs=2e-3)
    assert other.pose[:3] == pytest.approx(quarter @ one.pose[:3] + [0.1, 0.2, 0.3], abs=2e-4)
    assert other.high - other.low == pytest.approx(one.high - one.low, abs=2e-4)


def test_a_lying_object_points_the_same_way_however_it_was_turned() -> None:
    for degrees in (90.0, -90.0):
        axes = split_pose(frame_of(ELLIPSOID, about_x(math.radians(degrees)), PLACE).pose)[1]
        assert abs(axes[1, 2]) == pytest.approx(1.0, abs=1e-4)
        assert np.linalg.det(axes) == pytest.approx(1.0)


def test_few_contacts_give_an_upright_frame_about_them() -> None:
    points, normals, platform = contacts(ELLIPSOID, np.eye(3), PLACE)
    few = points[:6]
    found = slicing_frame(fit_coarse(few, NOISE), few, normals[:6], platform, NOISE)

    assert found.ambiguous
    assert (found.low, found.high) == (platform, few[:, 2].max())
    assert found.extent_error > 0.01


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_an_axis_is_taken_even_if_contacts_tell_nothing(axis: tuple[float, float, float]) -> None:
    points, normals, platform = contacts(ELLIPSOID, np.eye(3), PLACE)
    few = points[:6]
    fit = fit_coarse(few, NOISE)
    found = slicing_frame(fit, few, normals[:6], platform, NOISE, np.array(axis))

    assert found.axis == "given"
    assert split_pose(found.pose)[1][:, 2] == pytest.approx(np.abs(axis), abs=1e-12)
    assert found.high > found.low


def test_a_fit_that_came_to_a_bound_makes_the_axis_less_certain() -> None:
    points, normals, platform = contacts(ELLIPSOID, about_x(0.5), PLACE)
    found = fit_coarse(points, NOISE)
    strained = replace(found, doubts=("at a bound",))
    sure, unsure = (
        slicing_frame(fit, points, normals, platform, NOISE) for fit in (found, strained)
    )

    assert unsure.ambiguous or unsure.axis_error == pytest.approx(6.0 * sure.axis_error)


def test_the_same_contacts_give_the_same_frame() -> None:
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
def test_what_is_no_grasp_is_refused(count: int, normals: Floats, noise: float, words: str) -> None:
    points = contacts(ELLIPSOID, np.eye(3), PLACE)[0]
    found = fit_coarse(points, NOISE)

    with pytest.raises(ValueError, match=words):
        slicing_frame(found, points[:count], normals, 0.0, noise)


def test_a_pose_of_the_world_is_the_worlds() -> None:
    found = frame_of(ELLIPSOID, np.eye(3), np.array([0.0, 0.0, 0.042]))

    assert found.pose == pytest.approx(pose_of(np.zeros(3), np.eye(3)), abs=3e-4)
