"""Faulty contours, and shapes on which rebuilding easily fails."""

from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild import LatticeSolid, reconstruct
from tests.core.rebuild import objects
from tests.core.rebuild.objects import SECTIONS, at_height, circle, column, is_closed, polar, slow

HALF = 50.0
HEIGHTS = np.linspace(-49.0, 49.0, 9)
TOPS = np.array([[0.0, 0.0, HALF], [0.0, 0.0, -HALF]])
VOLUME = 30.0**2 * np.pi * (1.0 + 0.1**2 / 2.0) * 2 * HALF  # of the lobed column


def ring(z: float, count: int = 60, radius: float = 30.0) -> Floats:
    turns = np.arange(count) / count
    return at_height(polar(turns, radius * (1.0 + 0.1 * np.cos(6 * np.pi * turns + z / 50.0))), z)


def rings(count: int = 9, points: int = 60) -> list[Floats]:
    return [ring(z, points) for z in np.linspace(-49.0, 49.0, count)]


def skin(contours: Any, tops: Any = TOPS, **more: Any) -> LatticeSolid:
    return reconstruct(contours, tops=tops, method="skin", **more)


def same(first: LatticeSolid, second: LatticeSolid) -> float:
    """Largest distance at the same places, over the size."""
    v, turns = np.linspace(0.0, 1.0, 33)[:, None], np.arange(40) / 40
    return float(np.abs(first.surface.at(v, turns) - second.surface.at(v, turns)).max()) / 30.0


ANGLE = 2 * np.pi * np.arange(80) / 80
EIGHT = at_height(np.column_stack([30 * np.cos(ANGLE) - 8, 20 * np.sin(2 * ANGLE) + 5]), 3.0)
CLUTTER = at_height(np.random.default_rng(0).uniform(-30.0, 30.0, (60, 2)), 5.0)
LOOP = at_height((20 + 30 * np.cos(ANGLE))[:, None] * circle(80), 3.0)
NONE = dict.fromkeys(("tilted", "self_intersecting", "gaping", "not_starlike"), 0)
TURNS = np.arange(90) / 90
LINE = np.column_stack([np.linspace(0, 1, 9), np.linspace(0, 2, 9), np.full(9, 2.0)])


@pytest.mark.parametrize(
    ("extra", "which", "why"),
    [
        (np.tile([1.0, 2.0, 5.0], (40, 1)), 9, "in one place"),
        (LINE, 9, "on one line"),
        (ring(5.0)[:2], 9, "too few points"),
        (np.repeat(ring(5.0)[:2], 3, axis=0), 9, "too few points"),
        ([], 9, "too few points"),
        (EIGHT, 9, "around no area"),
        (CLUTTER, 9, "its points are in no order"),
        (ring(0.0)[::4], 9, "repeats another at its height"),
        (ring(0.0, radius=9.0), 9, "inside another at its height"),
        (ring(0.0, radius=60.0), 4, "inside another at its height"),
        (ring(0.0, radius=20.0) + [80.0, 0.0, 0.0], 9, "beside another at its height"),
        (ring(0.0, radius=25.0) + [25.0, 0.0, 0.0], 4, "crosses another at its height"),
    ],
)
def test_dropped_contour_says_why_and_leaves_solid_of_others(extra, which, why):
    contours = [*rings(), extra]
    solid = skin(contours)
    assert [one[:2] for one in solid.slices.dropped] == [(which, why)]
    assert same(solid, skin(contours[:which] + contours[which + 1 :])) == 0.0


@pytest.mark.parametrize(
    ("contours", "figures"),
    [
        (rings(), NONE | {"reparametrised": 0, "outlying_points": 0, "suspicious": 0}),
        ([*rings()[::4], LOOP], NONE | {"self_intersecting": 1, "not_starlike": 1}),
        ([ring(z) + 0.8 * (z == 0) * np.outer(ring(z)[:, 0], [0, 0, 1]) for z in HEIGHTS],
         NONE | {"tilted": 1}),
        ([at_height(30.0 * circle(60)[:31], z) for z in HEIGHTS], {"gaping": 9}),
        ([at_height(30.0 * circle(4), z) for z in HEIGHTS], NONE),
        ([at_height(30.0 * SECTIONS["kidney"](TURNS, z / 50), z) for z in HEIGHTS],
         NONE | {"not_starlike": 9}),
        ([at_height(30.0 * SECTIONS["star"](TURNS, z / 50), z) for z in HEIGHTS], NONE),
    ],
)  # fmt: skip
def test_health_counts_kinds_of_contours(contours, figures):
    health = skin(contours).health()
    assert {name: health[name] for name in figures} == figures


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_contour_that_is_point_touches_its_end(radius):
    point = [0.0, 0.0, 49.9] + radius * np.random.default_rng(0).normal(size=(20, 3))
    solid = skin([*[one for one in rings() if one[0, 2] < 45.0], point], None)
    assert [one[:2] for one in solid.slices.dropped] == [(8, "in one place: a touch of its end")]
    assert solid.evidence.top == pytest.approx(49.9, abs=0.05)
    assert solid.slices.dropped[0].height == solid.evidence.top
    assert solid.uncovered[1] == 0.0
    assert is_closed(solid)
    tiny = skin([at_height(1e-9 * circle(9), -49.9), *rings()[1:]], None)
    assert tiny.uncovered[0] == 0.0 and is_closed(tiny)


