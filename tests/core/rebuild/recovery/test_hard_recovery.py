"""Points from which a plain fit goes wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.fitting import recover
from palpate.core.shapes.superquadrics import Superquadric

Made = Callable[..., Any]
GOOD = 0.02  # Of the diameter


def worst(cloud: Made, chamfer: Made, *shape: Any, trials: int = 3) -> float:
    """Largest Chamfer distance of some recoveries, as a share of the diameter."""
    clouds = [cloud(*shape, seed=seed) for seed in range(trials)]
    return float(max(chamfer(recover(made.points), made) for made in clouds))


@pytest.mark.parametrize("trials", [6, pytest.param(20, marks=pytest.mark.slow)])
def test_a_cube_with_exponents_of_005_is_found_from_anywhere(cloud, chamfer, trials):
    clouds = [cloud([1.0, 1.0, 1.0], [0.05, 0.05], seed=seed) for seed in range(trials)]
    assert np.mean([chamfer(recover(made.points), made) < GOOD for made in clouds]) >= 0.95


@pytest.mark.parametrize("trials", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_a_disc_twenty_times_as_wide_as_thick_is_no_wider(cloud, chamfer, trials):
    assert worst(cloud, chamfer, [1.0, 1.0, 0.05], [1.0, 1.0], trials=trials) < GOOD


@pytest.mark.parametrize("trials", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_a_needle_twenty_times_as_long_as_thick_keeps_its_axis(cloud, chamfer, trials):
    assert worst(cloud, chamfer, [0.05, 0.05, 1.0], [1.0, 1.0], trials=trials) < GOOD


def test_a_ball_is_recovered_and_the_missing_rank_reported(cloud, chamfer):
    exact = recover(cloud([0.5, 0.5, 0.5], [1.0, 1.0], noise=0.0).points)
    assert exact.converged
    assert exact.rank == 8
    assert exact.size == pytest.approx([0.5, 0.5, 0.5], rel=1e-9)
    turns = [exact.deviations()[name] for name in ("turn x", "turn y", "turn z")]
    assert min(turns) > 0.9  # as much as before there were points
    made = cloud([0.5, 0.5, 0.5], [1.0, 1.0])
    assert chamfer(recover(made.points), made) < GOOD


def test_a_cube_turned_by_45_degrees_does_not_become_an_octahedron(cloud):
    points = Superquadric(np.ones(3), np.full(2, 0.1)).mesh(2).vertices
    turn = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2)]]) / np.sqrt(2)
    for turned in (points, points @ turn.T, points @ turn.T[:, [1, 2, 0]], points @ turn @ turn.T):
        found = recover(turned)
        assert found.exponents == pytest.approx([0.1, 0.1], abs=1e-6)


@pytest.mark.slow
def test_15_percent_of_outliers_are_seen_through(cloud, chamfer):
    good, plain = [], []
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        made = cloud(rng.uniform(0.3, 1.0, 3), rng.uniform(0.1, 2.0, 2), noise=0.01, seed=seed)
        points = made.points.copy()
        stray = rng.random(60) < 0.15
        spread = 0.75 * made.diameter * rng.uniform(-1, 1, (60, 3))
        points[stray] = (made.points.mean(axis=0) + spread)[stray]
        good.append(chamfer(recover(points, outliers=True), made) < GOOD)
        if seed < 6:
            plain.append(chamfer(recover(points), made) < GOOD)
    assert np.mean(good) >= 0.95
    assert np.mean(plain) < 0.5


def flat(rng: np.random.Generator) -> Floats:
    return np.asarray(rng.normal(size=(40, 3)) * [1.0, 0.5, 0.0] + [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("points", "warning"),
    [
        (np.zeros((0, 3)), "too few points"),
        (np.random.default_rng(0).normal(size=(10, 3)), "too few points"),
        (flat(np.random.default_rng(0)), "coplanar points"),
        (np.outer(np.linspace(-1, 1, 30), [1.0, 2.0, 3.0]), "collinear points"),
        (np.full((30, 3), 0.7), "identical points"),
        (np.full((1, 3), 0.7), "identical points"),
        (1e-300 * np.random.default_rng(0).normal(size=(30, 3)), "identical points"),
    ],
)
@pytest.mark.parametrize("options", [{}, {"taper": True, "bend": True}, {"outliers": True}])
def test_points_that_determine_no_solid_give_an_ellipsoid_and_say_why(points, warning, options):
    found = recover(points, **options)
    assert found.warnings == (warning,)
    assert not found.fitted
    assert not found.converged
    assert found.rank == 0
    assert found.exponents.tolist() == [1.0, 1.0]
    numbers = (found.size, found.pose, found.residuals, found.covariance, [found.rms])
    assert all(np.isfinite(part).all() for part in numbers)
    if found.size.any():
        low, high = found.shape().bounds()
        reach = np.abs(points - points.mean(axis=0)).max()
        assert (high - low).max() <= 2.5 * reach


def test_points_that_are_next_to_coplanar_are_finite_and_doubted():
    rng = np.random.default_rng(1)
    for thickness in (1e-5, 1e-3, 1e-2):
        found = recover(rng.normal(size=(60, 3)) * [1.0, 1.0, thickness])
        assert np.isfinite(found.size).all()
        assert np.isfinite(found.covariance).all()
        assert found.warnings


def test_when_most_points_are_one_the_others_still_say_where_the_solid_is(cloud):
    made = cloud([0.3, 0.2, 0.5], [0.6, 0.8], count=60)
    points = np.concatenate([np.tile(made.points[:1], (70, 1)), made.points[1:]])
    found = recover(points, outliers=True)
    assert found.warnings
    low, high = made.truth.bounds()
    assert (np.abs(found.pose[:3] - 0.5 * (low + high)) < 0.3 * (high - low)).all()
    assert np.isfinite(found.covariance).all()


@pytest.mark.parametrize(("count", "noise"), [(11, 0.01), (13, 0.01), (60, 0.08)])
def test_points_that_are_few_or_scatter_much_leave_the_surface_loose(cloud, count, noise):
    fits = [
        recover(cloud([0.3, 0.2, 0.5], [0.6, 0.8], count=count, noise=noise, seed=seed).points)
        for seed in range(6)
    ]
    assert sum("loose" in found.warnings for found in fits) >= 5


def test_half_a_solid_gives_sizes_within_the_points_extents_and_is_doubted(cloud):
    named, certain = [], []
    for seed in range(10):
        made = cloud([0.3, 0.2, 0.5], [0.6, 0.8], count=120, turned=False, seed=seed)
        middle = made.points.mean(axis=0)
        whole = recover(made.points)
        half = recover(made.points[made.points[:, 2] > middle[2]])
        named.append("one-sided" in half.warnings)
        assert not set(whole.warnings) & {"one-sided", "loose"}
        assert set(half.warnings) & {"one-sided", "at a bound"}
        assert half.size.max() < 2.0 * whole.size.max()
        # The size that the points leave open is the least certain.
        sizes = [
            max(found.deviations()[f"log size {axis}"] for axis in "xyz") for found in (half, whole)
        ]
        certain.append(sizes[0] / sizes[1])
    assert np.mean(named) >= 0.5
    assert np.median(certain) > 3.0
