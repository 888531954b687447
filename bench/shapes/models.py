"""Superquadrics recovered from noisy points: how often, how well, how fast; and casts at models."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.bench.table import Row, at_least, at_most, best_seconds
from palpate.core import Floats
from palpate.core.geometry import nearest_points, nearest_search, sample_surface
from palpate.core.rebuild.recovery import Warps, distances_alone, normal_distances, recover
from palpate.core.shapes import (
    Bend,
    BooleanShape,
    Dent,
    GeneralisedCylinder,
    HalfSpace,
    Hyperquadric,
    ImplicitShape,
    Polyhedron,
    SplineSection,
    SuperellipseSection,
    Superquadric,
    Taper,
    difference,
    inside_outside,
    largest_curvature,
)

TRIALS, QUICK_TRIALS = 200, 30
HARD_TRIALS, QUICK_HARD_TRIALS = 40, 8
SAMPLES, LEVEL = 1000, 4
GOOD = 0.02  # Of the diameter
LARGEST_BEND, LARGEST_ANGLE = 0.6, 1.2  # Of the bend that folds, and rad at the ends
RAYS = 256  # As many as a sensor has taxels
SIZE = np.array([0.035, 0.03, 0.045])
AXES = np.column_stack([np.diag(1.0 / SIZE), np.zeros(3)])
MOST_RATIO = 40.0  # Of a superquadric's cast
MOST_ERROR = 1e-12  # m
# Rays along which the function falls less than this share of the steepest say little.
GRAZING = 0.05
FAR = 0.15  # Rays start this far before the solid, m


class RecoveryTrial(NamedTuple):
    """A solid, and what is known of it."""

    size: Floats
    exponents: Floats
    taper: Floats
    bend: Bend
    points: Floats  # (n, 3), noisy, in the world's frame, m
    surface: Floats  # Triangles of the true surface in the world's frame, (m, 3, 3), m
    finer: Floats  # The same surface in four times as many triangles
    diameter: float


class RecoveryOutcome(NamedTuple):
    """How well a solid was recovered; distances as shares of its diameter."""

    one_sided: float  # Root mean square distance of places of the true surface from the model
    chamfer: float  # Mean of the mean distances of places of each surface from the other
    floor: float  # The same between two tessellations of the truth
    doubted: bool
    seconds: float


class RecoveryKind(NamedTuple):
    """Of which solids, and which points on them."""

    points: int
    noise: float = 0.01
    outliers: float = 0.0
    taper: bool = False
    bend: bool = False
    # Size and exponents, if they are not random.
    fixed: tuple[tuple[float, float, float], tuple[float, float]] | None = None


def draw_trial(kind: RecoveryKind, rng: np.random.Generator) -> RecoveryTrial:
    """A solid with semi-axes of 0.3 to 1 m and exponents of 0.1 to 2, anywhere, and its points.

    Points lie where rays from the centre, even in all directions of the scaled solid, meet the
    surface; so there are few of them at corners.
    """
    size, exponents = rng.uniform(0.3, 1.0, 3), rng.uniform(0.1, 2.0, 2)
    if kind.fixed is not None:
        size, exponents = (np.array(part) for part in kind.fixed)
    shape = Superquadric(size, exponents)
    taper = rng.uniform(-0.7, 0.7, 2) * kind.taper
    direction = rng.uniform(0.0, 2.0 * np.pi) * kind.bend
    limit = min(LARGEST_BEND * largest_curvature(shape, taper, direction), LARGEST_ANGLE / size[2])
    bend = Bend(rng.uniform(0.1, 1.0) * limit * kind.bend, direction)
    tapering = Taper(float(taper[0]), float(taper[1]), float(size[2]))
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes[:, 0] *= np.linalg.det(axes)
    place = rng.normal(size=3)
    coarse, fine = shape.mesh(LEVEL), shape.mesh(LEVEL + 1)
    vertices = bend(tapering(coarse.vertices))
    rays = rng.normal(size=(kind.points, 3)) * size
    points = bend(tapering(rays / shape.gauge(rays)[:, None]))
    diameter = float(np.ptp(vertices, axis=0).max())
    points = points + kind.noise * diameter * rng.normal(size=points.shape)
    off = rng.random(kind.points) < kind.outliers
    points[off] = rng.uniform(-1.5, 1.5, (int(off.sum()), 3)) * size.max()
    surface = (vertices @ axes.T + place)[coarse.faces]
    finer = (bend(tapering(fine.vertices)) @ axes.T + place)[fine.faces]
    return RecoveryTrial(
        size, exponents, taper, bend, points @ axes.T + place, surface, finer, diameter
    )


def recovery_rows(quick: bool) -> Iterable[Row]:
    """Figures of the recovery, one at a time; fewer solids if quick."""
    trials = QUICK_TRIALS if quick else TRIALS
    hard = QUICK_HARD_TRIALS if quick else HARD_TRIALS
    yield logarithm_row()
    for name, kind, least, most in (
        ("60 points, 1 % noise", RIGID, 0.97, 60.0),
        ("60 points, 15 % outliers", OUTLIERS, 0.95, 400.0),
        ("tapered, 100 points", TAPERED, 0.98, 500.0),
        ("bent, 100 points", BENT, 0.98, 500.0),
        ("tapered and bent, 100 points", BOTH, 0.98, 500.0),
    ):
        yield from _rows(name, recover_many(kind, trials), least, most)
    for name, kind in (("cube, exponents 0.05", CUBE), ("flat box, 1 : 20", FLAT_BOX)):
        yield from _rows(name, recover_many(kind, hard), 0.95, None)
    for name, kind in (("disc, 1 : 20", DISC), ("needle, 20 : 1", NEEDLE)):
        worst = max(recover_many(kind, hard), key=lambda one: one.chamfer)
        yield _chamfer_row(f"{name}: worst Chamfer distance", worst.chamfer, worst.floor)
    yield slope_row()


def logarithm_row() -> Row:
    """Largest error of log F against extended precision, in roundings."""
    rng = np.random.default_rng(0)
    worst = 0.0
    for _ in range(40):
        exponents = np.exp(rng.uniform(np.log(0.05), np.log(2.0), 2))
        points = np.exp(rng.uniform(np.log(0.01), np.log(100.0), (500, 3)))
        x, y, z = np.log(points.astype(np.longdouble)).T
        e1, e2 = exponents.astype(np.longdouble)
        across = e2 / 2 * np.logaddexp(2 / e2 * x, 2 / e2 * y)
        exact = e1 * np.logaddexp(2 / e1 * across, 2 / e1 * z)
        error = np.abs(inside_outside(points, exponents).value - exact).max()
        worst = max(worst, float(error / np.finfo(float).eps))
    return at_most("log F, largest error", worst, 16.0, ".1f", " eps")


def _rows(
    name: str, found: list[RecoveryOutcome], least: float, most: float | None
) -> Iterator[Row]:
    title, least = f"recovery, {name}", 100.0 * least
    typical = statistics.median(one.chamfer for one in found)
    floor = statistics.median(one.floor for one in found)
    yield at_least(f"{title}: one way", 100 * share_one_way(found), least, ".1f", " %")
    yield at_least(f"{title}: both ways", 100 * share_both_ways(found), least, ".1f", " %")
    yield _chamfer_row(f"{name}: Chamfer distance", typical, floor)
    if most is not None:
        cost = 1e3 * statistics.median(one.seconds for one in found)
        yield at_most(f"{title}: time", cost, most, ".0f", " ms")


def share_one_way(found: list[RecoveryOutcome]) -> float:
    """Share of solids whose surface is nearly everywhere near the model."""
    return float(np.mean([one.one_sided < GOOD for one in found]))


def share_both_ways(found: list[RecoveryOutcome]) -> float:
    """Share of solids whose Chamfer distance to the model is small."""
    return float(np.mean([one.chamfer < GOOD for one in found]))


def _chamfer_row(name: str, distance: float, floor: float) -> Row:
    target = f"< 2 %, floor {100 * floor:.3f} %"
    return Row(f"recovery, {name}", f"{100 * distance:.2f} %", target, distance < GOOD)


def recover_many(kind: RecoveryKind, trials: int, seed: int = 5) -> list[RecoveryOutcome]:
    """Recover many solids of a kind, always the same ones."""
    rng = np.random.default_rng(seed)
    return [recover_one(kind, rng) for _ in range(trials)]


def recover_one(kind: RecoveryKind, rng: np.random.Generator) -> RecoveryOutcome:
    """Recover one solid."""
    trial = draw_trial(kind, rng)
    begin = time.perf_counter()
    found = recover(trial.points, taper=kind.taper, bend=kind.bend, outliers=kind.outliers > 0.0)
    seconds = time.perf_counter() - begin
    if not found.fitted or "folded" in found.warnings:
        return RecoveryOutcome(np.inf, np.inf, np.inf, True, seconds)
    vertices, faces = found.shape().mesh(LEVEL)
    there = _distances(trial.surface, vertices[faces], rng)
    back = _distances(vertices[faces], trial.surface, rng)
    return RecoveryOutcome(
        float(np.sqrt(np.mean(there**2))) / trial.diameter,
        0.5 * float(there.mean() + back.mean()) / trial.diameter,
        _floor(trial, rng),
        bool(found.warnings),
        seconds,
    )


def _floor(trial: RecoveryTrial, rng: np.random.Generator) -> float:
    there = _distances(trial.surface, trial.finer, rng)
    back = _distances(trial.finer, trial.surface, rng)
    return 0.5 * float(there.mean() + back.mean()) / trial.diameter


def _distances(places: Floats, surface: Floats, rng: np.random.Generator) -> Floats:
    """Distances of samples of one surface from another, m."""
    return nearest_points(
        nearest_search(surface), sample_surface(places, SAMPLES, rng).points
    ).distances


def slope_row() -> Row:
    """Analytic Jacobian of all 15 parameters against central differences, in time."""
    rng = np.random.default_rng(0)
    warps = Warps(taper=True, bend=True)
    parameters = rng.uniform(-0.3, 0.3, (6, warps.total))
    parameters[:, 3:5] = rng.uniform(0.3, 1.7, (6, 2))
    points, axes = rng.normal(size=(60, 3)), np.broadcast_to(np.eye(3), (6, 3, 3))

    def central() -> None:
        for step in 1e-6 * np.eye(warps.total):
            for way in (step, -step):
                distances_alone(parameters + way, points, axes, warps)

    def exact() -> None:
        normal_distances(parameters, points, axes, warps)

    ratios = [best_seconds(central, 1) / best_seconds(exact, 1) for _ in range(9)]
    ratio = statistics.median(ratios)
    return at_least("Jacobian of 15 parameters, by differences", ratio, 5, ".0f", " x")


def model_rows(quick: bool) -> Iterable[Row]:
    """For each model the cost of a cast against a superquadric's, its error, and what it passed."""
    directions = _directions(4 if quick else 24)
    base = Superquadric(SIZE, np.array([0.5, 0.8]))
    unit = _cast_seconds(base, directions)
    yield Row("cast at a superquadric, 256 rays", f"{1e6 * unit:.0f} us")
    for name, shape in _models().items():
        ratio = _cast_seconds(shape, directions) / unit
        yield Row(f"cast at {name}", f"{ratio:.1f} x", f"<= {MOST_RATIO:g}", ratio <= MOST_RATIO)
        error, passed = _error(shape, directions)
        yield at_most(f"error of a cast at {name}", error, MOST_ERROR, ".1e", " m")
        yield Row(f"rays that pass a part of {name}", str(passed), "0", passed == 0)


