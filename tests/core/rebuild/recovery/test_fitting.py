from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import principal_axes, split_pose
from palpate.core.rebuild.recovery.distances import Warps
from palpate.core.rebuild.recovery.fitting import folds, recover, starts_of, suggested_axes
from palpate.core.rebuild.recovery.report import CHOICES, scaled_down
from palpate.core.shapes.global_deformations import Bend
from palpate.core.shapes.superquadrics import Superquadric

Made = Callable[..., Any]
Draw = Callable[[int], Floats]


@pytest.mark.parametrize("exponents", [[0.1, 0.1], [0.3, 1.2], [1.0, 1.0], [1.0, 0.2], [1.7, 0.6]])
def test_exact_points_give_the_solid_back(cloud, exponents):
    made = cloud([0.3, 0.2, 0.5], exponents, noise=0.0)
    found = recover(made.points)
    assert found.warnings == ()
    assert found.rms < 1e-9
    assert np.sort(found.size) == pytest.approx([0.2, 0.3, 0.5], rel=1e-6)
    assert np.allclose(found.shape().bounds(), made.truth.bounds(), rtol=0, atol=1e-3)


def test_a_tapered_and_bent_solid_is_recovered(cloud, chamfer):
    made = cloud(
        [0.3, 0.2, 0.6], [0.4, 1.1], count=100, noise=0.002, taper=[0.5, -0.3], bend=Bend(0.9, 0.4)
    )
    found = recover(made.points, taper=True, bend=True)
    assert found.warnings == ()
    assert found.names[11:] == ("taper x", "taper y", "bend x", "bend y")
    assert chamfer(found, made) < 0.004
    assert abs(found.bend.curvature) == pytest.approx(0.9, abs=5 * 0.05)
    assert np.sort(np.abs(found.taper)) == pytest.approx([0.3, 0.5], abs=0.06)


def test_what_is_not_asked_for_is_not_fitted(cloud):
    made = cloud([0.3, 0.2, 0.5], [0.5, 1.0])
    found = recover(made.points)
    assert not found.taper.any()
    assert found.bend.curvature == 0.0
    assert found.covariance.shape == (11, 11)
    assert len(found.names) == len(found.deviations()) == 11
    only = recover(made.points, bend=True)
    assert only.names[11:] == ("bend x", "bend y")
    assert not only.taper.any()


def test_the_choice_of_the_thesis_is_among_three_shapes(cloud, chamfer):
    for name, exponents in CHOICES.items():
        made = cloud([0.3, 0.25, 0.5], exponents)
        found = recover(made.points, choice="thesis")
        assert found.choice == name
        assert tuple(found.exponents.tolist()) == exponents
        assert found.rank == 9 or name == "sphere"
        assert found.deviations()["e1"] == 0.0
        assert chamfer(found, made) < 0.01
    assert recover(made.points).choice is None


@pytest.mark.slow
def test_errors_of_repeated_fits_are_as_large_as_their_deviations_say(cloud):
    names, true = ("log size x", "log size y", "log size z", "e1", "e2"), [0.3, 0.2, 0.5, 0.5, 0.8]
    errors = []
    for seed in range(40):
        found = recover(cloud(true[:3], true[3:], seed=seed, turned=False).points)
        error = np.concatenate([np.log(found.size / true[:3]), found.exponents - true[3:]])
        deviations = found.deviations()
        errors.append(error / [deviations[name] for name in names])
    spread = np.std(errors, axis=0)
    assert (spread > 0.7).all()
    assert (spread < 1.3).all()


@pytest.mark.slow
def test_the_surface_is_as_far_off_as_its_looseness_tells(cloud, chamfer):
    shares = []
    for seed in range(12):
        made = cloud([0.3, 0.2, 0.5], [0.5, 0.8], seed=seed, noise=0.01)
        found = recover(made.points)
        shares.append(chamfer(found, made) * made.diameter / found.looseness)
    # A normal deviate is on average 0.8 of its standard deviation from 0.
    assert 0.5 < np.median(shares) < 1.2


def test_of_thousands_of_points_all_count(cloud):
    made = cloud([0.3, 0.2, 0.5], [0.5, 0.8], count=5000, noise=0.01, turned=False)
    for options in ({}, {"outliers": True}):
        found = recover(made.points, **options)
        assert found.warnings == ()
        assert found.size == pytest.approx([0.3, 0.2, 0.5], rel=0.01)
        assert found.deviations()["log size z"] < 0.002
        assert found.inliers.mean() > 0.99
        assert len(found.residuals) == 5000


