"""What each way from a tactile frame to curvature is worth, and what it costs.

Fourteen estimators on the same frames; lengths are in pitches. The first estimator is the thesis's
own chain, the last what the filter and curvature nodes do.
"""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter

from palpate.bench.surfaces import SURFACES, WALKS, FusionScore, draw_touch, score_fusion
from palpate.bench.table import Row, at_least, at_most
from palpate.core import thesis, touch
from palpate.core.arrays import Bools, Floats

# Noise in pitches, and share of impulses.
COLUMNS = ((0.0, 0.0), (0.01, 0.0), (0.05, 0.0), (0.05, 0.02), (0.05, 0.08))
TRIALS, QUICK_TRIALS = 40, 6  # Frames of each shape and column
DRAWS, QUICK_DRAWS = 100, 15  # Random touches of each kind of surface
WALKED, QUICK_WALKED = 30, 3  # Walks over each surface
RADII = (8.0, 6.0, 4.0, 3.0, 2.0, 1.5)  # Of a contact, pitches
MOST_ERROR = {1: 0.5e-3, 4: 1.6e-3}  # By column: mean error of what palpate does, 1/pitch
LEAST_GAIN = 20.0  # Over the thesis's chain, in each column
MOST_PARTIAL = 0.05  # Share of the curvature that may be wrong with 32 touched taxels or more
LEAST_RIGHT = 0.95  # Share of each kind that must be called by its name
MOST_FUSED = 1.1  # Error of fused touches over that of single ones, on any surface
HEADS = ("0", ".01", ".05", "+2 %", "+8 %")  # Of the columns: noise in pitches, then impulses
VERDICTS: tuple[touch.PatchKind, ...] = ("smooth", "edge", "corner", "insufficient", "miss")
BALL = 20.0  # Radius of the ball that is touched in part, pitches
FUSED_NOISE = 20e-6  # m
PAD = touch.Pad(rows=16, cols=16, pitch=1.0, thickness=3.0, dome=0.0, saturation=0.8)
ALL: Bools = np.ones((16, 16), bool)
QUADRIC_REACH = 6.0  # Half the width of the window of a local quadric, pitches
SMOOTHING_REACH = 3.6  # The same of a Savitzky-Golay filter of 8 by 8 taxels
FLAGGED = 6.0  # Robust deviations from the median beyond which a taxel is flagged
LEAST_DEVIATION = 1e-3
# Principal curvatures, the larger first, 1/pitch, not numbers if none were found; and where, from
# the pad's middle, pitches.
Curvatures = tuple[float, float, tuple[float, float]]
Estimator = Callable[[Floats, float], Curvatures]  # Of a frame of heights and its noise, in pitches
HeightMap = Callable[[Floats, Floats], Floats]  # Heights at places x, y


