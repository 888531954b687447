"""Accuracy and cost of fourteen estimators of curvature, on the same tactile frames.

Lengths are in pitches. The first estimator is the chain of the thesis, the last that of the filter
and curvature nodes.
"""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter

from palpate.bench.surfaces import SURFACES, WALKS, FusionScore, draw_touch, score_fusion
from palpate.bench.table import Row, at_least, at_most
from palpate.core import thesis, touch
from palpate.core.arrays import Bools, Floats

HEADS = ("0", ".01", ".05", "+2 %", "+8 %")  # Of the columns: noise in pitches, then impulses
VERDICTS: tuple[touch.PatchKind, ...] = ("smooth", "edge", "corner", "insufficient", "miss")
PAD = touch.Pad(rows=16, cols=16, pitch=1.0, thickness=3.0, dome=0.0, saturation=0.8)
ALL_TAXELS: Bools = np.ones((PAD.rows, PAD.cols), bool)
ACROSS = (0.0, 1.0, 0.0)  # Direction along the pad in which a contour is followed
# Principal curvatures, the larger first [1/pitch], NaN without an answer; and the point [pitch]
# from the centre of the pad at which they hold.
Curvatures = tuple[float, float, tuple[float, float]]
Estimator = Callable[[Floats, float], Curvatures]  # From a frame of heights and its noise [pitch]
HeightMap = Callable[[Floats, Floats], Floats]  # Heights at points x, y


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSettings:
    """Frames on which estimators are compared."""

    # Standard deviation of the noise [pitch], and fraction of taxels with impulses.
    columns: tuple[tuple[float, float], ...] = (
        *((0.0, 0.0), (0.01, 0.0), (0.05, 0.0), (0.05, 0.02), (0.05, 0.08)),
    )
    n_frames: int = 40  # of each surface and column
    ball_radius: float = 20.0  # [pitch] of the ball in the table of partial contact
    contact_radii: tuple[float, ...] = (8.0, 6.0, 4.0, 3.0, 2.0, 1.5)  # [pitch] of its contact
    contact_noise: float = 0.01  # [pitch] standard deviation of a taxel there
    n_draws: int = 100  # touches of each kind of surface, in the table of kinds
    n_walks: int = 30  # over each surface, in the table of fusion
    fused_noise: float = 20e-6  # [m] standard deviation of a taxel there


@dataclass(frozen=True, slots=True, kw_only=True)
class CurvatureDemands:
    """What is demanded of palpate."""

    max_error: float = 0.5e-3  # [1/pitch] of curvatures with little noise (column 1)
    max_impulse_error: float = 1.6e-3  # [1/pitch] with noise and impulses (column 4)
    min_gain: float = 20.0  # error of the thesis's chain / palpate's, in each column
    max_partial_error: float = 0.05  # relative, of a partial contact with 32 touched taxels or more
    min_right: float = 0.95  # share of each kind that is called by its name
    max_fused: float = 1.1  # error of fused touches / of single ones, on any surface


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorSettings:
    """Tuned numbers of the other estimators."""

    quadric_reach: float = 6.0  # [pitch] half width of the window of a local quadric
    cubic_reach: float = 3.6  # [pitch] the same of a Savitzky-Golay filter of 8 by 8 taxels
    gaussian_width: float = 2.0  # [pitch] standard deviation of the smoothing Gaussian
    max_deviation: float = 6.0  # [robust sigmas] from the local median; beyond it an impulse
    min_noise: float = 1e-3  # [pitch] that the robust fit assumes at least


DEFAULT_FRAMES = FrameSettings()
QUICK_FRAMES = FrameSettings(n_frames=6, n_draws=15, n_walks=3)
DEMANDS = CurvatureDemands()
ESTIMATION = EstimatorSettings()


