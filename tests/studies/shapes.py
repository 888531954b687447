"""The mathematics of shapes and splines: what is recovered, cast at, inverted and closed.

Superquadrics recovered from noisy points, how often, how well and how fast; casts at all models;
point inversion and closed curves, against a loop and against the thesis's clamped schemes. It
rests on core alone, no node takes part.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from palpate.bench.table import Row, at_least, at_most, figure_of
from palpate.core import Floats, shapes, splines
from palpate.core.geometry import nearest_points, nearest_search, sample_surface
from palpate.core.rebuild.recovery import Warps, distances_alone, normal_distances, recover
from palpate.core.splines.inversion import invert_general
from palpate.core.thesis import fit_closed_curve_thesis, invert_thesis
from tests.studies.timing import best_seconds

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
GRAZING = 0.05  # Rays along which the function falls less than this of the steepest say little
FAR = 0.15  # Rays start this far before the solid, m
POINTS = 10_000
LOOPED, QUICK_LOOPED = 200, 40  # Points that are inverted one at a time
REGULAR, DEFORMED = (5, 5, 27), (7, 7, 9)  # Control points of the lattices, all cubic
FRAME = splines.upright_parallelepiped(np.full(3, -1.0), np.full(3, 2.0))
# Spread of the control points, in quarters of the size; seeds; whether the lattice folds.
NOISES = ((0.05, 4, "sound"), (0.85, 9, "folded"))
EPSILON = float(np.finfo(float).eps) * 2.0  # Of the size
INVERSION_ROUNDS = 7
CURVE_POINTS = 81  # Points of a contour, the first again at the end
CURVE_CONTROLS = 16  # Control points around a layer of 5 by 5
FEW, MANY = 4000, 20000  # Places on a curve and on the shape between which distances are taken
CURVE_NOISE = 0.01  # Standard deviation of a coordinate over the curve's size
CurveShape = Callable[[Floats], Floats]


class RecoveryOutcome(NamedTuple):
    """How well a solid was recovered; distances as shares of its diameter."""

    one_sided: float  # Root mean square distance of places of the true surface from the model
    chamfer: float  # Mean of the mean distances of places of each surface from the other
    floor: float  # The same between two tessellations of the truth
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


def recovery_rows(quick: bool) -> Iterable[Row]:
    """Figures of the recovery, one at a time; fewer solids if quick."""
    trials = QUICK_TRIALS if quick else TRIALS
    hard = QUICK_HARD_TRIALS if quick else HARD_TRIALS
    yield logarithm_row()
    for name, kind, least, most in (
        ("60 points, 1 % noise", "rigid", 0.97, 60.0),
        ("60 points, 15 % outliers", "outliers", 0.95, 400.0),
        ("tapered, 100 points", "tapered", 0.98, 500.0),
        ("bent, 100 points", "bent", 0.98, 500.0),
        ("tapered and bent, 100 points", "both", 0.98, 500.0),
    ):
        yield from _rows(name, recover_many(KINDS[kind], trials), least, most)
    for name, kind in (("cube, exponents 0.05", "cube"), ("flat box, 1 : 20", "flat box")):
        yield from _rows(name, recover_many(KINDS[kind], hard), 0.95, None)
    for name, kind in (("disc, 1 : 20", "disc"), ("needle, 20 : 1", "needle")):
        worst = max(recover_many(KINDS[kind], hard), key=lambda one: one.chamfer)
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
        error = np.abs(shapes.inside_outside(points, exponents).value - exact).max()
        worst = max(worst, float(error / np.finfo(float).eps))
    return at_most("log F, largest error", worst, 16.0, ".1f", " eps")


def _rows(
    name: str, found: list[RecoveryOutcome], least: float, most: float | None
) -> Iterator[Row]:
    title, least = f"recovery, {name}", 100.0 * least
    typical = statistics.median(one.chamfer for one in found)
    floor = statistics.median(one.floor for one in found)
    one_way, both_ways = (100 * share for share in good_shares(found))
    yield at_least(f"{title}: one way", one_way, least, ".1f", " %")
    yield at_least(f"{title}: both ways", both_ways, least, ".1f", " %")
    yield _chamfer_row(f"{name}: Chamfer distance", typical, floor)
    if most is not None:
        cost = 1e3 * statistics.median(one.seconds for one in found)
        yield at_most(f"{title}: time", cost, most, ".0f", " ms")


def good_shares(found: list[RecoveryOutcome]) -> tuple[float, float]:
    """Shares of solids whose surface is nearly everywhere near the model, and both ways."""
    one_way = float(np.mean([one.one_sided < GOOD for one in found]))
    return one_way, float(np.mean([one.chamfer < GOOD for one in found]))


def _chamfer_row(name: str, distance: float, floor: float) -> Row:
    target = f"< 2 %, floor {100 * floor:.3f} %"
    return Row(f"recovery, {name}", f"{100 * distance:.2f} %", target, distance < GOOD)


def recover_many(kind: RecoveryKind, trials: int, seed: int = 5) -> list[RecoveryOutcome]:
    """Recover many solids of a kind, always the same ones."""
    rng = np.random.default_rng(seed)
    return [recover_one(kind, rng) for _ in range(trials)]


def recover_one(kind: RecoveryKind, rng: np.random.Generator) -> RecoveryOutcome:
    """Recover a solid with semi-axes of 0.3 to 1 m and exponents of 0.1 to 2, anywhere.

    Points lie where rays from the centre, even in all directions of the scaled solid, meet the
    surface; so there are few of them at corners.
    """
    size, exponents = rng.uniform(0.3, 1.0, 3), rng.uniform(0.1, 2.0, 2)
    if kind.fixed is not None:
        size, exponents = (np.array(part) for part in kind.fixed)
    shape = shapes.Superquadric(size, exponents)
    taper = rng.uniform(-0.7, 0.7, 2) * kind.taper
    direction = rng.uniform(0.0, 2.0 * np.pi) * kind.bend
    limit = min(
        LARGEST_BEND * shapes.largest_curvature(shape, taper, direction), LARGEST_ANGLE / size[2]
    )
    bend = shapes.Bend(rng.uniform(0.1, 1.0) * limit * kind.bend, direction)
    tapering = shapes.Taper(float(taper[0]), float(taper[1]), float(size[2]))
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
    true = (vertices @ axes.T + place)[coarse.faces]
    finer = (bend(tapering(fine.vertices)) @ axes.T + place)[fine.faces]
    points, outliers = points @ axes.T + place, kind.outliers > 0.0
    begin = time.perf_counter()
    found = recover(points, taper=kind.taper, bend=kind.bend, outliers=outliers)
    seconds = time.perf_counter() - begin
    if not found.fitted or "folded" in found.warnings:
        return RecoveryOutcome(np.inf, np.inf, np.inf, seconds)
    vertices, faces = found.shape().mesh(LEVEL)
    there = _distances(true, vertices[faces], rng)
    back = _distances(vertices[faces], true, rng)
    rms = float(np.sqrt(np.mean(there**2))) / diameter
    chamfer = 0.5 * float(there.mean() + back.mean()) / diameter
    there, back = _distances(true, finer, rng), _distances(finer, true, rng)
    return RecoveryOutcome(
        rms, chamfer, 0.5 * float(there.mean() + back.mean()) / diameter, seconds
    )


def _distances(places: Floats, surface: Floats, rng: np.random.Generator) -> Floats:
    """Distances of samples of one surface, in triangles (m, 3, 3), from another, m."""
    samples = sample_surface(places, SAMPLES, rng).points
    return nearest_points(nearest_search(surface), samples).distances


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
    directions = np.random.default_rng(0).normal(size=(4 if quick else 24, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    base = shapes.Superquadric(SIZE, np.array([0.5, 0.8]))
    unit = _cast_seconds(base, directions)
    yield Row("cast at a superquadric, 256 rays", f"{1e6 * unit:.0f} us")
    for name, shape in _models().items():
        ratio = _cast_seconds(shape, directions) / unit
        yield at_most(f"cast at {name}", ratio, MOST_RATIO, ".1f", " x", kind="time")
        error, passed = _error(shape, directions)
        yield at_most(f"error of a cast at {name}", error, MOST_ERROR, ".1e", " m")
        yield Row(f"rays that pass a part of {name}", str(passed), "0", passed == 0)


def _cast_seconds(shape: shapes.ImplicitShape, directions: Floats) -> float:
    """Mean time of a cast; for each direction the best of three."""
    calls = (partial(shape.cast, _origins(shape, one), one, 1.0) for one in directions)
    return float(np.mean([best_seconds(call, 3) for call in calls]))


def _models() -> Mapping[str, shapes.ImplicitShape]:
    dent = shapes.Dent(
        0.6, np.array([[45.0, 0, 0, -1.6], [0, 55.0, 0, 0], [0, 0, 45.0, 0]]), np.full(3, 2.0)
    )
    ball = shapes.Superquadric(np.full(3, 0.035), np.ones(2))
    drill = shapes.GeneralisedCylinder(
        shapes.SuperellipseSection(np.full(2, 0.012), 1.0), np.array([0.0, 0.1]), np.ones(2)
    )
    lobes = shapes.SplineSection(np.array([0.03, 0.02, 0.03, 0.02, 0.03, 0.02]))
    corners = np.concatenate([np.diag(SIZE), -np.diag(SIZE)])  # of an octahedron
    upper = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]]
    heights, scales = np.array([0.0, 0.02, 0.05, 0.07]), np.array([0.9, 1.1, 0.6, 0.7])
    return {
        "a hyperquadric": shapes.Hyperquadric(AXES, np.full(3, 4.0)),
        "a hyperquadric of powers below 1": shapes.Hyperquadric(AXES, np.full(3, 0.6)),
        "a dented hyperquadric": shapes.Hyperquadric(AXES, np.full(3, 4.0), (dent,)),
        "a lobed generalised cylinder": shapes.GeneralisedCylinder(
            lobes, heights, scales, smooth=True
        ),
        "a drilled half ball": shapes.BooleanShape(
            shapes.difference(ball, drill, shapes.HalfSpace(np.array([0.0, 0.0, 1.0]), -0.005))
        ),
        "a polyhedron": shapes.Polyhedron(corners, [*upper, *([b, a, 5] for a, b, _ in upper)]),
    }


def _error(shape: shapes.ImplicitShape, directions: Floats) -> tuple[float, int]:
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
        # Rays that are inside at one of some places before their ends.
        share, stop = np.linspace(0.0, 1.0 - 1e-6, 200), np.where(met, ranges, 2 * FAR)
        places = origins[:, None] + (share * stop[:, None])[..., None] * direction
        flat = places.reshape(-1, 3)
        value = shape.inside_out(flat, np.zeros_like(flat))[0].reshape(len(origins), -1)
        passed += int(np.count_nonzero((value < -1e-9).any(axis=1)))
    return worst, passed


def _origins(shape: shapes.ImplicitShape, direction: Floats) -> Floats:
    """Starts of parallel rays that cover the shape as a pad does."""
    low, high = shape.enclosure()
    places = np.random.default_rng(1).uniform(low, high, (RAYS, 3))
    return np.asarray(places - FAR * direction)


def spline_rows(quick: bool) -> Iterable[Row]:
    """Figures of point inversion and of the search for folds."""
    looped = QUICK_LOOPED if quick else LOOPED
    yield from _undeformed_rows(looped)
    bases = _bases(DEFORMED)
    control = FRAME.greville_control(bases)
    for noise, seed, verdict in NOISES:
        disturbed = np.random.default_rng(seed).normal(size=control.shape)
        volume = splines.SplineVolume(control + 0.5 * noise * disturbed, bases)
        yield from _deformed_rows(volume, verdict, looped)


def _undeformed_rows(looped: int) -> Iterable[Row]:
    bases, points = _bases(REGULAR), FRAME.points(_places())
    greville = splines.SplineVolume(FRAME.greville_control(bases), bases)
    found = splines.invert_points(greville, points)
    off = np.abs(greville.at(found.parameters) - points).max() / EPSILON
    closed = best_seconds(lambda: FRAME.local(points), INVERSION_ROUNDS)
    yield at_most("greville lattice: residual", off, 8, ".1f", " eps")
    yield _time("greville lattice: parameters in closed form", closed, 0.1)
    even = splines.SplineVolume(FRAME.even_control(REGULAR), bases)
    found = splines.invert_points(even, points)
    off = np.abs(even.at(found.parameters) - points).max() / EPSILON
    regular = best_seconds(lambda: splines.invert_points(even, points), INVERSION_ROUNDS)
    yield at_most("regular lattice: residual", off, 8, ".1f", " eps")
    yield _time("regular lattice: inverted axis by axis", regular, 20.0)
    loop = _loop(even, points[:looped])
    yield _ratio("closed form against a loop over points", loop / closed, 1000)
    yield _ratio("axis by axis against a loop over points", loop / regular, 1000)


def _time(name: str, seconds: float, most: float) -> Row:
    target = f"< {most:g} ms for 10,000"
    return Row(name, f"{1e3 * seconds:.3f} ms", target, 1e3 * seconds < most)


def _deformed_rows(volume: splines.SplineVolume, verdict: str, looped: int) -> Iterable[Row]:
    points, slopes = volume.first(_places())
    folded = float((np.linalg.det(slopes) <= 0.0).mean())
    name = f"deformed lattice, {folded:.0%} folded"
    report = splines.fold_report(splines.Lattice(volume, FRAME))
    yield Row(f"{name}: proved", report.verdict, verdict, report.verdict == verdict)
    most = 0.0 if verdict == "sound" else 0.01
    ours = best_seconds(lambda: splines.invert_points(volume, points), 1)
    lost = _lost(splines.invert_points(volume, points))
    yield at_most(f"{name}: points not inverted", lost, most, ".2%")
    thesis = _lost(invert_thesis(volume, points))
    yield Row(f"{name}: not inverted by the thesis", f"{thesis:.2%}", "for comparison", True)
    loop = _loop(volume, points[:looped])
    yield _ratio(f"{name}: against a loop over points", loop / ours, 50)
    if verdict == "sound":
        weights = np.random.default_rng(0).uniform(0.7, 1.4, DEFORMED)
        rational = splines.SplineVolume(volume.control, volume.bases, weights)
        found = splines.invert_points(rational, rational.at(_places()))
        yield at_most("the same with weights: points not inverted", _lost(found), 0.0, ".2%")


def _places() -> Floats:
    return np.random.default_rng(0).random((POINTS, 3))


def _lost(found: splines.Inversion) -> float:
    return float((~found.converged).mean())


def _loop(volume: splines.SplineVolume, points: Floats) -> float:
    """Seconds for all points one at a time, of which some are: by the same least squares."""
    invert = partial(invert_general, volume)
    return best_seconds(lambda: [invert(p[None]) for p in points], 1) * POINTS / len(points)


def _ratio(name: str, ratio: float, least: float) -> Row:
    number = figure_of(ratio, "x", kind="time")
    return Row(name, f"{ratio:,.0f} x", f">= {least:,.0f} x", ratio >= least, number)


def _bases(counts: tuple[int, int, int]) -> splines.Bases:
    s, t, u = (splines.clamped_basis(count) for count in counts)
    return s, t, u


def curve_rows(quick: bool) -> Iterable[Row]:
    """Rows on closed curves: condition, closure, error against the thesis's scheme, noise, time."""
    for name, shape in CLOSED_CURVES.items():
        points = shape(np.arange(CURVE_POINTS) / (CURVE_POINTS - 1))
        ours = splines.fit_closed_curve(points, count=CURVE_CONTROLS)
        thesis = fit_closed_curve_thesis(points, CURVE_CONTROLS)
        title = f"{name}, {CURVE_CONTROLS} control points: condition"
        yield at_most(title, ours.condition, 10.0, ".3g")
        gap = ours.closure_gap / float(np.ptp(points))
        yield at_most(f"{name}: closure gap over its size", gap, 1e-15, ".3g")
        # The other shapes have finer features than 16 control points can follow.
        most = 0.2 if name.startswith("ellipse") else 0.5
        share = _curve_error(ours, shape) / _curve_error(thesis, shape)
        yield at_most(f"{name}: error over the thesis's", share, most, ".3g")
        through = _curve_error(splines.fit_closed_curve(points), shape)
        floor = _curve_error(shape, shape)  # between two samplings of the shape itself
        what = f"{name}, through all points: error over its size"
        yield Row(what, f"{through:.3g}", f"<= 0.001, floor {floor:.2g}", through <= 1e-3)
    off = _noisy(4 if quick else 20)
    yield at_most("bean with 1 % noise: error over the noise", off, 0.55, ".3g")
    yield from _times(5 if quick else 40)


