import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.hand import search_places
from palpate.core.explore.probing.ends import (
    FOOT,
    EndObservation,
    ProbeCommand,
    ProbeResult,
    SideContour,
    StopProbing,
    turned_command,
    turned_over,
)
from palpate.core.explore.probing.rule import (
    MOST_CLIMBS,
    MOST_RINGS,
    SUMMIT_LEAN,
    highest_expected,
    next_probe,
    next_uphill,
    probe_along_axis,
)
from palpate.core.poses import (
    FACING_DOWN,
    IDENTITY_POSE,
    pose_of,
    rotations_from_vectors,
    split_pose,
)
from palpate.core.shapes.protocol import PosedShape
from palpate.core.shapes.superquadrics import Superquadric

UP = np.array([0.0, 0.0, 1.0])


def _ball():
    return Superquadric(np.array([0.03, 0.03, 0.04]), np.array([1.0, 1.0]))


def _column(radius=0.025):
    return Superquadric(np.array([radius, radius, 0.04]), np.array([0.1, 1.0]))


def _whys(probes):
    return "".join(one.probing.reason[0] for one in probes)


def test_an_end_is_found_by_one_touch_before_any_contour(probed, observation):
    done, probes = probed(_ball(), "upper", observation)
    assert len(probes) == 1 and done.reason == "the end is found"
    np.testing.assert_allclose(probes[0].point[2], 0.04, atol=5e-5)


def test_an_end_beside_the_axis_is_climbed_to(probed, observation):
    aside = PosedShape(_ball(), pose_of(np.array([0.013, -0.01, 0.0]), np.eye(3)))
    _, probes = probed(aside, "upper", observation)
    assert probes[0].point[2] < 0.0395
    assert max(one.point[2] for one in probes) == pytest.approx(0.04, abs=1e-4)
    assert len(probes) <= 4


def test_a_touch_that_no_contour_lies_around_says_nothing_of_face(touch, observation, ring):
    around = ring(0.0103, 0.0376, lean=math.radians(67.0), above=1e-3)
    aside = touch(_ball(), _over_place(0.027))
    found = next_probe("upper", replace(observation, contour=around, probes=(aside,)))
    assert isinstance(found, ProbeCommand) and found.reason == "face"
    np.testing.assert_allclose(found.target[:2], 0.0, atol=1e-9)
    missed = ProbeResult(found, "miss", found.target, UP)
    again = next_probe("upper", replace(observation, contour=around, probes=(aside, missed)))
    assert isinstance(again, StopProbing) or np.linalg.norm(again.target[:2]) > 1e-3


def _over_place(x):
    start = np.array([x, 0.0, 0.06])
    return ProbeCommand(pose_of(start, FACING_DOWN), 0.05, "search", np.array([x, 0.0, 0.04]))


def test_a_pole_takes_one_touch(probed, observation, ring):
    contour = ring(0.0103, 0.0376, lean=math.radians(67.0), above=1e-3)
    done, probes = probed(_ball(), "upper", replace(observation, contour=contour))
    assert _whys(probes) == "s" and done.reason == "nothing larger than a pad is untouched"
    assert done.untouched < 0.01


def test_a_flat_top_takes_five_that_lie_all_over_it(probed, observation, ring):
    done, probes = probed(
        _column(), "upper", replace(observation, contour=ring(0.024, 0.037, above=2e-3))
    )
    assert _whys(probes) == "sffff" and done.reason == "5 touches lie in one plane"
    turns = np.sort([math.atan2(one.point[1], one.point[0]) for one in probes[1:]])
    assert np.diff(turns, append=turns[0] + 2.0 * math.pi).max() < math.radians(150.0)


@pytest.mark.parametrize("radius", [0.024, 0.014, 0.011])
def test_a_flat_top_takes_as_many_touches_as_its_share_of_the_surface_asks_for_in_noise(
    probed, observation, ring, radius
):
    noisy = replace(observation, contour=ring(radius - 2e-4, 0.037, above=2e-3), noise=1e-4)
    _, probes = probed(_column(radius), "upper", noisy)
    share = radius / (2.0 * (radius + observation.height - observation.other))
    enough = share * (noisy.noise / (0.05 * observation.tolerance)) ** 2
    assert abs(len(probes) - max(enough, 5.0)) <= 1.0
    _, fewer = probed(_column(radius), "upper", replace(noisy, noise=1e-6))
    assert len(fewer) <= 5 < enough


def test_a_top_on_which_no_whole_pad_lies_is_not_touched_again(probed, observation, ring):
    noisy = replace(observation, contour=ring(0.0048, 0.037, above=2e-3), noise=1e-4)
    _, probes = probed(_column(0.005), "upper", noisy)
    assert _whys(probes) == "s"


