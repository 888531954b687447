"""What a sweep came to: a row for each run, the Pareto front, the CSV file, the table and the page.

The page is one file without network, styled as a run's report, a dot a run; without a script the
fronts over touches, robot seconds and compute seconds stand below each other, else take turns.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools
from palpate.launch.exchange_rate import Scale, scale
from palpate.launch.printing import counted, text_table
from palpate.tools.report.page import REPORT, html_page
from palpate.tools.sweep.sweep_file import Sweep

# Keys of a run's record, in the order of the CSV file.
FIGURES = (
    *("status", "exit_code", "tolerance_met", "chamfer_m", "rms_m", "p95_m", "hausdorff_m"),
    *("rms_bound_95_m", "largest_untouched_m", "sampling_floor_m", "size_m", "contours"),
    *("touches", "robot_time_s", "compute_s", "wall_s", "reason", "folder"),
)
TIMES = ("compute_s", "wall_s")  # All else is the same whoever makes the run, and when
# Figures for people: the key, and what it is multiplied by, with so many decimals.
SHOWN = {
    "rms mm": ("rms_m", 1000.0, 4),
    "bound mm": ("rms_bound_95_m", 1000.0, 4),
    "touches": ("touches", 1.0, 0),
    "robot s": ("robot_time_s", 1.0, 0),
    "compute s": ("compute_s", 1.0, 1),
}
COSTS = {"touches": "touches", "robot_time_s": "robot seconds", "compute_s": "compute seconds"}
ERROR, BOUND, FLOOR = "rms_m", "rms_bound_95_m", "sampling_floor_m"  # What is drawn upwards
LINKS = ("", REPORT, "cost.svg", "summary.json")  # Of a run, where they are there
COLOURS = 8
APART = 16.0  # Pixels between the numbers of two runs on the front
TICK_ROOM = {"across": 60.0, "up": 32.0}  # Pixels between two ticks at least


class Frame(NamedTuple):
    """Where a chart has its axes, in pixels."""

    width: float
    height: float
    left: float = 66.0
    top: float = 14.0

    @property
    def right(self) -> float:
        """The end of the axis across."""
        return self.width - 16.0

    @property
    def bottom(self) -> float:
        """The place of the axis across."""
        return self.height - 46.0


# Each is shown where it fits, so that its words have the size of those of the page.
FRAMES = {"narrow": Frame(358.0, 330.0), "middle": Frame(670.0, 420.0), "wide": Frame(900.0, 462.0)}


class Row(NamedTuple):
    """One run that is finished."""

    number: int  # From 1, in the order of the file
    asked: Mapping[str, Any]  # Scene, parameters, seed; None for what the file leaves open
    record: Mapping[str, Any]  # What came of it, by `FIGURES`


def rows_of(sweep: Sweep, records: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """The runs that are finished, by their marks, in the order of the file."""
    names = list(dict.fromkeys(name for run in sweep.runs for name in run.asked if name != "seed"))
    return [
        Row(number, {name: run.asked.get(name) for name in (*names, "seed")}, records[run.mark])
        for number, run in enumerate(sweep.runs, 1)
        if run.mark in records
    ]


def pareto_front(cost: ArrayLike, error: ArrayLike) -> Bools:
    """Which of some points nothing betters, (n,), given their costs and errors, (n,) each.

    A point betters another if neither its cost nor its error is larger, and one is smaller; of
    equal points all or none are on the front. Raises ValueError if the lengths differ, or
    anything is no finite number.
    """
    points = np.column_stack((cost, error))
    if points.dtype.kind not in "iuf" or not np.isfinite(points).all():
        raise ValueError("costs and errors must be finite numbers")
    unique, place = np.unique(points, axis=0, return_inverse=True)
    least = np.concatenate(([np.inf], np.minimum.accumulate(unique[:, 1])))[:-1]
    return np.asarray((unique[:, 1] < least)[place.reshape(-1)])


def measured(rows: Iterable[Row], cost: str) -> list[Row]:
    """The rows with a model whose error is known, at a known cost; the cheapest first."""
    kept = [row for row in rows if None not in (row.record["rms_m"], row.record[cost])]
    return sorted(kept, key=lambda row: row.record[cost])


def fronts(rows: Iterable[Row], cost: str) -> dict[str, list[Row]]:
    """Of each scene the rows that no other one of it betters, the cheapest first."""
    scenes: dict[str, list[Row]] = {}
    for row in measured(rows, cost):
        scenes.setdefault(row.asked["scene"], []).append(row)
    for scene, own in scenes.items():
        best = pareto_front(*([row.record[key] for row in own] for key in (cost, "rms_m")))
        scenes[scene] = [row for row, on_front in zip(own, best, strict=True) if on_front]
    return scenes


def on_front(rows: Iterable[Row], cost: str) -> set[int]:
    """Numbers of the rows on the front of their scene."""
    return {row.number for best in fronts(rows, cost).values() for row in best}


def told(value: Any) -> str:
    """A value as text; nothing for None."""
    return (
        value or "" if value is None or isinstance(value, str) else json.dumps(value, default=str)
    )


def csv_text(rows: Sequence[Row]) -> str:
    """The table, with all digits; what is unknown is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["run", *(rows[0].asked if rows else ()), *FIGURES])
    for row in rows:
        figures = [row.record.get(name) for name in FIGURES]
        writer.writerow([row.number, *map(told, (*row.asked.values(), *figures))])
    return text.getvalue()