def estimator_rows(
    settings: FrameSettings = DEFAULT_FRAMES, seed: int = 0
) -> list[EstimatorErrors]:
    """The table of estimators, all on the same frames."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        rng = np.random.default_rng(seed)
        columns = [_column(estimator, rng, *column, settings) for column in settings.columns]
        errors, lost, costs = zip(*columns, strict=True)
        rows.append(EstimatorErrors(name, errors, sum(lost), (costs[2], costs[4])))
    return rows


def _column(
    estimator: Estimator,
    rng: np.random.Generator,
    noise: float,
    impulses: float,
    settings: FrameSettings,
) -> tuple[float, int, float]:
    """Mean error over the surfaces, number of frames without an answer, and median cost [us]."""
    errors, costs, lost = [], [], 0
    for surface in PAD_SURFACES.values():
        squares = []
        for frame in _frames(rng, surface, noise, impulses, settings.n_frames):
            start = time.perf_counter()
            k1, k2, place = estimator(frame, noise)
            costs.append(1e6 * (time.perf_counter() - start))
            if not np.isfinite(k1):
                lost += 1
                continue
            true = _truth(surface, place)
            squares.append(((k1 - true[0]) ** 2 + (k2 - true[1]) ** 2) / 2.0)
        errors.append(float(np.sqrt(np.mean(squares))) if squares else np.nan)
    return float(np.mean(errors)), lost, statistics.median(costs)


def _frames(
    rng: np.random.Generator, surface: HeightMap, noise: float, impulses: float, n_frames: int
) -> Iterator[Floats]:
    clean = surface(*PAD.grid())
    low, high = float(clean.min()) - 0.5, float(clean.max()) + 0.5
    for _ in range(1 if noise == 0.0 else n_frames):
        frame = clean + noise * rng.normal(size=clean.shape)
        hit, up = rng.random((2, *clean.shape))
        yield np.where(hit < impulses, np.where(up < 0.5, low, high), frame)


def _truth(surface: HeightMap, place: tuple[float, float]) -> tuple[float, float]:
    """Principal curvatures by differences over a thousandth of a pitch."""
    h = 1e-3
    x, y = (np.array(coordinate) for coordinate in place)
    z = {(i, j): float(surface(x + i * h, y + j * h)) for i in (-1, 0, 1) for j in (-1, 0, 1)}
    slopes = (z[1, 0] - z[-1, 0]) / (2 * h), (z[0, 1] - z[0, -1]) / (2 * h)
    seconds = (
        (z[1, 0] - 2 * z[0, 0] + z[-1, 0]) / h**2,
        (z[1, 1] - z[-1, 1] - z[1, -1] + z[-1, -1]) / (4 * h**2),
        (z[0, 1] - 2 * z[0, 0] + z[0, -1]) / h**2,
    )
    k1, k2, *_ = touch.principal_curvatures(touch.graph_shape_operator(slopes, seconds))
    return k1, k2


def partial_rows(settings: FrameSettings = DEFAULT_FRAMES, seed: int = 0) -> list[PartialContact]:
    """A ball whose contact does not fill the pad: taxels without contact are not flat."""
    rng, ball, noise = np.random.default_rng(seed), settings.ball_radius, settings.contact_noise
    x, y = PAD.grid()
    height = ball - np.sqrt(ball**2 - x**2 - y**2)
    rows = []
    for radius in settings.contact_radii:
        rim = ball - np.sqrt(ball**2 - radius**2)
        touched = height < rim - 1e-12
        size = (settings.n_frames, *height.shape)
        frames = np.minimum(height, rim) + noise * rng.normal(size=size)
        names = {"thesis's chain": THESIS, "unmasked quadric": "quadric, 12 x 12"}
        errors = {
            title: _relative_error([ESTIMATORS[name](frame, noise)[:2] for frame in frames], ball)
            for title, name in names.items()
        }
        masked = [_masked(frame, touched, noise) for frame in frames]
        errors["palpate"] = _relative_error(masked, ball)
        rows.append(PartialContact(int(touched.sum()), errors))
    return rows


def _relative_error(curvatures: list[tuple[float, float] | None], ball: float) -> float | None:
    """Root mean square relative error of the curvatures of a ball; None if one is missing."""
    if None in curvatures:
        return None
    return float(np.sqrt(np.mean((np.array(curvatures) * ball - 1.0) ** 2)))


def _masked(frame: Floats, touched: Bools, noise: float) -> tuple[float, float] | None:
    patch = touch.fit_patch(PAD, frame, touched, np.array(ACROSS), noise)
    return patch.principal if patch.kind == "smooth" else None


def curvature_rows(quick: bool) -> Iterator[Row | str]:
    """Four tables of estimators, partial contact, kinds and fusion; then the demands."""
    settings = QUICK_FRAMES if quick else DEFAULT_FRAMES
    rows, partial = estimator_rows(settings), partial_rows(settings)
    calls, borderline = confusion(settings.n_draws, seed=2)
    scores = {name: score_fusion(name, settings.fused_noise, settings.n_walks) for name in WALKS}
    yield from _estimator_table(rows)
    yield from _partial_table(partial, settings.ball_radius)
    yield from _verdict_table(calls, borderline)
    yield from _fusion_table(scores, settings.fused_noise)
    demands = (*estimator_demands(rows, partial), *verdict_demands(calls), *fusion_demands(scores))
    yield from demands


def confusion(
    draws: int, seed: int
) -> tuple[Counter[tuple[touch.PatchKind, touch.PatchKind]], int]:
    """Counts of true kind and verdict, and the number of borderline draws, which are left out."""
    rng = np.random.default_rng(seed)
    calls: Counter[tuple[touch.PatchKind, touch.PatchKind]] = Counter()
    borderline = 0
    for name in SURFACES:
        for _ in range(draws):
            known = draw_touch(rng, name)
            if known is None:
                borderline += 1
                continue
            across, noise = np.array(ACROSS), known.noise
            patch = touch.fit_patch(known.pad, known.height, known.touched, across, noise)
            calls[known.kind, patch.kind] += 1
    return calls, borderline


def _estimator_table(rows: list[EstimatorErrors]) -> Iterator[str]:
    yield "error of k1 and k2, 1e-3/pitch, mean of six shapes; noise in pitches, then impulses"
    yield f"{'':<34}{_cells(8, HEADS)}  lost   us/frame  impulses  cost"
    for row in rows:
        errors = "".join(f"{1e3 * error:8.2f}" for error in row.errors)
        plain, impulses = row.micros
        costs = f"{plain:11.0f}{impulses:10.0f}{plain / rows[0].micros[0]:6.2f}"
        yield f"{row.name:<34}{errors}{row.lost:6d}{costs}"
    yield ""


def _partial_table(partial: list[PartialContact], ball: float) -> Iterator[str]:
    yield f"a ball of radius {ball:.0f} pitches that touches a part of the pad: error of k1 and k2"
    yield f"taxels{_cells(20, partial[0].errors)}"
    for contact in partial:
        errors = contact.errors.values()
        shown = ("insufficient" if error is None else f"{error:.1%}" for error in errors)
        yield f"{contact.taxels:6d}{_cells(20, shown)}"
    yield ""


def _verdict_table(
    calls: Counter[tuple[touch.PatchKind, touch.PatchKind]], borderline: int
) -> Iterator[str]:
    yield (
        f"verdicts: rows are what is touched, columns what it is called; {borderline} draws "
        "left out as borderline cases"
    )
    yield f"{'':<14}{_cells(14, VERDICTS)}   right"
    for kind in VERDICTS:
        called = _cells(14, (calls[kind, verdict] for verdict in VERDICTS))
        yield f"{kind:<14}{called}{right_share(calls, kind):8.1%}"
    yield ""


def _fusion_table(scores: Mapping[str, FusionScore], noise: float) -> Iterator[str]:
    yield (
        f"error of k1 and k2, 1/m, with {1e6 * noise:.0f} um of noise; squared innovation "
        "should be 3"
    )
    yield f"{'':<14}{'one touch':>12}{'fused':>10}{'ratio':>8}{'innovation':>12}"
    for name, (single, fused, surprise) in scores.items():
        yield f"{name:<14}{single:12.2f}{fused:10.2f}{fused / single:8.2f}{surprise:12.1f}"
    yield ""


def _cells(width: int, values: Iterable[object]) -> str:
    return "".join(f"{value:>{width}}" for value in values)


def estimator_demands(rows: list[EstimatorErrors], partial: list[PartialContact]) -> Iterator[Row]:
    """Errors of palpate, with the demands on them and in comparison with the thesis's chain."""
    by_name = {row.name: row.errors for row in rows}
    ours, thesis = by_name[OURS], by_name[THESIS]
    for column, most in ((1, DEMANDS.max_error), (4, DEMANDS.max_impulse_error)):
        (noise, impulses), error = DEFAULT_FRAMES.columns[column], ours[column]
        name = f"error of curvatures, noise {noise:g}, impulses {impulses:.0%}"
        yield Row(name, f"{1e3 * error:.2f}e-3", f"<= {1e3 * most:.1f}e-3 /pitch", error <= most)
    gain = min(theirs / mine for theirs, mine in zip(thesis, ours, strict=True))
    yield at_least("error of the thesis's chain to ours, at least", gain, DEMANDS.min_gain, ".0f")
    worst = max(row.errors["palpate"] or np.inf for row in partial if row.taxels >= 32)
    most, name = DEMANDS.max_partial_error, "the same, 32 taxels or more touched"
    yield Row(name, f"{worst:.1%}", f"< {100 * most:g} %", worst < most)