def test_a_pole_takes_one_touch_in_spite_of_noise(probed, observation, ring):
    contour = ring(0.0103, 0.0376, lean=math.radians(67.0), above=1e-3)
    _, probes = probed(_ball(), "upper", replace(observation, contour=contour, noise=1e-4))
    assert _whys(probes) == "s"


def test_a_narrow_flat_top_takes_one(probed, observation, ring):
    done, probes = probed(
        _column(0.014), "upper", replace(observation, contour=ring(0.0138, 0.037, above=2e-3))
    )
    assert _whys(probes) == "s" and done.untouched < 0.0105


def test_an_edge_below_which_band_ends_is_touched_at_45_degrees(probed, observation, ring):
    contour = ring(0.025, 0.03, above=3e-3)
    _, probes = probed(_column(), "upper", replace(observation, contour=contour))
    assert _whys(probes) == "sffffeeee"
    for one in probes[5:]:
        assert one.touched and abs(one.normal[2] - math.sqrt(0.5)) < 0.2


def test_a_lower_end_is_an_upper_one_turned_over(probed, observation, ring):
    upper = replace(observation, contour=ring(0.025, 0.03, above=3e-3))
    done, probes = probed(_column(), "upper", upper)
    for count in range(len(probes) + 1):
        upper = replace(upper, probes=probes[:count])
        lower = next_probe("lower", turned_over(upper))
        wanted = next_probe("upper", upper)
        if isinstance(wanted, StopProbing):
            assert lower == wanted == done
            continue
        assert isinstance(lower, ProbeCommand)
        wanted = turned_command(wanted)
        np.testing.assert_allclose(lower.pose[:3], wanted.pose[:3], atol=1e-12)
        np.testing.assert_allclose(split_pose(lower.pose)[1], split_pose(wanted.pose)[1], atol=1e-9)
        np.testing.assert_allclose(lower.target, wanted.target, atol=1e-12)
        assert lower.reach == pytest.approx(wanted.reach) and lower.reason == wanted.reason


def test_an_end_on_which_it_stands_takes_none(observation, ring):
    below = replace(observation, height=-0.04, other=0.04, standing=True)
    assert next_probe("lower", below) == StopProbing("it stands on the platform", 0.0)
    found = next_probe("lower", replace(below, contour=ring(0.025, -0.03, below=6e-3)))
    assert isinstance(found, StopProbing) and found.untouched == pytest.approx(4e-3)


def test_an_end_that_is_lower_than_thought_is_found(probed, observation):
    done, probes = probed(_ball(), "upper", replace(observation, height=0.06))
    assert done.reason == "the end is found" and len(probes) == 1


def test_an_end_that_is_higher_than_thought_is_found(probed, observation):
    done, probes = probed(_ball(), "upper", replace(observation, height=0.02))
    outcomes = [one.outcome for one in probes]
    assert outcomes == ["inside", "hit"] and done.reason == "the end is found"


def test_a_touch_that_begins_inside_again_and_again_is_given_up(observation):
    probes = ()
    for _ in range(5):
        found = next_probe("upper", replace(observation, probes=probes))
        assert isinstance(found, ProbeCommand)
        probes = (*probes, ProbeResult(found, "inside", np.zeros(3), UP))
    first, last = probes[0].probing, probes[-1].probing
    assert last.pose[2] - first.pose[2] == pytest.approx(4 * observation.width)
    found = next_probe("upper", replace(observation, probes=probes))
    assert isinstance(found, ProbeCommand) and np.linalg.norm(found.pose[:2]) > 0.01


def test_an_object_off_the_axis_is_looked_for_around_it(probed, observation):
    aside = PosedShape(_column(0.01), pose_of(np.array([0.02, 0.0, 0.0]), np.eye(3)))
    done, probes = probed(aside, "upper", observation)
    assert done.reason == "the end is found"
    assert [one.outcome for one in probes] == ["miss", "hit"]


@pytest.mark.parametrize("contour", [False, True], ids=["no contour", "a contour"])
def test_where_nothing_is_the_search_ends(probed, observation, ring, contour):
    far = PosedShape(_ball(), pose_of(np.array([1.0, 0.0, 0.0]), np.eye(3)))
    observation = replace(observation, contour=ring(0.025, 0.03) if contour else None)
    done, probes = probed(far, "upper", observation)
    assert done.reason == "nothing was touched" and 1 < len(probes) <= 19
    assert done.untouched >= 0.05


