from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints
from palpate.core.rebuild.ends.closing import End
from palpate.core.rebuild.ends.profiles import Conic
from palpate.core.rebuild.ends.touched import (
    dome_height,
    edge_samples,
    on_end,
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


def _felt(lean: Floats, turns: Floats = TURNS) -> ContactPoints:
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
    found = with_touched_middle(_end(np.array(told)), ROW, _felt(lean))
    assert found.middle == pytest.approx(lean, abs=0.6e-3)


def test_one_side_alone_tells_of_its_own_direction():
    lean = np.array([-0.003, 0.002])
    found = with_touched_middle(_end(np.zeros(2)), ROW, _felt(lean, np.linspace(-0.2, 0.2, 9)))
    assert found.middle[0] == pytest.approx(lean[0], abs=1e-3)
    assert abs(found.middle[1]) < abs(lean[1])


def test_an_end_that_nobody_touched_stays_where_it_is():
    contacts = _felt(np.zeros(2))
    below = ContactPoints(
        contacts.points - np.array([0.0, 0.0, 0.02]), contacts.normals, contacts.touch
    )
    told = _end(np.array([0.004, 0.0]))
    assert with_touched_middle(told, ROW, below) is told
    level = replace(told, height=RIM)
    assert with_touched_middle(level, ROW, contacts) is level


def test_a_middle_far_outside_is_not_believed():
    told = _end(np.zeros(2))
    assert with_touched_middle(told, ROW, _felt(np.array([0.03, 0.0]))) is told


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
