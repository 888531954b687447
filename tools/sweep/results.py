"""Results of a sweep: a row for each run, the Pareto front, the CSV file, the table and the page.

The page is one file without network, in the style of a report, with a dot for each run. The fronts
over touches, robot seconds and compute seconds are shown in turn, or all without a script.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from html import escape
from itertools import cycle
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools
from palpate.launch import charts
from palpate.launch.log_scale import MIN_VALUE
from palpate.launch.printing import counted, text_table
from palpate.tools.report.page import REPORT, Markup, html_page, table
from palpate.tools.sweep.sweep_file import Sweep

# Keys of the record of a run, in the order of the CSV file.
FIGURES = (
    *("status", "exit_code", "tolerance_met", "chamfer_m", "rms_m", "p95_m", "hausdorff_m"),
    *("rms_bound_95_m", "largest_untouched_m", "sampling_floor_m", "size_m", "contours"),
    *("touches", "robot_time_s", "compute_s", "wall_s", "reason", "folder"),
)
TIMES = ("compute_s", "wall_s")  # all other figures are the same in each repetition of a run
# Figures of the table: key, factor to the unit, and decimals.
SHOWN = {
    "rms mm": ("rms_m", 1000.0, 4),
    "bound mm": ("rms_bound_95_m", 1000.0, 4),
    "touches": ("touches", 1.0, 0),
    "robot s": ("robot_time_s", 1.0, 0),
    "compute s": ("compute_s", 1.0, 1),
}
COSTS = {"touches": "touches", "robot_time_s": "robot seconds", "compute_s": "compute seconds"}
ERROR, BOUND, FLOOR = "rms_m", "rms_bound_95_m", "sampling_floor_m"  # keys of the drawn errors
LINKS = ("", REPORT, "cost.svg", "summary.json")  # to files of a run, where they exist
# Drawings of both sizes are in the page, so that texts have the size of those of the page.
SIZES = {"narrow": (358.0, 330.0), "wide": (670.0, 430.0)}  # width and height [pixels]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontLayout:
    """Distances in a drawing of a front [pixels]."""

    number_gap: float = 16.0  # smallest between the numbers of two runs
    legend_width: float = 150.0  # of an entry


LAYOUT = FrontLayout()


class Row(NamedTuple):
    """One finished run."""

    number: int  # from 1, in the order of the file
    asked: Mapping[str, Any]  # scene, parameters, seed; None where the file leaves one open
    record: Mapping[str, Any]  # results by `FIGURES`


def rows_of(sweep: Sweep, records: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """Finished runs, from records by mark, in the order of the file."""
    names = list(dict.fromkeys(name for run in sweep.runs for name in run.asked if name != "seed"))
    return [
        Row(number, {name: run.asked.get(name) for name in (*names, "seed")}, records[run.mark])
        for number, run in enumerate(sweep.runs, 1)
        if run.mark in records
    ]


def pareto_front(cost: ArrayLike, error: ArrayLike) -> Bools:
    """Mask (n,) of the Pareto-optimal points with costs and errors (n,) each.

    A point dominates another if neither its cost nor its error is larger, and one is smaller; of
    equal points all or none are on the front. Raises ValueError if the lengths differ, or a value
    is not finite.
    """
    points = np.column_stack((cost, error))
    if points.dtype.kind not in "iuf" or not np.isfinite(points).all():
        raise ValueError("costs and errors must be finite numbers")
    unique, inverse = np.unique(points, axis=0, return_inverse=True)
    cheaper_min = np.concatenate(([np.inf], np.minimum.accumulate(unique[:, 1])))[:-1]
    return np.asarray((unique[:, 1] < cheaper_min)[inverse.reshape(-1)])


def measured(rows: Iterable[Row], cost: str) -> list[Row]:
    """Rows with a known error and cost, the cheapest first."""
    known = [row for row in rows if None not in (row.record["rms_m"], row.record[cost])]
    return sorted(known, key=lambda row: row.record[cost])


def fronts(rows: Iterable[Row], cost: str) -> dict[str, list[Row]]:
    """Pareto-optimal rows of each scene, the cheapest first."""
    scenes: dict[str, list[Row]] = {}
    for row in measured(rows, cost):
        scenes.setdefault(row.asked["scene"], []).append(row)
    for scene, own in scenes.items():
        best = pareto_front(*([row.record[key] for row in own] for key in (cost, "rms_m")))
        scenes[scene] = [row for row, on_front in zip(own, best, strict=True) if on_front]
    return scenes


def on_front(rows: Iterable[Row], cost: str) -> set[int]:
    """Numbers of the rows on the front of their scene."""
    return {row.number for front in fronts(rows, cost).values() for row in front}


def text_of(value: Any) -> str:
    """A value as text; empty for None."""
    return (
        value or "" if value is None or isinstance(value, str) else json.dumps(value, default=str)
    )


def csv_text(rows: Sequence[Row]) -> str:
    """The table with all digits; unknown values are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", *(rows[0].asked if rows else ()), *FIGURES])
    for row in rows:
        figures = [row.record.get(name) for name in FIGURES]
        writer.writerow([row.number, *map(text_of, (*row.asked.values(), *figures))])
    return text.getvalue()