def test_a_top_that_is_no_plane_is_touched_all_over(observation, ring):
    observation = replace(observation, contour=ring(0.028, 0.037, above=3e-3))
    while isinstance(found := next_probe("upper", observation), ProbeCommand):
        away = float(np.linalg.norm(found.target[:2]))
        point = np.array([*found.target[:2], 0.036 + 4.0 * away**2])
        observation = replace(
            observation, probes=(*observation.probes, ProbeResult(found, "hit", point, UP))
        )
    assert (
        5 < len(observation.probes) <= 14
        and found.reason == "nothing larger than a pad is untouched"
    )


def test_a_top_too_wide_to_be_touched_all_over_says_so(observation, ring):
    observation = replace(observation, contour=ring(0.09, 0.037, above=3e-3))
    while isinstance(found := next_probe("upper", observation), ProbeCommand):
        point = np.array([*found.target[:2], 0.04 + 1e-3 * len(observation.probes)])
        observation = replace(
            observation, probes=(*observation.probes, ProbeResult(found, "hit", point, UP))
        )
    assert sum(one.probing.reason != "edge" for one in observation.probes) == 14
    assert found.untouched > observation.width
    assert found.reason == "14 touches have not reached all of it"


def test_a_leaning_face_is_touched_along_its_normal(observation, ring):
    observation = replace(observation, contour=ring(0.025, 0.02))
    normal = np.array([math.sin(0.3), 0.0, math.cos(0.3)])
    first = next_probe("upper", observation)
    assert isinstance(first, ProbeCommand)
    made = ProbeResult(first, "hit", np.array([0.0, 0.0, 0.035]), normal)
    found = next_probe("upper", replace(observation, probes=(made,)))
    assert isinstance(found, ProbeCommand) and found.reason == "face"
    np.testing.assert_allclose(split_pose(found.pose)[1][:, 2], -normal, atol=1e-6)


def test_a_pole_beside_the_first_touch_is_looked_for(probed, observation, ring):
    turned = rotations_from_vectors(np.array([[0.0, math.radians(12.0), 0.0]]))[0]
    tip = Superquadric(np.array([0.015, 0.015, 0.045]), np.array([1.0, 1.0]))
    shape = PosedShape(tip, pose_of(np.zeros(3), turned))
    contour = ring(0.0115, 0.03, lean=math.radians(35.0), above=2e-3)
    _, probes = probed(shape, "upper", replace(observation, contour=contour))
    highest = max(one.point[2] for one in probes)
    assert highest == pytest.approx(shape.bounds()[1, 2], abs=1e-4) and 2 <= len(probes) <= 3


def test_an_end_on_the_wrong_side_is_refused(observation):
    with pytest.raises(ValueError, match="height of the lower end must lie beyond the other one's"):
        next_probe("lower", observation)


def test_a_touch_of_the_edge_alone_tells_of_no_face(observation, ring):
    probing = ProbeCommand(IDENTITY_POSE, 0.01, "edge", np.zeros(3))
    made = ProbeResult(probing, "hit", np.zeros(3), UP)
    found = next_probe("upper", replace(observation, contour=ring(0.02, 0.03), probes=(made,)))
    assert isinstance(found, StopProbing) and found.reason == "only its edge was touched"


@settings(derandomize=True, deadline=None, max_examples=20)
@given(
    st.tuples(st.floats(0.008, 0.06), st.floats(0.008, 0.06)),
    st.tuples(st.floats(0.1, 1.6), st.floats(0.1, 1.6)),
    st.floats(-1.0, 1.0),
    st.integers(0, 99),
)
@example((0.0546875, 0.052734375), (0.90625, 0.625), 0.34375, 0)
def test_every_end_is_done_after_at_most_24_touches(probed, size, exponents, lean, seed):
    turned = rotations_from_vectors(np.array([[0.4 * lean, 0.3 * lean, 0.0]]))[0]
    solid = Superquadric(np.array([*size, 0.04]), np.array(exponents))
    shape = PosedShape(solid, pose_of(np.zeros(3), turned))
    low, high = shape.bounds()[:, 2]
    turn = 2.0 * np.pi * np.arange(48) / 48
    out = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    level = low + 0.9 * (high - low)
    ways = [shape.cast((out[i] * 0.2 + [0, 0, level])[None], -out[i], 0.4)[0] for i in range(48)]
    hits = np.flatnonzero(np.isfinite(ways))
    contour = None
    if len(hits) > 2:
        points = out[hits] * (0.2 - np.array(ways)[hits, None]) + [0.0, 0.0, level]
        band = np.full(len(hits), level)
        contour = SideContour(points, out[hits], band - 5e-3, band + 3e-3)
    observation = EndObservation(
        height=float(high),
        deviation=1e-3,
        other=float(low),
        radius=0.06,
        width=0.015,
        tolerance=2e-4,
        noise=1e-4,
        contour=contour,
    )
    done, probes = probed(shape, "upper", observation)
    assert len(probes) <= 24 and done.untouched >= 0.0
    if contour is not None and done.reason != "nothing was touched":
        # The bounds are those of a tessellation; the solid itself reaches some 2 um higher.
        top = superquadric_support(solid, turned[2])
        assert high <= top + 1e-9
        assert max(one.point[2] for one in probes if one.touched) <= top + 1e-6


