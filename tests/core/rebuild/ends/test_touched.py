from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints, stack_points
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Conic
from palpate.core.rebuild.ends.touched import (
    Shear,
    dome_height,
    edge_samples,
    end_contacts_of,
    end_plane,
    levelled,
    on_end,
    only_given,
    shear_between,
    touched_end,
    with_touched_middle,
)
from palpate.core.rebuild.side.equations import fit_axis_curve
from palpate.core.rebuild.side.radial import RadialSpline, fit_radial_spline

LAST = 0.09  # Height of the last contour, m, or of the first one below


def touches(heights: Floats, way: float = 1.0) -> ContactPoints:
    """Touches of an end at these heights, of three taxels each, two a little short of it."""
    lower = np.array([0.0, 5e-4, 1e-3])
    levels = (way * (np.asarray(heights)[:, None] - lower)).ravel()
    points = np.column_stack([np.zeros((len(levels), 2)), levels])
    normals = np.tile([0.0, 0.0, way], (len(levels), 1))
    return ContactPoints(points, normals, np.repeat(np.arange(len(heights), dtype=np.int32), 3))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_touches_that_may_be_one_height_are_averaged(way):
    contacts = touches(np.array([0.1, 0.1002, 0.0998, 0.0996, 0.097]), way)
    found = touched_end(contacts, way * LAST, way, 1.5e-4, None)
    assert found == pytest.approx(way * 0.0999)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_without_noise_the_farthest_is_the_truest(way):
    contacts = touches(np.array([0.1, 0.0999]), way)
    assert touched_end(contacts, way * LAST, way, None, way * 0.0999) == pytest.approx(way * 0.1)
    assert touched_end(contacts, way * LAST, way, None, way * 0.1001) == pytest.approx(way * 0.1001)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_end_that_is_known_to_lie_farther_is_not_pulled_in(way):
    contacts = touches(np.array([0.097]), way)
    assert touched_end(contacts, way * LAST, way, 1e-4, way * 0.1) == pytest.approx(way * 0.1)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_is_no_touch_of_the_end_tells_nothing_of_it(way):
    short = touches(np.array([0.08]), way)
    sideways = touches(np.array([0.1]), -way)._replace(points=touches(np.array([0.1]), way).points)
    for contacts in (short, sideways, touches(np.array([0.1]), way)._replace(normals=None)):
        assert not on_end(contacts, way * LAST, way).any()
        assert touched_end(contacts, way * LAST, way, 1e-4, None) is None
        assert touched_end(contacts, way * LAST, way, 1e-4, 0.1) == 0.1


def test_flat_flanks_do_not_outvote_the_tip_between_them():
    x, y = (1e-3 * part.ravel() for part in np.meshgrid(*2 * (np.arange(-3.0, 4.0),)))
    parts, normals = [], []
    for place in ((0.0, 0.0), (0.01, 0.0), (-0.01, 0.0), (0.0, 0.01), (0.0, -0.01)):
        at = np.column_stack([x, y]) + place
        steep = np.abs(at).argmax(axis=1)
        slope = np.zeros_like(at)
        slope[np.arange(len(at)), steep] = -0.3 * np.sign(at[np.arange(len(at)), steep])
        parts.append(np.column_stack([at, 0.1 + (slope * at).sum(axis=1)]))
        normals.append(np.column_stack([-slope, np.ones(len(at))]) / np.sqrt(1.09))
    contacts = ContactPoints(
        np.concatenate([*parts, [[0.05, 0.0, 0.0]]]),
        np.concatenate([*normals, [[1.0, 0.0, 0.0]]]),
        np.append(np.repeat(np.arange(5), len(x)), 0).astype(np.int32),
    )
    assert touched_end(contacts, 0.09, 1.0, None, 0.1) == pytest.approx(0.1, abs=1e-12)


RADIUS, TOP, POSE = 0.08, 0.1, 1e-4
PLACES = np.array([[0.0, 0.0], [0.01, 0.0], [-0.01, 0.0], [0.0, 0.01], [0.0, -0.01]])


def domed(shifts: Floats, way: float = 1.0) -> ContactPoints:
    """Touches of a ball's top, each off along the axis."""
    x, y = (1e-3 * part.ravel() for part in np.meshgrid(*2 * (np.arange(-4.0, 5.0),)))
    parts, normals = [], []
    for place, shift in zip(PLACES, shifts, strict=False):
        at = np.column_stack([x, y]) + place
        depth = np.sqrt(RADIUS**2 - (at**2).sum(axis=1))
        normals.append(np.column_stack([at, way * depth]) / RADIUS)
        parts.append(np.column_stack([at, way * (TOP - RADIUS + depth + shift)]))
    touch = np.repeat(np.arange(len(parts), dtype=np.int32), len(x))
    points = np.concatenate([*parts, [[0.08, 0.0, -way * 0.1]]])
    normals.append(np.array([[1.0, 0.0, 0.0]]))
    return ContactPoints(points, np.concatenate(normals), np.append(touch, 0).astype(np.int32))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_touches_beside_the_top_tell_how_high_it_is(way):
    contacts = domed(np.zeros(5), way)
    on = np.arange(len(contacts.points)) < len(contacts.points) - 1
    assert dome_height(contacts, on, way) == pytest.approx(TOP, abs=1e-5)


