"""Figures of filters and estimators: Fung, 1999, figures 3.3 to 3.6, anew and with errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.core.arrays import Floats
from palpate.core.touch.filters import (
    adaptive_wiener,
    median_filter,
    median_then_wiener,
    wiener_then_median,
)
from palpate.core.touch.impulses import robust_clean
from palpate.core.touch.pad import Pad
from palpate.launch.bench_curvature import TRIALS, estimator_rows
from palpate.launch.curvature_rows import noise_variance
from palpate.launch.curvature_tables import HEADS, Row

PAD = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
NOISE = 40e-6
"""m."""
IMPULSES = 0.05
"""Share of the taxels."""
CONTACT = 200e-6
"""Least compression that counts as touched, m: 5 deviations of the noise."""
DRAWS = 50
"""Frames over which the error under each picture is taken; the first is shown."""
DPI = 110


def write_figures(folder: str | Path) -> None:
    """Write ``filters_corner.png``, ``filters_ball.png`` and ``estimators.png``.

    Parameters
    ----------
    folder : str or Path
        Made if it is not there.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    draw_filters(_corner(), "the corner of a box").savefig(folder / "filters_corner.png", dpi=DPI)
    draw_filters(_ball(), "a ball of 20 mm").savefig(folder / "filters_ball.png", dpi=DPI)
    draw_estimators(estimator_rows(TRIALS)).savefig(folder / "estimators.png", dpi=DPI)


def filtered(truth: Floats, seed: int = 0) -> Mapping[str, Floats]:
    """A noisy frame with impulses, and what each filter makes of it; (rows, cols) each, m."""
    rng = np.random.default_rng(seed)
    raw = truth + NOISE * rng.normal(size=truth.shape)
    hit, up = rng.random((2, *truth.shape))
    raw = np.where(hit < IMPULSES, np.where(up < 0.5, 0.0, 2.4e-3), raw)
    return {
        "raw (3.3)": raw,
        "Wiener (3.4)": adaptive_wiener(raw, noise_variance(raw)),
        "median (3.4)": median_filter(raw),
        "Wiener, then median (3.5)": wiener_then_median(raw, noise_variance(raw)),
        "median, then Wiener (3.6)": median_then_wiener(raw, noise_variance(median_filter(raw))),
        "palpate: impulses mended": robust_clean(PAD, raw, CONTACT, NOISE).image,
    }


def mean_errors(truth: Floats) -> Mapping[str, float]:
    """Root mean square error after each filter, over many frames, m."""
    squares: dict[str, float] = {}
    for seed in range(DRAWS):
        for name, frame in filtered(truth, seed).items():
            squares[name] = squares.get(name, 0.0) + float(np.mean((frame - truth) ** 2))
    return {name: math.sqrt(total / DRAWS) for name, total in squares.items()}


def draw_filters(truth: Floats, what: str) -> Figure:
    """Surfaces and heat maps of a frame after each filter, with the error of each."""
    frames = filtered(truth)
    errors = mean_errors(truth)
    figure = Figure(figsize=(14.0, 5.4), layout="constrained")
    figure.suptitle(f"{what}: compression, {1e6 * NOISE:.0f} um of noise, {IMPULSES:.0%} impulses")
    x, y = (1e3 * axis for axis in PAD.grid())
    for column, (name, frame) in enumerate(frames.items()):
        above = figure.add_subplot(2, len(frames), column + 1, projection="3d")
        above.plot_surface(x, y, 1e3 * frame, cmap="viridis", vmin=0.0, vmax=1.6)
        above.set_zlim(0.0, 2.4)
        above.set_axis_off()
        above.set_title(name, fontsize=9)
        below = figure.add_subplot(2, len(frames), len(frames) + column + 1)
        below.imshow(1e3 * frame, cmap="viridis", vmin=0.0, vmax=1.6)
        below.set_xticks([])
        below.set_yticks([])
        below.set_xlabel(f"rms error {1e6 * errors[name]:.0f} um", fontsize=9)
    return figure


def draw_estimators(rows: list[Row]) -> Figure:
    """Errors of all estimators by column, on a logarithmic scale."""
    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    axes = figure.add_subplot()
    marks = "osv^<>Dph*XP8d"
    for row, mark in zip(rows, marks, strict=True):
        ours = row is rows[-1]
        axes.plot(
            HEADS,
            [1e3 * error for error in row.errors],
            marker=mark,
            linewidth=2.5 if ours else 1.0,
            color="black" if ours else None,
            label=row.name,
        )
    axes.set_yscale("log")
    axes.set_xlabel("noise in pitches, then noise .05 with impulses")
    axes.set_ylabel("error of k1 and k2, 1e-3/pitch")
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.grid(True, which="both", alpha=0.3)
    return figure


def _corner() -> Floats:
    """Compression under the corner of a box's flat top, pressed by 1.2 mm, a little askew."""
    x, y = PAD.grid()
    turn = math.radians(12.0)
    along = x * math.cos(turn) + y * math.sin(turn) + 3.3e-3
    beside = y * math.cos(turn) - x * math.sin(turn) + 2.6e-3
    return np.where((along > 0.0) & (beside > 0.0), 1.2e-3 + 0.01 * x, 0.0)


def _ball() -> Floats:
    """Compression under a ball of 20 mm, pressed by 1.4 mm."""
    x, y = PAD.grid()
    return np.maximum(1.4e-3 - (0.02 - np.sqrt(0.02**2 - x * x - y * y)), 0.0)
