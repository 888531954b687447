from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline

from palpate.core.arrays import Floats
from palpate.core.shapes.generalised_cylinders import (
    GeneralisedCylinder,
    Section,
    SplineSection,
    SuperellipseSection,
    natural_spline,
    periodic_spline,
    profile_mesh,
    straight_pieces,
)
from palpate.core.shapes.protocol import INSIDE, MISS

RADII = np.array([0.03, 0.022, 0.031, 0.025, 0.028])
HEIGHTS, SCALES = np.array([0.0, 0.03, 0.05, 0.09]), np.array([1.0, 1.3, 0.5, 0.7])
ROUND = SuperellipseSection(np.array([0.03, 0.03]), 1.0)
DOWN, SIDEWAYS = np.array([0.0, 0.0, -1.0]), np.array([-1.0, 0.0, 0.0])
CYLINDER = GeneralisedCylinder(ROUND, np.array([0.0, 0.1]), np.ones(2))
CONE = GeneralisedCylinder(ROUND, np.array([0.0, 0.09]), np.array([1.0, 0.0]))
VASE = GeneralisedCylinder(SplineSection(RADII), HEIGHTS, SCALES, smooth=True)
CASES: dict[str, tuple[bool, bool, float, float]] = {
    "smooth": (True, True, 0.0, 0.0),
    "kinked": (True, False, 0.0, 0.0),
    "leaning": (True, True, 0.5, 2.0),
    "superellipse": (False, False, -0.3, 1.0),
}


def made(name):
    """A solid, and the function of which it is the zero set by its definition."""
    spline, smooth, tilt, towards = CASES[name]
    section = SplineSection(RADII) if spline else SuperellipseSection(np.array([0.03, 0.02]), 0.4)
    solid = GeneralisedCylinder(section, HEIGHTS, SCALES, smooth, tilt, towards)
    knots = np.linspace(0, 2 * math.pi, len(RADII) + 1)
    rho = CubicSpline(knots, np.append(RADII, RADII[0]), bc_type="periodic")
    scale = CubicSpline(HEIGHTS, SCALES, bc_type="natural")

    def level(points):
        x, y, z = np.moveaxis(points, -1, 0)
        along = z / np.cos(np.longdouble(tilt))
        x = x - along * np.sin(np.longdouble(tilt)) * math.cos(towards)
        y = y - along * np.sin(np.longdouble(tilt)) * math.sin(towards)
        if spline:
            gauge = np.hypot(x, y) / rho(np.mod(np.arctan2(y, x), 2 * math.pi).astype(float))
        else:
            gauge = (np.abs(x / 0.03) ** 5 + np.abs(y / 0.02) ** 5) ** (1 / np.longdouble(5))
        clipped = np.clip(along.astype(float), 0.0, 0.09)
        size = scale(clipped) if smooth else np.interp(clipped, HEIGHTS, SCALES)
        end = np.maximum(-along, along - 0.09) / solid._half[0]
        return np.maximum(gauge - size, end)

    return solid, level


