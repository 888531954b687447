from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.core.arrays import Floats
from palpate.core.rebuild.reconstruction import reconstruct
from palpate.core.rebuild.solid import LatticeSolid

HALF = 50.0
HEIGHTS = np.linspace(-49.0, 49.0, 9)
TOPS = np.array([[0.0, 0.0, HALF], [0.0, 0.0, -HALF]])


def ring(z: float, count: int = 60, radius: float = 30.0, start: float = 0.0) -> Floats:
    turn = 2 * np.pi * (np.arange(count) / count + start)
    around = radius * (1.0 + 0.1 * np.cos(3 * turn + z / 50.0))
    return np.column_stack([around * np.cos(turn), around * np.sin(turn), np.full(count, z)])


def rings(count: int = 60) -> list[Floats]:
    return [ring(z, count) for z in HEIGHTS]


def skin(contours: Any, tops: Any = TOPS, **more: Any) -> LatticeSolid:
    return reconstruct(contours, tops=tops, method="skin", **more)


@cache
def whole() -> LatticeSolid:
    return skin(rings())


def volume(solid: LatticeSolid) -> float:
    return solid.volume


@cache
def whole_volume() -> float:
    return volume(whole())


WANTED = 30.0**2 * np.pi * (1.0 + 0.1**2 / 2.0) * 2 * HALF


def assert_closed(solid: LatticeSolid) -> None:
    assert solid.check()[:4] == (True, True, 0, 0)  # closed, oriented, genus, self-crossings
    assert np.isfinite(solid.mesh().vertices).all()
    assert all(np.isfinite(value) for value in solid.health().values())


def same_side(one: LatticeSolid, other: LatticeSolid) -> float:
    """Largest distance of two sides at the same places, over the size."""
    heights, turns = np.linspace(-49.0, 49.0, 33)[:, None], np.arange(40) / 40
    off = one.closed.loft.at(heights, turns) - other.closed.loft.at(heights, turns)
    return float(np.abs(off).max()) / 30.0


def test_34_forty_points_in_one_place_are_left_out():
    solid = skin([*rings(), np.tile([1.0, 2.0, 5.0], (40, 1))])
    assert [one[:2] for one in solid.slices.dropped] == [(9, "in one place")]
    assert same_side(solid, whole()) == 0.0


def test_35_points_that_come_twice_and_a_closing_one_change_nothing():
    twice = [np.repeat(one, 2, axis=0) for one in rings()]
    closing = [np.vstack([one, one[:1]]) for one in rings()]
    for contours in (twice, closing):
        assert same_side(skin(contours), whole()) < 1e-12


def test_37_points_crowded_in_one_place_do_not_spoil_the_rest():
    rng = np.random.default_rng(0)
    contours = []
    for z in HEIGHTS:
        place = np.concatenate([0.05 * rng.random(60), 0.05 + 0.95 * np.arange(20) / 20])
        turn = 2 * np.pi * np.sort(place)
        around = np.column_stack([np.cos(turn), np.sin(turn)])
        contours.append(np.column_stack([30.0 * around, np.full(80, z)]))
    assert volume(skin(contours)) == pytest.approx(np.pi * 30.0**2 * 2 * HALF, rel=1e-3)


def test_38_a_square_does_not_swing_out_at_its_corners():
    place = np.arange(40) / 40
    corner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * 30.0
    plane = np.stack([np.interp(place, np.arange(5) / 4, corner[:, i]) for i in (0, 1)], axis=-1)
    solid = skin([np.column_stack([plane, np.full(40, z)]) for z in HEIGHTS])
    side = solid.closed.loft.at(np.linspace(-49, 49, 20)[:, None], np.arange(400) / 400)
    assert np.abs(side).max() < 1.05 * 30.0
    assert volume(solid) == pytest.approx(60.0**2 * 2 * HALF, rel=8e-3)
    assert solid.evidence.outliers == 0


@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 0.0), (1e9, 0.0), (1e-3, 1.0)])
def test_39_unit_and_place_change_nothing(scale, offset):
    solid = skin([scale * one + offset for one in rings()], scale * TOPS + offset)
    assert volume(solid) / scale**3 == pytest.approx(whole_volume(), rel=1e-8)


