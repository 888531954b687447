"""What each way from a tactile frame to curvature is worth, and what it costs."""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.curvature import Kind, feel_patch
from palpate.core.touch.forms import graph_shape, principal
from palpate.launch.bench_fusion import WALKS, Score, score_fusion
from palpate.launch.bench_patches import SURFACES, draw_touch
from palpate.launch.curvature_rows import ESTIMATORS, PAD, SHAPES, Estimator
from palpate.launch.curvature_tables import (
    BALL,
    FUSED_NOISE,
    HEADS,
    KINDS,
    Partial,
    Row,
    estimator_table,
    fusion_table,
    partial_table,
    right_share,
    verdict_table,
)

Echo = Callable[[str], None]

THESIS, OURS = next(iter(ESTIMATORS)), list(ESTIMATORS)[-1]
COLUMNS = ((0.0, 0.0), (0.01, 0.0), (0.05, 0.0), (0.05, 0.02), (0.05, 0.08))
"""Noise in pitches, and share of impulses."""
TRIALS, QUICK_TRIALS = 40, 6
"""Frames of each shape and column."""
DRAWS, QUICK_DRAWS = 100, 15
"""Random touches of each kind of surface."""
WALKED, QUICK_WALKED = 30, 3
"""Walks over each surface."""
RADII = (8.0, 6.0, 4.0, 3.0, 2.0, 1.5)
"""Of a contact, pitches."""
MOST_ERROR = {1: 0.5e-3, 4: 1.6e-3}
"""By column: mean error of what palpate does, 1/pitch."""
LEAST_GAIN = 20.0
"""Over the thesis's chain, in each column."""
MOST_PARTIAL = 0.05
"""Share of the curvature that may be wrong with 32 touched taxels or more."""
LEAST_RIGHT = 0.95
"""Share of each kind that must be called by its name."""
MOST_FUSED = 1.1
"""Error of fused touches over that of single ones, on any surface."""


