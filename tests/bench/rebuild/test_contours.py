from __future__ import annotations

import numpy as np
import pytest

from palpate.bench.objects import ROUND_OBJECTS
from palpate.bench.rebuild.comparison import (
    NARROW,
    WIDE,
    band_rows,
    judge_band,
    step_swing,
)
from palpate.core.rebuild.side.lofting import fit_contour_loft

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