def test_a_turn_that_the_start_did_not_foresee_is_no_bound(cloud):
    for seed in range(8):
        found = recover(cloud([0.5, 0.5, 0.7], [0.1, 1.0], noise=0.01, seed=seed).points)
        assert found.warnings == ()


def test_a_noise_larger_than_the_solid_is_as_large_as_the_solid(cloud):
    found = recover(cloud([0.3, 0.2, 0.5], [0.5, 0.8]).points, outliers=True, noise=1e300)
    assert "loose" in found.warnings
    assert np.isfinite(found.covariance).all()


def test_points_that_lie_elsewhere_are_named_outliers(cloud, chamfer):
    made = cloud([0.3, 0.2, 0.5], [0.4, 0.9], noise=0.005)
    points, rng = made.points.copy(), np.random.default_rng(7)
    middle = points.mean(axis=0)
    points[:8] = middle + rng.uniform(-0.7, 0.7, (8, 3))
    found = recover(points, outliers=True, noise=0.005)
    assert found.inliers[8:].mean() > 0.9
    assert found.inliers[:8].sum() <= 2
    assert chamfer(found, made) < 0.02
    assert chamfer(recover(points), made) > 0.02


@pytest.mark.parametrize(
    ("turns", "kind", "options"),
    [
        (24, {"size": [0.3, 0.2, 0.5], "exponents": [0.4, 1.3]}, {}),
        (12, {"size": [1.0, 1.0, 1.0], "exponents": [0.1, 0.1]}, {}),
        (8, {"size": [1.0, 1.0, 0.05], "exponents": [1.0, 1.0]}, {}),
        (6, {"size": [0.3, 0.2, 0.5], "exponents": [0.4, 1.3]}, {"outliers": True}),
        (
            6,
            {"size": [0.3, 0.2, 0.5], "exponents": [0.4, 0.9], "count": 100, "taper": [0.4, 0.2]},
            {"taper": True},
        ),
    ],
)
def test_the_solid_does_not_depend_on_where_it_stands_nor_on_the_unit(
    cloud, rotations, turns, kind, options
):
    made = cloud(**kind)
    first = recover(made.points, **options)
    vertices = first.shape().mesh(3).vertices
    for which, turn in enumerate(rotations(turns)):
        unit, shift = (1e-3, 1.0, 1e3)[which % 3], np.array([1.0, -2.0, 3.0]) * which
        found = recover(unit * (made.points @ turn.T + shift), **options)
        position, axes = split_pose(found.pose)
        there = (unit * (vertices @ turn.T + shift) - position) @ axes
        base = Superquadric(found.size, found.exponents)
        share = 1.0 + np.outer(there[:, 2] / found.size[2], found.taper)
        there[:, :2] /= share
        assert np.abs(base.gauge(there) - 1.0).max() < 1e-5
        assert found.size == pytest.approx(unit * first.size, rel=1e-5)


def test_the_points_order_does_not_matter(cloud):
    made = cloud([0.3, 0.2, 0.5], [0.4, 1.3])
    first, second = recover(made.points), recover(made.points[::-1])
    assert second.size == pytest.approx(first.size, rel=1e-8)
    assert second.residuals[::-1] == pytest.approx(first.residuals, abs=1e-9)


def test_a_solid_about_points_in_one_place_has_no_shape():
    with pytest.raises(ValueError, match="size must be positive"):
        recover(np.ones((20, 3))).shape()


@pytest.mark.parametrize(
    ("points", "options", "words"),
    [
        (np.ones((20, 2)), {}, r"points must have shape \(any, 3\), got \(20, 2\)"),
        (np.full((20, 3), np.nan), {}, "points must be finite"),
        (np.full((20, 3), 1e300), {}, r"points must lie within 1e\+150 m, got a .* of 1e\+300 m"),
        (np.ones((20, 3)), {"noise": 0.0}, "noise must be positive and finite, got 0.0 m"),
        (np.ones((20, 3)), {"choice": "cube"}, "choice must be 'thesis' or None, got 'cube'"),
    ],
)
def test_what_cannot_be_recovered_from_is_refused(points, options, words):
    with pytest.raises(ValueError, match=words):
        recover(points, **options)


