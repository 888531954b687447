"""Superquadrics recovered from noisy points, counted: how often, how well and how fast."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.measure.nearest import nearest_points, search_of
from palpate.core.measure.sampling import sample_surface
from palpate.core.rebuild.recovery.normal_distance import Warps, distances_alone, normal_distances
from palpate.core.rebuild.recovery.recover import recover
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.inside_outside import inside_outside
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper
from palpate.core.shapes.warped import most_bend
from palpate.launch.bench_row import Row

TRIALS, QUICK_TRIALS = 200, 30
HARD_TRIALS, QUICK_HARD_TRIALS = 40, 8
SAMPLES, LEVEL = 1000, 4
GOOD = 0.02
"""Of the diameter."""
LARGEST_BEND, LARGEST_ANGLE = 0.6, 1.2
"""Of the bend that folds, and rad at the ends."""


class Trial(NamedTuple):
    """A solid, and what is known of it."""

    size: Floats
    exponents: Floats
    taper: Floats
    bend: Bend
    points: Floats
    """(n, 3), noisy, in the world's frame, m."""
    surface: Floats
    """Triangles of the true surface in the world's frame, (m, 3, 3), m."""
    finer: Floats
    """The same surface in four times as many triangles."""
    diameter: float


class Outcome(NamedTuple):
    """How well a solid was recovered; distances as shares of its diameter."""

    one_sided: float
    """Root mean square distance of places of the true surface from the model."""
    chamfer: float
    """Mean of the mean distances of places of each surface from the other."""
    floor: float
    """The same between two tessellations of the truth."""
    doubted: bool
    seconds: float


class Kind(NamedTuple):
    """Of which solids, and which points on them."""

    points: int
    noise: float = 0.01
    outliers: float = 0.0
    taper: bool = False
    bend: bool = False
    fixed: tuple[tuple[float, float, float], tuple[float, float]] | None = None
    """Size and exponents, if they are not random."""


RIGID = Kind(60)
OUTLIERS = Kind(60, outliers=0.15)
TAPERED = Kind(100, taper=True)
BENT = Kind(100, bend=True)
BOTH = Kind(100, taper=True, bend=True)
CUBE = Kind(60, noise=0.005, fixed=((1.0, 1.0, 1.0), (0.05, 0.05)))
DISC = Kind(60, noise=0.005, fixed=((1.0, 1.0, 0.05), (1.0, 1.0)))
FLAT_BOX = Kind(60, noise=0.005, fixed=((1.0, 1.0, 0.05), (0.1, 0.1)))
NEEDLE = Kind(60, noise=0.005, fixed=((0.05, 0.05, 1.0), (1.0, 1.0)))


def draw(kind: Kind, rng: np.random.Generator) -> Trial:
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
    limit = min(LARGEST_BEND * most_bend(shape, taper, direction), LARGEST_ANGLE / size[2])
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
    stray = rng.random(kind.points) < kind.outliers
    points[stray] = rng.uniform(-1.5, 1.5, (int(stray.sum()), 3)) * size.max()
    surface = (vertices @ axes.T + place)[coarse.faces]
    finer = (bend(tapering(fine.vertices)) @ axes.T + place)[fine.faces]
    return Trial(size, exponents, taper, bend, points @ axes.T + place, surface, finer, diameter)


def attempt(kind: Kind, rng: np.random.Generator) -> Outcome:
    """Recover one solid."""
    trial = draw(kind, rng)
    begin = time.perf_counter()
    found = recover(trial.points, taper=kind.taper, bend=kind.bend, outliers=kind.outliers > 0.0)
    seconds = time.perf_counter() - begin
    if not found.fitted or "folded" in found.doubts:
        return Outcome(np.inf, np.inf, np.inf, True, seconds)
    vertices, faces = found.shape().mesh(LEVEL)
    there = _distances(trial.surface, vertices[faces], rng)
    back = _distances(vertices[faces], trial.surface, rng)
    return Outcome(
        float(np.sqrt(np.mean(there**2))) / trial.diameter,
        0.5 * float(there.mean() + back.mean()) / trial.diameter,
        _floor(trial, rng),
        bool(found.doubts),
        seconds,
    )


def outcomes(kind: Kind, trials: int, seed: int = 5) -> list[Outcome]:
    """Recover many solids of a kind, always the same ones."""
    rng = np.random.default_rng(seed)
    return [attempt(kind, rng) for _ in range(trials)]


def success(found: list[Outcome]) -> float:
    """Share of solids whose surface is nearly everywhere near the model."""
    return float(np.mean([one.one_sided < GOOD for one in found]))


def both_ways(found: list[Outcome]) -> float:
    """Share of solids whose Chamfer distance to the model is small."""
    return float(np.mean([one.chamfer < GOOD for one in found]))


def _floor(trial: Trial, rng: np.random.Generator) -> float:
    there = _distances(trial.surface, trial.finer, rng)
    back = _distances(trial.finer, trial.surface, rng)
    return 0.5 * float(there.mean() + back.mean()) / trial.diameter


def _distances(places: Floats, surface: Floats, rng: np.random.Generator) -> Floats:
    """Distances of samples of one surface from another, m."""
    return nearest_points(search_of(surface), sample_surface(places, SAMPLES, rng).points).distances


def recovery_rows(quick: bool) -> Iterable[Row]:
    """Figures of the recovery, one at a time.

    Parameters
    ----------
    quick : bool
        Fewer solids.
    """
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
        yield from _rows(name, outcomes(kind, trials), least, most)
    for name, kind in (("cube, exponents 0.05", CUBE), ("flat box, 1 : 20", FLAT_BOX)):
        yield from _rows(name, outcomes(kind, hard), 0.95, None)
    for name, kind in (("disc, 1 : 20", DISC), ("needle, 20 : 1", NEEDLE)):
        worst = max(outcomes(kind, hard), key=lambda one: one.chamfer)
        yield _chamfer_row(f"{name}: worst Chamfer distance", worst.chamfer, worst.floor)
    yield slope_row()


def _rows(name: str, found: list[Outcome], least: float, most: float | None) -> Iterator[Row]:
    share, both = success(found), both_ways(found)
    typical = statistics.median(one.chamfer for one in found)
    floor = statistics.median(one.floor for one in found)
    target = f">= {100 * least:.0f} %"
    yield Row(f"recovery, {name}: one way", f"{100 * share:.1f} %", target, share >= least)
    shown = f"{100 * both:.1f} %"
    yield Row(f"recovery, {name}: both ways", shown, target, both >= least)
    yield _chamfer_row(f"{name}: Chamfer distance", typical, floor)
    if most is not None:
        cost = 1e3 * statistics.median(one.seconds for one in found)
        yield Row(f"recovery, {name}: time", f"{cost:.0f} ms", f"<= {most:.0f} ms", cost <= most)


def _chamfer_row(name: str, distance: float, floor: float) -> Row:
    target = f"< 2 %, floor {100 * floor:.3f} %"
    return Row(f"recovery, {name}", f"{100 * distance:.2f} %", target, distance < GOOD)


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
    return Row("log F, largest error", f"{worst:.1f} eps", "<= 16 eps", worst <= 16.0)


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

    ratio = statistics.median(_seconds(central) / _seconds(exact) for _ in range(9))
    return Row("Jacobian of 15 parameters, by differences", f"{ratio:.0f} x", ">= 5 x", ratio >= 5)


def _seconds(call: Callable[[], None]) -> float:
    """Time of one call."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin
