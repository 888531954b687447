import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.explore.probing.ends import (
    FOOT,
    EndFace,
    ProbeCommand,
    ProbeResult,
    SideContour,
    covers,
    expected_edge,
    fit_face,
    inner_outline,
    interior_point,
    is_plane,
    largest_untouched_disc,
    next_edge,
    turned_command,
    turned_over,
)
from palpate.core.explore.probing.rule import probe_along_axis
from palpate.core.geometry.polygons import winding_number
from palpate.core.poses import IDENTITY_POSE, split_pose


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radius": 0.0}, "radius must be positive and finite, got 0.0 m"),
        ({"width": -1.0}, "width must be positive"),
        ({"tolerance": float("nan")}, "tolerance must be positive"),
        ({"deviation": -1e-3}, "deviation must be 0 or more and finite, got -0.001 m"),
        ({"noise": float("inf")}, "noise must be 0 or more and finite"),
        ({"height": -0.04}, "height must be finite and differ from that of the other end"),
        ({"other": float("inf")}, "height must be finite and differ"),
    ],
)
def test_what_cannot_be_an_end_is_refused(observation, change, words):
    with pytest.raises(ValueError, match=words):
        replace(observation, **change)


@pytest.mark.parametrize(
    ("contour", "words"),
    [
        (
            SideContour(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2), np.zeros(2)),
            "at least 3, got 2",
        ),
        (
            SideContour(np.zeros((4, 3)), np.zeros((3, 3)), np.zeros(4), np.zeros(4)),
            "contour.normals must",
        ),
        (
            SideContour(np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros(3)),
            "contour.contact_high must",
        ),
        (
            SideContour(np.zeros((4, 3)), np.zeros((4, 3)), np.full(4, np.nan), np.zeros(4)),
            "contour.contact_low must be finite",
        ),
    ],
)
def test_a_contour_that_cannot_be_used_is_refused(observation, contour, words):
    with pytest.raises(ValueError, match=words):
        replace(observation, contour=contour)


def test_turned_over_twice_an_end_is_as_it_was(observation):
    rng = np.random.default_rng(3)
    points, normals = rng.standard_normal((2, 5, 3))
    contour = SideContour(points, normals, -np.arange(5.0), np.arange(5.0))
    probing = probe_along_axis(observation, np.array([1e-3, 2e-3]))
    made = ProbeResult(probing, "hit", rng.standard_normal(3), rng.standard_normal(3))
    observation = replace(observation, contour=contour, probes=(made,))
    again = turned_over(turned_over(observation))
    assert again.contour is not None and again.height == observation.height
    for before, after in zip(contour, again.contour, strict=True):
        np.testing.assert_array_equal(after, before)
    [other] = again.probes
    np.testing.assert_array_equal(other.point, made.point)
    np.testing.assert_allclose(
        split_pose(other.probing.pose)[1], split_pose(probing.pose)[1], atol=1e-15
    )