def varying(rows: Sequence[Row]) -> list[str]:
    """Names of settings that differ between rows."""
    names = rows[0].asked if rows else ()
    return [name for name in names if len({text_of(row.asked[name]) for row in rows}) > 1]


def table_of(rows: Sequence[Row]) -> list[list[str]]:
    """Rows of the printed table, its heads first: only settings that differ, under short names."""
    names = varying(rows)
    last = [name.rpartition(".")[2] for name in names]
    heads = [s if last.count(s) == 1 else name for s, name in zip(last, names, strict=True)]
    table = [["run", *heads, "status", *SHOWN]]
    for number, asked, record in rows:
        state = {0: "done", 1: "missed"}.get(record["exit_code"], record["status"])
        figures = [(record[key], scale, digits) for key, scale, digits in SHOWN.values()]
        cells = ["" if x is None else f"{scale * x:.{digits}f}" for x, scale, digits in figures]
        table.append([str(number), *(text_of(asked[name]) for name in names), state, *cells])
    return table


def sweep_text(rows: Sequence[Row]) -> str:
    """The table as lines; ``*`` marks runs on the front over touches."""
    table, best = table_of(rows), on_front(rows, "touches")
    marks = ["", *("*" if row.number in best else "" for row in rows)]
    lines = [[mark, *cells] for mark, cells in zip(marks, table, strict=True)]
    return "\n".join(text_table(lines, range(len(lines[0]) - len(SHOWN), len(lines[0]))))


def page_text(name: str, rows: Sequence[Row], folder: Path) -> str:
    """The page of a sweep by name, for the `folder` of the sweep."""
    names = varying(rows)
    asked = rows[0].asked if rows else {}
    shared = ((key, text_of(value)) for key, value in asked.items() if key not in names)
    about = [f"{key} {text}" for key, text in shared if text]
    lost = len(rows) - len(measured(rows, "touches"))
    about += [f"{counted(lost, 'run')} without a model that was measured"] * bool(lost)
    series = _series(rows, names)
    title = f"{name}: {counted(len(rows), 'run')}"
    body = Template(Path(__file__).with_name("page.html").read_text("utf-8")).substitute(
        title=escape(title),
        about=escape("; ".join(about)),
        charts="\n".join(line for cost in COSTS for line in _chart(rows, cost, series, folder)),
        table="\n".join(_table(rows, folder)),
    )
    return html_page(title, [body])


def _series(rows: Sequence[Row], names: Sequence[str]) -> str:
    """Name of the setting that colours stand for: one of few values, preferably words."""
    limit = len(charts.SERIES)
    few = [name for name in names if len({text_of(row.asked[name]) for row in rows}) <= limit]
    words = (name for name in few if any(isinstance(row.asked[name], str) for row in rows))
    return next(words, next(iter(few), "scene"))


def _chart(rows: Sequence[Row], cost: str, series: str, folder: Path) -> Iterator[str]:
    """A figure of error against one cost; nothing if no run has both."""
    if not measured(rows, cost):
        return
    title = f"Error against {COSTS[cost]}"
    yield f'<figure data-cost="{COSTS[cost]}"><figcaption>{title}</figcaption>'
    for fit, size in SIZES.items():
        figure, notes = draw_front(rows, cost, series, folder, size)
        drawn = charts.svg_text(figure, title, notes)
        yield f'<div class="{fit}">{drawn}</div>'
    yield "</figure>"


