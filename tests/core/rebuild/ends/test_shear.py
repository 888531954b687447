from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints, stack_points
from palpate.core.rebuild.ends.touched import (
    Shear,
    end_contacts_of,
    end_plane,
    levelled,
    only_given,
    shear_between,
)

PLACES = [(0.0, 0.0), (0.012, 0.0), (-0.012, 0.0), (0.0, 0.012), (0.0, -0.012)]
TOP = np.array([0.1, -0.05])
NOISE = 1e-5


def touch(
    place: tuple[float, float], height: float, slopes: Floats, way: float = 1.0
) -> ContactPoints:
    """A touch of 49 taxels of a plane; its height is that on the axis."""
    x, y = np.meshgrid(*2 * (1e-3 * np.arange(-3, 4),), indexing="ij")
    at = np.column_stack([x.ravel(), y.ravel()]) + place
    normal = way * np.array([-slopes[0], -slopes[1], 1.0])
    normals = np.tile(normal / np.linalg.norm(normal), (49, 1))
    points = np.column_stack([at, height + at @ slopes])
    return ContactPoints(points, normals, np.zeros(49, np.int32))


def sides(shear: Shear | None = None) -> ContactPoints:
    """A ring of an upright column of 20 mm, from 0 to 80 mm."""
    turns = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    out = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(400)])
    heights = np.linspace(0.0, 0.08, 400)
    points = 0.02 * out + np.column_stack([np.zeros((400, 2)), heights])
    return ContactPoints(points, out, np.zeros(400, np.int32))


def top_contacts(slopes: Floats, *, pose: float = 0.0, noise: float = 0.0) -> ContactPoints:
    rng = np.random.default_rng(0)
    parts = [touch(place, 0.08 + rng.normal(0.0, pose), slopes) for place in PLACES]
    parts = [one._replace(points=one.points + rng.normal(0.0, noise, (49, 3))) for one in parts]
    return stack_points([sides(), *parts])