def test_a_touch_from_above_becomes_one_from_below(observation):
    probing: ProbeCommand = turned_command(probe_along_axis(observation, np.array([1e-3, 2e-3])))
    position, axes = split_pose(probing.pose)
    np.testing.assert_allclose(position[:2], [1e-3, -2e-3])
    assert position[2] < -0.04
    np.testing.assert_allclose(axes[:, 2], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(probing.target, [1e-3, -2e-3, -0.04])


WIDTH = 0.015
FACE = EndFace(0.04, np.array([0.1, -0.05]))


def _made(place, normal=None, off=0.0):
    height = FACE.at(np.array([place]))[0] + off
    probing = ProbeCommand(IDENTITY_POSE, 0.0, "face", np.zeros(3))
    at = np.array([*place, height])
    return ProbeResult(probing, "hit", at, FACE.normal if normal is None else normal)


def test_a_touch_with_its_normal_tells_the_plane():
    found = fit_face([_made((0.005, -0.002))], WIDTH)
    assert found.height == pytest.approx(0.04, abs=1e-12)
    np.testing.assert_allclose(found.slopes, FACE.slopes, atol=1e-12)


def test_a_normal_from_an_edge_is_not_believed():
    places = [(0.0, 0.0), (0.02, 0.0), (0.0, 0.02)]
    touches = [_made(place, np.array([0.9, 0.0, 0.4])) for place in places]
    np.testing.assert_allclose(fit_face(touches, WIDTH).slopes, FACE.slopes, atol=1e-6)
    np.testing.assert_allclose(fit_face(touches[:1], WIDTH).slopes, 0.0, atol=1e-12)


def test_touches_in_a_plane_are_one(ring):
    touches = [_made((0.0, 0.0)), _made((0.02, 0.0)), _made((0.0, 0.02), off=1e-4)]
    face = fit_face(touches, WIDTH)
    assert is_plane(face, touches, ring(0.025, 0.03), 2e-4)


@pytest.mark.parametrize(
    ("last", "above"),
    [
        (_made((0.0, 0.02), off=2e-3), 0.0),
        (_made((0.0, 0.02), np.array([0.0, 0.1, 0.995])), 0.0),
        (_made((0.0, 0.02)), 0.02),
    ],
    ids=["a step", "a lean", "a hollow"],
)
def test_what_is_no_plane_is_none(ring, last, above):
    touches = [_made((0.0, 0.0)), _made((0.02, 0.0)), last]
    contour = ring(0.025, 0.03, above=above)
    assert not is_plane(fit_face(touches, WIDTH), touches, contour, 2e-4)


def test_the_band_of_a_steep_wall_ends_on_the_contour(ring):
    contour = ring(0.025, 0.03, above=5e-3)
    np.testing.assert_allclose(inner_outline(contour), contour.points[:, :2], atol=1e-15)


def test_the_band_of_a_leaning_wall_ends_farther_in(ring):
    contour = ring(0.025, 0.03, lean=math.radians(45.0), above=5e-3)
    np.testing.assert_allclose(np.linalg.norm(inner_outline(contour), axis=1), 0.02, atol=1e-12)


def test_of_a_horseshoe_the_heart_lies_within():
    turn = np.linspace(-0.4 * math.pi, 1.4 * math.pi, 80)
    out = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    points = np.concatenate([0.03 * out, 0.02 * out[::-1]])
    count = np.zeros(len(points))
    place = interior_point(SideContour(points, points, count, count))
    assert winding_number(points[:, :2], place[None])[0] != 0


def test_on_a_disc_the_gap_lies_between_touch_and_rim(ring):
    gap = largest_untouched_disc(ring(0.025, 0.0).points[:, :2], np.zeros((1, 2)), WIDTH)
    wanted = 0.5 * (0.025 - FOOT * WIDTH)
    assert gap.radius == pytest.approx(wanted, abs=1e-3)
    assert np.linalg.norm(gap.place) == pytest.approx(0.025 - wanted, abs=1.5e-3)


def test_where_a_foot_covers_all_there_is_no_gap(ring):
    assert (
        largest_untouched_disc(ring(0.004, 0.0).points[:, :2], np.zeros((1, 2)), WIDTH).radius
        <= 0.0
    )
    tiny = 1e-9 * ring(1.0, 0.0).points[:, :2] + 5e-5
    assert largest_untouched_disc(tiny, np.zeros((1, 2)), WIDTH).radius <= 0.0


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.integers(1, 6))
def test_a_gap_is_empty_and_inside(seed, count):
    rng = np.random.default_rng(seed)
    turn = 2.0 * np.pi * np.arange(40) / 40
    radius = 0.03 * (1.0 + 0.3 * np.cos(rng.integers(2, 5) * turn + rng.uniform(0.0, 6.0)))
    outline = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    tried = rng.uniform(-0.03, 0.03, (count, 2))
    gap = largest_untouched_disc(outline, tried, WIDTH)
    if gap.radius > 0.0:
        assert winding_number(outline, gap.place[None])[0] != 0
        reach = FOOT * WIDTH + gap.radius
        assert np.linalg.norm(tried - gap.place, axis=1).min() >= reach - 1e-12


def test_a_contour_covers_what_lies_inside_or_close_beside_it(ring):
    places = np.array([[0.0, 0.0], [0.024, 0.0], [0.029, 0.0], [0.031, 0.0]])
    assert covers(ring(0.025, 0.03), places, 5e-3).tolist() == [True, True, True, False]


WIDTH, ALLOWED = 0.015, 2e-4
LEVEL = EndFace(0.04, np.zeros(2))
MIDDLE = np.array([[0.0, 0.0, 0.04]])