@charts.styled
def draw_front(
    rows: Sequence[Row],
    cost: str,
    series: str,
    folder: Path,
    size: tuple[float, float],
    layout: FrontLayout = LAYOUT,
) -> tuple[Figure, dict[str, str]]:
    """Runs with their bounds and fronts, and the tooltips of runs by their ``gid``."""
    best = fronts(rows, cost)
    unit = "mm" if len(best) == 1 else "% of the height"
    figure = charts.new_figure(*size)
    axes = figure.subplots()
    axes.set(xscale="log", yscale="log", xlabel=COSTS[cost])
    axes.set_ylabel(f"root mean square error, {unit}")
    axes.grid()
    values = dict.fromkeys(text_of(row.asked[series]) for row in rows)
    colours = dict(zip(values, cycle(charts.SERIES), strict=False))
    place = partial(_coordinates, cost=cost, in_mm=len(best) == 1)
    notes = dict[str, str]()
    drawn = measured(rows, cost)
    x, y, bounds, _ = zip(*map(place, drawn), strict=True)
    seen = [colours[text_of(row.asked[series])] for row in drawn]
    axes.vlines(x, y, bounds, seen, linewidth=0.8, alpha=0.5)
    for row, colour, at in zip(drawn, seen, zip(x, y, strict=True), strict=True):
        gid = f"run{row.number}"
        filled = colour if row.record["exit_code"] == 0 else charts.PAGE
        url, notes[gid] = _link_and_note(row, folder)
        axes.plot(*at, "o", color=colour, markerfacecolor=filled, gid=gid, url=url, zorder=3.0)
    _draw_fronts(axes, best, place, colours if series == "scene" else {}, layout.number_gap)
    signs = [Line2D([], [], color=colour, marker="o", lw=0.0) for colour in colours.values()]
    figure.legend(signs, colours, title=series, loc="outside upper left", alignment="left",
                  ncols=int(size[0] / layout.legend_width))  # fmt: skip
    charts.log_ticks(axes)
    return figure, notes


def _coordinates(row: Row, cost: str, *, in_mm: bool) -> tuple[float, float, float, float]:
    """Cost, and error, bound and sampling floor in mm or % of the height; NaN if unknown."""
    unit = 1000.0 if in_mm else 100.0 / row.record["size_m"]
    x, y = max(row.record[cost], MIN_VALUE), max(unit * row.record[ERROR], MIN_VALUE)
    bound, floor = (unit * (row.record[key] or math.nan) for key in (BOUND, FLOOR))
    return x, y, bound, floor


def _draw_fronts(
    axes: Axes,
    best: Mapping[str, Sequence[Row]],
    place: Callable[[Row], tuple[float, float, float, float]],
    colours: Mapping[str, str],
    number_gap: float,
) -> None:
    """Draw the front of each scene, its sampling floor, and the numbers of its runs."""
    for scene, own in best.items():
        xs, ys, _, floors = zip(*map(place, own), strict=True)
        axes.axhline(floors[0], color=charts.DIM, linestyle=":", linewidth=1.0)
        axes.autoscale_view()
        right, colour = axes.get_xlim()[1], colours.get(scene, charts.INK)
        axes.step([*xs, right], [*ys, ys[-1]], where="post", color=colour, alpha=0.75, lw=1.8)
        axes.set_xlim(right=right)
    numbered = ((*place(row)[:2], row.number) for own in best.values() for row in own)
    last = -number_gap
    for x, y, number in sorted(numbered):
        across = float(axes.transData.transform((x, y))[0])
        if across - last >= number_gap:
            last = across
            axes.annotate(str(number), (x, y), (0.0, -12.0), textcoords="offset points",
                          ha="center", fontsize="small")  # fmt: skip


def _link_and_note(row: Row, folder: Path) -> tuple[str, str]:
    """Target of the link of a run's dot, and its tooltip."""
    target = f"{row.record['folder']}/"
    target += REPORT if (folder / target / REPORT).is_file() else ""
    asked = [f"{name} {text_of(value)}" for name, value in row.asked.items() if text_of(value)]
    costs = [f"{row.record[key]} {name}" for key, name in COSTS.items()]
    words = ", ".join((*asked, f"{1000.0 * row.record[ERROR]:.4f} mm", *costs))
    return target, f"{row.number}: {words}"


def _table(rows: Sequence[Row], folder: Path) -> Iterator[str]:
    """A row for each run; those on the front over touches are highlighted."""
    (heads, *cells), best, marks = table_of(rows), on_front(rows, "touches"), list[str]()
    for row, line in zip(rows, cells, strict=True):
        path, failed = row.record["folder"], row.record["exit_code"] == 3
        links = (
            f'<a href="{escape(path)}/{name}">{name or "folder"}</a>'
            for name in LINKS
            if (folder / path / name).exists()
        )
        line.append(Markup(" ".join(links)))
        kind = "bad" if failed else "best" if row.number in best else ""
        marks.append(f' class="{kind}" title="{escape(row.record["reason"])}"')
    numbers = range(len(heads) - len(SHOWN), len(heads))
    return table([*heads, ""], cells, right=numbers, marks=marks)