def _directions(count: int) -> Floats:
    found = np.random.default_rng(0).normal(size=(count, 3))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _cast_seconds(shape: ImplicitShape, directions: Floats) -> float:
    """Mean time of a cast; for each direction the best of three."""
    best = []
    for direction in directions:
        call = partial(shape.cast, _origins(shape, direction), direction, 1.0)
        best.append(best_seconds(call, 3))
    return float(np.mean(best))


def _models() -> Mapping[str, ImplicitShape]:
    dent = Dent(
        0.6, np.array([[45.0, 0, 0, -1.6], [0, 55.0, 0, 0], [0, 0, 45.0, 0]]), np.full(3, 2.0)
    )
    ball = Superquadric(np.full(3, 0.035), np.ones(2))
    drill = GeneralisedCylinder(
        SuperellipseSection(np.full(2, 0.012), 1.0), np.array([0.0, 0.1]), np.ones(2)
    )
    lobes = SplineSection(np.array([0.03, 0.02, 0.03, 0.02, 0.03, 0.02]))
    heights, scales = np.array([0.0, 0.02, 0.05, 0.07]), np.array([0.9, 1.1, 0.6, 0.7])
    return {
        "a hyperquadric": Hyperquadric(AXES, np.full(3, 4.0)),
        "a hyperquadric of powers below 1": Hyperquadric(AXES, np.full(3, 0.6)),
        "a dented hyperquadric": Hyperquadric(AXES, np.full(3, 4.0), (dent,)),
        "a lobed generalised cylinder": GeneralisedCylinder(lobes, heights, scales, smooth=True),
        "a drilled half ball": BooleanShape(
            difference(ball, drill, HalfSpace(np.array([0.0, 0.0, 1.0]), -0.005))
        ),
        "a polyhedron": _octahedron(),
    }