def estimator_rows(trials: int, seed: int = 0) -> list[EstimatorErrors]:
    """The table of estimators, all on the same frames."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        rng = np.random.default_rng(seed)
        found = [_column(estimator, rng, column, trials) for column in range(len(COLUMNS))]
        errors, lost, costs = zip(*found, strict=True)
        rows.append(EstimatorErrors(name, errors, sum(lost), (costs[2], costs[4])))
    return rows


def _column(
    estimator: Estimator, rng: np.random.Generator, column: int, trials: int
) -> tuple[float, int, float]:
    """Mean error over the shapes, frames without an answer, and the median cost in us."""
    noise, impulses = COLUMNS[column]
    errors, costs, lost = [], [], 0
    for shape in PAD_SURFACES.values():
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
    rng: np.random.Generator, shape: HeightMap, noise: float, impulses: float, trials: int
) -> Iterator[Floats]:
    clean = shape(*PAD.grid())
    low, high = float(clean.min()) - 0.5, float(clean.max()) + 0.5
    for _ in range(1 if noise == 0.0 else trials):
        frame = clean + noise * rng.normal(size=clean.shape)
        hit, up = rng.random((2, *clean.shape))
        yield np.where(hit < impulses, np.where(up < 0.5, low, high), frame)


def _truth(shape: HeightMap, place: tuple[float, float]) -> tuple[float, float]:
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
    k1, k2, *_ = touch.principal_curvatures(touch.graph_shape_operator(slopes, seconds))
    return k1, k2


def partial_rows(trials: int, seed: int = 0) -> list[PartialContact]:
    """A ball whose contact does not fill the pad: what is not touched is not flat."""
    rng = np.random.default_rng(seed)
    x, y = PAD.grid()
    height = BALL - np.sqrt(BALL**2 - x**2 - y**2)
    rows = []
    for radius in RADII:
        rim = BALL - np.sqrt(BALL**2 - radius**2)
        touched = height < rim - 1e-12
        frames = np.minimum(height, rim) + 0.01 * rng.normal(size=(trials, *height.shape))
        ways = {"thesis's chain": THESIS, "unmasked quadric": "quadric, 12 x 12"}
        errors = {
            name: _share([ESTIMATORS[way](frame, 0.01)[:2] for frame in frames])
            for name, way in ways.items()
        }
        errors["palpate"] = _share([_masked(frame, touched) for frame in frames])
        rows.append(PartialContact(int(touched.sum()), errors))
    return rows


def _share(found: list[tuple[float, float] | None]) -> float | None:
    if None in found:
        return None
    return float(np.sqrt(np.mean((np.array(found) * BALL - 1.0) ** 2)))


def _masked(frame: Floats, touched: Bools) -> tuple[float, float] | None:
    patch = touch.fit_patch(PAD, frame, touched, np.array([0.0, 1.0, 0.0]), 0.01)
    return patch.principal if patch.kind == "smooth" else None


def curvature_rows(quick: bool) -> Iterator[Row | str]:
    """Four tables of what the ways to curvature are worth, and the demands that are missed."""
    trials = QUICK_TRIALS if quick else TRIALS
    rows = estimator_rows(trials)
    partial = partial_rows(trials)
    calls, borderline = confusion(QUICK_DRAWS if quick else DRAWS, seed=2)
    walked = QUICK_WALKED if quick else WALKED
    scores = {name: score_fusion(name, FUSED_NOISE, walked) for name in WALKS}
    yield from _tables(rows, partial, calls, borderline, scores)
    demands = (*estimator_demands(rows, partial), *verdict_demands(calls), *fusion_demands(scores))
    yield from demands


def confusion(
    draws: int, seed: int
) -> tuple[Counter[tuple[touch.PatchKind, touch.PatchKind]], int]:
    """How often each kind is called what, and how many draws were borderline cases."""
    rng = np.random.default_rng(seed)
    calls: Counter[tuple[touch.PatchKind, touch.PatchKind]] = Counter()
    borderline = 0
    for name in SURFACES:
        for _ in range(draws):
            known = draw_touch(rng, name)
            if known is None:
                borderline += 1
                continue
            across = np.array([0.0, 1.0, 0.0])
            patch = touch.fit_patch(known.pad, known.height, known.touched, across, known.noise)
            calls[known.kind, patch.kind] += 1
    return calls, borderline


def _tables(
    rows: list[EstimatorErrors],
    partial: list[PartialContact],
    calls: Counter[tuple[touch.PatchKind, touch.PatchKind]],
    borderline: int,
    scores: Mapping[str, FusionScore],
) -> Iterator[str]:
    """Estimators, partial contact, the confusion matrix, and fusion; a blank line after each."""
    yield "error of k1 and k2, 1e-3/pitch, mean of six shapes; noise in pitches, then impulses"
    yield f"{'':<34}{_cells(8, HEADS)}  lost   us/frame  impulses  cost"
    for row in rows:
        errors = "".join(f"{1e3 * error:8.2f}" for error in row.errors)
        plain, impulses = row.micros
        costs = f"{plain:11.0f}{impulses:10.0f}{plain / rows[0].micros[0]:6.2f}"
        yield f"{row.name:<34}{errors}{row.lost:6d}{costs}"
    yield ""
    yield f"a ball of radius {BALL:.0f} pitches that touches a part of the pad: error of k1 and k2"
    yield f"taxels{_cells(20, partial[0].errors)}"
    for some in partial:
        told = ("insufficient" if one is None else f"{one:.1%}" for one in some.errors.values())
        yield f"{some.taxels:6d}{_cells(20, told)}"
    yield ""
    yield (
        f"verdicts: rows are what is touched, columns what it is called; {borderline} draws "
        "left out as borderline cases"
    )
    yield f"{'':<14}{_cells(14, VERDICTS)}   right"
    for kind in VERDICTS:
        called = _cells(14, (calls[kind, one] for one in VERDICTS))
        yield f"{kind:<14}{called}{right_share(calls, kind):8.1%}"
    yield ""
    yield (
        f"error of k1 and k2, 1/m, with {1e6 * FUSED_NOISE:.0f} um of noise; squared innovation "
        "should be 3"
    )
    yield f"{'':<14}{'one touch':>12}{'fused':>10}{'ratio':>8}{'innovation':>12}"
    for name, (single, fused, surprise) in scores.items():
        yield f"{name:<14}{single:12.2f}{fused:10.2f}{fused / single:8.2f}{surprise:12.1f}"
    yield ""


def _cells(width: int, values: Iterable[object]) -> str:
    return "".join(f"{value:>{width}}" for value in values)


def estimator_demands(rows: list[EstimatorErrors], partial: list[PartialContact]) -> Iterator[Row]:
    """What palpate does, against what is demanded of it and against the thesis's chain."""
    by_name = {row.name: row.errors for row in rows}
    ours, thesis = by_name[OURS], by_name[THESIS]
    for column, most in MOST_ERROR.items():
        (noise, impulses), error = COLUMNS[column], ours[column]
        name = f"error of curvatures, noise {noise:g}, impulses {impulses:.0%}"
        yield Row(name, f"{1e3 * error:.2f}e-3", f"<= {1e3 * most:.1f}e-3 /pitch", error <= most)
    gain = min(theirs / mine for theirs, mine in zip(thesis, ours, strict=True))
    yield at_least("error of the thesis's chain to ours, at least", gain, LEAST_GAIN, ".0f")
    worst = max(row.errors["palpate"] or np.inf for row in partial if row.taxels >= 32)
    yield Row("the same, 32 taxels or more touched", f"{worst:.1%}", "< 5 %", worst < MOST_PARTIAL)