def varying(rows: Sequence[Row]) -> list[str]:
    """Names of what is asked in which rows differ."""
    names = rows[0].asked if rows else ()
    return [name for name in names if len({told(row.asked[name]) for row in rows}) > 1]


def table_of(rows: Sequence[Row]) -> list[list[str]]:
    """The table for people, its heads first: only what differs, under short names."""
    names = varying(rows)
    last = [name.rpartition(".")[2] for name in names]
    heads = [one if last.count(one) == 1 else name for one, name in zip(last, names, strict=True)]
    table = [["run", *heads, "status", *SHOWN]]
    for number, asked, record in rows:
        state = {0: "done", 1: "missed"}.get(record["exit_code"], record["status"])
        figures = [(record[key], scale, digits) for key, scale, digits in SHOWN.values()]
        cells = ["" if x is None else f"{scale * x:.{digits}f}" for x, scale, digits in figures]
        table.append([str(number), *(told(asked[name]) for name in names), state, *cells])
    return table


def sweep_text(rows: Sequence[Row]) -> str:
    """The table as lines; ``*`` are the runs on the front of touches."""
    table, best = table_of(rows), on_front(rows, "touches")
    marks = ["", *("*" if row.number in best else "" for row in rows)]
    lines = [[mark, *cells] for mark, cells in zip(marks, table, strict=True)]
    return "\n".join(text_table(lines, range(len(lines[0]) - len(SHOWN), len(lines[0]))))


def page_text(name: str, rows: Sequence[Row], folder: Path) -> str:
    """The page of a sweep of this name; `folder` is where it will lie, and its runs' folders."""
    names = varying(rows)
    asked = rows[0].asked if rows else {}
    about = [f"{key} {told(one)}" for key, one in asked.items() if key not in names and told(one)]
    lost = len(rows) - len(measured(rows, "touches"))
    about += [f"{counted(lost, 'run')} without a model that was measured"] * bool(lost)
    # What colours tell: something of few values, of words if there is such.
    few = [one for one in names if len({told(row.asked[one]) for row in rows}) <= COLOURS]
    series = next((one for one in few if any(isinstance(row.asked[one], str) for row in rows)), "")
    series = series or next(iter(few), "scene")
    values = dict.fromkeys(told(row.asked[series]) for row in rows)
    kinds = {kind: f"c{i % COLOURS}" for i, kind in enumerate(values)}
    key = "".join(f'<b class="{kinds[kind]}">●</b> {escape(kind)} ' for kind in kinds)
    title = f"{name}: {counted(len(rows), 'run')}"
    body = Template(Path(__file__).with_name("page.html").read_text("utf-8")).substitute(
        title=escape(title),
        about=escape("; ".join(about)),
        key=f"{escape(series)}: {key}",
        charts="\n".join(
            line for cost in COSTS for line in _chart(rows, cost, series, kinds, folder)
        ),
        table="\n".join(_table(rows, folder)),
    )
    return html_page(title, [body])


def _chart(
    rows: Sequence[Row], cost: str, series: str, kinds: dict[str, str], folder: Path
) -> Iterator[str]:
    """A figure: error against one cost; nothing if no run has both."""
    if not measured(rows, cost):
        return
    yield f'<figure data-cost="{COSTS[cost]}"><figcaption>Error against {COSTS[cost]}</figcaption>'
    for fit, frame in FRAMES.items():
        yield f'<svg class="fit {fit}" viewBox="0 0 {frame.width} {frame.height}" role="img">'
        yield from _points(rows, cost, series, kinds, folder, frame)
        yield "</svg>"
    yield "</figure>"


