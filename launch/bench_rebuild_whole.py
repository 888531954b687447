"""Whole solids from contours, measured: what disorder and stray points do, and what all costs."""

from __future__ import annotations

import time
import timeit
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.lattice.lattice_fit import fit_lattice
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.solid import Method
from palpate.launch.bench_rebuild_peers import NOISE, felt_contours, rebuilt
from palpate.launch.bench_row import Row
from palpate.launch.one_thread import one_thread
from palpate.launch.rebuild_shapes import SHAPES, RebuiltShape, truth_of

SIZE, LARGE = (27, 81), (108, 162)
"""Contours, and points of each; the larger has eight times as many points."""
HUGE, CONTROL = (200, 400), 40
"""Contours and points, and control points each way, of the largest lattice."""
COUNTS = 0.25
"""By which the number of points differs from contour to contour."""
STRAY, OFF = 0.02, 3.0
"""Share of the points that are off, and by how much, mm."""
ROUNDS = 5
FIT_MS, UPDATE_MS, BAND_MS, LATTICE_S = 30.0, 10.0, 10.0, 1.0

Disorder = Callable[[RebuiltShape, Floats, np.random.Generator], Sequence[Floats]]


def whole_rows(quick: bool) -> Iterable[Row]:
    """Figures of whole solids.

    Parameters
    ----------
    quick : bool
        Without meaning here: all of it is quick.
    """
    with one_thread():
        yield from _disorders()
        yield from _times()


def _disorders() -> Iterable[Row]:
    for name, disorder, most in (
        ("random starts, directions and counts", shuffled, 1.03),
        (f"{STRAY:.0%} of points off by {OFF:g} mm", strayed, 1.1),
    ):
        ratio = ratio_of(disorder)
        told = f"{SIZE[0]} by {SIZE[1]}, {NOISE} mm: {name}, error over that without"
        yield Row(told, f"{ratio:.3f} x", f"<= {most:g} x", ratio <= most)


def ratio_of(disorder: Disorder, shapes: Mapping[str, RebuiltShape] = SHAPES) -> float:
    """Mean error over objects from disordered contours, over that from plain ones.

    The ends are touched, lest what nobody can know of them hides the rest.
    """
    plain, other = 0.0, 0.0
    for name, shape in shapes.items():
        tops = np.array([[0.0, 0.0, shape.low], [0.0, 0.0, shape.high]])
        contours = felt_contours(shape, SIZE, NOISE, np.random.default_rng(0))
        changed = disorder(shape, contours, np.random.default_rng(1))
        plain += truth_of(name).errors_of(rebuilt(list(contours), tops)).chamfer
        other += truth_of(name).errors_of(rebuilt(changed, tops)).chamfer
    return other / plain


def shuffled(shape: RebuiltShape, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """Other contours at the same heights: each begun anywhere, of any direction and count."""
    found = []
    for level in contours[..., 2].mean(axis=1):
        count = round(contours.shape[1] * rng.uniform(1.0 - COUNTS, 1.0 + COUNTS))
        exact = shape.contours(np.array([level]), count, rng.random())[0]
        noisy = exact + NOISE * rng.normal(size=exact.shape)
        found.append(noisy[::-1] if rng.random() < 0.5 else noisy)
    return [found[i] for i in rng.permutation(len(found))]


def strayed(shape: RebuiltShape, contours: Floats, rng: np.random.Generator) -> list[Floats]:
    """The same contours with some points off, outwards or inwards."""
    changed = contours.copy()
    wrong = rng.random(contours.shape[:2]) < STRAY
    away = contours - contours.mean(axis=1, keepdims=True)
    away[..., 2] = 0.0
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    changed[wrong] += OFF * rng.choice([-1.0, 1.0], (int(wrong.sum()), 1)) * away[wrong]
    return list(changed)


def _times() -> Iterable[Row]:
    shape = SHAPES["lobed zig-zag"]
    contours = list(felt_contours(shape, SIZE, NOISE, np.random.default_rng(0)))
    head = f"{SIZE[0]} by {SIZE[1]}"
    for method in ("skin", "lattice"):
        yield _time(f"{head}: whole fit, method {method}", _fit(contours, method), FIT_MS)
    solid = reconstruct([*contours[:13], *contours[14:]])
    yield _time(f"{head}: one contour more", lambda: solid.update(contours[13]), UPDATE_MS)
    closed = solid.closed
    assert closed is not None
    heights = np.linspace(-49.0, 49.0, 241)
    turns = np.arange(97) / 97
    yield _time(f"{head}: band", lambda: closed.skin.deviation(heights, turns), BAND_MS)
    large = list(felt_contours(shape, LARGE, NOISE, np.random.default_rng(0)))
    ratio = _least(_fit(large, "skin"), 2) / _least(_fit(contours, "skin"))
    most = LARGE[0] * LARGE[1] / (SIZE[0] * SIZE[1])
    yield Row(
        f"{LARGE[0]} by {LARGE[1]} over {head}: time",
        f"{ratio:.1f} x",
        f"<= {most:.1f} x",
        ratio <= most,
    )
    yield _largest(shape)


def _largest(shape: RebuiltShape) -> Row:
    contours = list(felt_contours(shape, HUGE, 0.0, np.random.default_rng(0)))
    closed = reconstruct(contours, method="skin").closed
    assert closed is not None
    surface = closed.skin.surface
    seconds = _least(lambda: fit_lattice(surface, size=(CONTROL, CONTROL)), 2)
    name = f"{HUGE[0]} by {HUGE[1]}: lattice of {CONTROL} x {CONTROL} x {CONTROL}"
    return Row(name, f"{seconds:.2f} s", f"<= {LATTICE_S:g} s", seconds <= LATTICE_S)


def _fit(contours: list[Floats], method: str) -> Callable[[], object]:
    way: Method = "skin" if method == "skin" else "lattice"
    return lambda: reconstruct(contours, method=way)


def _least(call: Callable[[], object], rounds: int = ROUNDS) -> float:
    """Processor time of the best of some calls, s: what others do meanwhile is not counted."""
    return min(timeit.repeat(call, timer=time.process_time, number=1, repeat=rounds))


def _time(name: str, call: Callable[[], object], most: float) -> Row:
    milliseconds = 1e3 * _least(call)
    return Row(f"{name}, ms", f"{milliseconds:.1f}", f"<= {most:g}", milliseconds <= most)
