"""Contours as closed curves, their stack, and corresponding places."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.geometry import signed_area
from palpate.core.rebuild import contours as stacks
from palpate.core.rebuild.contours import Slices, match_slices
from tests.core.rebuild.objects import SECTIONS, Traced, at_height, circle, curve_distances, polar

HEIGHTS = np.linspace(-0.9, 0.9, 9)
COUNT = 80


def slices_of(contours: Any, heights: Any = None) -> Slices:
    return stacks.stack_curves(stacks.contour_curves(contours, heights))


def curve_of(points: Floats) -> stacks.ContourCurve:
    (curve,) = stacks.contour_curves([points])
    assert isinstance(curve, stacks.ContourCurve)
    return curve


def disc(radius: float, height: float) -> Floats:
    return at_height(radius * circle(40), height)


def in_order(points: Floats) -> Floats:
    return points[np.argsort(np.arctan2(points[:, 1] + 1e-3, points[:, 0]))]


def lobes(turns: Floats, count: int = 3, depth: float = 0.2) -> Floats:
    return polar(turns, 1.0 + depth * np.cos(2 * np.pi * count * turns))


@pytest.mark.parametrize("count", [3, 4, 24, 81])
def test_curve_passes_all_points_of_contour(count):
    turns = np.sort(np.random.default_rng(count).random(count))
    for plane in (circle(count), lobes(turns)):
        loop = curve_of(at_height(plane, 7.0))
        assert loop.height == 7.0
        assert (loop.tilt, loop.error) == (0.0, 0.0)
        assert loop.curve.at(loop.curve.parameters) == pytest.approx(loop.points, abs=1e-12)
        assert in_order(loop.points) == pytest.approx(in_order(plane), abs=1e-12)
        assert loop.fine == pytest.approx(loop.curve.at(np.arange(512) / 512), abs=1e-12)
        assert signed_area(loop.fine) > 0.0
        steps = np.linalg.norm(np.diff(loop.fine, axis=0, append=loop.fine[:1]), axis=1)
        assert loop.perimeter == pytest.approx(steps.sum(), rel=1e-3)


def test_even_noisy_points_keep_even_steps():
    rng = np.random.default_rng(0)
    plane = circle(200) + 0.02 * rng.normal(size=(200, 2))
    noisy = curve_of(at_height(plane, 0.0))
    steps = np.diff(noisy.curve.parameters)
    assert np.ptp(steps) < 1e-12
    assert np.std(np.linalg.norm(noisy.fine, axis=1)) < 0.018
    dense = curve_of(at_height(circle(500) + 0.02 * rng.normal(size=(500, 2)), 0.0))
    assert dense.curve.smoothing > 0.0 and not dense.curve.flags.self_intersecting
    assert dense.perimeter == pytest.approx(2 * np.pi, rel=0.01)
    uneven = lobes((np.arange(81) + rng.uniform(-0.45, 0.45, 81)) / 81)
    assert np.ptp(np.diff(curve_of(at_height(uneven, 0.0)).curve.parameters)) > 5e-3


@pytest.mark.parametrize("harmonic", [1, 2])
def test_tilt_and_saddle_of_heights_are_no_noise(harmonic):
    heights = 0.3 * np.cos(harmonic * 2 * np.pi * np.arange(30) / 30)
    plane = circle(30) * [2.0, 1.0] + [5.0, 0.0]
    loop = curve_of(np.column_stack([plane, 1e6 + heights]))
    assert loop.tilt == pytest.approx(0.3 / np.sqrt(2), rel=1e-6)
    assert loop.error < 1e-6
    assert sorted(loop.rises) == pytest.approx(sorted(heights), abs=1e-9)
    noise = 0.2 * np.random.default_rng(0).normal(size=(30, 60))
    level = [curve_of(np.column_stack([circle(60), one])) for one in noise]
    assert np.linalg.norm([one.tilt for one in level]) / np.sqrt(30) < 0.05
    assert np.mean([one.error for one in level]) == pytest.approx(0.2 / np.sqrt(60), rel=0.1)
    few = curve_of(np.column_stack([circle(4), [0.0, 1.0, 0.0, -1.0]]))
    assert few.tilt == pytest.approx(np.sqrt(0.5))
    assert few.error == 0.0


def test_single_wrong_heights_are_found():
    angle = 2 * np.pi * np.arange(40) / 40
    for shape in (0.1 * np.cos(angle), 0.05 * np.cos(2 * angle), np.zeros(40)):
        assert not curve_of(np.column_stack([circle(40), shape])).off_height.any()
        off = shape.copy()
        off[[5, 6, 30]] += [0.4, 0.3, -0.5]
        loop = curve_of(np.column_stack([circle(40), off]))
        wrong = in_order(loop.as_given[loop.off_height])
        assert wrong == pytest.approx(in_order(circle(40)[[5, 6, 30]]))
    noisy = 0.01 * np.random.default_rng(0).normal(size=40)
    for heights in (noisy, np.where(np.arange(40) % 4 == 0, 1.0, 0.0)):
        assert not curve_of(np.column_stack([circle(40), heights])).off_height.any()
    assert not curve_of(np.column_stack([circle(4), [0.0, 0.0, 0.0, 9.0]])).off_height.any()


def test_star_shapes_are_recognised_exactly_and_nearly():
    turn = 2 * np.pi * np.arange(256) / 256
    noisy = circle(256) + 0.02 * np.random.default_rng(0).normal(size=(256, 2))
    angle = turn + 0.6 * np.sin(4 * turn)  # the outline runs back by half a radian
    hooked = polar(angle / (2 * np.pi), 1 + 0.3 * np.cos(4 * turn))
    figures = np.stack([circle(256), noisy, hooked, circle(256)[::-1], circle(256) + [3.0, 0.0]])
    assert stacks.are_star_shaped(figures).tolist() == [True, False, False, False, False]
    assert stacks.are_nearly_star_shaped(figures).tolist() == [True, True, False, False, False]


def test_slices_rise_and_keep_numbers_of_contours():
    contours = Traced("lobed").contours(HEIGHTS, 60)
    slices = slices_of(contours[::-1])
    assert np.allclose(slices.heights, HEIGHTS, atol=1e-12)
    assert slices.rows.tolist() == list(range(9))[::-1]
    assert slices.dropped == ()
    assert [len(points) for points in slices.points] == [len(one) for one in contours]
    assert slices.star.all()
    assert not slices.self_intersecting.any() and not slices.tilted.any()
    noisy = slices_of(Traced("lobed").contours(HEIGHTS, 80, noise=0.01))
    assert np.abs(noisy.heights - HEIGHTS).max() < 4 * 0.01 / np.sqrt(64)
    assert not noisy.tilted.any()


def test_contours_apart_by_noise_are_one_slice():
    rng = np.random.default_rng(0)
    shake = np.array([0.0, 0.0, 0.01])
    noisy = [disc(1.0, z) + shake * rng.normal(size=(40, 3)) for z in (0, 0.5, 0.5, 1.0)]
    assert len(slices_of(noisy).heights) == 3
    step = [disc(1.0, 0.0), disc(1.0, 0.5), disc(0.6, 0.505), disc(0.6, 1.0)]
    assert len(slices_of(step).heights) == 4
    level = slices_of([disc(1.0, 0.3), disc(1.0, 0.3 + 1e-17), disc(1.0, 0.3)])
    assert (len(level.heights), len(level.dropped)) == (1, 2)


def test_tilted_contour_is_flagged_where_it_reaches_towards_next():
    tilted = disc(1.0, 0.5)
    tilted[:, 2] += 0.2 * tilted[:, 0]
    slices = slices_of([disc(1.0, 0.0), tilted, disc(1.0, 1.0)])
    assert slices.tilted.tolist() == [False, True, False]
    assert slices.tilt[1] == pytest.approx(0.2 / np.sqrt(2), rel=1e-6)
    assert slices.heights[1] == pytest.approx(0.5, abs=1e-12)
    far = slices_of([disc(1.0, -1.0), tilted, disc(1.0, 2.0)])
    assert not far.tilted.any()
    assert slices_of([tilted]).tilted.tolist() == [True]
    assert slices_of([disc(1.0, 0.0)]).tilted.tolist() == [False]


def test_slices_are_dropped_afterwards_with_reason():
    slices = slices_of([np.zeros((2, 3)), *Traced("lobed").contours(HEIGHTS, 60)])
    bad = np.isin(np.arange(9), [0, 5])
    left = slices.without(bad, "unlike its neighbours", np.arange(9.0), ~bad)
    assert left.rows.tolist() == [2, 3, 4, 5, 7, 8, 9]
    assert np.array_equal(left.fine, slices.fine[~bad])
    assert left.curves[0] is slices.curves[1]
    assert [(one.which, one.off) for one in left.dropped] == [(0, 0.0), (1, 0.0), (6, 5.0)]
    assert [one.height for one in left.dropped[1:]] == slices.heights[bad].tolist()
    for wrong in (np.ones(9, bool), np.zeros(8, bool)):
        with pytest.raises(ValueError, match="bad must leave at least one of 9 slices, got"):
            slices.without(wrong, "unlike its neighbours")


@cache
def stack(name: str, count: int, points: int) -> Slices:
    return slices_of(Traced(name).contours(np.linspace(-0.97, 0.97, count), points))


@pytest.mark.parametrize("name", SECTIONS)
def test_matched_places_are_as_good_as_true_ones(name):
    slices, section, between = stack(name, 9, 24), SECTIONS[name], np.linspace(-0.96, 0.96, 40)
    matched = match_slices(slices, COUNT)
    true = []  # the same curves at places that truly correspond
    for curve, z in zip(slices.curves, slices.heights, strict=True):
        fine = curve.at(np.arange(8000) / 8000)
        true.append(fine[cKDTree(fine).query(section(np.arange(COUNT) / COUNT, float(z)))[1]])
    rims = [section(np.arange(1600) / 1600, float(z)) for z in between]
    # Mean distances between the object and cubics through each row of places.
    error, exact = (
        np.mean([curve_distances(*pair) for pair in zip(rims, loft(between), strict=True)])
        for loft in (CubicSpline(slices.heights, grid) for grid in (matched.grid, np.stack(true)))
    )
    # 24 points do not determine the corners of a square: which of them are cut is chance.
    allowed = 1.15 if name == "square" else 1.03
    assert error < allowed * exact + 5e-6
    assert slices.star.all() == (name != "kidney") == ("azimuth" in matched.scores)
    # A score is about the error of a loft through every other contour.
    assert 0.02 * exact < matched.scores[matched.method]


@pytest.mark.parametrize(
    ("angles", "count", "tolerance"),
    [
        (0.06 * np.arange(8), 3, 2e-3),
        (-0.06 * np.arange(8), 3, 2e-3),
        (0.11 * np.arange(8), 4, 2e-3),  # nearly half a lobe each
        (0.1 * np.arange(8) + 0.05 * (np.arange(8) > 3), 4, 6e-3),  # a step like a lobe
    ],
)
def test_signature_follows_lobes(angles, count, tolerance):
    turns = np.arange(512) / 512
    rings = [polar(turns, 1 + 0.1 * np.cos(2 * np.pi * count * (turns - a))) for a in angles]
    slices = slices_of([at_height(ring, z) for z, ring in enumerate(rings)])
    away = match_slices(slices, COUNT, "signature").grid[:, 0] - slices.middles
    steps = np.diff(np.unwrap(np.arctan2(away[:, 1], away[:, 0])) / (2 * np.pi))
    assert steps == pytest.approx(np.diff(angles), abs=tolerance)


def test_least_twist_has_smallest_sum_of_squared_distances():
    turns = np.arange(256) / 256
    angle = 2 * np.pi * turns
    first = np.column_stack([2 * np.cos(angle) + 0.2 * np.cos(2 * angle), np.sin(angle)])
    waves = 0.2 * np.column_stack([np.cos(3 * angle), np.sin(3 * angle)])
    second = 1.3 * (first + waves) @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    slices = slices_of([at_height(first, 0.0), at_height(second, 1.0)])
    matched = match_slices(slices, 256, "twist")
    apart = slices.fine - slices.middles[:, None]
    costs = [((apart[0] - np.roll(apart[1], -k, axis=0)) ** 2).sum() for k in range(512)]
    off = matched.turns[1] - matched.turns[0] - np.argmin(costs) / 512
    assert abs(off - np.round(off)) <= 0.5 / 512 + 1e-9


@pytest.mark.parametrize("method", ["twist", "signature", "ray", "azimuth"])
def test_places_lie_on_curves_in_order(method):
    slices = stack("lobed", 9, 60)
    matched = match_slices(slices, COUNT, method)
    assert matched.method == method
    for curve, row, places in zip(slices.curves, matched.places, matched.grid, strict=True):
        assert curve.at(row) == pytest.approx(places, abs=1e-12)
    assert (np.diff(matched.places, axis=1) > 0).all()
    assert (matched.places[:, -1] - matched.places[:, 0] < 1).all()
    assert ((matched.turns >= 0) & (matched.turns < 1)).all()
    assert np.allclose(np.mod(matched.places[:, 0] - matched.turns + 0.5, 1), 0.5)
    away = matched.grid - slices.middles[:, None]
    if method in ("ray", "azimuth"):
        assert np.abs(away[:, 0, 1]).max() < 1e-3 and (away[:, 0, 0] > 0.0).all()
    if method == "azimuth":
        angle = np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=1)
        assert np.abs(angle - 2 * np.pi * np.arange(COUNT) / COUNT).max() < 1e-3


def test_two_slices_are_matched_without_scores():
    for count in (1, 2):
        matched = match_slices(stack("bent tube", count, 40), 20)
        assert (matched.grid.shape, matched.method, matched.scores) == ((count, 20, 2), "twist", {})
    slices = stack("bent tube", 2, 40)
    with pytest.raises(ValueError, match="count must be at least 3, got 2"):
        match_slices(slices, 2)
    with pytest.raises(ValueError, match="must be auto or one of twist, signature, ray, azimuth"):
        match_slices(slices, 9, "best")  # type: ignore[arg-type]