def test_the_errors_of_the_poses_average_out():
    rng = np.random.default_rng(0)
    off = []
    for _ in range(200):
        contacts = domed(rng.normal(0.0, POSE, 5))
        off.append(touched_end(contacts, 0.09, 1.0, POSE, None))
    errors = np.array(off, np.float64) - TOP
    assert abs(errors.mean()) < 0.15 * POSE
    assert errors.std() < 0.55 * POSE  # of the highest alone it is .67, and the mean is off by 1.2


def test_noise_that_hides_a_dome_does_not_lower_it():
    rng = np.random.default_rng(0)
    x, y = (1e-3 * part.ravel() for part in np.meshgrid(*2 * (np.arange(-5.0, 6.0),)))
    off = []
    for _ in range(60):
        parts, normals = [], []
        for place in PLACES:
            at = np.column_stack([x, y]) + place
            heights = TOP - (at**2).sum(axis=1) / 1.2 + rng.normal(0.0, POSE)
            parts.append(np.column_stack([at, heights + rng.normal(0.0, 1e-5, len(x))]))
            normals.append(np.column_stack([at / 0.6, np.ones(len(x))]))
        points = np.concatenate([*parts, [[0.08, 0.0, 0.0]]])
        touch = np.append(np.repeat(np.arange(5), len(x)), 0).astype(np.int32)
        contacts = ContactPoints(points, np.concatenate([*normals, [[1.0, 0.0, 0.0]]]), touch)
        off.append(touched_end(contacts, 0.09, 1.0, POSE, None))
    assert abs(np.mean(np.array(off, np.float64) - TOP)) < 0.3 * POSE


def test_two_touches_are_as_they_are():
    contacts = domed(np.array([0.0, 2e-5]))
    on = np.arange(len(contacts.points)) < len(contacts.points) - 1
    assert dome_height(contacts, on, 1.0) is None
    assert touched_end(contacts, 0.09, 1.0, 1e-6, None) == pytest.approx(TOP, abs=2e-5)


RIM, HEIGHT, END_MIDDLE_RADIUS = 0.06, 0.07, 0.008
TURNS = 2.0 * np.pi * np.arange(48) / 48
ROW = END_MIDDLE_RADIUS * np.column_stack([np.cos(TURNS), np.sin(TURNS)])


def _end(middle: Floats) -> End:
    return End("conic", RIM, HEIGHT, 0.0, Conic(0.0), middle, True)


def _touched(lean: Floats, turns: Floats = TURNS) -> ContactPoints:
    """Half an ellipsoid on the row, sheared by a lean."""
    way, at = (one.ravel() for one in np.meshgrid(np.linspace(0.1, 0.95, 9), turns))
    out = np.column_stack([np.cos(at), np.sin(at)])
    share = np.sqrt(1.0 - way**2)
    places = END_MIDDLE_RADIUS * share[:, None] * out + way[:, None] * lean
    # The gradient of (|xy - way lean| / RADIUS)^2 + way^2.
    level = 2.0 * share[:, None] * out / END_MIDDLE_RADIUS
    upward = (2.0 * way - level @ lean) / (HEIGHT - RIM)
    normals = np.column_stack([level, upward])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = np.column_stack([places, RIM + way * (HEIGHT - RIM)])
    return ContactPoints(points, normals, np.zeros(len(points), np.intp))


@pytest.mark.parametrize("told", [[0.0, 0.0], [0.006, -0.004]])
def test_an_end_leans_as_it_was_touched_and_not_as_the_contours_do(told):
    lean = np.array([-0.003, 0.002])
    found = with_touched_middle(_end(np.array(told)), ROW, _touched(lean))
    assert found.middle == pytest.approx(lean, abs=0.6e-3)


def test_one_side_alone_tells_of_its_own_direction():
    lean = np.array([-0.003, 0.002])
    found = with_touched_middle(_end(np.zeros(2)), ROW, _touched(lean, np.linspace(-0.2, 0.2, 9)))
    assert found.middle[0] == pytest.approx(lean[0], abs=1e-3)
    assert abs(found.middle[1]) < abs(lean[1])