def verdict_demands(calls: Counter[tuple[touch.PatchKind, touch.PatchKind]]) -> Iterator[Row]:
    """How often each kind is called by its name."""
    for kind in VERDICTS:
        right = right_share(calls, kind)
        yield at_least(f"{kind}: called by its name", right, DEMANDS.min_right, ".1%")


def fusion_demands(scores: Mapping[str, FusionScore]) -> Iterator[Row]:
    """Errors of fused touches over those of single ones."""
    for name, score in scores.items():
        ratio = score.fused / score.single
        yield at_most(f"{name}: fused over single", ratio, DEMANDS.max_fused)


def right_share(
    calls: Counter[tuple[touch.PatchKind, touch.PatchKind]], kind: touch.PatchKind
) -> float:
    """Share of a kind that was called by its name."""
    return calls[kind, kind] / max(sum(calls[kind, called] for called in VERDICTS), 1)


class EstimatorErrors(NamedTuple):
    """Errors and costs of an estimator."""

    name: str
    errors: tuple[float, ...]  # By column: rms error of k1 and k2, mean over surfaces [1/pitch]
    lost: int  # Number of frames without an answer
    micros: tuple[float, float]  # Cost of a frame with noise, and of one with impulses [us]


class PartialContact(NamedTuple):
    """Errors of a ball that touches only the middle of the pad."""

    taxels: int  # Number of touched ones
    errors: Mapping[str, float | None]  # Relative rms error by method; None without an answer