def _octahedron() -> Polyhedron:
    corners = np.concatenate([np.diag(SIZE), -np.diag(SIZE)])
    upper = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]]
    return Polyhedron(corners, [*upper, *([face[1], face[0], 5] for face in upper)])


def _error(shape: ImplicitShape, directions: Floats) -> tuple[float, int]:
    """Largest way from where a ray ended to the surface, m, and rays that passed a part of it."""
    worst, passed = 0.0, 0
    for direction in directions:
        origins = _origins(shape, direction)
        ranges = shape.cast(origins, direction, 1.0)
        met = np.isfinite(ranges)
        ends = origins[met] + ranges[met, None] * direction
        value, slope = shape.inside_out(ends, np.broadcast_to(direction, ends.shape))
        clear = slope < -GRAZING * np.abs(slope).max(initial=0.0)
        worst = max(worst, float(np.abs(value[clear] / slope[clear]).max(initial=0.0)))
        passed += _passed(shape, origins, direction, np.where(met, ranges, 2 * FAR))
    return worst, passed


def _origins(shape: ImplicitShape, direction: Floats) -> Floats:
    """Starts of parallel rays that cover the shape as a pad does."""
    low, high = shape.enclosure()
    places = np.random.default_rng(1).uniform(low, high, (RAYS, 3))
    return np.asarray(places - FAR * direction)