def verdict_demands(calls: Counter[tuple[touch.PatchKind, touch.PatchKind]]) -> Iterator[Row]:
    """How often each kind is called by its name."""
    for kind in VERDICTS:
        yield at_least(f"{kind}: called by its name", right_share(calls, kind), LEAST_RIGHT, ".1%")


def fusion_demands(scores: Mapping[str, FusionScore]) -> Iterator[Row]:
    """Errors of fused touches over those of single ones."""
    for name, score in scores.items():
        yield at_most(f"{name}: fused over single", score.fused / score.single, MOST_FUSED)


def right_share(
    calls: Counter[tuple[touch.PatchKind, touch.PatchKind]], kind: touch.PatchKind
) -> float:
    """Share of a kind that was called by its name."""
    return calls[kind, kind] / max(sum(calls[kind, called] for called in VERDICTS), 1)


class EstimatorErrors(NamedTuple):
    """One estimator."""

    name: str  # What it does
    errors: tuple[float, ...]  # Rms error of k1 and k2, mean over the shapes, by column; 1/pitch
    lost: int  # Frames for which it gave no number
    micros: tuple[float, float]  # Cost of a frame with noise, and of one with impulses, us


class PartialContact(NamedTuple):
    """A ball that touches only the middle of the pad."""

    taxels: int  # How many it touches
    errors: Mapping[str, float | None]  # Rms error over the curvature, by method; None if unknown


def noise_variance(frame: Floats) -> float:
    """Mean of the variances around each taxel: what a Wiener filter that knows no noise takes."""
    return float(touch.neighbourhoods(frame).var(axis=-1).mean())


def _curvatures(derivatives: Floats) -> Curvatures:
    p, q, r, s, t = derivatives.tolist()
    k1, k2, *_ = touch.principal_curvatures(touch.graph_shape_operator((p, q), (r, s, t)))
    return k1, k2, (0.0, 0.0)


def _spline(frame: Floats) -> Curvatures:
    return _curvatures(thesis.fit_bspline(PAD, frame, ALL, 0.0).derivatives)


def _smoothed(frame: Floats, noise: float) -> Curvatures:
    """A bicubic spline whose sum of squared misfits is as large as the noise explains.

    FITPACK gives up where that is far below what the frame holds; then it passes through all.
    """
    x, y = PAD.grid()
    surface = partial(RectBivariateSpline, y[:, 0], x[0], frame)
    try:
        spline = surface(s=frame.size * noise**2)
    except ValueError:  # "the maximal number of iterations ... has been reached"
        spline = surface(s=0.0)
    orders = ((0, 1), (1, 0), (0, 2), (1, 1), (2, 0))
    return _curvatures(np.array([spline([0.0], [0.0], *order)[0, 0] for order in orders]))


@cache
def _window(reach: float, degree: int) -> tuple[Bools, Floats]:
    """A square window, and what gives the derivatives at the pad's middle from its taxels."""
    x, y = PAD.grid()
    inside = (np.abs(x) < reach) & (np.abs(y) < reach)
    solve = np.linalg.pinv(touch.monomials(x[inside], y[inside], degree))
    return inside, solve[1:6] * np.array([1.0, 1.0, 2.0, 1.0, 2.0])[:, None]