@pytest.mark.parametrize("name", CASES)
def test_casts_pass_nothing(name, cast_check):
    (solid, level), rng, met = made(name), np.random.default_rng(2), 0
    low, high = solid.enclosure()
    for number in range(9):
        towards = rng.normal(size=3) if number % 3 else np.eye(3)[number // 3]
        towards /= np.linalg.norm(towards)
        places = rng.uniform(low - 0.005, high + 0.005, (40, 3))
        origins = places - rng.choice([0.0, 0.12], 40)[:, None] * towards
        met += cast_check(solid, level, origins, towards, 0.25)
    assert met > 40


@given(seed=st.integers(0, 999), scale=st.floats(0.1, 30.0), turns=st.integers(0, 4))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_size_and_turns_carry_over_to_the_ranges(seed: int, scale: float, turns: int) -> None:
    other = GeneralisedCylinder(
        SplineSection(scale * np.roll(RADII, turns)), scale * HEIGHTS, SCALES, smooth=True
    )
    rng = np.random.default_rng(seed)
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    origins = [0, 0, 0.045] + rng.uniform(-0.04, 0.04, (60, 3)) - 0.1 * towards
    angle = 2 * math.pi * turns / len(RADII)
    turn = np.array([[math.cos(angle), math.sin(angle), 0], [-math.sin(angle), math.cos(angle), 0]])
    matrix = np.vstack([turn, [0, 0, 1]])
    wanted = VASE.cast(origins, towards, 1.0)
    found = other.cast(scale * origins @ matrix, towards @ matrix, scale) / scale
    assert (np.isfinite(found) == np.isfinite(wanted)).mean() > 0.98
    both = np.isfinite(found) & np.isfinite(wanted)
    assert np.allclose(found[both], wanted[both], rtol=0, atol=1e-10)


def test_a_cylinder_and_a_cone_are_met_where_they_are():
    origins = np.array([[0.1, 0.0, 0.05], [0.1, 0.018, 0.05], [0.1, 0.0, 0.0], [0.1, 0.0, 0.1]])
    assert np.allclose(
        CYLINDER.cast(origins, SIDEWAYS, 1.0), [0.07, 0.076, 0.07, 0.07], rtol=0, atol=1e-15
    )
    heights = np.array([0.0, 0.03, 0.06, 0.089999])
    origins = np.column_stack([np.full(4, 0.1), np.zeros(4), heights])
    wanted = 0.1 - 0.03 * (1 - heights / 0.09)
    assert np.allclose(CONE.cast(origins, SIDEWAYS, 1.0), wanted, rtol=0, atol=1e-15)
    below = np.column_stack([np.array([0.0, 0.01, 0.02999, 0.03001]), np.zeros(4), np.full(4, 0.2)])
    found = CONE.cast(below, DOWN, 1.0)
    assert np.allclose(found[:3], [0.11, 0.14, 0.2 - 0.03e-3], rtol=0, atol=1e-9)
    assert found[3] == MISS


def test_the_plane_ends_are_met_and_left():
    origins = np.array([[0.01, 0.0, 0.2], [0.0299999, 0.0, 0.2], [0.0300001, 0.0, 0.2]])
    found = CYLINDER.cast(origins, DOWN, 1.0)
    assert np.allclose(found[:2], 0.1, rtol=0, atol=1e-13)
    assert found[2] == MISS
    assert np.allclose(CYLINDER.cast(-origins, -DOWN, 1.0)[:2], 0.2, rtol=0, atol=1e-13)
    assert CYLINDER.cast(np.array([[0.0, 0.0, 0.05]]), DOWN, 1.0)[0] == INSIDE
    assert CYLINDER.cast(np.array([[0.0, 0.0, -0.001]]), DOWN, 1.0)[0] == MISS
    assert CYLINDER.cast(np.array([[0.1, 0.0, 0.05]]), SIDEWAYS, 0.0699)[0] == MISS


def test_a_ray_along_the_axis_and_one_through_the_apex_are_told():
    axis = np.array([[0.0, 0.0, 0.2]])
    for solid, top in ((CYLINDER, 0.1), (CONE, 0.09), (VASE, 0.09)):
        assert solid.cast(axis, DOWN, 1.0)[0] == pytest.approx(0.2 - top, abs=1e-11)
    past = np.array([[0.1, 1e-7, 0.09 - 1e-9], [0.1, 0.0, 0.09 + 1e-9]])
    assert (CONE.cast(past, SIDEWAYS, 1.0) == MISS).all()


def test_the_linear_cylinder_is_a_cone_cut_off():
    """Fung, 1999, (1.4): the radius is (A z + B) lambda(theta)."""
    a, b = -4.0, 1.0
    heights = np.array([0.02, 0.1])
    solid = GeneralisedCylinder(SplineSection(RADII), heights, a * heights + b)
    places = np.linspace(0.021, 0.099, 7)
    origins = np.column_stack([np.full(7, 0.1), np.zeros(7), places])
    wanted = 0.1 - RADII[0] * (a * places + b)
    assert np.allclose(solid.cast(origins, SIDEWAYS, 1.0), wanted, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", CASES)
def test_meshes_are_closed_and_lie_on_the_surface(name, is_closed, signed_volume):
    solid, _ = made(name)
    mesh = solid.mesh(4)
    assert is_closed(mesh)
    assert signed_volume(mesh) > 0.0
    level = solid.inside_out(mesh.vertices, np.zeros_like(mesh.vertices))[0]
    assert np.abs(level).max() < 1e-12
    low, high = solid.enclosure()
    assert ((mesh.vertices >= low - 1e-12) & (mesh.vertices <= high + 1e-12)).all()
    assert np.allclose(solid.bounds()[:, 2], [low[2], high[2]], rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", CASES)
def test_spans_and_slopes_agree_with_the_function(name):
    (solid, level), rng = made(name), np.random.default_rng(6)
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    low, high = solid.enclosure()
    origins = rng.uniform(low, high, (40, 3)) - rng.choice([0, 0.1], 40)[:, None] * towards
    spans = solid.spans(origins, towards)
    ways = np.linspace(0.0, 0.25, 801)
    points = origins[:, None] + ways[:, None] * towards
    seen = level(points.astype(np.longdouble)).astype(float)
    within = ((ways >= spans[..., :1]) & (ways <= spans[..., 1:])).any(axis=1)
    assert (within == (seen <= 0))[np.abs(seen) > 1e-6].all()
    flat = points.reshape(-1, 3)
    value, slope = solid.inside_out(flat, np.broadcast_to(towards, flat.shape))
    assert np.allclose(value, seen.ravel(), rtol=0, atol=1e-11)
    step = 1e-8
    there, back = (solid.inside_out(flat + s * towards, 0 * flat)[0] for s in (step, -step))
    assert np.quantile(np.abs(slope - (there - back) / (2 * step)), 0.98) < 1e-3


def test_what_is_convex_is_known_to_be():
    assert CYLINDER.convex
    assert CONE.convex
    dome = GeneralisedCylinder(ROUND, HEIGHTS, np.array([1.0, 0.95, 0.85, 0.4]), smooth=False)
    assert dome.convex
    assert not VASE.convex
    assert not GeneralisedCylinder(ROUND, HEIGHTS, SCALES).convex


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"heights": [0.0]}, r"scales must have shape \(1\)"),
        ({"heights": [0.0], "scales": [1.0]}, "heights must be 2 to 64, got 1"),
        ({"heights": [0.0, 0.1, 0.1]}, "heights must increase"),
        ({"scales": [1.0, 0.0, 1.0]}, "scales must be positive, but for 0 at an end"),
        ({"scales": [1.0, -1.0, 1.0]}, "scales must be positive"),
        ({"scales": [0.0, 1.0, -0.1]}, "scales must be positive"),
        ({"heights": [0.0, 0.1], "scales": [0.0, 0.0]}, "scales must be positive"),
        ({"tilt": 1.4}, "tilt must be at most 75 degrees, got 80.2"),
        ({"tilt": math.nan}, "tilt must be at most 75 degrees"),
        ({"tilt_direction": math.inf}, "tilt_direction must be finite"),
        (
            {"heights": [0, 1, 2, 3], "scales": [1, 0.01, 0.01, 1], "smooth": True},
            "smooth curve through them down to -.* at the height 1.5 m",
        ),
    ],
)
def test_what_makes_no_solid_is_refused(words, sentence):
    given_: dict[str, Any] = {"heights": [0.0, 0.05, 0.1], "scales": [1.0, 1.0, 1.0], **words}
    heights, scales = (np.array(given_.pop(name), float) for name in ("heights", "scales"))
    with pytest.raises(ValueError, match=sentence):
        GeneralisedCylinder(ROUND, heights, scales, **given_)


