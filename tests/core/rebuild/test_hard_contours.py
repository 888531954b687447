"""Contours on which rebuilding went wrong: blades, half turns, over-declared noise, rods."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours import contour_curves
from palpate.core.rebuild.reconstruction import reconstruct

LEVELS = np.linspace(-0.04, 0.04, 9)
LENGTH = LEVELS[-1] - LEVELS[0]


def ellipses(
    wide: float, narrow: float, count: int, turns: float = 1.0, *, by_length: bool = False
) -> list[Floats]:
    """Contours of an elliptic cylinder, of points at even angles or even steps along it, m."""
    angles = 2.0 * np.pi * turns * np.arange(count) / count
    if by_length:
        fine = np.linspace(0.0, 2.0 * np.pi, 20_001)
        steps = np.hypot(wide * np.diff(np.cos(fine)), narrow * np.diff(np.sin(fine)))
        way = np.concatenate([[0.0], np.cumsum(steps)])
        angles = np.interp(np.arange(count) / count * way[-1], way, fine)
    x, y = wide * np.cos(angles), narrow * np.sin(angles)
    return [np.column_stack([x, y, np.full(count, z)]) for z in LEVELS]


@pytest.mark.parametrize("by_length", [False, True])
@pytest.mark.parametrize(
    ("ratio", "count"), [(20.0, 24), (20.0, 60), (20.0, 200), (50.0, 24), (50.0, 60)]
)
def test_a_blade_has_the_volume_that_it_has(ratio, count, by_length):
    solid = reconstruct(ellipses(0.05, 0.05 / ratio, count, by_length=by_length))
    volume = np.pi * 0.05**2 / ratio * LENGTH
    assert solid.volume == pytest.approx(volume, rel=6e-3)
    assert solid.health()["outlying_points"] == 0.0


@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-3])
def test_exact_points_are_no_outliers_however_much_noise_is_declared(noise):
    solid = reconstruct(ellipses(0.03, 0.02, 40), noise=noise)
    assert solid.health()["outlying_points"] == 0.0
    volume = np.pi * 0.03 * 0.02 * LENGTH
    assert solid.volume == pytest.approx(volume, rel=3e-3)


def test_contours_that_cover_half_a_turn_are_said_to_gape():
    assert reconstruct(ellipses(0.03, 0.03, 30, 0.5)).health()["gaping"] == len(LEVELS)
    assert reconstruct(ellipses(0.03, 0.03, 30)).health()["gaping"] == 0.0
    square = [np.array([[1, 1, z], [-1, 1, z], [-1, -1, z], [1, -1, z]]) * 0.02 for z in (0, 1, 2)]
    assert reconstruct(square).health()["gaping"] == 0.0


def test_a_rod_is_as_good_as_what_is_thick():
    rod = [one + [0.1 * one[0, 2], 0.0, 0.0] for one in ellipses(3e-4, 3e-4, 40)]
    solid = reconstruct(rod)
    assert solid.method == "lattice"
    assert solid.volume == pytest.approx(np.pi * 3e-4**2 * LENGTH, rel=3e-3)


def circles(count: int, points: int, lobes: float = 0.0, missing: tuple[int, ...] = ()) -> list:
    """Sections of a cylinder of 30 mm, round or of three lobes; the middle one lacks points."""
    found = []
    for number in range(count):
        angles = 2.0 * np.pi * np.arange(points) / points
        if number == count // 2:
            angles = np.delete(angles, missing)
        radius = 0.03 * (1.0 + lobes * np.cos(3.0 * angles))
        level = np.full(len(angles), 0.004 * number)
        found.append(np.column_stack([radius * np.cos(angles), radius * np.sin(angles), level]))
    return found


@pytest.mark.parametrize("lobes", [0.0, 0.1, 0.25])
@pytest.mark.parametrize(("count", "points"), [(12, 8), (15, 16), (15, 40)])
def test_a_missing_point_is_no_difference_of_shape(count, points, lobes):
    solid = reconstruct(circles(count, points, lobes, (3,)), method="skin")
    assert not solid.slices.dropped and not solid.evidence.feature_candidates


def test_an_odd_contour_is_found_though_points_are_missing():
    contours = circles(15, 40, 0.1, (3, 11))
    contours[10][:, :2] *= 1.15
    dropped = reconstruct(contours, method="skin").slices.dropped
    assert [one.which for one in dropped] == [10]


@pytest.mark.parametrize("order", ["shuffled", "by columns", "zigzag", "twice", "doubled"])
@pytest.mark.parametrize("lobes", [0.0, 0.25])
def test_points_in_no_order_give_the_solid_of_those_in_order(order, lobes):
    rng = np.random.default_rng(3)
    ordered = circles(9, 40, lobes)
    given = {
        "shuffled": lambda one: rng.permutation(one),
        "by columns": lambda one: one[np.argsort(one[:, 0])],
        "zigzag": lambda one: one[np.arange(40).reshape(2, 20).T.ravel()],
        "twice": lambda one: np.concatenate([one, one]),
        "doubled": lambda one: rng.permutation(np.concatenate([one, one])),
    }[order]
    solid = reconstruct([given(one) for one in ordered], method="skin")
    volume = reconstruct(ordered, method="skin").volume
    assert solid.volume == pytest.approx(volume, rel=1e-6)


def test_points_that_have_no_order_are_dropped_by_name():
    contours = circles(9, 40)
    contours[4][:, :2] = np.random.default_rng(0).uniform(-0.03, 0.03, (40, 2))
    dropped = reconstruct(contours, method="skin").slices.dropped
    assert [(one.which, one.why) for one in dropped] == [(4, "its points are in no order")]
    with pytest.raises(ValueError, match="in order around the object, and those of contour 0"):
        reconstruct([contours[4] + [0.0, 0.0, level] for level in LEVELS])


def test_noise_is_no_disorder():
    rng = np.random.default_rng(5)
    for points in (24, 60, 200):
        contours = circles(9, points, 0.1)
        for one in contours:
            one[:, :2] += 0.005 * rng.normal(size=(points, 2))
        assert not any(loop.disordered or loop.reordered for loop in contour_curves(contours))


@pytest.mark.parametrize("lean", [5.0, 15.0, 30.0])
def test_stated_error_knows_the_points_of_leaning_contours(lean):
    contours = circles(7, 40)
    for number, one in enumerate(contours):
        one[:, 2] += np.tan(np.radians(lean)) * (one[:, 0] if number % 2 else one[:, 1])
    solid = reconstruct(contours, method="skin")
    missed = solid.signed_distance(np.concatenate(contours))
    stated = solid.uncertainty()
    assert stated is not None
    assert stated.rms > 0.99 * np.sqrt(np.mean(missed**2))
    assert stated.most > 0.99 * np.abs(missed).max()
