from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.splines.closed_curve import fit_closed_curve

FINE = np.arange(4000) / 4000
MANY = np.arange(20000) / 20000


def ellipse(turn: Floats) -> Floats:
    return np.column_stack([2 * np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])


def bean(turn: Floats) -> Floats:
    angle = 2 * np.pi * turn
    radius = 1 + 0.35 * np.cos(2 * angle) + 0.1 * np.sin(3 * angle)
    return radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def square(turn: Floats) -> Floats:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0.0]])
    around = np.linspace(0, 1, 5)
    return np.column_stack([np.interp(turn, around, corners[:, axis]) for axis in (0, 1)])


def hausdorff(found: Floats, wanted: Floats) -> float:
    far = max(
        cKDTree(found).query(wanted)[0].max(),
        cKDTree(wanted).query(found)[0].max(),
    )
    return float(far / np.ptp(wanted, axis=0).max())


@pytest.mark.parametrize("many", [1, 40])
def test_points_in_one_place_give_that_place_and_are_flagged(many: int) -> None:
    curve = fit_closed_curve(np.tile([0.1, -0.2], (many, 1)))
    assert curve.flags.degenerate
    assert np.array_equal(curve.at([0.0, 0.3]), [[0.1, -0.2], [0.1, -0.2]])
    assert curve.area == curve.length == curve.closure_gap == 0.0
    barely = 1e3 + 1e-13 * np.random.default_rng(0).random((40, 2))
    assert fit_closed_curve(barely).flags.degenerate


@pytest.mark.parametrize("count", [None, 16])
def test_duplicates_an_open_end_and_a_closed_one_give_one_curve(count: int | None) -> None:
    open_end = bean(np.arange(60) / 60)
    closed = np.vstack([open_end, open_end[:1]])
    doubled = np.repeat(closed, 3, axis=0)
    wanted = fit_closed_curve(open_end, count=count)
    for points in (closed, doubled):
        found = fit_closed_curve(points, count=count)
        assert np.array_equal(found.control, wanted.control)
        assert np.array_equal(points[found.used], open_end[wanted.used])


def test_as_many_control_points_as_points_do_no_harm() -> None:
    # With even knots and no bending the error is 3000 times the noise.
    noise = 0.026 * np.random.default_rng(0).normal(size=(80, 2))
    curve = fit_closed_curve(bean(np.arange(80) / 80) + noise, count=80, smoothing=None)
    away = cKDTree(bean(MANY)).query(curve.at(FINE))[0]
    assert np.sqrt(np.mean(away**2)) < 1.5 * 0.026
    assert curve.condition < 1e3


@pytest.mark.parametrize("shape", [ellipse, bean])
@pytest.mark.parametrize("count", [None, 16, 40])
def test_most_points_in_a_twentieth_of_the_curve_leave_the_rest_right(
    shape: Callable[[Floats], Floats], count: int | None
) -> None:
    rng = np.random.default_rng(0)
    turns = np.sort(np.concatenate([rng.uniform(0, 0.05, 60), rng.uniform(0.05, 1, 20)]))
    curve = fit_closed_curve(shape(turns), count=count)
    assert curve.flags.uneven
    assert hausdorff(curve.at(FINE), shape(MANY)) < 0.05


@pytest.mark.parametrize("count", [None, 40])
def test_the_corners_of_a_square_are_kept_without_overshoot(count: int | None) -> None:
    curve = fit_closed_curve(square(np.arange(80) / 80), count=count)
    places = curve.at(FINE)
    assert hausdorff(places, square(MANY)) < 0.008
    assert places.min() > -0.05
    assert places.max() < 1.05


@pytest.mark.parametrize("count", [None, 16])
@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 1e3), (1e8, 0.0), (1e-12, 0.0), (1e150, 0.0)])
def test_a_tiny_ring_far_away_and_a_huge_one_are_as_good_as_any(
    scale: float, offset: float, count: int | None
) -> None:
    # Summed about the origin the area of the first is 12.0 instead of 3.14.
    ring = bean(np.arange(80) / 80)
    usual = fit_closed_curve(ring, count=count)
    curve = fit_closed_curve(offset + scale * ring, count=count)
    rounded = 1e-3 if offset else 1e-12
    assert usual.area is not None
    assert curve.area is not None
    assert curve.area / scale / scale == pytest.approx(usual.area, rel=rounded)
    assert curve.length / scale == pytest.approx(usual.length, rel=rounded)
    assert hausdorff((curve.at(FINE) - offset) / scale, usual.at(FINE)) < 2 * rounded
    middle = (area_centroid(offset + scale * ring) - offset) / scale
    assert np.allclose(middle, area_centroid(ring), rtol=0, atol=rounded)


def test_a_figure_of_eight_and_a_curve_that_touches_itself_are_flagged() -> None:
    # The area of the first is next to 0.
    angle = 2 * np.pi * np.arange(80) / 80
    eight = fit_closed_curve(np.column_stack([np.sin(angle), np.sin(2 * angle)]))
    assert eight.flags.self_intersecting
    assert not eight.flags.degenerate
    assert eight.area == pytest.approx(0.0, abs=1e-3)
    limacon = (1.0 + 1.3 * np.cos(angle))[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    assert fit_closed_curve(limacon).flags.self_intersecting
    right = np.column_stack([1 - np.cos(angle), np.sin(angle)])
    touching = fit_closed_curve(np.vstack([right, -right[::-1]]))  # round 0 both times as far
    assert touching.flags.self_intersecting
    assert not fit_closed_curve(bean(np.arange(80) / 80)).flags.self_intersecting


def test_rows_that_are_not_finite_are_dropped_and_counted() -> None:
    points = bean(np.arange(60) / 60)
    holed = np.insert(points, [3, 30, 60], [[np.nan, 0.0], [np.inf, 1.0], [0.0, -np.inf]], axis=0)
    curve = fit_closed_curve(holed)
    assert curve.dropped == 3
    assert np.array_equal(curve.control, fit_closed_curve(points).control)
    assert np.isfinite(holed[curve.used]).all()


@pytest.mark.parametrize("count", [None, 16])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("space", [False, True])
def test_neither_the_beginning_nor_the_direction_changes_the_curve(
    count: int | None, noise: float, space: bool
) -> None:
    points = bean(np.arange(60) / 60)
    points += noise * np.random.default_rng(0).normal(size=points.shape)
    if space:
        points = np.column_stack([points, np.full(60, 0.4)])
    wanted = fit_closed_curve(points, count=count)
    for shift in (1, 17, 59):
        for way in (1, -1):
            turned = np.roll(points, shift, axis=0)[::way]
            found = fit_closed_curve(turned, count=count)
            assert np.array_equal(found.control, wanted.control)
            assert np.array_equal(found.knots, wanted.knots)
            assert np.array_equal(turned[found.used], points[wanted.used])
    places = wanted.at(FINE)[:, :2]
    following = np.roll(places, -1, axis=0)
    assert (places[:, 0] * following[:, 1] - places[:, 1] * following[:, 0]).sum() > 0.0