def test_40_a_contour_that_meets_itself_is_flagged():
    turn = 2 * np.pi * np.arange(80) / 80
    eight = np.column_stack([30 * np.cos(turn) - 8, 20 * np.sin(2 * turn) + 5, np.full(80, 3.0)])
    looped = np.column_stack(
        [
            (20 + 30 * np.cos(turn)) * np.cos(turn),
            (20 + 30 * np.cos(turn)) * np.sin(turn),
            np.full(80, 3.0),
        ]
    )
    assert (9, "around no area") in [one[:2] for one in skin([*rings(), eight]).slices.dropped]
    solid = skin([*rings()[::4], looped])
    assert solid.health()["self_intersecting"] == 1.0
    assert solid.health()["not_starlike"] == 1.0


def test_41_rows_that_are_not_finite_are_left_out():
    spoilt = rings()
    spoilt[3] = np.insert(spoilt[3], 7, [np.nan, 0.0, 0.0], axis=0)
    spoilt[5] = np.insert(spoilt[5], 0, [0.0, np.inf, 0.0], axis=0)
    assert same_side(skin(spoilt), whole()) == 0.0


def test_42_direction_beginning_and_order_change_nothing():
    others = [np.roll(one, 7 * i, axis=0)[:: 1 - 2 * (i % 2)] for i, one in enumerate(rings())]
    assert same_side(skin(others[::-1]), whole()) < 1e-12


def test_43_uneven_points_do_not_pull_the_middle_aside():
    place = np.concatenate([np.linspace(0, 0.2, 60, False), np.linspace(0.2, 1.0, 40, False)])
    turn = 2 * np.pi * place
    contours = [
        np.column_stack([30 * np.cos(turn), 30 * np.sin(turn), np.full(100, z)]) for z in HEIGHTS
    ]
    assert np.abs(skin(contours).slices.middles).max() < 0.005 * 30.0


@pytest.mark.parametrize("name", ["kidney", "star"])
def test_44_sections_that_rays_meet_more_than_once_are_rebuilt_and_flagged(sections, name):
    place = np.arange(90) / 90
    contours = [
        np.column_stack([30 * sections[name](place, z), np.full(90, 50.0 * z)])
        for z in np.linspace(-0.98, 0.98, 15)
    ]
    solid = skin(contours)
    assert solid.health()["not_starlike"] == (15.0 if name == "kidney" else 0.0)
    assert solid.overshoot < 0.02
    rows = [solid.slices.heights[4], solid.slices.heights[10]]
    for z in rows:
        side = solid.closed.loft.at(z, np.arange(200) / 200)
        truth = 30 * sections[name](np.arange(4000) / 4000, z / 50.0)
        apart = np.linalg.norm(side[:, None] - truth, axis=2).min(axis=1)
        assert np.quantile(apart, 0.9) < 0.1 and apart.max() < 1.5


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_49_a_last_contour_that_is_but_a_point_is_a_touch_of_the_end(radius):
    point = [0.0, 0.0, 49.9] + radius * np.random.default_rng(0).normal(size=(20, 3))
    solid = skin([*[one for one in rings() if one[0, 2] < 45.0], point], None)
    assert [one[:2] for one in solid.slices.dropped] == [(8, "in one place: a touch of its end")]
    assert solid.evidence.top == pytest.approx(49.9, abs=0.05)
    assert solid.slices.dropped[0].height == solid.evidence.top
    assert solid.uncovered[1] == 0.0
    assert_closed(solid)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_50_few_contours_are_a_solid(count):
    solid = skin([ring(z) for z in np.linspace(-49, 49, count)])
    assert_closed(solid)
    assert volume(solid) == pytest.approx(WANTED, rel=0.02)


def test_50_one_contour_is_a_prism_if_both_ends_were_touched():
    solid = skin([ring(0.0)])
    assert_closed(solid)
    assert volume(solid) == pytest.approx(WANTED, rel=1e-3)
    for tops in (None, TOPS[:1], TOPS[1:]):
        with pytest.raises(ValueError, match="or 1 with tops that touched both ends, got 1"):
            skin([ring(0.0)], tops)


