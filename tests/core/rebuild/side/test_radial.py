from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.contours.contacts import ContactPoints, stack_points
from palpate.core.rebuild.side import radial as along
from palpate.core.rebuild.side.equations import AxisCurve, fit_axis_curve
from palpate.core.rebuild.side.radial import (
    FINE_SECTORS,
    HALVED,
    LEAST,
    SECTORS,
    SPANS,
    along_basis,
    bending_root,
    bridged,
    coverage_of,
    even_spans,
    fit_radial_spline,
    gap_widths,
    radial_fit,
    with_normals,
)
from palpate.core.rebuild.side.shifts import stiffened
from palpate.core.rebuild.side.smoothing import bending_along

Make = Callable[..., Any]
HEIGHT = 0.06
TURNS = np.linspace(0.0, 1.0, 24, endpoint=False)


def upright() -> AxisCurve:
    return fit_axis_curve(np.array([0.0]), np.zeros((1, 2)))


def everywhere(ellipsoid: Any) -> ContactPoints:
    contacts: ContactPoints = ellipsoid.contacts_at(
        np.concatenate([ellipsoid.section(s) for s in np.linspace(-0.98, 0.98, 49)])
    )
    return contacts


def ellipse(heights: Floats, turns: Floats, a: float, b: float) -> Floats:
    """Squared distance from the axis of an ellipsoid that stands on height 0."""
    azimuth = 2 * np.pi * turns
    level = 1 - (heights / (HEIGHT / 2) - 1) ** 2
    return np.asarray(level[:, None] / ((np.cos(azimuth) / a) ** 2 + (np.sin(azimuth) / b) ** 2))


def test_the_spline_of_an_ellipsoid_is_the_ellipsoid(oracle):
    contacts = everywhere(oracle([0.04, 0.025, 0.03], [1.0, 1.0]))
    spline = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    heights = np.linspace(0.003, 0.057, 40)
    wanted = ellipse(heights, TURNS, 0.04, 0.025)
    error = np.sqrt(spline.squared(heights, TURNS)) - np.sqrt(wanted)
    assert np.abs(error).max() < 5e-6
    assert spline.sigma < 2e-6
    assert 1.0 < spline.system.condition < 1e8


def test_the_spline_is_taken_about_a_leaning_axis():
    heights = np.repeat(np.linspace(0.0, HEIGHT, 30), 60)
    turn = np.tile(2 * np.pi * np.arange(60) / 60, 30)
    axis = np.column_stack([0.2 * heights, -0.1 * heights])
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    points = np.column_stack([axis + 0.02 * rim, heights])
    normals = np.column_stack([rim, np.zeros(len(rim))])
    ends = np.array([0.0, HEIGHT])
    axis_curve = fit_axis_curve(ends, np.column_stack([0.2 * ends, -0.1 * ends]))
    spline = fit_radial_spline(
        ContactPoints(points, normals, np.zeros(len(points), np.int32)), axis_curve, 0.0, HEIGHT
    )
    squared = spline.squared(np.linspace(0, HEIGHT, 20), TURNS)
    assert np.allclose(np.sqrt(squared), 0.02, rtol=0, atol=1e-9)


def test_a_band_that_was_not_touched_is_bridged_smoothly(oracle):
    ball = oracle([0.03] * 3, [1.0, 1.0])
    contacts = stack_points([ball.band(share) for share in (-0.8, 0.8)] + [ball.top()])
    spline = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    radius = np.sqrt(spline.squared(np.linspace(0.01, 0.05, 30), TURNS))
    wanted = np.sqrt(ellipse(np.linspace(0.01, 0.05, 30), TURNS, 0.03, 0.03))
    assert np.abs(radius - wanted).max() < 1e-3
    assert np.isfinite(radius).all()