def test_an_end_that_nobody_touched_stays_where_it_is():
    contacts = _touched(np.zeros(2))
    below = ContactPoints(
        contacts.points - np.array([0.0, 0.0, 0.02]), contacts.normals, contacts.touch
    )
    told = _end(np.array([0.004, 0.0]))
    assert with_touched_middle(told, ROW, below) is told
    level = replace(told, height=RIM)
    assert with_touched_middle(level, ROW, contacts) is level


def test_a_middle_far_outside_is_not_believed():
    told = _end(np.zeros(2))
    assert with_touched_middle(told, ROW, _touched(np.array([0.03, 0.0]))) is told


Make = Callable[..., Any]
NO_LEAN = np.zeros(2)
LAST_ROW, END = 0.072, 0.08  # Of a box: its edge is rounded over some 8 mm


def spline_of(contacts: ContactPoints) -> RadialSpline:
    axis_curve = fit_axis_curve(np.array([0.0, END]), np.zeros((2, 2)))
    return fit_radial_spline(contacts, axis_curve, 0.0, END)


def contacts_at(true: Any, heights: Floats) -> ContactPoints:
    sections = [true.section(height / 0.04 - 1.0) for height in heights]
    found = true.contacts_at(np.concatenate(sections))
    assert isinstance(found, ContactPoints)
    return found


def test_an_edge_is_told_as_mean_radii(oracle):
    true = oracle([0.03, 0.02, 0.04], [0.4, 0.4])
    contacts = contacts_at(true, np.linspace(0.002, 0.079, 60))
    spline = spline_of(contacts)
    found = edge_samples(contacts, spline, LAST_ROW, END, 0.02, NO_LEAN)
    assert found is not None
    assert (np.diff(found.depths) > 0.0).all() and (np.diff(found.radii) < 0.0).all()
    assert found.depths[0] > LAST_ROW and found.depths[-1] < END
    # A section of a superquadric has the same shape at every height.
    mean = true.section(LAST_ROW / 0.04 - 1.0)[0, 0]
    there = [true.section(height / 0.04 - 1.0)[0, 0] / mean for height in found.depths]
    assert np.abs(found.radii / 0.02 - there).max() < 0.03


def test_what_was_touched_next_to_the_last_row_alone_tells_nothing(oracle):
    true = oracle([0.03, 0.02, 0.04], [0.4, 0.4])
    contacts = contacts_at(
        true, np.append(np.linspace(0.002, 0.072, 40), np.nextafter(LAST_ROW, 1.0))
    )
    assert edge_samples(contacts, spline_of(contacts), LAST_ROW, END, 0.02, NO_LEAN) is None


def test_what_was_touched_on_one_side_alone_tells_nothing(oracle):
    true = oracle([0.03, 0.02, 0.04], [0.4, 0.4])
    contacts = contacts_at(true, np.linspace(0.002, 0.079, 60))
    assert contacts.normals is not None
    aside = (contacts.points[:, 0] > 0.0) & (
        np.abs(contacts.points[:, 1]) < 0.4 * contacts.points[:, 0]
    )
    kept = (contacts.points[:, 2] < LAST_ROW) | aside
    less = ContactPoints(contacts.points[kept], contacts.normals[kept], contacts.touch[kept])
    assert edge_samples(less, spline_of(contacts), LAST_ROW, END, 0.02, NO_LEAN) is None


def test_a_surface_that_leans_over_the_end_has_no_edge_to_tell_of(oracle):
    true = oracle([0.03, 0.03, 0.04], [1.0, 1.0])
    heights = np.append(np.linspace(0.002, 0.077, 60), np.linspace(0.0772, 0.0798, 14))
    contacts = contacts_at(true, heights)
    spline = spline_of(contacts)
    assert edge_samples(contacts, spline, 0.077, END, 0.01, NO_LEAN) is None
    assert edge_samples(contacts, spline, 0.06, END, 0.02, NO_LEAN) is not None


TOUCHED = [(0.0, 0.0), (0.012, 0.0), (-0.012, 0.0), (0.0, 0.012), (0.0, -0.012)]
SLOPES = np.array([0.1, -0.05])
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
    parts = [touch(place, 0.08 + rng.normal(0.0, pose), slopes) for place in TOUCHED]
    parts = [one._replace(points=one.points + rng.normal(0.0, noise, (49, 3))) for one in parts]
    return stack_points([sides(), *parts])


