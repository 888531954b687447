"""Point inversion and closed curves, against a loop and against the thesis's clamped schemes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from scipy.spatial import cKDTree

from palpate.bench.table import Row, at_most, best_seconds
from palpate.core import Floats
from palpate.core.splines import (
    Bases,
    ClosedCurve,
    Inversion,
    Lattice,
    SplineVolume,
    clamped_basis,
    fit_closed_curve,
    fold_report,
    invert_points,
    upright_parallelepiped,
)
from palpate.core.thesis import fit_closed_curve_thesis, invert_thesis

POINTS = 10_000
LOOPED, QUICK_LOOPED = 200, 40  # Points that are inverted one at a time
REGULAR, DEFORMED = (5, 5, 27), (7, 7, 9)  # Control points of the lattices, all cubic
FRAME = upright_parallelepiped(np.full(3, -1.0), np.full(3, 2.0))
# Spread of the control points, in quarters of the size; seeds; whether the lattice folds.
NOISES = ((0.05, 4, "sound"), (0.85, 9, "folded"))
EPSILON = float(np.finfo(float).eps) * 2.0  # Of the size
ROUNDS = 7
CURVE_POINTS = 81  # Points of a contour, the first again at the end
CURVE_CONTROLS = 16  # Control points around a layer of 5 by 5
FEW, MANY = 4000, 20000  # Places on a curve and on the shape between which distances are taken
CURVE_NOISE = 0.01  # Standard deviation of a coordinate over the curve's size
CurveShape = Callable[[Floats], Floats]


def spline_rows(quick: bool) -> Iterable[Row]:
    """Figures of point inversion and of the search for folds."""
    looped = QUICK_LOOPED if quick else LOOPED
    yield from _undeformed_rows(looped)
    for noise, seed, verdict in NOISES:
        yield from _deformed_rows(_disturbed(noise, seed), verdict, looped)


def _undeformed_rows(looped: int) -> Iterable[Row]:
    bases, points = _bases(REGULAR), FRAME.points(_places())
    greville = SplineVolume(FRAME.greville_control(bases), bases)
    found = invert_points(greville, points)
    off = np.abs(greville.at(found.parameters) - points).max() / EPSILON
    closed = best_seconds(lambda: FRAME.local(points), ROUNDS)
    yield at_most("greville lattice: residual", off, 8, ".1f", " eps")
    yield _time("greville lattice: parameters in closed form", closed, 0.1)
    even = SplineVolume(FRAME.even_control(REGULAR), bases)
    found = invert_points(even, points)
    off = np.abs(even.at(found.parameters) - points).max() / EPSILON
    regular = best_seconds(lambda: invert_points(even, points), ROUNDS)
    yield at_most("regular lattice: residual", off, 8, ".1f", " eps")
    yield _time("regular lattice: inverted axis by axis", regular, 20.0)
    loop = _loop(even, points[:looped])
    yield _ratio("closed form against a loop over points", loop / closed, 1000)
    yield _ratio("axis by axis against a loop over points", loop / regular, 1000)


def _time(name: str, seconds: float, most: float) -> Row:
    milliseconds = 1e3 * seconds
    target = f"< {most:g} ms for 10,000"
    return Row(name, f"{milliseconds:.3f} ms", target, milliseconds < most)


def _deformed_rows(volume: SplineVolume, verdict: str, looped: int) -> Iterable[Row]:
    points, slopes = volume.first(_places())
    folded = float((np.linalg.det(slopes) <= 0.0).mean())
    name = f"deformed lattice, {folded:.0%} folded"
    report = fold_report(Lattice(volume, FRAME))
    yield Row(f"{name}: proved", report.verdict, verdict, report.verdict == verdict)
    most = 0.0 if verdict == "sound" else 0.01
    ours = best_seconds(lambda: invert_points(volume, points), 1)
    yield _failures(f"{name}: points not inverted", invert_points(volume, points), most)
    thesis = invert_thesis(volume, points)
    failed = float((~thesis.converged).mean())
    yield Row(f"{name}: not inverted by the thesis", f"{failed:.2%}", "for comparison", True)
    loop = _loop(volume, points[:looped])
    yield _ratio(f"{name}: against a loop over points", loop / ours, 50)
    if verdict == "sound":
        weights = np.random.default_rng(0).uniform(0.7, 1.4, DEFORMED)
        rational = SplineVolume(volume.control, volume.bases, weights)
        found = invert_points(rational, rational.at(_places()))
        yield _failures("the same with weights: points not inverted", found, 0.0)


def _places() -> Floats:
    return np.random.default_rng(0).random((POINTS, 3))


def _failures(name: str, found: Inversion, most: float) -> Row:
    failed = float((~found.converged).mean())
    return Row(name, f"{failed:.2%}", f"<= {most:.0%}", failed <= most)


def _loop(volume: SplineVolume, points: Floats) -> float:
    """Seconds for all points one at a time, of which some are: by the same least squares."""

    def call() -> None:
        for point in points:
            invert_points(volume, point[None], method="general")

    return best_seconds(call, 1) * POINTS / len(points)


def _ratio(name: str, ratio: float, least: float) -> Row:
    return Row(name, f"{ratio:,.0f} x", f">= {least:,.0f} x", ratio >= least)


def _disturbed(noise: float, seed: int) -> SplineVolume:
    bases = _bases(DEFORMED)
    control = FRAME.greville_control(bases)
    rng = np.random.default_rng(seed)
    return SplineVolume(control + 0.5 * noise * rng.normal(size=control.shape), bases)


def _bases(counts: tuple[int, int, int]) -> Bases:
    s, t, u = (clamped_basis(count) for count in counts)
    return s, t, u


def curve_rows(quick: bool) -> Iterable[Row]:
    """Rows on closed curves: condition, closure, error against the thesis's scheme, noise, time."""
    for name, shape in CLOSED_CURVES.items():
        points = shape(np.arange(CURVE_POINTS) / (CURVE_POINTS - 1))
        ours = fit_closed_curve(points, count=CURVE_CONTROLS)
        thesis = fit_closed_curve_thesis(points, CURVE_CONTROLS)
        title = f"{name}, {CURVE_CONTROLS} control points: condition"
        yield at_most(title, ours.condition, 10.0, ".3g")
        gap = ours.closure_gap / float(np.ptp(points))
        yield at_most(f"{name}: closure gap over its size", gap, 1e-15, ".3g")
        # The other shapes have finer features than 16 control points can follow.
        most = 0.2 if name.startswith("ellipse") else 0.5
        share = _error(ours, shape) / _error(thesis, shape)
        yield at_most(f"{name}: error over the thesis's", share, most, ".3g")
        through, floor = _error(fit_closed_curve(points), shape), _floor(shape)
        what = f"{name}, through all points: error over its size"
        yield Row(what, f"{through:.3g}", f"<= 0.001, floor {floor:.2g}", through <= 1e-3)
    yield at_most(
        "bean with 1 % noise: error over the noise", _noisy(4 if quick else 20), 0.55, ".3g"
    )
    yield from _times(5 if quick else 40)