def test_51_heights_may_be_uneven_and_come_twice():
    heights = np.concatenate([-(np.linspace(0.1, 1, 7) ** 2), np.linspace(0.1, 1, 7) ** 2]) * 49
    solid = skin([ring(z) for z in [*heights, heights[3], 0.0]])
    assert [one.why for one in solid.slices.dropped] == ["repeats another at its height"]
    assert volume(solid) == pytest.approx(WANTED, rel=1e-3)


def test_a_contour_scaled_is_dropped_and_tells_that_it_may_be_a_feature():
    contours = [ring(z) for z in np.linspace(-49, 49, 27)]
    contours[11] = contours[11] * [1.3, 1.3, 1.0]
    solid = skin(contours)
    (dropped,) = solid.slices.dropped
    assert (dropped.which, dropped.why) == (11, "unlike its neighbours")
    assert dropped.height == pytest.approx(contours[11][0, 2])
    assert dropped.off == pytest.approx(0.3 * 30.0, rel=0.05)
    assert dropped.may_be_feature and solid.health()["perhaps_features"] == 1.0
    assert same_side(solid, skin(contours[:11] + contours[12:])) == 0.0


def test_a_contour_that_is_unlike_few_others_is_kept_and_told():
    contours = [ring(z) for z in np.linspace(-49, 49, 6)]
    contours[3] = contours[3] * [1.4, 1.4, 1.0]
    solid = skin(contours)
    assert [one.which for one in solid.evidence.feature_candidates] == [3]
    assert solid.evidence.feature_candidates[0].off > 0.2 * 30.0
    assert solid.health()["suspicious"] == 1.0
    assert whole().health()["suspicious"] == 0.0


def step(seed: int, noise: float) -> list[Floats]:
    """A cylinder that narrows at once, touched at random heights close to the step as well."""
    rng = np.random.default_rng(seed)
    near = 6.0 + np.concatenate([rng.uniform(-3.0, 0.0, 2), 0.1 + rng.uniform(0.0, 3.0, 2)])
    heights = np.concatenate([rng.uniform(-49, 49, 12), near])
    turn = 2 * np.pi * np.arange(60) / 60
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(60)])
    return [
        (30.0 if z < 6.05 else 18.0) * rim + [0.0, 0.0, z] + noise * rng.normal(size=(60, 3))
        for z in heights
    ]


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_a_step_between_contours_close_together_does_not_swing_out(noise):
    for seed in range(2):
        solid = skin(step(seed, noise))
        side = solid.closed.loft.at(np.linspace(-49, 49, 997)[:, None], np.arange(60) / 60)
        radius = np.linalg.norm(side, axis=2)
        assert radius.max() < 30.0 + 0.02 * 60.0
        assert radius.min() > 18.0 - 0.05 * 60.0
        health = solid.health()
        assert health["reparametrised"] == 1.0 and health["swing"] < 0.75
        assert solid.overshoot < 0.02


def test_smooth_objects_keep_their_pace():
    for count in (3, 5, 27):
        solid = skin([ring(z) for z in np.linspace(-49, 49, count)])
        assert solid.health()["reparametrised"] == 0.0


def test_points_that_stray_are_left_out_and_counted():
    rng = np.random.default_rng(1)
    contours = rings(81)
    for one in contours:
        one += 0.2 * rng.normal(size=one.shape)
    clean = skin(contours)
    for one, place in zip(contours, rng.integers(0, 81, 9), strict=True):
        away = rng.normal(size=3) * [1.0, 1.0, 0.0]
        one[place] += 3.0 * away / np.linalg.norm(away)
    solid = skin(contours)
    assert 7.0 <= solid.health()["outlying_points"] <= 9.0
    assert clean.health()["outlying_points"] == 0.0
    assert same_side(solid, clean) < 0.01


def test_a_mesh_of_what_is_mostly_noise_stays_small():
    rng = np.random.default_rng(0)
    solid = skin([one + 5.0 * rng.normal(size=one.shape) * [1.0, 1.0, 0.0] for one in rings()])
    assert len(solid.mesh().faces) < 100_000
    assert len(whole().mesh().faces) > 2_000