def noise_variance(frame: Floats) -> float:
    """Mean of the variances around each taxel, the noise of a Wiener filter that is given none."""
    return float(touch.neighbourhoods(frame).var(axis=-1).mean())


def _curvatures(derivatives: Floats) -> Curvatures:
    p, q, r, s, t = derivatives.tolist()
    k1, k2, *_ = touch.principal_curvatures(touch.graph_shape_operator((p, q), (r, s, t)))
    return k1, k2, (0.0, 0.0)


def _spline(frame: Floats) -> Curvatures:
    return _curvatures(thesis.fit_bspline(PAD, frame, ALL_TAXELS, 0.0).derivatives)


def _smoothed(frame: Floats, noise: float) -> Curvatures:
    """A bicubic spline whose sum of squared residuals is that of the noise.

    FITPACK fails if that is far below the variation of the frame; then the spline interpolates.
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
    """A square window, and the matrix from its taxels to the derivatives at the pad's centre."""
    x, y = PAD.grid()
    inside = (np.abs(x) < reach) & (np.abs(y) < reach)
    solve = np.linalg.pinv(touch.monomials(x[inside], y[inside], degree))
    return inside, solve[1:6] * np.array([1.0, 1.0, 2.0, 1.0, 2.0])[:, None]


def _polynomial(
    frame: Floats, reach: float = ESTIMATION.quadric_reach, degree: int = 2
) -> Curvatures:
    inside, solve = _window(reach, degree)
    return _curvatures(solve @ frame[inside])