def test_points_beyond_the_ends_are_outside():
    points: Floats = np.array([[0.0, 0, 0.11], [0.0, 0, -0.01], [0.0, 0, 0.1], [0.0, 0, 0.05]])
    value = CYLINDER.inside_out(points, np.zeros((4, 3)))[0]
    assert np.array_equal(np.sign(value), [1.0, 1.0, 0.0, -1.0])


def test_a_ray_that_leaves_through_a_slanting_side_is_seen_to_leave():
    # The gauge of a rhombus has creases, and this ray gains on its scale only slowly.
    spindle = GeneralisedCylinder(
        SuperellipseSection(np.array([0.0325, 0.0164]), 2.0),
        np.array([-0.022, 0.002, 0.01, 0.035]),
        np.array([0.0, 0.32, 0.6, 1.03]),
    )
    rng = np.random.default_rng(5)
    ways = np.linspace(0.0, 0.2, 2001)
    for direction in rng.normal(size=(8, 3)):
        towards = direction / np.linalg.norm(direction)
        origins = rng.uniform([-0.02, -0.01, 0.0], [0.02, 0.01, 0.03], (50, 3)) - 0.1 * towards
        spans = spindle.spans(origins, towards)
        points = (origins[:, None] + ways[:, None] * towards).reshape(-1, 3)
        level = spindle.inside_out(points, np.zeros_like(points))[0].reshape(50, -1)
        within = ((spans[..., :1] <= ways) & (ways <= spans[..., 1:])).any(axis=1)
        assert (within == (level <= 0.0))[np.abs(level) > 1e-9].all()


