"""What an element of the array sees and hears: its aperture, warmth, lost and mixed echoes."""

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch import Fingertip, SimulatedTouch, assemble
from tests.core.touch.touches import DENT, X, Y, above, applied, finger, touch

READINGS = pytest.mark.parametrize("reading", ["mean", "max"])
Height = Callable[[Floats, Floats], Floats]


def over(height: Height, depth: float) -> SimulatedTouch:
    """A touch from 3 mm above its zero of a ground of this height under each place."""

    def cast(origins: Floats, direction: Floats, reach: float) -> Floats:
        assert np.allclose(direction, [0.0, 0.0, -1.0])
        x, y, z = origins.T
        ranges = z - height(x, y)
        return np.where(ranges <= reach, ranges, np.inf)

    start = above(3e-3)
    return touch(believed=start, actual=start, depth=depth, shape=SimpleNamespace(cast=cast))


def seen(tip: Fingertip, contact: SimulatedTouch, width: float, rays: int, reduce: Any) -> Floats:
    """What is made of the rays of each element at the end of a move, element by element."""
    pad, (position, axes) = tip.pad, contact.actual
    offsets = ((np.arange(rays) + 0.5) / rays - 0.5) * width * pad.pitch
    result = np.zeros((pad.rows, pad.cols))
    for place, x, y in zip(np.ndindex(result.shape), *map(np.ravel, pad.grid()), strict=True):
        along, down = (axis.ravel() for axis in np.meshgrid(x + offsets, y + offsets))
        depth = pad.thickness + 0.5 * pad.dome * (along**2 + down**2)
        origins = position + np.column_stack([along, down, -depth]) @ axes.T
        ranges = contact.shape.cast(origins, axes[:, 2], 0.05)
        result[place] = reduce(pad.thickness - ranges)
    return result


@READINGS
@pytest.mark.parametrize("dome", [0.0, 1 / 0.015])
def test_elements_report_what_their_rays_see(reading, dome):
    tip, start = finger(dome=dome), above(0.033, 1.3e-3)
    contact = touch(believed=start, actual=start)
    applied("aperture", contact, tip, width=0.9, rays=4, reading=reading)
    of_depths = {"mean": np.mean, "max": np.max}[reading]
    expected = seen(tip, contact, 0.9, 4, lambda depths: of_depths(np.maximum(depths, 0.0)))
    assert contact.outcome == "hit"
    assert np.allclose(contact.compression, expected, rtol=0.0, atol=1e-12)
    touched = contact.compression > 0.0
    assert touched.any() and not touched.all() and (contact.indentation[~touched] <= 0.0).all()
    assert np.array_equal(contact.indentation[touched], contact.compression[touched])
    nearest = seen(tip, contact, 0.9, 4, np.max)  # a free element is as far as its nearest ray
    assert np.allclose(contact.indentation[~touched], nearest[~touched], rtol=0.0, atol=1e-12)


@READINGS
@pytest.mark.parametrize("depth", [0.05e-3, 1e-3, 2.2e-3])
def test_deepest_element_reports_the_given_depth(reading, depth):
    for dome in (0.0, 1 / 0.015):
        contact = applied("aperture", touch(depth=depth), finger(dome=dome), reading=reading)
        assert contact.outcome == "hit"
        assert contact.compression.max() == pytest.approx(depth, abs=1e-15)
        assert np.allclose(contact.pressure, 2e8 * contact.compression, rtol=1e-14)


def test_mean_reaches_its_depth_on_rough_ground():
    for seed in range(5):
        heights = np.random.default_rng(seed).uniform(-2e-3, 0.0, (64, 64))
        heights[::7] = -np.inf  # nothing there

        def rough(x: Floats, y: Floats, heights: Floats = heights) -> Floats:
            col, row = (np.floor(part / 0.27e-3).astype(int) + 32 for part in (x, y))
            return heights[row, col]

        contact = applied("aperture", over(rough, 0.3e-3))
        assert contact.outcome == "hit" and np.isfinite(contact.compression).all()
        assert contact.compression.max() == pytest.approx(0.3e-3, abs=1e-15)