def test_the_deviation_is_large_where_nothing_was_touched(oracle):
    ball = oracle([0.03] * 3, [1.0, 1.0])
    contacts = stack_points([ball.band(-0.7), ball.band(0.7)])
    noise = np.random.default_rng(0).normal(scale=2e-5, size=(len(contacts.points), 1))
    noisy = contacts._replace(points=contacts.points + noise * np.asarray(contacts.normals))
    spline = fit_radial_spline(noisy, upright(), 0.0, HEIGHT)
    at_bands, between = spline.deviation(np.array([0.009, 0.03]), TURNS).mean(axis=1)
    assert 0.0 < at_bands < 3e-5
    assert between > 10 * at_bands


def test_noise_is_averaged_and_the_deviation_tells_how_well(oracle):
    ball = oracle([0.03] * 3, [1.0, 1.0])
    contacts, sigma = everywhere(ball), 5e-5
    noise = np.random.default_rng(1).normal(scale=sigma, size=(len(contacts.points), 1))
    noisy = contacts._replace(points=contacts.points + noise * np.asarray(contacts.normals))
    spline = stiffened(fit_radial_spline(noisy, upright(), 0.0, HEIGHT))
    assert spline.stiffness > 1.0
    heights = np.linspace(0.01, 0.05, 30)
    error = np.sqrt(spline.squared(heights, TURNS)) - np.sqrt(ellipse(heights, TURNS, 0.03, 0.03))
    along_normal = error * (np.sqrt(ellipse(heights, TURNS, 0.03, 0.03)) / 0.03)
    assert spline.sigma == pytest.approx(sigma, rel=0.2)
    pooled = float(np.sqrt(np.mean(along_normal**2)))
    assert pooled < 0.6 * sigma
    told = float(np.sqrt(np.mean(spline.deviation(heights, TURNS) ** 2)))
    assert 0.5 < told / pooled < 2.0


def contacts_of(points: Floats, normals: Floats) -> ContactPoints:
    return ContactPoints(points, normals, np.zeros(len(points), np.int32))


def test_points_on_level_faces_and_outside_the_heights_are_left_out(oracle):
    ball = oracle([0.03] * 3, [1.0, 1.0])
    contacts = everywhere(ball)
    level = contacts_of(np.array([[0.001, 0.0, 0.03]] * 50), np.array([[0.0, 0.0, 1.0]] * 50))
    beyond = contacts_of(np.array([[0.5, 0.0, 0.09]] * 50), np.array([[1.0, 0.0, 0.0]] * 50))
    on_axis = contacts_of(np.array([[0.0, 0.0, 0.03]]), np.array([[1.0, 0.0, 0.0]]))
    alone = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    with_them = fit_radial_spline(
        stack_points([contacts, level, beyond, on_axis]), upright(), 0.0, HEIGHT
    )
    assert np.array_equal(alone.coefficients, with_them.coefficients)


def test_a_spline_without_any_point_on_the_side_is_refused():
    up = contacts_of(np.array([[0.01, 0.0, 0.03]]), np.array([[0.0, 0.0, 1.0]]))
    for contacts in (up, stack_points([])):
        with pytest.raises(
            ValueError, match=r"no contact point lies on the side between 0 and 0.06 m"
        ):
            fit_radial_spline(contacts, upright(), 0.0, HEIGHT)


def test_normals_that_nobody_measured_are_those_of_the_surface(oracle):
    contacts = everywhere(oracle([0.04, 0.025, 0.03], [1.0, 1.0]))
    side = np.abs(contacts.points[:, 2] - 0.03) < 0.02
    blind = contacts._replace(normals=None)
    found = with_normals(blind, upright(), 0.0, HEIGHT).normals
    assert found is not None and contacts.normals is not None
    assert np.einsum("ni,ni->n", found, contacts.normals)[side].min() > np.cos(np.radians(0.5))
    assert with_normals(contacts, upright(), 0.0, HEIGHT) is contacts


def test_the_squared_distance_never_falls_below_its_least(oracle):
    ball = oracle([0.03] * 3, [1.0, 1.0])
    spline = fit_radial_spline(ball.band(0.0), upright(), 0.0, HEIGHT)
    least = LEAST * spline.middle**2
    assert spline.squared(np.linspace(-1.0, 1.0, 50), TURNS).min() >= least > 0.0


