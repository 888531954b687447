from __future__ import annotations

import numpy as np
import pytest

from palpate.core.rebuild.side.lofting import fit_contour_loft
from tests.studies.contours import noisy_contours
from tests.studies.lofts import (
    NARROW,
    ROUND_OBJECTS,
    WIDE,
    band_rows,
    distances,
    judge_band,
    ratio_of,
    shuffled,
    step_swing,
    with_outliers,
)
from tests.studies.rebuilt import REBUILT_SHAPES, WAVY

TIMED = ("fit, ms", "deviation on", "contour more", "time")


@pytest.mark.slow
def test_every_demand_on_the_band_that_needs_no_clock_is_met():
    rows = list(band_rows(True))
    assert len({row.name for row in rows}) == len(rows)
    judged = [row for row in rows if not any(word in row.name for word in TIMED)]
    assert len(judged) == 19
    assert [str(row) for row in judged if not row.holds] == []


def test_a_surface_that_is_off_by_more_than_its_band_is_found_out():
    thing, heights = ROUND_OBJECTS["barrel"], np.linspace(-1.0, 1.0, 12)
    grid = thing.contours(heights, 32)[..., :2]
    grid += 1e-3 * np.random.default_rng(0).normal(size=grid.shape)
    good = judge_band(thing, fit_contour_loft(heights, grid, low=-1.04, high=1.04))
    bad = judge_band(thing, fit_contour_loft(heights, grid + 0.05, low=-1.04, high=1.04))
    assert good.covered > 0.8
    assert good.safe_rms
    assert good.safe_most
    assert bad.covered < 0.3
    assert not bad.safe_rms
    assert bad.rms > 10 * good.rms


def test_a_step_keeps_its_radii():
    assert 0.0 <= step_swing(0) < 0.05 < NARROW / WIDE


EVERY = [*ROUND_OBJECTS.values(), WAVY]
NAMES = [*ROUND_OBJECTS, "wavy"]


@pytest.mark.parametrize("thing", EVERY, ids=NAMES)
def test_contours_lie_on_their_object_counter_clockwise(thing):
    heights = np.linspace(-1.0, 1.0, 7)
    grid = thing.contours(heights, 48)[..., :2]
    assert np.abs(distances(thing, grid, heights)[0]).max() < 1e-13
    x, y = grid.transpose(2, 0, 1)
    assert ((x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1) > 0.0).all()


@pytest.mark.parametrize("thing", EVERY, ids=NAMES)
def test_a_place_moved_along_the_normal_is_so_far_off(thing):
    heights = np.linspace(-0.8, 0.8, 5)
    grid, step = thing.contours(heights, 16)[..., :2], 1e-4
    out = grid - thing.axis(heights)[:, None]
    out /= np.linalg.norm(out, axis=-1, keepdims=True)
    off, area = distances(thing, grid + step * out, heights)
    assert (off > 0.0).all()
    assert (off <= step * (1 + 1e-3)).all()
    assert (area > 0.0).all()


def test_objects_have_the_height_of_2_and_differ():
    radii = [thing.radius(np.array(0.3), np.array(0.7)) for thing in ROUND_OBJECTS.values()]
    assert len(set(np.round(radii, 6))) == len(ROUND_OBJECTS)


ONE = {"vase": REBUILT_SHAPES["vase"]}


def test_disorder_keeps_the_object_and_changes_everything_else():
    contours = noisy_contours(REBUILT_SHAPES["vase"], (12, 40), 0.0, np.random.default_rng(0))
    mixed = shuffled(REBUILT_SHAPES["vase"], contours, np.random.default_rng(1))
    heights = [float(one[:, 2].mean()) for one in mixed]
    assert sorted(heights) == pytest.approx(contours[:, 0, 2], abs=0.3)
    assert heights != sorted(heights)
    assert len({len(one) for one in mixed}) > 3
    off = (
        np.array(with_outliers(REBUILT_SHAPES["vase"], contours, np.random.default_rng(1)))
        - contours
    )
    moved = np.linalg.norm(off, axis=-1)
    assert 0.005 < (moved > 0.0).mean() < 0.04
    assert moved[moved > 0.0] == pytest.approx(3.0)
    assert np.abs(off[..., 2]).max() == 0.0


def test_disorder_costs_nothing_on_one_object():
    assert ratio_of(shuffled, shapes=ONE) < 1.2
