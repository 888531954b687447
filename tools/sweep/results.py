"""What a sweep came to: a row for each run, the Pareto front, the CSV file and the text."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.core import Bools
from palpate.launch import counted, text_table
from palpate.tools.sweep.sweep_file import Sweep

# Columns behind those of the parameters; all but the last are keys of a run's record.
FIGURES = (
    *("status", "exit_code", "tolerance_met", "chamfer_m", "rms_m", "p95_m", "hausdorff_m"),
    *("rms_bound_95_m", "largest_untouched_m", "sampling_floor_m", "size_m", "contours"),
    *("touches", "robot_time_s", "compute_s", "wall_s", "reason", "folder"),
)
TIMES = ("compute_s", "wall_s")  # All else is the same whoever makes the run, and when
MOST_PRINTED = 40  # Rows; of a longer table only the front is printed
Row = Mapping[str, Any]


def pareto_front(cost: ArrayLike, error: ArrayLike) -> Bools:
    """Which of some points nothing betters.

    A point betters another if neither its cost nor its error is larger, and one is smaller; of
    equal points all or none are on the front.

    Parameters
    ----------
    cost, error : array_like, (n,)
        In any units.

    Returns
    -------
    Bools, (n,)

    Raises
    ------
    ValueError
        If the lengths differ, or anything is no finite number.
    """
    points = np.column_stack((cost, error))
    if points.dtype.kind not in "iuf" or not np.isfinite(points).all():
        raise ValueError("costs and errors must be finite numbers")
    unique, place = np.unique(points, axis=0, return_inverse=True)
    least = np.concatenate(([np.inf], np.minimum.accumulate(unique[:, 1])))[:-1]
    return np.asarray((unique[:, 1] < least)[place.reshape(-1)])


def rows_of(sweep: Sweep, records: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """The runs that are finished, by their marks, in the order of the file."""
    names = ("scene", *sweep.parameters, "seed")
    return [
        {"run": number}
        | {name: run.values.get(name) for name in names}
        | {name: records[run.mark].get(name) for name in FIGURES}
        for number, run in enumerate(sweep.runs, 1)
        if run.mark in records
    ]


def asked_of(rows: Sequence[Row]) -> list[str]:
    """The columns of what was asked: scene, parameters, seed."""
    return [name for name in (rows[0] if rows else ()) if name not in (*FIGURES, "run")]


def state_of(row: Row) -> str:
    """How a run ended, in a word."""
    return {0: "done", 1: "missed"}.get(row["exit_code"], str(row["status"]))


def measured(rows: Iterable[Row], cost: str) -> list[Row]:
    """The rows with a model whose error is known, at a known cost."""
    return [row for row in rows if row["rms_m"] is not None and row[cost] is not None]


def front_of(rows: Iterable[Row], cost: str) -> list[Row]:
    """The rows that no other of their scene betters, the cheapest first."""
    kept = measured(rows, cost)
    found = []
    for scene in dict.fromkeys(row["scene"] for row in kept):
        own = [row for row in kept if row["scene"] == scene]
        best = pareto_front([row[cost] for row in own], [row["rms_m"] for row in own])
        found += sorted(
            (row for row, on in zip(own, best, strict=True) if on), key=lambda r: r[cost]
        )
    return found


def varying(rows: Sequence[Row], names: Iterable[str]) -> list[str]:
    """The columns in which rows differ."""
    return [name for name in names if len({told(row[name]) for row in rows}) > 1]


def shortened(names: Sequence[str]) -> list[str]:
    """Names of parameters from their last dot on, where that tells them apart."""
    last = [name.rpartition(".")[2] for name in names]
    return [
        short if last.count(short) == 1 else name for short, name in zip(last, names, strict=True)
    ]


def told(value: Any) -> str:
    """A cell of the CSV file."""
    if value is None or isinstance(value, str):
        return value or ""
    return json.dumps(value, default=str)


def csv_text(rows: Sequence[Row]) -> str:
    """The table, with all digits; what is unknown is empty. The same from any number of workers."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0] if rows else FIGURES)
    writer.writerows([told(value) for value in row.values()] for row in rows)
    return text.getvalue()


def sweep_text(rows: Sequence[Row]) -> str:
    """The table for people, of what differs; ``*`` are the runs on the front of touches."""
    front = front_of(rows, "touches")
    shown = rows if len(rows) <= MOST_PRINTED else front
    names = varying(rows, asked_of(rows))
    lines = [
        [
            "",
            "run",
            *shortened(names),
            "status",
            "rms mm",
            "bound mm",
            "touches",
            "robot s",
            "compute s",
        ]
    ]
    for row in shown:
        words = ["*" if row in front else "", *(told(row[name]) for name in ("run", *names))]
        figures = [(row[key], 1000.0, 4) for key in ("rms_m", "rms_bound_95_m")]
        figures += [(row[key], 1.0, 0) for key in ("touches", "robot_time_s", "compute_s")]
        cells = ["-" if x is None else f"{scale * x:.{digits}f}" for x, scale, digits in figures]
        lines.append([*words, state_of(row), *cells])
    left = len(rows) - len(shown)
    more = [f"and {counted(left, 'run')} that others better: table.csv"] if left else []
    return "\n".join([*text_table(lines, range(3, len(lines[0]))), *more])
