"""What a sweep came to: a row for each run, the Pareto front, the CSV file and the table."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import Bools
from palpate.launch import text_table
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
    if value is None or isinstance(value, str):
        return value or ""
    return json.dumps(value, default=str)


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