def _passed(shape: ImplicitShape, origins: Floats, direction: Floats, ends: Floats) -> int:
    """Rays that are inside at one of some places before their ends."""
    share = np.linspace(0.0, 1.0 - 1e-6, 200)
    places = origins[:, None] + (share * ends[:, None])[..., None] * direction
    flat = places.reshape(-1, 3)
    value = shape.inside_out(flat, np.zeros_like(flat))[0].reshape(len(origins), -1)
    return int(np.count_nonzero((value < -1e-9).any(axis=1)))


RIGID = RecoveryKind(60)
OUTLIERS = RecoveryKind(60, outliers=0.15)
TAPERED = RecoveryKind(100, taper=True)
BENT = RecoveryKind(100, bend=True)
BOTH = RecoveryKind(100, taper=True, bend=True)
CUBE = RecoveryKind(60, noise=0.005, fixed=((1.0, 1.0, 1.0), (0.05, 0.05)))
DISC = RecoveryKind(60, noise=0.005, fixed=((1.0, 1.0, 0.05), (1.0, 1.0)))
FLAT_BOX = RecoveryKind(60, noise=0.005, fixed=((1.0, 1.0, 0.05), (0.1, 0.1)))
NEEDLE = RecoveryKind(60, noise=0.005, fixed=((0.05, 0.05, 1.0), (1.0, 1.0)))