CIRCLE = SuperellipseSection(np.array([0.03, 0.03]), 1.0)
STEPS = straight_pieces(np.array([0.0, 0.031, 0.05, 0.08]), np.array([1.0, 1.0, 0.4, 0.7]))


def test_rims_and_kinks_are_rings_of_the_mesh(is_closed):
    mesh = profile_mesh(CIRCLE.outline, STEPS, np.eye(3), 2)
    assert is_closed(mesh)
    height, radius = mesh.vertices[:, 2], np.hypot(*mesh.vertices[:, :2].T)
    for knot, scale in zip(STEPS.knots, (1.0, 1.0, 0.4, 0.7), strict=True):
        ring = radius[np.abs(height - knot) < 1e-15]
        assert ring.max() == pytest.approx(0.03 * scale)


def test_each_level_has_about_four_times_the_faces_and_a_quarter_of_the_error(signed_volume):
    true = 0.0
    for low, high, a, b in ((0, 0.031, 1, 1), (0.031, 0.05, 1, 0.4), (0.05, 0.08, 0.4, 0.7)):
        true += math.pi * 0.03**2 * (high - low) * (a * a + a * b + b * b) / 3
    meshes = [profile_mesh(CIRCLE.outline, STEPS, np.eye(3), level) for level in (2, 3, 4, 6)]
    faces = [len(mesh.faces) for mesh in meshes]
    errors = np.array([true - signed_volume(mesh) for mesh in meshes])
    assert (errors > 0).all()
    assert np.diff(np.log2(errors))[:2] == pytest.approx([-2, -2], abs=0.1)
    assert np.diff(np.log2(faces))[:2] == pytest.approx([2, 2], abs=0.3)
    assert 7e4 < faces[3] < 9e4


@pytest.mark.parametrize("scales", [(1.0, 0.0), (0.0, 1.0), (0.0, 0.5, 0.0)])
def test_an_apex_is_one_vertex(scales, is_closed):
    knots = np.linspace(0.0, 0.1, len(scales))
    for level in (0, 3):
        mesh = profile_mesh(
            CIRCLE.outline, straight_pieces(knots, np.array(scales)), np.eye(3), level
        )
        assert is_closed(mesh)
        for end in (knots[0], knots[-1]):
            on = np.abs(mesh.vertices[:, 2] - end) < 1e-15
            assert on.sum() == 1 or scales[0 if end == 0.0 else -1] > 0.0


