"""A sheet of three diagrams: what accuracy costs by each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from palpate.bench.accuracy import statistics
from palpate.bench.accuracy.runs import Run
from palpate.core.arrays import Floats
from palpate.launch import charts
from palpate.tools.sweep.results import pareto_front

COSTS = {
    "touches": "touches (grasp apart)",
    "robot": "robot time, s (grasp included)",
    "compute": "processor time, s (simulation included)",
}
MARKS = "osvD^P*X"


def write_sheet(folder: Path, runs: Sequence[Run], first: str, which: str) -> None:
    """Write ``sheet.svg`` and ``sheet.png``; method `first` is on top, `which` names the cost."""
    figure = draw_sheet(runs, first, which)
    for name in ("sheet.svg", "sheet.png"):
        charts.write_figure(figure, folder / name, "What accuracy costs")


@charts.styled
def draw_sheet(runs: Sequence[Run], first: str, which: str) -> Figure:
    """Targets reached, work against precision, and stated against true errors."""
    table = statistics.table_of(runs)
    names = sorted(table, key=lambda name: (name != first, name))
    looks = {
        name: {
            "color": charts.SERIES[i % len(charts.SERIES)],
            "marker": MARKS[i % len(MARKS)],
            "zorder": 3.0 + (name == first),
        }
        for i, name in enumerate(names)
    }
    figure = charts.new_figure(1700.0, 600.0)
    left, middle, right = figure.subplots(1, 3)
    _draw_reached(left, table, looks, which)
    _draw_work(middle, table, looks, which)
    _draw_honesty(right, table, looks)
    objects = sorted({name for name, _ in table[names[0]]})
    seeds = len({seed for _, seed in table[names[0]]})
    shown = ", ".join(objects) if len(objects) <= 6 else f"{len(objects)} objects"
    figure.suptitle(f"What accuracy costs: {shown}; {seeds} seed{'s' * (seeds > 1)}, default noise")
    return figure


def _draw_reached(
    axes: Any,
    table: statistics.Table,
    looks: Mapping[str, dict[str, Any]],
    which: str,
    n_costs: int = 400,
) -> None:
    costs = {name: statistics.target_costs(entries, which) for name, entries in table.items()}
    values = np.concatenate([c.ravel() for by_name in costs.values() for c in by_name.values()])
    finite = values[np.isfinite(values) & (values > 0.0)]
    low, high = (finite.min(), finite.max()) if len(finite) else (1.0, 10.0)
    grid = np.geomspace(0.8 * low, 1.25 * high, n_costs)
    for name, look in looks.items():
        reached = statistics.reached_share(costs[name], grid)
        color, mark, order = look["color"], look["marker"], look["zorder"]
        axes.step(grid, reached.share, where="post", color=color, lw=2.0, zorder=order)
        band = {"step": "post", "color": color, "alpha": 0.12, "lw": 0}
        axes.fill_between(grid, reached.low, reached.high, **band)
        axes.plot(grid[-1], reached.share[-1], mark, color=color, clip_on=False, label=name)
    axes.set(xscale="log", xlabel=COSTS[which], ylim=(0.0, 1.0), xlim=(grid[0], grid[-1]))
    charts.log_ticks(axes, "x")
    loose, strict = 100 * statistics.TARGETS[[0, -1]]
    spread = f"{loose:g} % to {strict:g} % of the height"
    axes.set_ylabel("share of (object, seed, target) reached")
    axes.set_title(f"a. {len(statistics.TARGETS)} targets of rms error, {spread}")
    axes.legend(loc="upper left", title="bands: 95 %, over objects")
    axes.grid()


def _draw_work(
    axes: Any, table: statistics.Table, looks: Mapping[str, dict[str, Any]], which: str
) -> None:
    medians = list[Floats]()
    for name, look in looks.items():
        spreads = statistics.work_precision(table[name], which)
        if not spreads:
            continue
        middle = np.array([[spread.cost[1], 100.0 * spread.error[1]] for spread in spreads])
        medians.append(middle)
        axes.errorbar(
            *(*middle.T, _bars(spreads, "error", 100.0), _bars(spreads, "cost", 1.0)),
            **{"lw": 1.5, "elinewidth": 0.6, "ms": 6.0, **look},
        )
    if medians:
        points = np.concatenate(medians)
        front = np.unique(points[pareto_front(*points.T)], axis=0)  # from the cheapest on
        axes.plot(*front.T, color=charts.INK, lw=5.0, alpha=0.25, zorder=2.0, label="Pareto front")
    floors = [
        run.sampling_floor_m / run.size_m
        for entries in table.values()
        for runs in entries.values()
        for run in runs
    ]
    floor = 100.0 * float(np.median(floors))
    axes.axhspan(1e-9, floor, color=charts.GRID, zorder=1.0)
    lowest = min((float(middle[:, 1].min()) for middle in medians), default=1e-2)
    axes.set(xscale="log", yscale="log", xlabel=COSTS[which], ylabel="rms error, % of the height")
    axes.set_ylim(bottom=0.5 * min(lowest, floor))
    charts.log_ticks(axes)
    axes.set_title("b. work and precision: medians, quartiles; grey: sampling floor")
    axes.legend(loc="lower left")
    axes.grid()


def _bars(spreads: Sequence[statistics.Spread], field: str, scale: float) -> Floats:
    """Distances (2, n) of the quartiles from the medians."""
    low, middle, high = scale * np.array([getattr(spread, field) for spread in spreads]).T
    return np.array([middle - low, high - middle])


def _draw_honesty(axes: Any, table: statistics.Table, looks: Mapping[str, dict[str, Any]]) -> None:
    ends = list[Floats]()
    for name, look in looks.items():
        pairs = 100.0 * statistics.stated_and_true(table[name])
        if len(pairs):
            label = f"{name}: {statistics.held_share(pairs):.0%} of {len(pairs)} held"
            axes.plot(*pairs.T, look["marker"], color=look["color"], alpha=0.75, label=label)
            ends.append(pairs)
    span = np.concatenate(ends) if ends else np.array([[0.01, 1.0]])
    line = np.array([0.7 * span.min(), 1.4 * span.max()])
    axes.plot(line, line, color=charts.INK, lw=1.0, zorder=2.0)
    axes.fill_between(line, line, line[-1], color=charts.VERMILION, alpha=0.07, lw=0)
    axes.text(0.03, 0.97, "error beyond what is stated", transform=axes.transAxes, va="top")
    axes.set(xscale="log", yscale="log", xlim=line, ylim=line)
    axes.set_xlabel("stated bound (95 %), % of the height")
    axes.set_ylabel("true rms error, % of the height")
    charts.log_ticks(axes)
    axes.set_title("c. honesty: 95 % should lie below the line")
    axes.legend(loc="lower right")
    axes.grid()