@pytest.mark.parametrize(("count", "off"), [(1, 1e-3), (2, 0.01), (3, 5e-3), (5, 1e-3)])
def test_few_contours_give_closed_solid(count, off):
    contours = [ring(0.0)] if count == 1 else rings(count)
    solid, exact = skin(contours), skin(contours, noise=1.0)
    assert is_closed(solid)
    assert solid.volume == pytest.approx(VOLUME, rel=off)
    assert solid.health()["reparametrised"] == 0.0
    assert exact.health()["outlying_points"] == 0.0  # whatever noise is stated


def test_dropped_contour_of_other_size_may_be_feature():
    contours = rings(27)
    contours[11] = contours[11] * [1.3, 1.3, 1.0]
    solid = skin(contours)
    (dropped,) = solid.slices.dropped
    assert dropped[:2] == (11, "unlike its neighbours")
    assert dropped.height == pytest.approx(contours[11][0, 2])
    assert dropped.off == pytest.approx(0.3 * 30.0, rel=0.05)
    assert dropped.may_be_feature and solid.health()["perhaps_features"] == 1.0
    assert same(solid, skin(contours[:11] + contours[12:])) == 0.0


@pytest.mark.parametrize("count", [6, slow(9), 11, 12])
def test_neck_of_one_contour_stays_among_few(count):
    contours = column(count)
    which = count // 2
    contours[which] = contours[which] * [0.8, 0.8, 1.0]
    solid = skin(contours)
    listed = [(one.which, round(one.off, 6)) for one in solid.evidence.feature_candidates]
    dropped = [(one.which, one.may_be_feature) for one in solid.slices.dropped]
    kept = [which for which, _ in listed]
    assert (kept, dropped) == (([which], []) if count < 12 else ([], [(which, True)]))
    assert solid.health()["suspicious"] == len(listed)
    assert all(4.0 < off < 8.0 for _, off in listed)
    lobes = 1 + 0.3 * np.cos(6 * np.pi * np.arange(60) / 60)  # a neck of another shape is dropped
    contours[which] = contours[which] * lobes[:, None] ** [1, 1, 0]
    other = [(one.which, one.may_be_feature) for one in skin(contours).slices.dropped]
    assert other == [(which, False)] or count < 9


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_side_does_not_oscillate_at_step_between_close_contours(noise):
    rng = np.random.default_rng(1)
    near = 6.0 + np.concatenate([rng.uniform(-3.0, 0.0, 2), 0.1 + rng.uniform(0.0, 3.0, 2)])
    contours = []
    for z in np.concatenate([rng.uniform(-49, 49, 12), near]):
        contour = at_height((30.0 if z < 6.05 else 18.0) * circle(60), z)
        contours.append(contour + noise * rng.normal(size=contour.shape))
    solid = skin(contours)
    heights = np.linspace(-49, 49, 997)
    radius = np.linalg.norm(solid.side.patch.rings(heights, np.arange(60) / 60), axis=2)
    assert radius.max() < 30.0 + 0.02 * 60.0
    assert radius.min() > 18.0 - 0.05 * 60.0
    health = solid.health()
    assert health["reparametrised"] == 1.0 and health["swing"] < 0.75
    assert solid.overshoot < 0.02 and health["overshoot"] == solid.overshoot


def test_outlying_points_are_left_out_and_counted():
    rng = np.random.default_rng(1)
    contours = [contour + 0.2 * rng.normal(size=contour.shape) for contour in rings(9, 81)]
    clean = skin(contours)
    for contour, place in zip(contours, rng.integers(0, 81, 9), strict=True):
        contour[place, :2] += 3.0 * polar(rng.random(1), 1.0)[0]
    solid = skin(contours)
    assert 7.0 <= solid.health()["outlying_points"] <= 9.0
    assert clean.health()["outlying_points"] == 0.0
    assert same(solid, clean) < 0.01


