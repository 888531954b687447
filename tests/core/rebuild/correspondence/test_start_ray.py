from __future__ import annotations

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.start_ray import start_ray


def circle(begin: float, middle: tuple[float, float] = (0.0, 0.0)) -> Floats:
    angle = 2 * np.pi * (np.arange(512) / 512 - begin)
    return np.column_stack([np.cos(angle), np.sin(angle)]) + middle


def test_a_curve_begins_where_it_comes_up_through_the_ray() -> None:
    begins = np.array([0.0, 0.2, 0.71, 0.9999])
    found = start_ray(np.stack([circle(begin) for begin in begins]))
    off = found - begins
    assert np.abs(off - np.round(off)).max() < 1e-8
    assert ((found >= 0) & (found < 1)).all()


def test_of_several_crossings_the_farthest_out_counts() -> None:
    angle = 2 * np.pi * np.arange(512) / 512
    bend = 1.9 * np.sin(angle)
    width = 0.52 + 0.16 * np.cos(angle)
    sausage = np.column_stack([width * np.cos(bend), width * np.sin(bend)])
    [turn] = start_ray(sausage[None])
    assert abs(turn - np.round(turn)) < 1e-9  # where the width is largest
    assert width[0] > sausage[256, 0] > 0  # the inner wall is crossed as well


def test_a_curve_that_never_meets_the_ray_begins_farthest_along_x() -> None:
    assert start_ray(circle(0.25, (0.0, 3.0))[None])[0] == pytest.approx(0.25, abs=1 / 512)
