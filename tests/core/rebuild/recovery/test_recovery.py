"""Superquadrics from points: accuracy, certainty, outliers, warnings, errors, distances."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.rebuild.recovery import Warps, distances_alone, normal_distances, recover
from palpate.core.shapes import Bend, DeformedSuperquadric, Superquadric, Taper
from tests.core.rebuild.objects import slow

SIZE = (0.3, 0.2, 0.5)


class Cloud(NamedTuple):
    """Points of a solid, the solid, its pose, and its diameter."""

    points: Floats
    truth: DeformedSuperquadric
    pose: Floats
    diameter: float


@cache
def cloud(
    size: tuple[float, ...] = SIZE,
    exponents: tuple[float, ...] = (0.5, 0.8),
    count: int = 60,
    noise: float = 0.005,
    seed: int = 0,
    taper: tuple[float, float] = (0.0, 0.0),
    bend: tuple[float, float] = (0.0, 0.0),
    turned: bool = True,
) -> Cloud:
    """Points where rays meet the solid, with noise that is a share of its diameter."""
    rng = np.random.default_rng(seed)
    base, bending = Superquadric(np.array(size), np.array(exponents)), Bend(*bend)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[:, 0] *= np.linalg.det(axes)
    pose = Pose(rng.normal(size=3), axes if turned else np.eye(3)).array
    solid = DeformedSuperquadric(base, np.array(taper), bending)
    rays = rng.normal(size=(count, 3)) * base.size
    points = bending(Taper(*taper, size[2])(rays / base.gauge(rays)[:, None]))
    diameter = float(np.ptp(solid.mesh(3).vertices, axis=0).max())
    points = points + noise * diameter * rng.normal(size=points.shape)
    return Cloud(Pose.from_array(pose).to_outer(points), solid, pose, diameter)


def error(fit: Any, made: Cloud) -> float:
    """Mean distance of the fitted surface from the true one, to first order, over the diameter."""
    position, axes = Pose.from_array(made.pose)
    local = (fit.shape().mesh(3).vertices - position) @ axes
    gauge = made.truth.gauge
    slopes = [(gauge(local + step) - gauge(local - step)) / 2e-6 for step in 1e-6 * np.eye(3)]
    off = (gauge(local) - 1.0) / np.linalg.norm(slopes, axis=0)
    return float(np.mean(np.abs(off))) / made.diameter


@pytest.mark.parametrize("exponents", [(0.1, 0.1), (0.3, 1.2), (1.0, 1.0), (1.0, 0.2), (1.7, 0.6)])
def test_exact_points_recover_solid(exponents):
    made = cloud(exponents=exponents, noise=0.0)
    fit = recover(made.points)
    assert fit.warnings == () and fit.fitted and fit.converged and fit.inliers.all()
    assert np.sort(fit.size) == pytest.approx([0.2, 0.3, 0.5], rel=1e-6)
    assert fit.rms < 1e-9 and np.abs(fit.residuals).max() < 1e-8
    assert error(fit, made) < 1e-7


def test_taper_and_bend_are_recovered_if_requested():
    made = cloud((0.3, 0.2, 0.6), (0.4, 1.1), 100, 0.002, 0, (0.5, -0.3), (0.9, 0.4))
    fit = recover(made.points, taper=True, bend=True)
    assert fit.warnings == ()
    assert fit.names[11:] == ("taper x", "taper y", "bend x", "bend y")
    assert error(fit, made) < 0.004
    assert abs(fit.bend.curvature) == pytest.approx(0.9, abs=0.1)
    assert np.sort(np.abs(fit.taper)) == pytest.approx([0.3, 0.5], abs=0.06)
    plain, only = (recover(cloud(exponents=(0.5, 1.0)).points, bend=bend) for bend in (False, True))
    assert not plain.taper.any() and plain.bend.curvature == 0.0
    assert plain.covariance.shape == (11, 11)
    assert len(plain.names) == len(plain.deviations()) == 11
    assert only.names[11:] == ("bend x", "bend y") and not only.taper.any()


@pytest.mark.parametrize(
    ("name", "exponents"), [("sphere", (1.0, 1.0)), ("box", (0.2, 0.2)), ("cylinder", (0.2, 1.0))]
)
def test_choice_of_thesis_is_among_three_shapes(name, exponents):
    made = cloud((0.3, 0.25, 0.5), exponents)
    fit = recover(made.points, choice="thesis")
    assert (fit.choice, tuple(fit.exponents)) == (name, exponents)
    assert fit.rank == 9 or name == "sphere"
    assert fit.deviations()["e1"] == 0.0
    assert error(fit, made) < 0.01
    assert recover(cloud().points).choice is None


@pytest.mark.slow
def test_errors_of_fits_are_as_large_as_stated():
    names, true = ("log size x", "log size y", "log size z", "e1", "e2"), [*SIZE, 0.5, 0.8]
    errors, shares = [], []
    for seed in range(12):
        made = cloud(seed=seed, turned=False)
        fit = recover(made.points)
        apart = np.concatenate([np.log(fit.size / true[:3]), fit.exponents - true[3:]])
        errors.append(apart / [fit.deviations()[name] for name in names])
        shares.append(error(fit, made) * made.diameter / fit.looseness)
    spread = np.std(errors, axis=0)  # Of 12 fits, by chance from 0.6 to 1.4
    assert (spread > 0.6).all() and (spread < 1.4).all()
    # A normal deviate is on average 0.8 of its standard deviation from 0.
    assert 0.5 < np.median(shares) < 1.2


def test_outliers_are_marked_and_ignored():
    rng = np.random.default_rng(7)
    made = cloud(exponents=(0.4, 0.9), seed=7)
    stray = np.arange(60) < 9
    away = made.points.mean(axis=0) + rng.uniform(-0.7, 0.7, (60, 3))
    points = np.where(stray[:, None], away, made.points)
    fit = recover(points, outliers=True, noise=0.005)
    assert fit.inliers[~stray].mean() > 0.9
    assert fit.inliers[stray].sum() <= 2
    assert error(fit, made) < 0.02 < error(recover(points), made)


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ({"exponents": (0.4, 1.3)}, {}),
        ({"size": (1.0, 1.0, 1.0), "exponents": (0.1, 0.1)}, {}),
        slow({"size": (1.0, 1.0, 0.05), "exponents": (1.0, 1.0)}, {}),
        slow({"exponents": (0.4, 1.3)}, {"outliers": True}),
        slow({"exponents": (0.4, 0.9), "count": 100, "taper": (0.4, 0.2)}, {"taper": True}),
    ],
)
def test_pose_unit_and_order_do_not_matter(kind, options, rotations):
    made = cloud(**kind)
    first = recover(made.points, **options)
    vertices = first.shape().mesh(3).vertices
    for which, turn in enumerate(rotations(3)):
        unit, shift = (1e-3, 1.0, 1e3)[which], np.array([1.0, -2.0, 3.0]) * which
        fit = recover(unit * (made.points[::-1] @ turn.T + shift), **options)
        position, axes = Pose.from_array(fit.pose)
        there = (unit * (vertices @ turn.T + shift) - position) @ axes
        there[:, :2] /= 1.0 + np.outer(there[:, 2] / fit.size[2], fit.taper)
        gauge = Superquadric(fit.size, fit.exponents).gauge(there)
        assert np.abs(gauge - 1.0).max() < 1e-5
        assert fit.size == pytest.approx(unit * first.size, rel=1e-5)
        assert fit.residuals[::-1] == pytest.approx(unit * first.residuals, abs=1e-6 * unit)


@pytest.mark.parametrize(
    ("size", "exponents"),
    [
        ((1.0, 1.0, 1.0), (0.05, 0.05)),  # A cube
        ((1.0, 1.0, 0.05), (1.0, 1.0)),  # A disc
        ((0.05, 0.05, 1.0), (1.0, 1.0)),  # A needle
        ((0.5, 0.5, 0.7), (0.1, 1.0)),
        ((0.5, 0.5, 0.5), (1.0, 1.0)),  # a ball, whose rotation is undetermined
    ],
)
def test_hard_shapes_are_recovered_in_any_pose(size, exponents):
    for seed in range(2):
        made = cloud(size, exponents, seed=seed)
        assert error(recover(made.points), made) < 0.02
    exact = recover(cloud(size, exponents, noise=0.0).points)
    assert np.sort(exact.size) == pytest.approx(sorted(size), rel=1e-5)
    if len(set(size)) == 1 and exponents == (1.0, 1.0):
        assert exact.converged and exact.rank == 8
        assert min(exact.deviations()[f"turn {axis}"] for axis in "xyz") > 0.9


def test_turned_cube_is_not_taken_for_octahedron(rotations):
    points = Superquadric(np.ones(3), np.full(2, 0.1)).mesh(2).vertices
    turn = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2)]]) / np.sqrt(2)
    for turned in (turn, turn[:, [1, 2, 0]], turn @ turn[:, ::-1], *rotations(2)):
        assert recover(points @ turned.T).exponents == pytest.approx([0.1, 0.1], abs=1e-6)


RANDOM = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("points", "warning"),
    [
        (np.zeros((0, 3)), "too few points"),
        (RANDOM.normal(size=(10, 3)), "too few points"),
        (RANDOM.normal(size=(40, 3)) * [1.0, 0.5, 0.0] + [0, 0, 1], "coplanar points"),
        (np.outer(np.linspace(-1, 1, 30), [1.0, 2.0, 3.0]), "collinear points"),
        (np.full((30, 3), 0.7), "identical points"),
        (1e-300 * RANDOM.normal(size=(30, 3)), "identical points"),
    ],
)
@pytest.mark.parametrize("options", [{}, {"taper": True, "bend": True}, {"outliers": True}])
def test_degenerate_points_give_ellipsoid_with_warning(points, warning, options):
    fit = recover(points, **options)
    assert fit.warnings == (warning,)
    assert not fit.fitted and not fit.converged and fit.rank == 0
    assert fit.exponents.tolist() == [1.0, 1.0]
    numbers = (fit.size, fit.pose, fit.residuals, fit.covariance, [fit.rms])
    assert all(np.isfinite(part).all() for part in numbers)
    if fit.size.any():
        low, high = fit.shape().bounds()
        assert (high - low).max() <= 2.5 * np.abs(points - points.mean(axis=0)).max()


@pytest.mark.slow
def test_uncertain_fits_have_warnings():
    for thickness in (1e-5, 1e-2):
        fit = recover(np.random.default_rng(1).normal(size=(60, 3)) * [1.0, 1.0, thickness])
        assert np.isfinite(fit.covariance).all() and fit.warnings
    made = cloud(exponents=(0.6, 0.8))
    most = np.concatenate([np.tile(made.points[:1], (70, 1)), made.points[1:]])
    fit = recover(most, outliers=True)
    assert fit.warnings and np.isfinite(fit.covariance).all()
    assert np.linalg.norm(fit.pose[:3] - made.pose[:3]) < 0.3 * made.diameter
    excessive = recover(made.points, outliers=True, noise=1e300)
    assert "loose" in excessive.warnings and np.isfinite(excessive.covariance).all()
    for options in ({"count": 11, "noise": 0.01}, {"count": 60, "noise": 0.08}):
        clouds = [cloud(exponents=(0.6, 0.8), **options, seed=seed) for seed in range(3)]
        assert sum("loose" in recover(one.points).warnings for one in clouds) >= 2


def test_half_covered_solid_has_warning_and_stays_bounded():
    certain = []
    for seed in range(4):
        made = cloud(exponents=(0.6, 0.8), count=120, turned=False, seed=seed)
        whole = recover(made.points)
        half = recover(made.points[made.points[:, 2] > made.points[:, 2].mean()])
        assert not set(whole.warnings) & {"one-sided", "loose"}
        assert set(half.warnings) & {"one-sided", "at a bound"}
        assert half.uncovered > 1.5 * whole.uncovered
        assert half.size.max() < 2.0 * whole.size.max()
        sizes = [max(f.deviations()[f"log size {a}"] for a in "xyz") for f in (half, whole)]
        certain.append(sizes[0] / sizes[1])
    assert np.median(certain) > 3.0


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
def test_recovery_rejects_invalid_arguments(points, options, words):
    with pytest.raises(ValueError, match=words):
        recover(points, **options)
    with pytest.raises(ValueError, match="size must be positive"):
        recover(np.ones((20, 3))).shape()


KINDS = [Warps(taper, bend) for taper in (False, True) for bend in (False, True)]


def drawn(warps: Warps, bend: float = 0.6, seed: int = 0) -> Any:
    """Parameters of eight solids, points and frames."""
    rng = np.random.default_rng(seed)
    parameters = np.zeros((8, warps.total))
    parameters[:, :3] = np.log(rng.uniform(0.3, 1.0, (8, 3)))
    parameters[:, 3:5] = rng.uniform(0.1, 1.9, (8, 2))
    parameters[:, 5:11] = rng.uniform(-0.5, 0.5, (8, 6))
    if warps.taper:
        parameters[:, warps.taper_columns] = rng.uniform(-0.8, 0.8, (8, 2))
    if warps.bend:
        parameters[:, warps.bend_columns] = bend * rng.uniform(-1.0, 1.0, (8, 2))
    return parameters, rng.normal(size=(40, 3)), np.linalg.qr(rng.normal(size=(8, 3, 3)))[0]


@pytest.mark.parametrize("warps", KINDS)
@pytest.mark.parametrize("bend", [0.6, 1e-9, 0.0])
def test_derivatives_of_distances_are_those_of_differences(warps, bend):
    parameters, points, frames = drawn(warps, bend)
    distances, jacobian = normal_distances(parameters, points, frames, warps)
    assert np.array_equal(distances, distances_alone(parameters, points, frames, warps))
    for column, step in enumerate(1e-6 * np.eye(warps.total)):
        wanted = distances_alone(parameters + step, points, frames, warps)
        wanted = (wanted - distances_alone(parameters - step, points, frames, warps)) / 2e-6
        off = np.abs(jacobian[:, :, column] - wanted) / (1.0 + np.abs(wanted))
        # Except at the few points next to a crease, where derivatives have no bound.
        assert np.quantile(off, 0.98) < 2e-8
        assert np.median(off) < 1e-9


def test_distances_from_ball_octahedron_and_disc():
    def rigid(size: Any, exponents: Any, points: Floats) -> Floats:
        parameters = np.concatenate([np.log(size), exponents, np.zeros(6)])[None]
        return distances_alone(parameters, points, np.eye(3)[None], KINDS[0])[0]

    points = np.random.default_rng(1).normal(size=(200, 3))
    ball, octahedron = (rigid([0.5] * 3, [e, e], points) for e in (1.0, 2.0))
    assert ball == pytest.approx(np.linalg.norm(points, axis=1) - 0.5, abs=1e-14)
    faces = (np.abs(points).sum(axis=1) - 0.5) / np.sqrt(3.0)
    assert octahedron == pytest.approx(faces, abs=1e-14)
    size, bend, taper = np.array([0.3, 0.2, 0.6]), np.array([0.8, -0.5]), np.array([0.5, -0.3])
    bending = Bend(float(np.hypot(*bend)), float(np.arctan2(bend[1], bend[0])))
    base = Superquadric(size, np.array([0.4, 1.3]))
    warped = DeformedSuperquadric(base, taper, bending).mesh(3).vertices
    parameters = np.concatenate([np.log(size), base.exponents, np.zeros(6), taper, bend])[None]
    assert np.abs(distances_alone(parameters, warped, np.eye(3)[None], KINDS[3])).max() < 1e-14
    above = np.array([[0.5, 0.0, 0.05 * np.sqrt(0.75) + 1e-4]])  # across, not along the radius
    assert rigid([1.0, 1.0, 0.05], [1.0, 1.0], above)[0] == pytest.approx(1e-4, rel=0.01)


@pytest.mark.parametrize("warps", KINDS)
def test_distances_are_finite_on_axes_creases_and_centres(warps):
    parameters, _, _ = drawn(warps, seed=3)
    parameters[:, 5:11] = 0.0
    parameters[:4, 3:5] = [[2.0, 2.0], [0.02, 0.02], [0.02, 2.0], [2.0, 0.02]]
    places = [*np.eye(3), *-np.eye(3), [0, 0, 0], [0, 1, 1], [1, 0, 1], [1e-200, 1, 0], [9, 9, 9]]
    places += [[0, 0, -50], [0, 0, 50], [1.6, 0, 0], [0, -1.6, 0]]
    frames = np.broadcast_to(np.eye(3), (8, 3, 3))
    distances, jacobian = normal_distances(parameters, np.array(places), frames, warps)
    assert np.isfinite(distances).all() and np.isfinite(jacobian).all()