@pytest.mark.parametrize("pose", [0.0, 1e-4])
def test_a_plane_leans_as_its_touches_do_whatever_the_error_of_their_places(pose):
    found = end_plane(top_contacts(TOP, pose=pose), 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(TOP, abs=1e-12)
    assert found.height == pytest.approx(0.08, abs=2.0 * pose + 1e-12)


def test_noise_of_taxels_leaves_a_slope_that_it_is_sure_of():
    found = end_plane(top_contacts(TOP, noise=NOISE), 1.0)
    assert found is not None
    assert np.abs(found.slopes - TOP).max() < 4.0 * found.error < 4e-3


def test_a_touch_across_an_edge_tells_nothing():
    bent = touch((0.016, 0.0), 0.08, TOP)
    beyond = bent.points[:, 0] > 0.017
    bent.points[beyond, 2] -= 3e-4
    contacts = stack_points([top_contacts(TOP, noise=1e-6), bent])
    assert [one.kind == "flat" for one in end_contacts_of(contacts, 1.0)] == [True] * 5 + [False]
    found = end_plane(contacts, 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(TOP, abs=1e-3)


def test_taxels_in_a_line_tell_nothing_of_a_slope():
    row = touch((0.0, 0.0), 0.08, TOP)
    at = np.column_stack([np.linspace(-0.005, 0.005, 49), np.zeros(49)])
    row.points[:] = np.column_stack([at, 0.08 + at @ TOP])
    contacts = stack_points([top_contacts(TOP), row])
    assert [one.kind for one in end_contacts_of(contacts, 1.0)] == ["flat"] * 5 + ["edge"]


def test_a_dome_that_one_touch_finds_flat_is_no_plane():
    parts = [touch(PLACES[0], 0.08, TOP)]
    for place in PLACES[1:]:
        one = touch(place, 0.08, TOP)
        one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.3
        parts.append(one)
    contacts = stack_points([sides(), *parts])
    assert [one.kind for one in end_contacts_of(contacts, 1.0)] == ["flat"] + ["bent"] * 4
    assert end_plane(contacts, 1.0) is None


def test_a_ledge_below_the_top_tells_nothing():
    ledge = touch((0.01, 0.01), 0.04, np.zeros(2))
    found = end_plane(stack_points([top_contacts(TOP), ledge]), 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(TOP, abs=1e-12)


def test_a_dome_is_no_plane():
    parts = []
    for place in PLACES:
        one = touch(place, 0.08, np.zeros(2))
        one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.08
        parts.append(one)
    contacts = stack_points([sides(), *parts])
    assert {one.kind for one in end_contacts_of(contacts, 1.0)} == {"bent"}
    assert end_plane(contacts, 1.0) is None
    assert shear_between(contacts, np.zeros(2), (0.0, None)) is None


def test_a_plane_over_which_something_stands_out_is_no_end():
    knob = sides()._replace(points=sides().points * [0.2, 0.2, 1.0] + [0.0, 0.0, 0.01])
    assert end_plane(stack_points([top_contacts(TOP), knob]), 1.0) is None


def test_between_a_platform_and_an_oblique_top_the_shear_grows():
    contacts = top_contacts(TOP)
    low = np.array([0.0, 0.0, -1e-3])
    found = shear_between(contacts, np.zeros(2), (low[2], None))
    assert found is not None
    assert found.steepness(-1e-3) == pytest.approx(0.0, abs=1e-12)
    assert found.slopes + 0.08 * found.change == pytest.approx(TOP)
    top = np.asarray(found.levelled_contacts(contacts).points)[400:]
    assert np.ptp(top[:, 2]) < 1e-12


def test_two_ends_that_lean_alike_make_the_same_shear_everywhere():
    bottom = [touch(place, 0.0, TOP, -1.0) for place in PLACES]
    found = shear_between(stack_points([top_contacts(TOP), *bottom]), np.zeros(2), (None, None))
    assert found is not None
    assert found.change == pytest.approx(np.zeros(2), abs=1e-12)
    assert found.slopes == pytest.approx(TOP)


def test_level_ends_are_left_as_they_are():
    assert shear_between(top_contacts(np.zeros(2)), np.zeros(2), (0.0, None)) is None
    assert shear_between(top_contacts(np.zeros(2), noise=NOISE), np.zeros(2), (0.0, None)) is None


def test_an_object_that_leans_as_a_whole_is_not_sheared_but_turned():
    lean = np.arctan(0.2)  # more than an axis is ever off
    turn = np.array(
        [[np.cos(lean), 0.0, np.sin(lean)], [0.0, 1.0, 0.0], [-np.sin(lean), 0.0, np.cos(lean)]]
    )
    bottom = [touch(place, 0.0, np.zeros(2), -1.0) for place in PLACES]
    contacts = stack_points([top_contacts(np.zeros(2)), *bottom])
    leaning = contacts._replace(
        points=contacts.points @ turn.T, normals=np.asarray(contacts.normals) @ turn.T
    )
    assert end_plane(leaning, 1.0) is not None
    assert shear_between(leaning, np.zeros(2), (None, None)) is None


def test_an_end_that_no_taxel_faces_is_only_given():
    level = top_contacts(np.zeros(2))
    assert only_given(level, -1.0, 0.0)
    assert only_given(level, 1.0, 0.081)
    assert not only_given(level, 1.0, 0.08)
    assert not only_given(level, -1.0, None)


@pytest.mark.parametrize("low", [0.0, -1e-5])
def test_a_taxel_of_the_side_on_the_platform_or_below_leaves_that_level(low):
    contacts = top_contacts(TOP)
    one = contacts.points[:1] * [1.0, 1.0, 0.0] + [0.0, 0.0, low]
    more = contacts._replace(
        points=np.concatenate([contacts.points, one]),
        normals=np.concatenate([np.asarray(contacts.normals), [[1.0, 0.0, 0.0]]]),
        touch=np.append(contacts.touch, 0).astype(np.int32),
    )
    found = shear_between(more, np.zeros(2), (0.0, None))
    assert found is not None
    assert found.steepness(0.0) == pytest.approx(0.0, abs=1e-12)


def test_both_flanks_of_a_gable_are_no_plane():
    flanks = [np.array([0.3, 0.0]), np.array([-0.3, 0.0])]
    parts = [
        touch((way * away, 0.004 * k), 0.08, flanks[int(way > 0)])
        for way in (1.0, -1.0)
        for k, away in enumerate((0.006, 0.01, 0.014))
    ]
    assert end_plane(stack_points([sides(), *parts]), 1.0) is None


def test_the_shear_moves_and_grows_with_the_object():
    contacts, away = top_contacts(TOP), np.array([1.0, -2.0, 0.5])
    one = shear_between(contacts, np.zeros(2), (None, None))
    moved = contacts._replace(points=1e3 * (contacts.points + away))
    other = shear_between(moved, 1e3 * away[:2], (None, None))
    assert one is not None and other is not None
    expected = 1e3 * (one.levelled(contacts.points) + away)
    found = other.levelled(moved.points)
    assert np.ptp(found - expected, axis=0) == pytest.approx(np.zeros(3), abs=1e-6)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e9])
def test_a_dome_is_bent_in_any_unit(scale):
    one = touch((0.0, 0.0), 0.08, np.zeros(2))
    one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.08
    contacts = stack_points([one])
    [contact] = end_contacts_of(contacts._replace(points=scale * contacts.points), 1.0)
    assert contact.kind == "bent"


def test_taxels_of_one_height_are_a_plane():
    found = end_plane(stack_points([touch(place, 0.0, np.zeros(2)) for place in PLACES]), 1.0)
    assert found is None or found.slopes == pytest.approx(np.zeros(2), abs=1e-12)


SHEAR = Shear(np.array([0.01, -0.02]), np.array([0.2, -0.1]), np.array([1.5, 0.8]))
STEP = 1e-6


def ball(v: Floats, turns: Floats) -> Floats:
    """A ball of 30 mm, (n, 3)."""
    polar, around = np.pi * v, 2.0 * np.pi * turns
    level = 0.03 * np.sin(polar)
    z = 0.05 - 0.03 * np.cos(polar)
    return np.column_stack([level * np.cos(around), level * np.sin(around), z])


def differences(v: Floats, turns: Floats, by: tuple[int, int]) -> Floats:
    """Derivatives of the ball by central differences, which are linear in it."""
    if by == (0, 0):
        return ball(v, turns)
    one = (1, 0) if by[0] else (0, 1)
    rest = by[0] - one[0], by[1] - one[1]
    ahead = differences(v + STEP * one[0], turns + STEP * one[1], rest)
    behind = differences(v - STEP * one[0], turns - STEP * one[1], rest)
    return (ahead - behind) / (2.0 * STEP)


@pytest.fixture
def places() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(0)
    return rng.uniform(0.1, 0.9, 40), rng.uniform(0.0, 1.0, 40)


def test_points_come_back_from_the_levelled_space(places):
    points = ball(*places)
    assert SHEAR.sheared(SHEAR.levelled(points)) == pytest.approx(points, abs=1e-15)
    assert SHEAR.levelled(SHEAR.sheared(points)) == pytest.approx(points, abs=1e-15)
    assert np.array_equal(SHEAR.sheared(points)[:, :2], points[:, :2])


def test_what_is_level_in_the_levelled_space_is_as_steep_as_it_tells():
    level = np.column_stack(
        [np.random.default_rng(1).normal(0.0, 0.02, (30, 2)), np.full(30, 0.04)]
    )
    sheared = SHEAR.sheared(level)
    rows = np.column_stack([np.ones(30), level[:, :2]])
    plane, left = np.linalg.lstsq(rows, sheared[:, 2], rcond=None)[:2]
    assert left == pytest.approx(0.0, abs=1e-28)
    assert plane[1:] == pytest.approx(SHEAR.slopes + 0.04 * SHEAR.change)
    assert np.hypot(*plane[1:]) == pytest.approx(SHEAR.steepness(0.04))


@pytest.mark.parametrize("by", [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)])
def test_derivatives_are_those_of_the_sheared_surface(places, by):
    found = SHEAR.carried(lambda order: differences(*places, order), by)
    one = (1, 0) if by[0] else (0, 1)
    rest = by[0] - one[0], by[1] - one[1]

    def below(sign: float) -> Floats:
        v, turns = places[0] + sign * STEP * one[0], places[1] + sign * STEP * one[1]
        return SHEAR.carried(lambda order: differences(v, turns, order), rest)

    expected = (below(1.0) - below(-1.0)) / (2.0 * STEP)
    assert found == pytest.approx(expected, abs=1e-9 if sum(by) == 1 else 2e-3)


def test_normals_are_square_to_the_surface_on_both_sides(places):
    tangents = [
        SHEAR.carried(lambda order: differences(*places, order), by) for by in ((1, 0), (0, 1))
    ]
    normals = np.cross(tangents[1], tangents[0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    contacts = ContactPoints(SHEAR.sheared(ball(*places)), normals, np.zeros(40, np.int32))
    found = levelled(SHEAR, contacts)
    assert found.points == pytest.approx(ball(*places), abs=1e-15)
    outwards = (ball(*places) - [0.0, 0.0, 0.05]) / 0.03
    assert np.asarray(found.normals) == pytest.approx(outwards, abs=1e-8)


def test_nothing_changes_without_a_shear_or_without_normals(places):
    contacts = ContactPoints(ball(*places), None, np.zeros(40, np.int32))
    assert levelled(None, contacts) is contacts
    assert levelled(SHEAR, contacts).normals is None