def test_a_shear_moves_the_sections_sideways():
    shear = np.array([[1.0, 0, 0.5], [0, 1, 0], [0, 0, 0.8]])
    plain, leaning = (profile_mesh(CIRCLE.outline, STEPS, m, 2) for m in (np.eye(3), shear))
    assert np.allclose(leaning.vertices, plain.vertices @ shear.T, rtol=0, atol=1e-17)
    assert np.array_equal(leaning.faces, plain.faces)


SECTIONS: list[Section] = [
    SplineSection(np.full(5, 0.03)),
    SplineSection(np.array([0.03, 0.02, 0.03, 0.02])),
    SplineSection(np.array([0.03, 0.022, 0.035, 0.021, 0.027, 0.031])),
    SuperellipseSection(np.array([0.03, 0.02]), 0.1),
    SuperellipseSection(np.array([0.02, 0.03]), 1.0),
    SuperellipseSection(np.array([0.03, 0.02]), 1.7),
]
every = pytest.mark.parametrize("section", SECTIONS)


@every
def test_the_gauge_is_1_on_the_outline_and_grows_evenly(section):
    points = section.outline(64)
    for share in (0.3, 1.0, 2.0):
        gauge = section.gauge_along(*(share * points.T), np.ones(64), np.ones(64))[0]
        assert np.allclose(gauge, share, rtol=0, atol=1e-14)
    turn = np.arctan2(points[:, 1], points[:, 0])
    assert (np.diff(turn[turn > -1e-12]) > 0).all()


@every
def test_slopes_are_derivatives(section):
    rng = np.random.default_rng(1)
    (x, y), (dx, dy) = rng.uniform(-0.04, 0.04, (2, 300)), rng.normal(size=(2, 300))
    step = 1e-8
    there, back = (section.gauge_along(x + s * dx, y + s * dy, dx, dy)[0] for s in (step, -step))
    slope = section.gauge_along(x, y, dx, dy)[1]
    assert np.quantile(np.abs(slope - (there - back) / (2 * step)), 0.95) < 1e-4
    assert np.isfinite(section.gauge_along(*np.zeros((2, 1)), *np.ones((2, 1)))).all()


@every
def test_the_bounds_hold_all_around(section):
    traits, azimuth = section.traits, np.linspace(0, 2 * math.pi, 20001)
    x, y = np.cos(azimuth), np.sin(azimuth)
    gauge, bend_way = section.gauge_along(x, y, -y, x)
    step = azimuth[1]
    assert traits.radius[0] <= (1 / gauge).min() * (1 + 1e-12)
    assert (1 / gauge).max() * (1 - 1e-12) <= traits.radius[1]
    bends = gauge + np.gradient(np.gradient(gauge, step), step)
    inner = bends[3:-3]
    assert inner.min() >= -traits.hollow - 1e-3 * traits.steepest
    assert inner.max() <= traits.bulge + 1e-2 * traits.steepest
    assert np.hypot(gauge, bend_way).max() <= traits.steepest * (1 + 1e-9)


def test_convex_sections_are_known_to_be_convex():
    assert [section.traits.hollow == 0.0 for section in SECTIONS] == [
        True, False, False, True, True, True,
    ]  # fmt: skip


@given(radii=st.lists(st.floats(0.5, 1.5), min_size=3, max_size=8))
@settings(derandomize=True, deadline=None, max_examples=30)
def test_no_chord_shows_a_section_hollower_than_it_says(radii: list[float]) -> None:
    section = SplineSection(np.array(radii))
    start = np.linspace(0, 2 * math.pi, 40)
    x, y = 0.7 * np.cos(start), 0.7 * np.sin(start)
    dx, dy = 0.3 * np.cos(2 * start + 1), 0.3 * np.sin(2 * start + 1)
    gauge, slope = section.gauge_along(x, y, dx, dy)
    after = section.gauge_along(x + dx, y + dy, dx, dy)[0]
    near = np.hypot(x, y) - 0.3
    across = np.abs(x * dy - y * dx)
    assert (after >= gauge + slope - 0.5 * section.traits.hollow * across**2 / near**3 - 1e-9).all()