def test_needle_bottoms_the_pad_before_its_element_reports_depth():
    def needle(x: Floats, y: Floats) -> Floats:
        return np.where(np.hypot(x - 0.5e-3, y - 0.5e-3) < 0.1e-3, 0.0, -5e-3)

    contact = applied("aperture", over(needle, 1e-3))
    assert contact.outcome == "bottomed" and contact.advance == pytest.approx(3e-3 + 0.8 * 3e-3)
    assert contact.compression.max() == pytest.approx(0.8 * 3e-3 / 9)


@READINGS
@pytest.mark.parametrize(
    "options", [{"reach": 2.9e-3}, {"reach": 3.1e-3}, {"depth": 2.9e-3}, {"actual": above(0.0299)}]
)
def test_on_smooth_ground_outcomes_are_those_of_single_rays(options, reading):
    single, pipeline = touch(**options), assemble(finger(), [])
    pipeline.simulate(single, pipeline.begin())
    many = applied("aperture", touch(**options), reading=reading)
    assert many.outcome == single.outcome
    assert many.advance == pytest.approx(single.advance, abs=30e-6)
    assert many.loading == pytest.approx(single.loading, rel=0.01)


@pytest.mark.parametrize("time", [0.0, 30.0, 600.0, 1e9])
def test_warm_pad_sends_the_times_of_slower_sound(time):
    tip, options = finger(), {"rise": 8.0, "warm_up": 300.0}
    contact = applied("temperature", touch(field=DENT, time=time), tip, **options)
    speed = 1000.0 - 3.0 * 8.0 * (1.0 - math.exp(-time / 300.0))
    times = 2 * (3e-3 - DENT) / speed
    assert np.allclose(tip.calibration.encode(contact.reading), times, rtol=1e-13)
    # A new zero leaves the scale alone: (1.1) with both times at the true speed.
    contact = applied("temperature", touch(field=DENT, time=time), tip, rezeroed=True, **options)
    expected = 1000.0 * (2 * 3e-3 / speed - times) / 2
    assert np.allclose(contact.reading, expected, rtol=1e-12, atol=1e-17)


def plane(slope: float, direction: float) -> Floats:
    """A plane over the array of this slope and direction [rad]."""
    return 20e-3 + math.tan(slope) * (math.cos(direction) * X + math.sin(direction) * Y)


@pytest.mark.parametrize("direction", np.linspace(0.0, 2 * math.pi, 7))
def test_plane_is_lost_where_its_echo_falls_below_the_threshold(direction):
    steepest = math.radians(12.0) * math.sqrt(-math.log(0.2))
    for slope, received in ((0.999 * steepest, True), (1.001 * steepest, False)):
        contact = touch(field=plane(slope, direction))
        applied("echo_loss", contact, angle=12.0, threshold=0.2)
        # Every taxel, at the border too, sees the slope of the plane.
        assert np.array_equal(contact.reading, contact.compression * received)


def test_echoes_are_lost_by_the_slope_of_the_pad():
    field = np.maximum(1.5e-3 - X**2 / (2 * 4e-3), 0.0)  # a ridge
    contact = applied("echo_loss", touch(field=field))
    slope = np.arctan(np.gradient(field, 1e-3, axis=1))
    lost = np.exp(-((slope / math.radians(15.0)) ** 2)) < 0.1
    assert lost.any() and not lost.all()
    assert np.array_equal(contact.reading, np.where(lost, 0.0, field))
    rough = np.random.default_rng(0).normal(1e-3, 1e-3, (16, 16))
    level = touch(field=np.full((16, 16), 1e-3), reading=rough)
    assert np.array_equal(applied("echo_loss", level).reading, rough)


def mixed(field: Floats, share: float = 0.05) -> Floats:
    return applied("crosstalk", touch(field=field), share=share).reading


def test_crosstalk_is_a_sum_over_four_neighbours_that_loses_nothing():
    rng = np.random.default_rng(0)
    for field in (DENT, rng.random((16, 16)), np.full((16, 16), 1e-3), np.eye(16)):
        around = np.pad(field, 1, mode="edge")  # a border keeps what it cannot give
        four = around[:-2, 1:-1] + around[2:, 1:-1] + around[1:-1, :-2] + around[1:-1, 2:]
        assert np.allclose(mixed(field), 0.8 * field + 0.05 * four, rtol=1e-14, atol=1e-19)
        assert mixed(field).sum() == pytest.approx(field.sum(), rel=1e-14)