def _curve_error(curve: splines.ClosedCurve | CurveShape, shape: CurveShape) -> float:
    """Hausdorff distance to the shape, over its size."""
    turns, true = np.arange(FEW) / FEW, shape(np.arange(MANY) / MANY)
    found = curve.at(turns) if isinstance(curve, splines.ClosedCurve) else curve(turns)
    there, back = (
        np.asarray(cKDTree(one).query(other)[0]) for one, other in ((true, found), (found, true))
    )
    return float(max(there.max(), back.max()) / np.ptp(true, axis=0).max())


def _noisy(curves: int) -> float:
    """Root mean square error of curves through noisy points, over the noise."""
    clean = _bean(np.arange(CURVE_POINTS - 1) / (CURVE_POINTS - 1))
    true = _bean(np.arange(MANY) / MANY)
    sigma = CURVE_NOISE * float(np.ptp(true, axis=0).max())
    tree, off = cKDTree(true), []
    for seed in range(curves):
        noise = sigma * np.random.default_rng(seed).normal(size=clean.shape)
        curve = splines.fit_closed_curve(clean + noise)
        off.append(np.asarray(tree.query(curve.at(np.arange(500) / 500))[0]))
    return float(np.sqrt(np.mean(np.square(off)))) / sigma


def _times(repeat: int) -> Iterable[Row]:
    points = _bean(np.arange(CURVE_POINTS) / (CURVE_POINTS - 1))
    noisy = points + CURVE_NOISE * np.random.default_rng(0).normal(size=points.shape)
    ways: Mapping[str, Callable[[], splines.ClosedCurve]] = {
        "through all points": partial(splines.fit_closed_curve, points),
        f"{CURVE_CONTROLS} control points": partial(
            splines.fit_closed_curve, points, count=CURVE_CONTROLS
        ),
        "with noise": partial(splines.fit_closed_curve, noisy),
    }
    for name, way in ways.items():
        cost = 1e3 * best_seconds(way, repeat)
        yield at_most(f"{CURVE_POINTS} points, {name}: time", cost, 2.0, ".2f", " ms")


