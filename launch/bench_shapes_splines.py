"""Point inversion, measured: every way to do it, against a loop over points and the thesis's."""

from __future__ import annotations

import timeit
from collections.abc import Callable, Iterable

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.folds import fold_report
from palpate.core.splines.frame import Bases, upright_frame
from palpate.core.splines.inversion import Inversion
from palpate.core.splines.invert import invert
from palpate.core.splines.lattice import Lattice
from palpate.core.splines.volume import Volume
from palpate.launch.bench_row import Row

POINTS = 10_000
LOOPED, QUICK_LOOPED = 200, 40
"""Points that are inverted one at a time."""
REGULAR, DEFORMED = (5, 5, 27), (7, 7, 9)
"""Control points of the lattices, all cubic."""
FRAME = upright_frame(np.full(3, -1.0), np.full(3, 2.0))
NOISES = ((0.05, 4, "sound"), (0.85, 9, "folded"))
"""Spread of the control points, in quarters of the size; seeds; whether the lattice folds."""
EPSILON = float(np.finfo(float).eps) * 2.0
"""Of the size."""
ROUNDS = 7


def spline_rows(quick: bool) -> Iterable[Row]:
    """Figures of point inversion and of the search for folds.

    Parameters
    ----------
    quick : bool
        Fewer points one at a time.
    """
    looped = QUICK_LOOPED if quick else LOOPED
    yield from _undeformed_rows(looped)
    for noise, seed, verdict in NOISES:
        yield from _deformed_rows(_disturbed(noise, seed), verdict, looped)


def _undeformed_rows(looped: int) -> Iterable[Row]:
    bases, points = _bases(REGULAR), FRAME.points(_places())
    greville = Volume(FRAME.greville_control(bases), bases)
    found = invert(greville, points)
    off = np.abs(greville.at(found.parameters) - points).max() / EPSILON
    closed = _seconds(lambda: FRAME.local(points))
    yield Row("greville lattice: residual", f"{off:.1f} eps", "<= 8 eps", bool(off <= 8))
    yield _time("greville lattice: parameters in closed form", closed, 0.1)
    even = Volume(FRAME.even_control(REGULAR), bases)
    found = invert(even, points)
    off = np.abs(even.at(found.parameters) - points).max() / EPSILON
    regular = _seconds(lambda: invert(even, points))
    yield Row("regular lattice: residual", f"{off:.1f} eps", "<= 8 eps", bool(off <= 8))
    yield _time("regular lattice: inverted axis by axis", regular, 20.0)
    loop = _loop(even, points[:looped])
    yield _ratio("closed form against a loop over points", loop / closed, 1000)
    yield _ratio("axis by axis against a loop over points", loop / regular, 1000)


def _deformed_rows(volume: Volume, verdict: str, looped: int) -> Iterable[Row]:
    points, slopes = volume.first(_places())
    folded = float((np.linalg.det(slopes) <= 0.0).mean())
    name = f"deformed lattice, {folded:.0%} folded"
    report = fold_report(Lattice(volume, FRAME))
    yield Row(f"{name}: proved", report.verdict, verdict, report.verdict == verdict)
    most = 0.0 if verdict == "sound" else 0.01
    ours = _seconds(lambda: invert(volume, points), rounds=1)
    yield _failures(f"{name}: points not inverted", invert(volume, points), most)
    thesis = invert(volume, points, method="thesis")
    failed = float((~thesis.converged).mean())
    yield Row(f"{name}: not inverted by the thesis", f"{failed:.2%}", "for comparison", True)
    loop = _loop(volume, points[:looped])
    yield _ratio(f"{name}: against a loop over points", loop / ours, 50)
    if verdict == "sound":
        weights = np.random.default_rng(0).uniform(0.7, 1.4, DEFORMED)
        rational = Volume(volume.control, volume.bases, weights)
        found = invert(rational, rational.at(_places()))
        yield _failures("the same with weights: points not inverted", found, 0.0)


def _bases(counts: tuple[int, int, int]) -> Bases:
    s, t, u = (clamped_basis(count) for count in counts)
    return s, t, u


def _disturbed(noise: float, seed: int) -> Volume:
    bases = _bases(DEFORMED)
    control = FRAME.greville_control(bases)
    rng = np.random.default_rng(seed)
    return Volume(control + 0.5 * noise * rng.normal(size=control.shape), bases)


def _places() -> Floats:
    return np.random.default_rng(0).random((POINTS, 3))


def _seconds(call: Callable[[], object], rounds: int = ROUNDS) -> float:
    """The best of some rounds: what a busy computer adds is not the method's."""
    return min(timeit.repeat(call, number=1, repeat=rounds))


def _loop(volume: Volume, points: Floats) -> float:
    """Seconds for all points one at a time, of which some are: by the same least squares."""
    seconds = _seconds(
        lambda: [invert(volume, point[None], method="general") for point in points], rounds=1
    )
    return seconds * POINTS / len(points)


def _time(name: str, seconds: float, most: float) -> Row:
    milliseconds = 1e3 * seconds
    target = f"< {most:g} ms for 10,000"
    return Row(name, f"{milliseconds:.3f} ms", target, milliseconds < most)


def _ratio(name: str, ratio: float, least: float) -> Row:
    return Row(name, f"{ratio:,.0f} x", f">= {least:,.0f} x", ratio >= least)


def _failures(name: str, found: Inversion, most: float) -> Row:
    failed = float((~found.converged).mean())
    return Row(name, f"{failed:.2%}", f"<= {most:.0%}", failed <= most)