@pytest.mark.parametrize(
    ("radii", "sentence"),
    [
        ([0.03, 0.03], "radii must be 3 to 64, got 2"),
        ([0.03] * 65, "radii must be 3 to 64, got 65"),
        ([0.03, 0.0, 0.03], "radii must be positive"),
        ([1e-320] * 3, "radii must be positive, 1e-09 m or more"),
        ([0.03, math.inf, 0.03], "radii must be finite"),
        ([1.0, 1.0, 0.001, 0.001, 0.001, 1.0], "the curve through them reaches the axis"),
    ],
)
def test_radii_that_make_no_section_are_refused(radii, sentence):
    with pytest.raises(ValueError, match=sentence):
        SplineSection(np.array(radii))


@pytest.mark.parametrize(
    ("size", "exponent", "sentence"),
    [
        ([0.03, 0.0], 1.0, "size must be positive"),
        ([0.03, 1e-320], 1.0, "size must be positive, 1e-09 m or more"),
        ([0.03], 1.0, r"size must have shape \(2\)"),
        ([0.03, 0.02], 2.5, "exponent must lie between 0.02 and 2.0, got 2.5"),
        ([0.03, 0.02], math.nan, "exponent must lie between"),
    ],
)
def test_superellipses_that_are_none_are_refused(size, exponent, sentence):
    with pytest.raises(ValueError, match=sentence):
        SuperellipseSection(np.array(size), exponent)


KNOTS = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
VALUES = np.array([1.0, 1.3, 0.5, 0.6, 0.2])


def test_the_natural_spline_is_the_one_of_the_textbooks():
    ours, theirs = natural_spline(KNOTS, VALUES), CubicSpline(KNOTS, VALUES, bc_type="natural")
    places = np.linspace(0.0, 0.1, 101)
    for order, found in enumerate(ours.at(places, ours.piece(places))):
        assert np.allclose(found, theirs(places, order), rtol=1e-9, atol=1e-9)


def test_the_periodic_spline_is_the_one_of_the_textbooks():
    for count in (3, 4, 9):
        values = np.random.default_rng(count).uniform(0.5, 1.5, count)
        knots = np.linspace(0.0, 2 * np.pi, count + 1)
        ours = periodic_spline(knots, values)
        theirs = CubicSpline(knots, np.append(values, values[0]), bc_type="periodic")
        places = np.linspace(0.0, 2 * np.pi, 101)[:-1]
        for order, found in enumerate(ours.at(places, ours.piece(places))):
            assert np.allclose(found, theirs(places, order), rtol=1e-9, atol=1e-9)


def test_straight_pieces_go_from_value_to_value():
    curve = straight_pieces(KNOTS, VALUES)
    places = np.linspace(-0.01, 0.1, 56)
    value, slope, bend = curve.at(places, curve.piece(places))
    inner = places >= 0.0
    assert np.allclose(value[inner], np.interp(places[inner], KNOTS, VALUES))
    assert slope[0] == pytest.approx(15.0)  # carried on before the first knot
    assert (bend == 0.0).all()


@pytest.mark.parametrize("make", [natural_spline, straight_pieces])
def test_the_range_holds_all_values_and_is_met(make):
    rng = np.random.default_rng(8)
    for _ in range(20):
        knots = np.cumsum(rng.uniform(0.1, 1.0, 6))
        curve = make(knots, rng.normal(size=6))
        places = np.linspace(knots[0], knots[-1], 4001)
        seen = curve.at(places, curve.piece(places))[0]
        low, high = curve.value_range()
        assert low <= seen.min() <= low + 2e-3
        assert high - 2e-3 <= seen.max() <= high


def test_extremes_of_parabolas_and_of_a_level_line_are_found():
    hill = natural_spline(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0]))
    assert np.isclose(hill.value_range()[1], 1.0)
    level = straight_pieces(np.array([0.0, 1.0]), np.array([2.0, 2.0]))
    assert level.value_range() == (2.0, 2.0)
    assert len(level.extremes()[0]) == 0