def _polynomial(frame: Floats, reach: float = QUADRIC_REACH, degree: int = 2) -> Curvatures:
    inside, solve = _window(reach, degree)
    return _curvatures(solve @ frame[inside])


def _gaussian(frame: Floats) -> Curvatures:
    """Derivatives of the frame smoothed by a Gaussian of two pitches."""
    orders = ((0, 1), (1, 0), (0, 2), (1, 1), (2, 0))
    smooth = partial(gaussian_filter, frame, 2.0, mode="nearest")
    return _curvatures(np.array([smooth(order=order)[7:9, 7:9].mean() for order in orders]))


def _flagged(frame: Floats) -> Curvatures:
    """Quartic on what does not stand off its neighbourhood's median."""
    off = np.abs(frame - touch.median_filter(frame))
    good = off <= FLAGGED * 1.4826 * float(np.median(off)) + 1e-12
    fit = touch.fit_jet(PAD, frame, good)
    if fit is None or fit.jet.degree < 2:
        return np.nan, np.nan, (0.0, 0.0)
    k1, k2, *_ = _curvatures(fit.derivatives)
    return k1, k2, fit.middle[:2]


def _quartic(frame: Floats, noise: float | None = None) -> Curvatures:
    """Over the whole pad; robust if a noise is told."""
    if noise is None:
        fit = touch.fit_jet(PAD, frame, ALL)
    else:
        fit = touch.fit_robust_jet(PAD, frame, ALL, max(noise, LEAST_DEVIATION))
    assert fit is not None
    return _curvatures(fit.derivatives)


def _ours(frame: Floats, noise: float) -> Curvatures:
    """What the filter and curvature nodes do: mend the frame, leave impulses out of the fit."""
    lift = float(frame.max()) + 1.0  # so that every taxel is touched
    clean = touch.remove_impulses(PAD, lift - frame, 0.05, noise)
    patch = touch.fit_patch(PAD, frame, ~clean.impulses, np.array([0.0, 1.0, 0.0]), noise)
    x, y, _ = patch.place.tolist()
    if patch.kind != "smooth":
        return np.nan, np.nan, (x, y)
    return *patch.principal, (x, y)


def _wiener_median(frame: Floats) -> Floats:
    return touch.wiener_then_median(frame, noise_variance(frame))


def _median_wiener(frame: Floats) -> Floats:
    return touch.median_then_wiener(frame, noise_variance(touch.median_filter(frame)))


# By name; the first is the thesis's own chain.
ESTIMATORS: Mapping[str, Estimator] = {
    "thesis: Wiener, median, B-spline": lambda f, s: _spline(_wiener_median(f)),
    "median, Wiener, B-spline": lambda f, s: _spline(_median_wiener(f)),
    "interpolating B-spline": lambda f, s: _spline(f),
    "smoothing B-spline": _smoothed,
    "quadric, 12 x 12": lambda f, s: _polynomial(f),
    "quartic, full pad": lambda f, s: _quartic(f),
    "Gaussian derivative": lambda f, s: _gaussian(f),
    "Savitzky-Golay, 8 x 8 cubic": lambda f, s: _polynomial(f, SMOOTHING_REACH, 3),
    "median, quadric": lambda f, s: _polynomial(touch.median_filter(f)),
    "Wiener, median, quadric": lambda f, s: _polynomial(_wiener_median(f)),
    "median, Wiener, quadric": lambda f, s: _polynomial(_median_wiener(f)),
    "flag, quartic on the rest": lambda f, s: _flagged(f),
    "robust quartic": _quartic,
    "palpate: filter and curvature": _ours,
}
THESIS, OURS = next(iter(ESTIMATORS)), list(ESTIMATORS)[-1]
# Surfaces over the pad, all lengths in pitches.
PAD_SURFACES: Mapping[str, HeightMap] = {
    "sphere of 20": lambda x, y: 20 - np.sqrt(400 - x * x - y * y),
    "sphere of 60": lambda x, y: 60 - np.sqrt(3600 - x * x - y * y),
    "cylinder of 15": lambda x, y: 15 - np.sqrt(225 - (0.6 * x + 0.8 * y) ** 2),
    "saddle": lambda x, y: (x * x - y * y) / 60,
    "tilted plane": lambda x, y: 0.2 * x - 0.1 * y,
    "wavy": lambda x, y: x * x / 50 + y * y / 80 + 3e-4 * x**3 - 4e-5 * x**4,
}