def test_noisy_mesh_stays_small_and_oscillating_side_closes():
    rng = np.random.default_rng(0)
    solid = skin([one + 5.0 * rng.normal(size=one.shape) * [1.0, 1.0, 0.0] for one in rings()])
    assert len(solid.mesh().faces) < 100_000
    wild = [one * [0.1, 0.1, 1.0] if row % 2 else one for row, one in enumerate(column(9))]
    rebuilt = skin(wild, None)
    for share in (0.002, 0.05, 100.0):
        assert is_closed(rebuilt, share * rebuilt.surface.size)


@pytest.mark.parametrize(("ratio", "count"), [(20.0, 200), (50.0, 24)])
def test_thin_blade_has_its_volume(ratio, count):
    plane = 50.0 * circle(count) * [1.0, 1.0 / ratio]
    solid = skin([at_height(plane, z) for z in HEIGHTS], None)
    assert solid.volume == pytest.approx(np.pi * 2500.0 / ratio * 98.0, rel=6e-3)
    assert solid.health()["outlying_points"] == 0.0


@pytest.mark.parametrize("order", ["shuffled", slow("by columns"), slow("zigzag"), slow("doubled")])
def test_shuffled_points_give_solid_of_ordered_points(order):
    rng = np.random.default_rng(3)
    radius = 30.0 * (1.0 + 0.1 * np.cos(6 * np.pi * np.arange(40) / 40))
    ordered = [at_height(radius[:, None] * circle(40), z) for z in HEIGHTS]
    arranged = {
        "shuffled": lambda one: rng.permutation(one),
        "by columns": lambda one: one[np.argsort(one[:, 0])],
        "zigzag": lambda one: one[np.arange(40).reshape(2, 20).T.ravel()],
        "doubled": lambda one: rng.permutation(np.concatenate([one, one])),
    }[order]
    solid, right = skin([arranged(one) for one in ordered]), skin(ordered)
    assert solid.volume == pytest.approx(right.volume, rel=1e-6)
    with pytest.raises(ValueError, match="in order around the object, and those of contour 0"):
        skin([CLUTTER + [0.0, 0.0, z] for z in HEIGHTS], None)


def test_stated_error_includes_points_of_tilted_contours():
    contours = [at_height(30.0 * circle(40), 4.0 * number) for number in range(7)]
    for number, contour in enumerate(contours):
        contour[:, 2] += np.tan(np.radians(5.0)) * (contour[:, 0] if number % 2 else contour[:, 1])
    solid = skin(contours, None)
    missed = solid.signed_distance(np.concatenate(contours))
    stated, all_of_it = solid.uncertainty(), solid.whole_deviation()
    expected = np.sqrt(np.mean(missed**2))
    assert 0.99 * expected < stated.rms < 1.2 * expected + 0.5
    assert stated.most > 0.99 * np.abs(missed).max()
    assert all_of_it.whole > 0.99 * expected


def test_ends_of_clamp_fold_and_of_angle_do_not():
    angle, clamp = (
        [
            at_height(objects.along(np.array(corners), np.arange(96) / 96), z)
            for z in np.linspace(0, 5, 6)
        ]
        for corners in (
            [[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]],
            [[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [4, 3], [4, 4], [0, 4]],
        )
    )
    for tops in (None, [[1, 1, -1.0], [1, 1, 6.0]]):
        solid = skin(angle, tops)
        assert (solid.health()["folded_below"], solid.health()["folded_above"]) == (0.0, 0.0)
        mesh = solid.mesh()
        corners = mesh.vertices[mesh.faces]
        level = np.ptp(corners[:, :, 2], axis=1) < 1e-9
        edges = corners[level, 1:, :2] - corners[level, :1, :2]
        facing = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
        upper = corners[level, 0, 2] > 2.5
        assert facing[upper].min() > -1e-12 and facing[~upper].max() < 1e-12
    folded = skin(clamp, None).health()
    assert folded["folded_below"] == pytest.approx(folded["folded_above"], rel=0.01)
    assert folded["folded_above"] > 0.2


def test_any_contours_give_closed_solid_or_error():
    rng = np.random.default_rng(0)
    for trial in range(14):
        contours = []
        for _ in range(rng.integers(1, 8)):  # contours with random faults
            turns = np.sort(rng.random(rng.choice([0, 1, 3, 5, 24])))
            plane = polar(turns, rng.choice([0, 1e-3, 1])) + rng.choice([0.0, 0.0, 2.0])
            contour = at_height(plane, rng.integers(-3, 4))
            contour += rng.choice([0.0, 0.0, 0.01, 0.5]) * rng.normal(size=contour.shape)
            if len(contour) and rng.random() < 0.5:
                contour[rng.integers(len(contour))] = rng.choice([np.nan, np.inf, 7.0])
            contours.append(10.0 ** (9 * (trial % 3 - 1)) * contour)
        try:
            solid = skin(contours, None)
        except ValueError as error:
            assert len(str(error)) > 20
        else:
            assert is_closed(solid, 0.01 * solid.surface.size)