def test_spans_are_even_but_for_those_at_the_ends_which_are_halved_and_halved_again():
    breaks = np.unique(along_basis().knots)
    widths = np.diff(breaks) * SPANS
    assert len(widths) == SPANS + 2 * HALVED
    assert np.allclose(widths[: HALVED + 1], [1 / 16, 1 / 16, 1 / 8, 1 / 4, 1 / 2])
    assert np.allclose(widths, widths[::-1])
    assert np.allclose(widths[HALVED + 1 : -HALVED - 1], 1)
    assert np.array_equal(np.bincount(even_spans())[[0, 1, SPANS - 2, SPANS - 1]], [5, 1, 1, 5])


def test_bending_counts_on_a_span_by_the_third_power_of_its_width():
    parabola = along_basis().greville() ** 2
    even, counted = (root @ parabola for root in (bending_along(along_basis()), bending_root()))
    shares = counted**2 / even**2
    assert np.allclose(shares[:2], 1 / 16**3) and np.allclose(shares[len(shares) // 2], 1)


def blunt_error(oracle: Make) -> float:
    """Misfit along the normals next to the ends of a solid blunter than an ellipsoid, m."""
    solid = oracle([0.04, 0.025, 0.03], [0.5, 1.0])
    contacts = solid.contacts_at(
        np.concatenate([solid.section(s) for s in np.linspace(-0.995, 0.995, 133)])
    )
    spline = fit_radial_spline(
        contacts, fit_axis_curve(np.array([0.0]), np.zeros((1, 2))), 0.0, 0.06
    )
    next_to_ends = np.abs(spline.rows.heights / 0.03 - 1.0) > 0.95
    return float(np.sqrt(np.mean(spline.misfits[next_to_ends] ** 2)))


def test_halved_spans_follow_a_blunt_end_where_even_ones_swing(oracle, monkeypatch):
    halved = blunt_error(oracle)
    tables = (along_basis, even_spans, bending_root)
    monkeypatch.setattr(along, "HALVED", 0)
    for table in tables:
        table.cache_clear()
    even = blunt_error(oracle)
    for table in tables:
        table.cache_clear()
    assert halved < 2e-6 < 1e-5 < even


PITCH = 1e-3


def with_gap(width: float, height: float = 0.03, turn: float = 0.02) -> ContactPoints:
    """A ball of 60 mm, touched every mm all around but in a circle of a width, m, on its side.

    Next to that its surface falls into a pit.
    """
    angle, level = 2 * np.pi * np.arange(188) / 188, np.arcsin(np.linspace(-0.97, 0.97, 61))
    at = np.stack(np.meshgrid(level, angle), axis=-1).reshape(-1, 2)
    out = np.column_stack(
        [np.cos(at[:, 0]) * np.cos(at[:, 1]), np.cos(at[:, 0]) * np.sin(at[:, 1]), np.sin(at[:, 0])]
    )
    points = np.array([0.0, 0.0, 0.03]) + 0.03 * out
    azimuth, rise = 2 * np.pi * turn, (height - 0.03) / 0.03
    level = np.sqrt(1 - rise**2)
    centre = np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])
    towards = centre - out * (out @ centre)[:, None]
    away = np.linalg.norm(towards, axis=1)
    apart = 0.03 * np.arccos(np.clip(out @ centre, -1, 1))
    into = np.clip(1 - (apart - 0.5 * width) / 1.5e-3, 0, 1) * (width > 0.0)
    normals = out + (2.0 * into / np.maximum(away, 1e-9))[:, None] * towards
    points -= (1.5e-3 * into**2)[:, None] * out
    kept = apart >= 0.5 * width
    touch = (np.arange(len(points)) // 100)[kept]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ContactPoints(points[kept], normals[kept], np.unique(touch, return_inverse=True)[1])


@pytest.mark.parametrize(("height", "turn"), [(0.03, 0.02), (0.0313, 0.479), (0.02, 0.6)])
def test_a_gap_has_a_deviation_of_its_size_wherever_it_lies(height: float, turn: float) -> None:
    told = {}
    for width in (0.0, 0.012):
        contacts = with_gap(width, height, turn)
        spline = bridged(contacts, fit_radial_spline(contacts, upright(), 0.0, HEIGHT))
        seen = coverage_of(spline.rows.heights, spline.rows.places[:, 1])
        assert seen is not None
        fit = radial_fit(spline, seen, None, (0.004, 0.056), False)
        told[width] = np.sqrt(np.interp(height, fit.band_heights, fit.band**2))
    # The share of the ring that it takes, and what a cone of its width has on average across.
    ring = 2 * np.pi * np.sqrt(0.03**2 - (height - 0.03) ** 2)
    expected = 0.012 * np.sqrt(0.012 / ring / 3)
    assert told[0.0] < 1e-5
    assert told[0.012] == pytest.approx(expected, rel=0.4)


def test_gaps_are_bridged_and_not_carried_on_to_the_axis() -> None:
    contacts = with_gap(0.014)
    plain = fit_radial_spline(contacts, upright(), 0.0, HEIGHT)
    across = np.linspace(-0.04, 0.08, 25)
    plunging, skin = (
        np.sqrt(one.squared(np.array([0.03]), across)).min()
        for one in (plain, bridged(contacts, plain))
    )
    assert skin > 0.02
    assert plunging < 0.5 * skin


def test_what_lies_between_touched_rings_is_no_gap() -> None:
    contacts = with_gap(0.0)
    z = contacts.points[:, 2]
    apart = contacts._replace(
        **{name: getattr(contacts, name)[np.abs(z - 0.03) > 0.006] for name in contacts._fields}
    )
    spline = fit_radial_spline(apart, upright(), 0.0, HEIGHT)
    assert not gap_widths(spline, np.linspace(0.004, 0.056, 27), TURNS).any()
    assert bridged(apart, spline) is spline


def test_single_points_tell_of_no_gaps() -> None:
    contacts = with_gap(0.012)
    each = contacts._replace(touch=np.arange(len(contacts.points)))
    spline = fit_radial_spline(each, upright(), 0.0, HEIGHT)
    assert not gap_widths(spline, np.array([0.03]), TURNS).any()


COVERAGE_TURNS = (np.arange(SECTORS) + 0.5) / SECTORS


def test_the_side_reaches_as_far_as_every_sector_was_touched():
    heights = np.concatenate([np.zeros(SECTORS), np.full(SECTORS, 0.04)])
    turns = np.tile(COVERAGE_TURNS, 2)
    heights[3], heights[SECTORS + 5] = 0.01, 0.03
    seen = coverage_of(heights, turns)
    assert seen is not None
    assert (seen.low, seen.high, seen.gap) == pytest.approx((0.01, 0.03, 0.04))
    finer = FINE_SECTORS // SECTORS
    touched = np.isfinite(seen.lows)
    assert np.count_nonzero(touched) == SECTORS
    assert (seen.lows[3 * finer + finer // 2], seen.highs[5 * finer + finer // 2]) == pytest.approx(
        (0.01, 0.03)
    )
    assert np.count_nonzero(seen.lows[touched]) == 1


def test_the_gap_is_the_highest_stretch_that_a_sector_misses():
    levels = np.array([0.0, 0.01, 0.02, 0.03])
    heights, turns = np.repeat(levels, SECTORS), np.tile(COVERAGE_TURNS, 4)
    kept = ~((heights == 0.02) & (turns == COVERAGE_TURNS[7]))
    seen = coverage_of(heights[kept], turns[kept] + 3.0)
    assert seen is not None
    assert seen.gap == pytest.approx(0.02)


def test_a_side_that_was_not_touched_all_around_has_no_coverage():
    assert coverage_of(np.zeros(SECTORS - 1), COVERAGE_TURNS[1:]) is None
    assert coverage_of(np.zeros(0), np.zeros(0)) is None