@pytest.mark.parametrize(
    ("taper", "bend", "count"),
    [(False, False, 36), (True, False, 72), (False, True, 144), (True, True, 144)],
)
def test_every_start_lies_within_its_bounds(cloud, taper, bend, count):
    warps = Warps(taper, bend)
    points = scaled_down(cloud([0.3, 0.2, 0.5], [0.5, 1.0]).points).points
    starts = starts_of(points, warps, None)
    assert starts.parameters.shape == (count, warps.total)
    assert (starts.low <= starts.parameters).all()
    assert (starts.parameters <= starts.high).all()


def test_chosen_exponents_cannot_move(cloud):
    points = scaled_down(cloud([0.3, 0.2, 0.5], [0.5, 1.0]).points).points
    starts = starts_of(points, Warps(False, False), tuple(CHOICES.values()))
    assert len(starts.parameters) == 36
    assert np.array_equal(starts.low[:, 3:5], starts.high[:, 3:5])
    assert set(map(tuple, starts.parameters[:, 3:5])) == set(CHOICES.values())


def test_one_of_the_starts_has_seen_the_taper_and_the_bend(cloud):
    made = cloud(
        [0.2, 0.2, 0.6], [0.5, 1.0], count=200, noise=0.0, taper=[0.5, 0.5], bend=Bend(0.8, 0.0)
    )
    scaled = scaled_down(made.points)
    starts = starts_of(scaled.points, Warps(True, True), None).parameters
    curvature = np.hypot(starts[:, 13], starts[:, 14]) / scaled.unit
    tapered = np.abs(starts[:, 11:13]).min(axis=1)
    seen = (np.abs(curvature - 0.8) < 0.4) & (tapered > 0.25)
    assert seen.any()


def test_flat_points_start_with_some_thickness():
    points = np.random.default_rng(0).normal(size=(30, 3)) * [0.3, 0.2, 1e-9]
    starts = starts_of(points, Warps(False, False), None)
    assert np.isfinite(starts.parameters).all()
    assert starts.parameters[:, :3].min() >= np.log(5e-3) - 1e-12


@pytest.mark.parametrize(("bend", "folded"), [(0.0, False), (1.5, False), (6.0, True)])
def test_a_bend_that_squeezes_the_inner_side_folds(bend, folded):
    parameters = np.concatenate([np.log([0.2, 0.2, 0.5]), np.ones(2), np.zeros(6), [0.0, bend]])
    assert folds(parameters, Warps(False, True)) is folded


def test_points_are_scaled_to_a_diameter_of_1_wherever_they_are():
    points = np.random.default_rng(0).normal(size=(40, 3))
    near, far = scaled_down(points), scaled_down(1e-3 * points + 1e3)
    assert np.linalg.norm(near.points, axis=1).max() == pytest.approx(0.5)
    assert np.abs(near.points.mean(axis=0)).max() < 1e-15
    assert np.allclose(far.points, near.points, rtol=0, atol=1e-9)
    assert np.allclose(near.middle + near.unit * near.points, points, rtol=0, atol=1e-14)


def nearest_turn(axes: Floats, wanted: Floats) -> float:
    """How far the nearest of some axes (k, 3, 3) are from the wanted ones or their opposites."""
    agreement = np.abs(np.einsum("kji,jl->kil", axes, wanted)).max(axis=2).min(axis=1)
    return float(np.arccos(np.clip(agreement.max(), 0, 1)))


def test_they_are_rotations():
    axes = suggested_axes(np.random.default_rng(0).normal(size=(30, 3)))
    assert axes.shape == (12, 3, 3)
    assert np.allclose(axes @ axes.transpose(0, 2, 1), np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(axes), 1.0)


def test_the_edges_of_a_cube_are_among_them_however_it_is_turned(rotations):
    cube = Superquadric(np.ones(3), np.full(2, 0.1)).mesh(2).vertices
    for turn in rotations(20):
        assert nearest_turn(suggested_axes(cube @ turn.T), turn) < 0.02
        assert nearest_turn(principal_axes(cube @ turn.T)[None], turn) < 0.96


def test_they_turn_with_the_points(rotations):
    points = np.random.default_rng(1).normal(size=(40, 3)) * [1.0, 0.6, 0.3]
    before = suggested_axes(points)
    for turn in rotations(10):
        after = suggested_axes(points @ turn.T + [1.0, 2.0, 3.0])
        alike = np.abs(np.einsum("kji,jl,klm->kim", after, turn, before))
        # Some of these sets are named with other signs or in another order.
        assert (np.abs(np.sort(alike, axis=2)[:, :, 2] - 1.0) < 1e-9).mean() > 0.5
