"""The tables of ``palpate bench curvature``, as lines of text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from palpate.core.touch.curvature import Kind
from palpate.launch.bench_fusion import Score

HEADS = ("0", ".01", ".05", "+2 %", "+8 %")
"""Of the columns: noise in pitches, then share of impulses."""
KINDS: tuple[Kind, ...] = ("smooth", "edge", "corner", "insufficient", "miss")
BALL = 20.0
"""Radius of the ball that is touched in part, pitches."""
FUSED_NOISE = 20e-6
"""m."""


class Row(NamedTuple):
    """One estimator."""

    name: str
    """What it does."""
    errors: tuple[float, ...]
    """Root mean square error of k1 and k2, mean over the shapes, for each column; 1/pitch."""
    lost: int
    """Frames for which it gave no number."""
    micros: tuple[float, float]
    """Cost of a frame with noise, and of one with impulses, us."""


class Partial(NamedTuple):
    """A ball that touches only the middle of the pad."""

    taxels: int
    """How many it touches."""
    errors: Mapping[str, float | None]
    """Root mean square error as a share of the curvature, by method; None if it said
    'insufficient'."""


def right_share(calls: Counter[tuple[Kind, Kind]], kind: Kind) -> float:
    """Share of a kind that was called by its name."""
    return calls[kind, kind] / max(sum(calls[kind, called] for called in KINDS), 1)


def estimator_table(rows: list[Row]) -> list[str]:
    """Lines of the table of estimators."""
    head = "".join(f"{name:>8}" for name in HEADS)
    lines = [
        "error of k1 and k2, 1e-3/pitch, mean of six shapes; noise in pitches, then impulses",
        f"{'':<34}{head}  lost   us/frame  impulses  cost",
    ]
    base = rows[0].micros[0]
    for row in rows:
        errors = "".join(f"{1e3 * error:8.2f}" for error in row.errors)
        costs = f"{row.micros[0]:11.0f}{row.micros[1]:10.0f}{row.micros[0] / base:6.2f}"
        lines.append(f"{row.name:<34}{errors}{row.lost:6d}{costs}")
    return lines


def partial_table(rows: list[Partial]) -> list[str]:
    """Lines of the table of partial contact."""
    names = list(rows[0].errors)
    lines = [
        f"a ball of radius {BALL:.0f} pitches that touches a part of the pad: error of k1 and k2",
        "taxels" + "".join(f"{name:>20}" for name in names),
    ]
    for row in rows:
        cells = (row.errors[name] for name in names)
        told = ("insufficient" if cell is None else f"{cell:.1%}" for cell in cells)
        lines.append(f"{row.taxels:6d}" + "".join(f"{cell:>20}" for cell in told))
    return lines


def verdict_table(calls: Counter[tuple[Kind, Kind]], borderline: int) -> list[str]:
    """Lines of the confusion matrix."""
    lines = [
        f"verdicts: rows are what is touched, columns what it is called; {borderline} draws "
        "left out as borderline cases",
        f"{'':<14}" + "".join(f"{kind:>14}" for kind in KINDS) + "   right",
    ]
    for kind in KINDS:
        cells = "".join(f"{calls[kind, called]:14d}" for called in KINDS)
        lines.append(f"{kind:<14}{cells}{right_share(calls, kind):8.1%}")
    return lines


def fusion_table(scores: Mapping[str, Score]) -> list[str]:
    """Lines of the table of fusion."""
    lines = [
        f"error of k1 and k2, 1/m, with {1e6 * FUSED_NOISE:.0f} um of noise; squared innovation "
        "should be 3",
        f"{'':<14}{'one touch':>12}{'fused':>10}{'ratio':>8}{'innovation':>12}",
    ]
    for name, (single, fused, surprise) in scores.items():
        ratio = fused / single
        lines.append(f"{name:<14}{single:12.2f}{fused:10.2f}{ratio:8.2f}{surprise:12.1f}")
    return lines