@pytest.mark.parametrize("pose", [0.0, 1e-4])
def test_a_plane_leans_as_its_touches_do_whatever_the_error_of_their_places(pose):
    found = end_plane(top_contacts(SLOPES, pose=pose), 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(SLOPES, abs=1e-12)
    assert found.height == pytest.approx(0.08, abs=2.0 * pose + 1e-12)


def test_noise_of_taxels_leaves_a_slope_that_it_is_sure_of():
    found = end_plane(top_contacts(SLOPES, noise=NOISE), 1.0)
    assert found is not None
    assert np.abs(found.slopes - SLOPES).max() < 4.0 * found.error < 4e-3


def test_a_touch_across_an_edge_tells_nothing():
    bent = touch((0.016, 0.0), 0.08, SLOPES)
    beyond = bent.points[:, 0] > 0.017
    bent.points[beyond, 2] -= 3e-4
    contacts = stack_points([top_contacts(SLOPES, noise=1e-6), bent])
    assert [one.kind == "flat" for one in end_contacts_of(contacts, 1.0)] == [True] * 5 + [False]
    found = end_plane(contacts, 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(SLOPES, abs=1e-3)


def test_taxels_in_a_line_tell_nothing_of_a_slope():
    row = touch((0.0, 0.0), 0.08, SLOPES)
    at = np.column_stack([np.linspace(-0.005, 0.005, 49), np.zeros(49)])
    row.points[:] = np.column_stack([at, 0.08 + at @ SLOPES])
    contacts = stack_points([top_contacts(SLOPES), row])
    assert [one.kind for one in end_contacts_of(contacts, 1.0)] == ["flat"] * 5 + ["edge"]


def test_a_dome_that_one_touch_finds_flat_is_no_plane():
    parts = [touch(TOUCHED[0], 0.08, SLOPES)]
    for place in TOUCHED[1:]:
        one = touch(place, 0.08, SLOPES)
        one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.3
        parts.append(one)
    contacts = stack_points([sides(), *parts])
    assert [one.kind for one in end_contacts_of(contacts, 1.0)] == ["flat"] + ["bent"] * 4
    assert end_plane(contacts, 1.0) is None


def test_a_ledge_below_the_top_tells_nothing():
    ledge = touch((0.01, 0.01), 0.04, np.zeros(2))
    found = end_plane(stack_points([top_contacts(SLOPES), ledge]), 1.0)
    assert found is not None
    assert found.slopes == pytest.approx(SLOPES, abs=1e-12)


def test_a_dome_is_no_plane():
    parts = []
    for place in TOUCHED:
        one = touch(place, 0.08, np.zeros(2))
        one.points[:, 2] -= (one.points[:, :2] ** 2).sum(axis=1) / 0.08
        parts.append(one)
    contacts = stack_points([sides(), *parts])
    assert {one.kind for one in end_contacts_of(contacts, 1.0)} == {"bent"}
    assert end_plane(contacts, 1.0) is None
    assert shear_between(contacts, np.zeros(2), (0.0, None)) is None


def test_a_plane_over_which_something_stands_out_is_no_end():
    knob = sides()._replace(points=sides().points * [0.2, 0.2, 1.0] + [0.0, 0.0, 0.01])
    assert end_plane(stack_points([top_contacts(SLOPES), knob]), 1.0) is None


def test_between_a_platform_and_an_oblique_top_the_shear_grows():
    contacts = top_contacts(SLOPES)
    low = np.array([0.0, 0.0, -1e-3])
    found = shear_between(contacts, np.zeros(2), (low[2], None))
    assert found is not None
    assert found.steepness(-1e-3) == pytest.approx(0.0, abs=1e-12)
    assert found.slopes + 0.08 * found.change == pytest.approx(SLOPES)
    top = np.asarray(found.levelled_contacts(contacts).points)[400:]
    assert np.ptp(top[:, 2]) < 1e-12


def test_two_ends_that_lean_alike_make_the_same_shear_everywhere():
    bottom = [touch(place, 0.0, SLOPES, -1.0) for place in TOUCHED]
    found = shear_between(stack_points([top_contacts(SLOPES), *bottom]), np.zeros(2), (None, None))
    assert found is not None
    assert found.change == pytest.approx(np.zeros(2), abs=1e-12)
    assert found.slopes == pytest.approx(SLOPES)


def test_level_ends_are_left_as_they_are():
    assert shear_between(top_contacts(np.zeros(2)), np.zeros(2), (0.0, None)) is None
    assert shear_between(top_contacts(np.zeros(2), noise=NOISE), np.zeros(2), (0.0, None)) is None


def test_an_object_that_leans_as_a_whole_is_not_sheared_but_turned():
    lean = np.arctan(0.2)  # more than an axis is ever off
    turn = np.array(
        [[np.cos(lean), 0.0, np.sin(lean)], [0.0, 1.0, 0.0], [-np.sin(lean), 0.0, np.cos(lean)]]
    )
    bottom = [touch(place, 0.0, np.zeros(2), -1.0) for place in TOUCHED]
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
    contacts = top_contacts(SLOPES)
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
    contacts, away = top_contacts(SLOPES), np.array([1.0, -2.0, 0.5])
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
    found = end_plane(stack_points([touch(place, 0.0, np.zeros(2)) for place in TOUCHED]), 1.0)
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