def superquadric_support(solid: Superquadric, way: Floats) -> float:
    """How far a convex superquadric about the origin reaches in a direction (3,): its dual norm."""
    e1, e2 = solid.exponents
    across, along = 2.0 / (2.0 - e2), 2.0 / (2.0 - e1)
    x, y, z = np.abs(solid.size * way)
    return float(((x**across + y**across) ** (along / across) + z**along) ** (1.0 / along))


def test_a_touch_ten_micrometres_above_the_solid_would_be_noticed():
    solid = Superquadric(np.array([0.0546875, 0.052734375, 0.04]), np.array([0.90625, 0.625]))
    turned = rotations_from_vectors(0.34375 * np.array([[0.4, 0.3, 0.0]]))[0]
    vertices = solid.mesh(6).vertices @ turned.T
    top = superquadric_support(solid, turned[2])
    assert 0.0 <= top - vertices[:, 2].max() < 1e-5


def test_places_of_a_search_are_a_pad_apart_and_few():
    places = np.stack(search_places(0.1, 0.015, MOST_RINGS))
    assert len(places) == 1 + 6 + 12 + 18
    apart = np.linalg.norm(places[:, None] - places, axis=2) + np.eye(len(places))
    assert apart.min() == pytest.approx(0.015, rel=0.06)
    assert len(search_places(0.01, 0.015, MOST_RINGS)) == 1


def test_a_search_begins_above_all_that_may_be(observation, ring):
    assert highest_expected(observation) == pytest.approx(0.0415)
    contour = ring(0.02, 0.04, above=4e-3)
    assert highest_expected(replace(observation, contour=contour)) == pytest.approx(0.044)


def test_once_it_is_found_the_guess_no_longer_counts(observation):
    probing = probe_along_axis(observation, np.zeros(2))
    made = ProbeResult(probing, "hit", np.array([0.0, 0.0, 0.035]), np.array([0.0, 0.0, 1.0]))
    assert highest_expected(replace(observation, probes=(made,))) == pytest.approx(0.035)


def test_a_search_goes_down_to_half_the_height(observation):
    probing = probe_along_axis(observation, np.array([0.01, 0.0]))
    assert probing.pose[2] - probing.reach == pytest.approx(0.0)


WIDTH = 0.016


def _touch(place, height, lean=0.0):
    """A touch of a surface that falls towards x."""
    target = np.array([*place, height])
    normal: Floats = np.array([math.sin(lean), 0.0, math.cos(lean)])
    return ProbeResult(
        ProbeCommand(pose_of(target, FACING_DOWN), 0.03, "search", target), "hit", target, normal
    )


def test_a_leaning_surface_is_climbed_by_as_much_as_a_pad_feels():
    touch = _touch((0.01, 0.002), 0.04, lean=0.3)
    place = next_uphill([touch], [touch], WIDTH)
    assert place is not None
    assert place == pytest.approx([0.01 - FOOT * WIDTH, 0.002])


@pytest.mark.parametrize("lean", [0.0, 0.9 * SUMMIT_LEAN])
def test_a_level_surface_is_not_climbed(lean):
    touch = _touch((0.0, 0.0), 0.04, lean)
    assert next_uphill([touch], [touch], WIDTH) is None


def test_the_highest_touch_tells_the_way():
    low, high = _touch((0.03, 0.0), 0.03, lean=0.5), _touch((0.0, 0.0), 0.04)
    assert next_uphill([low, high], [low, high], WIDTH) is None


def test_no_place_is_tried_twice_even_if_it_met_nothing():
    touch = _touch((0.01, 0.0), 0.04, lean=0.3)
    missed = _touch((0.01 - FOOT * WIDTH, 0.001), 0.04)._replace(outcome="miss")
    assert next_uphill([touch], [touch, missed], WIDTH) is None


def test_nobody_climbs_for_ever():
    touches = [_touch((-0.1 * k, 0.0), 0.04 + 0.01 * k, lean=0.3) for k in range(MOST_CLIMBS)]
    assert next_uphill(touches[:-1], touches[:-1], WIDTH) is not None
    assert next_uphill(touches, touches, WIDTH) is None