def _edge(contour, face=LEVEL, top=0.05):
    return expected_edge(face, contour, MIDDLE, 5e-3, top)


def _edge_touch(probing, off=0.0):
    way = split_pose(probing.pose)[1][:, 2]
    return ProbeResult(probing, "hit", probing.target + off * way, -way)


def _all_touches(edge, off):
    made = []
    while isinstance(found := next_edge(edge, made, WIDTH, ALLOWED), ProbeCommand):
        made.append(_edge_touch(found, off[len(made) % len(off)]))
    return made, found


def test_no_edge_lies_beyond_the_end(ring):
    rising = EndFace(0.04, np.array([1.0, 0.0]))
    edge = _edge(ring(0.025, 0.03, above=4e-3), rising, top=0.045)
    assert edge.places[:, 2].max() == pytest.approx(0.045)
    assert edge.untouched.max() == pytest.approx(0.045 - 0.034)


def test_an_upright_wall_meets_a_level_face_over_the_contour(ring):
    contour = ring(0.025, 0.03, above=4e-3)
    edge = _edge(contour)
    np.testing.assert_allclose(edge.places[:, :2], contour.points[:, :2])
    np.testing.assert_allclose(edge.places[:, 2], 0.04)
    np.testing.assert_allclose(edge.untouched, 6e-3)


def test_a_cone_is_carried_on_to_a_leaning_face(ring):
    contour = ring(0.025, 0.03, lean=math.radians(20.0))
    edge = _edge(contour, EndFace(0.04, np.array([0.2, 0.0])))
    radius = np.linalg.norm(edge.places[:, :2], axis=1)
    cone = 0.025 - math.tan(math.radians(20.0)) * (edge.places[:, 2] - 0.03)
    np.testing.assert_allclose(radius, cone, atol=1e-12)
    np.testing.assert_allclose(edge.places[:, 2], 0.04 + 0.2 * edge.places[:, 0], atol=1e-12)


def test_where_band_and_face_meet_no_touch_is_made(ring):
    edge = _edge(ring(0.025, 0.03, above=8e-3))
    assert next_edge(edge, [], WIDTH, ALLOWED) == pytest.approx(2e-3)


def test_a_wall_that_leans_over_the_end_has_no_edge(ring):
    assert _edge(ring(0.025, 0.03, lean=math.radians(40.0))).untouched.max() == 0.0


def test_an_edge_under_a_touch_of_the_face_is_touched(ring):
    assert _edge(ring(0.004, 0.03)).untouched.max() == 0.0


def test_a_touch_comes_at_45_degrees_from_outside(ring):
    found = next_edge(_edge(ring(0.025, 0.03)), [], WIDTH, ALLOWED)
    position, axes = split_pose(found.pose)
    out = np.array([*found.target[:2] / 0.025, 0.0])
    np.testing.assert_allclose(axes[:, 2], -math.sqrt(0.5) * (out + [0.0, 0.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(position + WIDTH * axes[:, 2], found.target, atol=1e-12)
    assert found.reach > WIDTH


def test_four_touches_that_agree_are_enough(ring):
    made, untouched = _all_touches(_edge(ring(0.025, 0.03)), [1e-3, 1.1e-3])
    assert len(made) == 4 and untouched == 0.0
    turns = np.sort([math.atan2(one.point[1], one.point[0]) for one in made])
    assert np.diff(turns).min() > math.radians(60.0)


def test_touches_that_differ_are_eight_at_most(ring):
    made, _ = _all_touches(_edge(ring(0.035, 0.03)), [0.0, 1e-3])
    assert len(made) == 8


def test_a_narrow_edge_takes_fewer(ring):
    made, _ = _all_touches(_edge(ring(0.008, 0.03)), [0.0, 1e-3])
    assert len(made) <= 3


def test_an_edge_that_nobody_met_is_told_as_untouched(ring):
    edge = _edge(ring(0.035, 0.03))
    made = []
    while isinstance(found := next_edge(edge, made, WIDTH, ALLOWED), ProbeCommand):
        made.append(ProbeResult(found, "miss", found.target, np.array([0.0, 0.0, 1.0])))
    assert len(made) == 8 and found == pytest.approx(0.01)