def _gaussian(frame: Floats) -> Curvatures:
    """Derivatives of the frame smoothed by a Gaussian."""
    orders = ((0, 1), (1, 0), (0, 2), (1, 1), (2, 0))
    smooth = partial(gaussian_filter, frame, ESTIMATION.gaussian_width, mode="nearest")
    return _curvatures(np.array([smooth(order=order)[7:9, 7:9].mean() for order in orders]))


def _flagged(frame: Floats) -> Curvatures:
    """A quartic of taxels near the median of their neighbourhood."""
    deviations = np.abs(frame - touch.median_filter(frame))
    most = ESTIMATION.max_deviation * 1.4826 * float(np.median(deviations)) + 1e-12
    good = deviations <= most
    fit = touch.fit_jet(PAD, frame, good)
    if fit is None or fit.jet.degree < 2:
        return np.nan, np.nan, (0.0, 0.0)
    k1, k2, *_ = _curvatures(fit.derivatives)
    return k1, k2, fit.middle[:2]


def _quartic(frame: Floats, noise: float | None = None) -> Curvatures:
    """A quartic over the whole pad; fitted robustly if the noise is known."""
    if noise is None:
        fit = touch.fit_jet(PAD, frame, ALL_TAXELS)
    else:
        fit = touch.fit_robust_jet(PAD, frame, ALL_TAXELS, max(noise, ESTIMATION.min_noise))
    assert fit is not None
    return _curvatures(fit.derivatives)


def _palpate(frame: Floats, noise: float) -> Curvatures:
    """The filter and curvature nodes: repair the frame, leave impulses out of the fit."""
    lift = float(frame.max()) + 1.0  # so that every taxel is touched
    clean = touch.remove_impulses(PAD, lift - frame, 0.05, noise)
    patch = touch.fit_patch(PAD, frame, ~clean.impulses, np.array(ACROSS), noise)
    x, y, _ = patch.place.tolist()
    if patch.kind != "smooth":
        return np.nan, np.nan, (x, y)
    return *patch.principal, (x, y)


def _wiener_median(frame: Floats) -> Floats:
    return touch.wiener_then_median(frame, noise_variance(frame))


def _median_wiener(frame: Floats) -> Floats:
    return touch.median_then_wiener(frame, noise_variance(touch.median_filter(frame)))


# The first is the chain of the thesis.
ESTIMATORS: Mapping[str, Estimator] = {
    "thesis: Wiener, median, B-spline": lambda f, s: _spline(_wiener_median(f)),
    "median, Wiener, B-spline": lambda f, s: _spline(_median_wiener(f)),
    "interpolating B-spline": lambda f, s: _spline(f),
    "smoothing B-spline": _smoothed,
    "quadric, 12 x 12": lambda f, s: _polynomial(f),
    "quartic, full pad": lambda f, s: _quartic(f),
    "Gaussian derivative": lambda f, s: _gaussian(f),
    "Savitzky-Golay, 8 x 8 cubic": lambda f, s: _polynomial(f, ESTIMATION.cubic_reach, 3),
    "median, quadric": lambda f, s: _polynomial(touch.median_filter(f)),
    "Wiener, median, quadric": lambda f, s: _polynomial(_wiener_median(f)),
    "median, Wiener, quadric": lambda f, s: _polynomial(_median_wiener(f)),
    "flag, quartic on the rest": lambda f, s: _flagged(f),
    "robust quartic": _quartic,
    "palpate: filter and curvature": _palpate,
}
THESIS, OURS = next(iter(ESTIMATORS)), list(ESTIMATORS)[-1]
# Surfaces over the pad, with lengths in pitches.
PAD_SURFACES: Mapping[str, HeightMap] = {
    "sphere of 20": lambda x, y: 20 - np.sqrt(400 - x * x - y * y),
    "sphere of 60": lambda x, y: 60 - np.sqrt(3600 - x * x - y * y),
    "cylinder of 15": lambda x, y: 15 - np.sqrt(225 - (0.6 * x + 0.8 * y) ** 2),
    "saddle": lambda x, y: (x * x - y * y) / 60,
    "tilted plane": lambda x, y: 0.2 * x - 0.1 * y,
    "wavy": lambda x, y: x * x / 50 + y * y / 80 + 3e-4 * x**3 - 4e-5 * x**4,
}
