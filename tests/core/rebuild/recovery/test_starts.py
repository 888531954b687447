from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.rebuild.recovery.choices import CHOICES, name_of
from palpate.core.rebuild.recovery.fold import folds
from palpate.core.rebuild.recovery.normal_distance import Warps
from palpate.core.rebuild.recovery.report import scaled_down
from palpate.core.rebuild.recovery.starts import starts_of
from palpate.core.shapes.bend import Bend

Made = Callable[..., Any]


@pytest.mark.parametrize(
    ("warps", "count"),
    [
        (Warps(False, False), 36),
        (Warps(True, False), 72),
        (Warps(False, True), 144),
        (Warps(True, True), 144),
    ],
)
def test_every_start_lies_within_its_bounds(cloud: Made, warps: Warps, count: int) -> None:
    points = scaled_down(cloud([0.3, 0.2, 0.5], [0.5, 1.0]).points).points
    starts = starts_of(points, warps, None)
    assert starts.parameters.shape == (count, warps.total)
    assert (starts.low <= starts.parameters).all()
    assert (starts.parameters <= starts.high).all()


def test_chosen_exponents_cannot_move(cloud: Made) -> None:
    points = scaled_down(cloud([0.3, 0.2, 0.5], [0.5, 1.0]).points).points
    starts = starts_of(points, Warps(False, False), tuple(CHOICES.values()))
    assert len(starts.parameters) == 36
    assert np.array_equal(starts.low[:, 3:5], starts.high[:, 3:5])
    assert {name_of(pair) for pair in starts.parameters[:, 3:5]} == set(CHOICES)


def test_one_of_the_starts_has_seen_the_taper_and_the_bend(cloud: Made) -> None:
    made = cloud(
        [0.2, 0.2, 0.6], [0.5, 1.0], count=200, noise=0.0, taper=[0.5, 0.5], bend=Bend(0.8, 0.0)
    )
    scaled = scaled_down(made.points)
    starts = starts_of(scaled.points, Warps(True, True), None).parameters
    curvature = np.hypot(starts[:, 13], starts[:, 14]) / scaled.unit
    tapered = np.abs(starts[:, 11:13]).min(axis=1)
    seen = (np.abs(curvature - 0.8) < 0.4) & (tapered > 0.25)
    assert seen.any()


def test_flat_points_start_with_some_thickness() -> None:
    points = np.random.default_rng(0).normal(size=(30, 3)) * [0.3, 0.2, 1e-9]
    starts = starts_of(points, Warps(False, False), None)
    assert np.isfinite(starts.parameters).all()
    assert starts.parameters[:, :3].min() >= np.log(5e-3) - 1e-12


@pytest.mark.parametrize(("bend", "folded"), [(0.0, False), (1.5, False), (6.0, True)])
def test_a_bend_that_squeezes_the_inner_side_folds(bend: float, folded: bool) -> None:
    parameters = np.concatenate([np.log([0.2, 0.2, 0.5]), np.ones(2), np.zeros(6), [0.0, bend]])
    assert folds(parameters, Warps(False, True)) is folded


def test_points_are_scaled_to_a_diameter_of_1_wherever_they_are() -> None:
    points = np.random.default_rng(0).normal(size=(40, 3))
    near, far = scaled_down(points), scaled_down(1e-3 * points + 1e3)
    assert np.linalg.norm(near.points, axis=1).max() == pytest.approx(0.5)
    assert np.abs(near.points.mean(axis=0)).max() < 1e-15
    assert np.allclose(far.points, near.points, rtol=0, atol=1e-9)
    assert np.allclose(near.middle + near.unit * near.points, points, rtol=0, atol=1e-14)