def estimator_rows(trials: int, seed: int = 0) -> list[Row]:
    """The table of estimators, all on the same frames."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        rng = np.random.default_rng(seed)
        found = [_column(estimator, rng, column, trials) for column in range(len(COLUMNS))]
        rows.append(
            Row(
                name,
                tuple(error for error, _, _ in found),
                sum(lost for _, lost, _ in found),
                (found[2][2], found[4][2]),
            )
        )
    return rows


def _column(
    estimator: Estimator, rng: np.random.Generator, column: int, trials: int
) -> tuple[float, int, float]:
    """Mean error over the shapes, frames without an answer, and the median cost in us."""
    noise, impulses = COLUMNS[column]
    errors, costs, lost = [], [], 0
    for shape in SHAPES.values():
        squares = []
        for frame in _frames(rng, shape, noise, impulses, trials):
            began = time.perf_counter()
            k1, k2, place = estimator(frame, noise)
            costs.append(1e6 * (time.perf_counter() - began))
            if not np.isfinite(k1):
                lost += 1
                continue
            wanted = _truth(shape, place)
            squares.append(((k1 - wanted[0]) ** 2 + (k2 - wanted[1]) ** 2) / 2.0)
        errors.append(float(np.sqrt(np.mean(squares))) if squares else np.nan)
    return float(np.mean(errors)), lost, statistics.median(costs)


def _frames(
    rng: np.random.Generator,
    shape: Callable[[Floats, Floats], Floats],
    noise: float,
    impulses: float,
    trials: int,
) -> Iterator[Floats]:
    clean = shape(*PAD.grid())
    low, high = float(clean.min()) - 0.5, float(clean.max()) + 0.5
    for _ in range(1 if noise == 0.0 else trials):
        frame = clean + noise * rng.normal(size=clean.shape)
        hit, up = rng.random((2, *clean.shape))
        yield np.where(hit < impulses, np.where(up < 0.5, low, high), frame)


def _truth(
    shape: Callable[[Floats, Floats], Floats], place: tuple[float, float]
) -> tuple[float, float]:
    """Principal curvatures by differences over a thousandth of a pitch."""
    h = 1e-3
    x, y = (np.array(at) for at in place)
    z = {(i, j): float(shape(x + i * h, y + j * h)) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    slopes = (z[1, 0] - z[-1, 0]) / (2 * h), (z[0, 1] - z[0, -1]) / (2 * h)
    seconds = (
        (z[1, 0] - 2 * z[0, 0] + z[-1, 0]) / h**2,
        (z[1, 1] - z[-1, 1] - z[1, -1] + z[-1, -1]) / (4 * h**2),
        (z[0, 1] - 2 * z[0, 0] + z[0, -1]) / h**2,
    )
    k1, k2, *_ = principal(graph_shape(slopes, seconds))
    return k1, k2


def partial_rows(trials: int, seed: int = 0) -> list[Partial]:
    """A ball whose contact does not fill the pad: what is not touched is not flat."""
    rng = np.random.default_rng(seed)
    x, y = PAD.grid()
    height = BALL - np.sqrt(BALL**2 - x**2 - y**2)
    rows = []
    for radius in RADII:
        rim = BALL - np.sqrt(BALL**2 - radius**2)
        touched = height < rim - 1e-12
        frames = np.minimum(height, rim) + 0.01 * rng.normal(size=(trials, *height.shape))
        errors = {
            "thesis's chain": _share([ESTIMATORS[THESIS](frame, 0.01)[:2] for frame in frames]),
            "unmasked quadric": _share(
                [ESTIMATORS["quadric, 12 x 12"](frame, 0.01)[:2] for frame in frames]
            ),
            "palpate": _share([_masked(frame, touched) for frame in frames]),
        }
        rows.append(Partial(int(touched.sum()), errors))
    return rows


def _masked(frame: Floats, touched: Bools) -> tuple[float, float] | None:
    patch = feel_patch(PAD, frame, touched, np.array([0.0, 1.0, 0.0]), 0.01)
    return patch.principal if patch.kind == "smooth" else None


def _share(found: list[tuple[float, float] | None]) -> float | None:
    known = [pair for pair in found if pair is not None]
    if len(known) < len(found):
        return None
    return float(np.sqrt(np.mean((np.array(known) * BALL - 1.0) ** 2)))


def confusion(draws: int, seed: int) -> tuple[Counter[tuple[Kind, Kind]], int]:
    """How often each kind is called what, and how many draws were borderline cases."""
    rng = np.random.default_rng(seed)
    calls: Counter[tuple[Kind, Kind]] = Counter()
    borderline = 0
    for name in SURFACES:
        for _ in range(draws):
            touch = draw_touch(rng, name)
            if touch is None:
                borderline += 1
                continue
            across = np.array([0.0, 1.0, 0.0])
            patch = feel_patch(touch.pad, touch.height, touch.touched, across, touch.noise)
            calls[touch.kind, patch.kind] += 1
    return calls, borderline


def bench_curvature(quick: bool = False, echo: Echo = print) -> int:
    """Print what the ways to curvature are worth; 0 if every demand is met, else 1."""
    trials = QUICK_TRIALS if quick else TRIALS
    rows = estimator_rows(trials)
    partial = partial_rows(trials)
    calls, borderline = confusion(QUICK_DRAWS if quick else DRAWS, seed=2)
    walked = QUICK_WALKED if quick else WALKED
    scores = {name: score_fusion(name, FUSED_NOISE, walked) for name in WALKS}
    for table in (
        estimator_table(rows),
        partial_table(partial),
        verdict_table(calls, borderline),
        fusion_table(scores),
    ):
        for line in table:
            echo(line)
        echo("")
    missed = missed_demands(rows, partial, calls, scores)
    for demand in missed:
        echo(f"MISSED {demand}")
    return int(bool(missed))


def missed_demands(
    rows: list[Row],
    partial: list[Partial],
    calls: Counter[tuple[Kind, Kind]],
    scores: Mapping[str, Score],
) -> list[str]:
    """Demands that are not met, in words."""
    by_name = {row.name: row for row in rows}
    ours, thesis = by_name[OURS], by_name[THESIS]
    missed = [
        f"{HEADS[column]}: {1e3 * ours.errors[column]:.2f}e-3 is more than {1e3 * most}e-3"
        for column, most in MOST_ERROR.items()
        if not ours.errors[column] <= most
    ]
    missed += [
        f"{head}: less than {LEAST_GAIN:.0f} times better than the thesis's chain"
        for head, mine, theirs in zip(HEADS, ours.errors, thesis.errors, strict=True)
        if not mine * LEAST_GAIN <= theirs
    ]
    missed += [
        f"{row.taxels} taxels: curvature wrong by more than {MOST_PARTIAL:.0%}"
        for row in partial
        if row.taxels >= 32 and not (row.errors["palpate"] or np.inf) < MOST_PARTIAL
    ]
    missed += [
        f"{kind}: {right_share(calls, kind):.1%} called by its name"
        for kind in KINDS
        if right_share(calls, kind) < LEAST_RIGHT
    ]
    missed += [
        f"{name}: fused is worse than single"
        for name, score in scores.items()
        if not score.fused <= MOST_FUSED * score.single
    ]
    return missed