def _superellipse(turn: Floats) -> Floats:
    c, s = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
    away = (np.abs(c) ** (2 / 0.3) + np.abs(s) ** (2 / 0.3)) ** -0.15
    return np.asarray(away[:, None] * np.column_stack([c, s]))


def _bean(turn: Floats) -> Floats:
    angle = 2 * np.pi * turn
    away = 1 + 0.35 * np.cos(2 * angle) + 0.1 * np.sin(3 * angle)
    return np.asarray(away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


KINDS: Mapping[str, RecoveryKind] = {
    "rigid": RecoveryKind(60),
    "outliers": RecoveryKind(60, outliers=0.15),
    "tapered": RecoveryKind(100, taper=True),
    "bent": RecoveryKind(100, bend=True),
    "both": RecoveryKind(100, taper=True, bend=True),
    "cube": RecoveryKind(60, noise=0.005, fixed=((1.0, 1.0, 1.0), (0.05, 0.05))),
    "disc": RecoveryKind(60, noise=0.005, fixed=((1.0, 1.0, 0.05), (1.0, 1.0))),
    "flat box": RecoveryKind(60, noise=0.005, fixed=((1.0, 1.0, 0.05), (0.1, 0.1))),
    "needle": RecoveryKind(60, noise=0.005, fixed=((0.05, 0.05, 1.0), (1.0, 1.0))),
}
CLOSED_CURVES: Mapping[str, CurveShape] = {
    "ellipse 2:1": lambda turn: np.column_stack(
        [2.0 * np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)]
    ),
    "superellipse e=0.3": _superellipse,
    "bean": _bean,
}