@pytest.mark.parametrize(
    ("contours", "tops", "more", "words"),
    [
        ("abc", None, {}, "contours must be a sequence of arrays, got str"),
        (["abc"], None, {}, "contour 0 must be an array of real numbers"),
        ([[]], None, {}, "contours must hold at least one of 3 points"),
        ([np.full((9, 3), np.nan)], None, {}, "contours must hold at least one of 3 points"),
        ([ring(0.0), ring(0.0, radius=20.0)], None, {}, "contour 1: inside another at its height"),
        (rings(), "up", {}, "tops must be an array of real numbers"),
        (rings(), [[0.0, 0.0, 20.0]], {}, "tops must not lie within the contours, got 20 where"),
        (rings(), [[0.0, 0.0, -20.0]], {}, "tops must not lie within the contours, got -20 where"),
        (rings(), None, {"noise": "a"}, "noise must be an array of real numbers"),
        (rings(), None, {"noise": 0.0}, "noise must be positive"),
        (rings(), None, {"noise": np.nan}, "noise must be finite"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(contours, tops, more, words):
    with pytest.raises(ValueError, match=words):
        skin(contours, tops, **more)


@st.composite
def stacks(draw: st.DrawFn) -> list[Floats]:
    """Contours of which anything may be wrong."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    found = []
    for _ in range(draw(st.integers(1, 7))):
        count, z = draw(st.sampled_from([0, 1, 2, 3, 5, 24])), draw(st.integers(-3, 3))
        turn = 2 * np.pi * np.sort(rng.random(count))
        radius = draw(st.sampled_from([0.0, 1e-3, 1.0, 1.5]))
        one = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)]) * radius + [0, 0, z]
        one += draw(st.sampled_from([0.0, 0.0, 0.01, 0.5])) * rng.normal(size=one.shape)
        one += draw(st.sampled_from([0.0, 0.0, 2.0])) * np.array([1.0, 0.0, 0.0])
        if count and draw(st.booleans()):
            one[rng.integers(count)] = draw(st.sampled_from([np.nan, np.inf, 7.0]))
        found.append(one[:: draw(st.sampled_from([-1, 1]))])
    return found


@given(contours=stacks(), touched=st.booleans(), scale=st.sampled_from([1e-9, 1.0, 1e9]))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_whatever_is_given_is_a_finite_closed_solid_or_refused(contours, touched, scale):
    tops = scale * np.array([[0.0, 0.0, 8.0], [0.0, 0.0, -8.0]]) if touched else None
    try:
        solid = skin([scale * one for one in contours], tops)
    except ValueError as error:
        assert len(str(error)) > 20
        return
    mesh = solid.mesh(0.01 * solid.surface.size)
    assert np.isfinite(mesh.vertices).all()
    assert all(np.isfinite(value) for value in solid.health().values())
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


ANGLE = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4.0]])
CLAMP = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4.0]])


def stack(corners: Floats) -> list[Floats]:
    closed = np.concatenate([corners, corners[:1]])
    ways = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = ways[-1] * np.arange(96) / 96
    ring = np.column_stack([np.interp(at, ways, closed[:, axis]) for axis in range(2)])
    return [np.column_stack([ring, np.full(96, height)]) for height in np.linspace(0.0, 5.0, 6)]


@pytest.mark.parametrize("tops", [None, [[1, 1, -1.0], [1, 1, 6.0]]])
def test_an_angle_has_ends_without_folds(tops):
    solid = reconstruct(stack(ANGLE), tops=tops, method="skin")
    assert (solid.health()["folded_below"], solid.health()["folded_above"]) == (0.0, 0.0)
    mesh = solid.mesh()
    corners = mesh.vertices[mesh.faces]
    high = np.ptp(corners[:, :, 2], axis=1) < 1e-9
    sides = corners[high, 1:, :2] - corners[high, :1, :2]
    turned = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    upper = corners[high, 0, 2] > 2.5
    assert upper.any() and (~upper).any()
    assert turned[upper].min() > -1e-12
    assert turned[~upper].max() < 1e-12


def test_a_clamp_tells_that_its_ends_lie_on_themselves():
    for method in ("skin", "lattice"):
        health = reconstruct(stack(CLAMP), method=method).health()
        assert health["folded_below"] == pytest.approx(health["folded_above"], rel=0.01)
        assert health["folded_above"] > 0.2