def _points(
    rows: Sequence[Row],
    cost: str,
    series: str,
    kinds: dict[str, str],
    folder: Path,
    frame: Frame,
) -> Iterator[str]:
    """The axes of a chart, its fronts and its runs."""
    kept, best = measured(rows, cost), fronts(rows, cost)
    unit = "mm" if len(best) == 1 else "% of the height"

    def height(row: Row, key: str = ERROR) -> float:
        value: float = row.record[key] or 0.0
        return value * (1000.0 if len(best) == 1 else 100.0 / row.record["size_m"])

    x = scale([row.record[cost] for row in kept], frame.left, frame.right)
    drawn = [height(row, key) for row in kept for key in (ERROR, BOUND, FLOOR)]
    y = scale([value for value in drawn if value] or [0.0], frame.bottom, frame.top)
    yield from _axes(frame, x, y, COSTS[cost], f"root mean square error, {unit}")
    for scene, own in best.items():
        if floor := height(own[0], FLOOR):
            yield f'<path class="floor" d="M{frame.left} {y.at(floor)}H{frame.right}"/>'
        way = "".join(f"H{x.at(row.record[cost])}V{y.at(height(row))}" for row in own)
        way = way.replace("H", "M", 1).replace("V", " ", 1)
        colour = kinds.get(scene, "all") if series == "scene" else "all"
        yield f'<path class="{colour} front" d="{way}H{frame.right}"/>'
    for row in kept:
        at = x.at(row.record[cost]), y.at(height(row)), y.at(height(row, BOUND))
        yield from _dot(row, kinds[told(row.asked[series])], folder, *at)
    marked = -APART
    for row in sorted((row for own in best.values() for row in own), key=lambda r: r.record[cost]):
        if (place := x.at(row.record[cost])) - marked >= APART:
            marked = place
            yield f'<text class="mark" x="{place}" y="{y.at(height(row)) + 18}">{row.number}</text>'


def _dot(row: Row, colour: str, folder: Path, x: float, y: float, bound: float) -> Iterator[str]:
    """A run, what is seen where the mouse rests on it, and the way up to its bound."""
    target = f"{row.record['folder']}/"
    target += REPORT if (folder / target / REPORT).is_file() else ""
    asked = [f"{name} {told(value)}" for name, value in row.asked.items() if told(value)]
    costs = [f"{row.record[key]} {name}" for key, name in COSTS.items()]
    words = escape(", ".join((*asked, f"{1000.0 * row.record[ERROR]:.4f} mm", *costs)))
    yield f'<a class="{colour}" href="{escape(target)}">'
    yield f"<title>{row.number}: {words}</title>"
    if row.record[BOUND]:
        yield f'<path class="bound" d="M{x} {y}V{bound}"/>'
    kind = "dot" if row.record["exit_code"] == 0 else "dot open"
    yield f'<circle class="{kind}" cx="{x}" cy="{y}" r="5"/></a>'


def _axes(frame: Frame, x: Scale, y: Scale, across: str, up: str) -> Iterator[str]:
    left, right, top, bottom = frame.left, frame.right, frame.top, frame.bottom
    size = f'width="{right - left}" height="{bottom - top}"'
    yield f'<rect class="frame" x="{left}" y="{top}" {size}/>'
    for value in _ticks(x, TICK_ROOM["across"]):
        yield f'<path class="grid" d="M{x.at(value)} {bottom}V{top}"/>'
        yield f'<text class="mid" x="{x.at(value)}" y="{bottom + 17}">{value:g}</text>'
    for value in _ticks(y, TICK_ROOM["up"]):
        yield f'<path class="grid" d="M{left} {y.at(value)}H{right}"/>'
        yield f'<text class="end" x="{left - 7}" y="{y.at(value) + 4}">{value:g}</text>'
    middle, low = (left + right) / 2, f"15 {(top + bottom) / 2}"
    yield f'<text class="mid" transform="translate({middle} {frame.height - 8})">{across}</text>'
    yield f'<text class="mid" transform="translate({low}) rotate(-90)">{up}</text>'


def _ticks(axis: Scale, room: float) -> list[float]:
    """Round values on a scale with so much room for each, in pixels."""
    kept: list[float] = []
    for value in axis.ticks(max(2, int(abs(axis.end - axis.start) / room))):
        if not kept or abs(axis.at(value) - axis.at(kept[-1])) >= 0.6 * room:
            kept.append(value)
    return kept


def _table(rows: Sequence[Row], folder: Path) -> Iterator[str]:
    """A row a run; those on the front of touches stand out."""
    table, best = table_of(rows), on_front(rows, "touches")
    yield f"<tr><th>{'</th><th>'.join(map(escape, table[0]))}</th><th></th></tr>"
    for row, cells in zip(rows, table[1:], strict=True):
        place = row.record["folder"]
        links = [
            f'<a href="{escape(place)}/{one}">{one or "folder"}</a>'
            for one in LINKS
            if (folder / place / one).exists()
        ]
        failed = row.record["exit_code"] == 3
        kind = "bad" if failed else "best" if row.number in best else ""
        yield f'<tr class="{kind}" title="{escape(row.record["reason"])}"><td>'
        yield f"{'</td><td>'.join(map(escape, cells))}</td><td>{' '.join(links)}</td></tr>"