def _error(curve: ClosedCurve, shape: CurveShape) -> float:
    """Hausdorff distance to the shape, over its size."""
    return _distance(curve.at(np.arange(FEW) / FEW), shape)


def _floor(shape: CurveShape) -> float:
    """The same between two samplings of the shape itself."""
    return _distance(shape(np.arange(FEW) / FEW), shape)


def _distance(found: Floats, shape: CurveShape) -> float:
    true = shape(np.arange(MANY) / MANY)
    there, back = (
        np.asarray(cKDTree(one).query(other)[0]) for one, other in ((true, found), (found, true))
    )
    return float(max(there.max(), back.max()) / np.ptp(true, axis=0).max())


def _noisy(curves: int) -> float:
    """Root mean square error of curves through noisy points, over the noise."""
    clean, true = (
        _bean(np.arange(CURVE_POINTS - 1) / (CURVE_POINTS - 1)),
        _bean(np.arange(20000) / 20000),
    )
    sigma = CURVE_NOISE * float(np.ptp(true, axis=0).max())
    tree, off = cKDTree(true), []
    for seed in range(curves):
        noise = sigma * np.random.default_rng(seed).normal(size=clean.shape)
        curve = fit_closed_curve(clean + noise)
        off.append(np.asarray(tree.query(curve.at(np.arange(500) / 500))[0]))
    return float(np.sqrt(np.mean(np.square(off)))) / sigma


def _times(repeat: int) -> Iterable[Row]:
    points = _bean(np.arange(CURVE_POINTS) / (CURVE_POINTS - 1))
    noisy = points + CURVE_NOISE * np.random.default_rng(0).normal(size=points.shape)
    ways: Mapping[str, Callable[[], ClosedCurve]] = {
        "through all points": lambda: fit_closed_curve(points),
        f"{CURVE_CONTROLS} control points": lambda: fit_closed_curve(points, count=CURVE_CONTROLS),
        "with noise": lambda: fit_closed_curve(noisy),
    }
    for name, way in ways.items():
        cost = 1e3 * best_seconds(way, repeat)
        yield at_most(f"{CURVE_POINTS} points, {name}: time", cost, 2.0, ".2f", " ms")


def _ellipse(turn: Floats) -> Floats:
    return np.column_stack([2.0 * np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])


def _superellipse(turn: Floats) -> Floats:
    c, s = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
    away = (np.abs(c) ** (2 / 0.3) + np.abs(s) ** (2 / 0.3)) ** -0.15
    return np.asarray(away[:, None] * np.column_stack([c, s]))


def _bean(turn: Floats) -> Floats:
    angle = 2 * np.pi * turn
    away = 1 + 0.35 * np.cos(2 * angle) + 0.1 * np.sin(3 * angle)
    return np.asarray(away[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


CLOSED_CURVES: Mapping[str, CurveShape] = {
    "ellipse 2:1": _ellipse,
    "superellipse e=0.3": _superellipse,
    "bean": _bean,
}
