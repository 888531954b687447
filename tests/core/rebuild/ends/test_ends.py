"""Ends determined by contours: families, poles, shoulders, profiles, invalid input."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends import close_ends, profile_curves
from tests.core.rebuild.objects import circle, polar

TURNS = np.arange(80) / 80
FRACTIONS = np.linspace(0.0, 1.0, 33)


def superellipse(z: Floats, exponent: float) -> Floats:
    return np.asarray(np.maximum(1.0 - np.abs(z / 50) ** (2 / exponent), 0.0) ** (exponent / 2))


# Radius by azimuth and height, between the heights -50 and 50.
SHAPES: dict[str, Callable[[Floats, Floats], Floats]] = {
    "sphere": lambda t, z: np.sqrt(np.maximum(2500 - z**2, 0)) + 0 * t,
    "ellipsoid": lambda t, z: superellipse(z, 1.0) / np.hypot(np.cos(t) / 35, np.sin(t) / 25),
    "paraboloid": lambda t, z: np.sqrt(8.0 * np.maximum(50.0 - z, 0.0)) + 0 * t,
    "cylinder": lambda t, z: 30.0 + 0 * (t + z),
    "rounded cylinder": lambda t, z: 30 * superellipse(z, 0.2) + 0 * t,
    "rounded box": lambda t, z: (
        30 * superellipse(z, 0.2) / (np.cos(t) ** 10 + np.sin(t) ** 10) ** 0.1
    ),
    "frustum": lambda t, z: 30 - 0.15 * z + 0 * t,
    "cone": lambda t, z: 0.3 * (50 - z) + 0 * t,
    "egg": lambda t, z: superellipse(z, 1.0) * (32 + 0.12 * z) + 0 * t,
    "lobed vase": lambda t, z: (
        (28 + 6 * np.sin(0.06 * z)) * (1 + 0.1 * np.cos(4 * t)) * superellipse(z, 0.5) ** 2
    ),
}


def contours(
    name: str, gap: float, count: int = 27, noise: float = 0.0
) -> tuple[Floats, Floats, dict[str, float]]:
    rng = np.random.default_rng(7)
    heights = np.linspace(-50.0 + gap, 50.0 - gap, count)
    radius = SHAPES[name](2 * np.pi * TURNS[None], heights[:, None])
    radius = radius + noise * rng.normal(size=(count, 80))
    low, high = np.array([-50.0, 50.0]) + noise * rng.normal(size=2)
    return heights, radius[..., None] * circle(80), {"bottom": low, "top": high}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("sphere", "conic"),
        ("ellipsoid", "conic"),
        ("rounded box", "superellipse"),
        ("egg", "conic"),
        ("cylinder", "flat"),
        ("frustum", "flat"),
        ("rounded cylinder", "superellipse"),
    ],
)
def test_touched_end_has_family_that_predicts_last_contour(name, kind):
    heights, grid, tops = contours(name, 5.0)
    ends = close_ends(heights, grid, **tops)
    assert [end.kind for end in ends] == [kind, kind]
    assert [end.height for end in ends] == [-50.0, 50.0]
    assert [(end.uncovered, end.unseen, end.starlike) for end in ends] == [(0.0, 5.0, True)] * 2
    assert [end.round for end in ends] == [kind == "conic"] * 2
    for row, end in zip((0, -1), ends, strict=True):
        levels = heights[row] + (end.height - heights[row]) * FRACTIONS[:-1]
        mean = np.sqrt(np.mean(SHAPES[name](2 * np.pi * TURNS, levels[:, None]) ** 2, axis=1))
        expected = mean / mean[0]
        off = np.abs(end.profile.radius_ratios(FRACTIONS[:-1]) - expected)
        assert off.max() < {"sphere": 1e-6, "ellipsoid": 1e-6}.get(name, 0.02)


@pytest.mark.parametrize("gap", [0.5, 2.0, 5.0])
@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "egg", "paraboloid", "cone"])
def test_untouched_pole_is_extrapolated_from_contours(name, gap):
    heights, grid, _ = contours(name, gap)
    ends = close_ends(heights, grid)
    for end, pole in zip(ends, (-50.0, 50.0), strict=True):
        if pole > 0.0 or name not in ("paraboloid", "cone"):
            assert (end.kind, end.round, end.uncovered) == ("pole", True, 0.0)
            assert end.height == pytest.approx(pole, abs=0.05)


@pytest.mark.parametrize("name", ["cylinder", "rounded box", "frustum"])
def test_untouched_flat_end_leaves_spacing_uncovered(name):
    heights, grid, tops = contours(name, 5.0)
    for end, rim in zip(close_ends(heights, grid), heights[[0, -1]], strict=True):
        assert (end.kind, end.round) == ("fan", False)
        assert end.height == end.rim == rim
        assert end.uncovered == pytest.approx(heights[1] - heights[0])
    bottom, top = close_ends(heights, grid, top=tops["top"])
    assert (bottom.kind, top.height, top.uncovered) == ("fan", 50.0, 0.0)
    for count in (1, 2, 3, 4):
        few = heights[-count:], grid[-count:]
        assert [end.kind for end in close_ends(*few)] == ["fan", "fan"]
        assert close_ends(*few, bottom=-50.0, top=60.0)[1].kind in ("flat", "conic")


@pytest.mark.parametrize("count", [20, 24, 27, 40])
def test_rounded_edge_determines_height_of_box(count):
    heights, grid, _ = contours("rounded cylinder", 0.5, count)
    for unit in (1.0, 1e-3):
        for end in close_ends(unit * heights, unit * grid):
            assert end.kind == "superellipse"
            assert end.unseen == pytest.approx(0.5 * unit, rel=0.4)
            assert end.uncovered == pytest.approx(end.unseen)
    zigzag = (20.0 + 8.0 * np.sin(heights)) * np.sqrt(1.0 - (heights / 51.0) ** 2)
    for radii in (np.full(count, 30.0), 30.0 - 0.2 * heights, zigzag):
        assert close_ends(heights, radii[:, None, None] * circle(80))[1].kind != "superellipse"
    assert close_ends(heights[-11:], grid[-11:])[1].kind == "fan"  # too few contours
    off = []
    heights, grid, _ = contours("rounded cylinder", 0.5)
    for seed in range(5):
        wider = 0.02 * np.random.default_rng(seed).normal(size=(27, 1, 1)) * circle(80)
        tops = close_ends(heights, grid + wider, noise=0.02 * np.sqrt(80))
        off += [0.5 if end.kind == "fan" else abs(end.unseen - 0.5) for end in tops]
    assert np.sqrt(np.mean(np.square(off))) < 0.3


def test_axis_is_extrapolated_by_height_of_stack_at_most():
    heights, grid, tops = contours("cylinder", 5.0)
    leaning = grid + np.stack([0.2 * heights, -0.1 * heights], axis=-1)[:, None]
    bottom, top = close_ends(heights, leaning, **tops)
    assert bottom.middle == pytest.approx([-10.0, 5.0], abs=1e-9)
    assert top.middle == pytest.approx([10.0, -5.0], abs=1e-9)
    far = close_ends(heights, leaning, bottom=-50.0, top=500.0)[1]
    assert far.middle == pytest.approx([9.0 + 18.0, -4.5 - 9.0], abs=1e-9)


def test_end_touched_at_last_contour_is_disc():
    heights, grid, _ = contours("cylinder", 5.0)
    bottom, top = close_ends(heights, grid, bottom=-45.0, top=44.9)
    assert (bottom.kind, bottom.height, bottom.uncovered) == ("flat", -45.0, 0.0)
    assert (top.kind, top.height) == ("flat", 45.0)
    arc = polar(np.linspace(0.0, 0.8, 40), 1.0)
    kidneys = np.broadcast_to(np.concatenate([30 * arc, 20 * arc[::-1]]), (27, 80, 2))
    assert not any(end.starlike for end in close_ends(heights, kidneys))


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("gap", [0.5, 5.0])
def test_profile_curves_run_from_rim_to_middle(name, gap):
    heights, grid, tops = contours(name, gap)
    for end in close_ends(heights, grid, **tops):
        curves = profile_curves(end.profile, 1.0)
        ends = np.array([curve.at(np.array([0.0, 1.0])) for curve in curves])
        assert ends[0, 0] == pytest.approx([0.0, 1.0], abs=1e-12)
        assert ends[-1, 1] == pytest.approx([1.0, 0.0], abs=1e-12)
        assert ends[1:, 0] == pytest.approx(ends[:-1, 1], abs=1e-12)
        height, radius = curves[0].at(FRACTIONS[:-1]).T
        wide = radius > 0.3  # next to the axis the height of a square end has no digits left
        assert end.profile.radius_ratios(height)[wide] == pytest.approx(radius[wide], abs=1e-9)
        at, step = np.linspace(0.01, 0.97, 25), 1e-5
        for curve, by in product(curves, (1, 2)):
            slopes = (curve.at(at + step, by - 1) - curve.at(at - step, by - 1)) / (2.0 * step)
            derivative = curve.at(at, by)
            size = max(np.abs(derivative).max(), 1.0)
            assert derivative == pytest.approx(slopes, abs=1e-6 * size)
            assert np.isfinite(curve.at(np.array([0.0, 1.0]), by)).all()
    flat = close_ends(*contours("cylinder", gap)[:2])[0].profile
    (disc,) = profile_curves(flat, 0.0)  # no gap, no wall
    assert disc.at(np.array([0.0, 0.5, 1.0])).tolist() == [[0, 1], [0, 0.5], [0, 0]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"heights": [0.0, 0.0, 1.0]}, "heights must ascend"),
        ({"heights": [], "grid": np.zeros((0, 4, 2))}, "heights must ascend, and be at least one"),
        ({"heights": [0.0, 1.0]}, r"grid must have shape \(2, any, 2\)"),
        ({"heights": [0.0, np.nan, 1.0]}, "heights must be finite"),
        ({"grid": np.zeros((3, 8, 2))}, "contours must have a width, got radius 0 in 3"),
        ({"noise": -1.0}, "noise must be 0 or more"),
        ({"top": 0.5}, "top must not lie within the contours, got 0.5 where the last is at 2"),
        ({"bottom": 1.5}, "bottom must not lie within the contours"),
    ],
)
def test_invalid_contours_of_ends_are_refused(change, words):
    options: dict[str, Any] = {"heights": [0.0, 1.0, 2.0], "grid": np.stack([circle(8)] * 3)}
    with pytest.raises(ValueError, match=words):
        close_ends(**options | change)
