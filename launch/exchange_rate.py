"""What accuracy cost a run: error and bound of each model against touches, robot and compute time.

What the next halving of the bound was foretold to cost stands beside what it then did cost; and
where the processor's time went, by step of the work. In text it is drawn as a small curve: costs
and errors on log scales, a mark for each model, its true error where the truth is known, and the
bound that the run states itself. `palpate.launch.cost_chart` draws it as a picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from palpate.launch.log_scale import LogScale, log_scale
from palpate.launch.progress import Progress
from palpate.messages.types import NodeStatus, PlanEstimate, Score

REST = "rest"  # Step of all that is none: starting, receiving and sending
COSTS = ("touches", "robot_time_s")  # What is foretold of a halving
Entry = dict[str, Any]
# The latter halves: a run knows it, whether anybody knows the truth or not.
ERROR, BOUND = "rms_m", "rms_bound_95_m"
# What a model has cost, by its key: how it is called, and in short.
AXES = {
    "touches": ("touches", "touches"),
    "robot_time_s": ("robot time, s", "robot s"),
    "compute_s": ("compute time, s", "compute s"),
}
FLOOR_REACH = 20.0  # A floor that is farther than so many times below all errors is not drawn
ROWS, COLUMNS, LABEL = 9, 58, 10  # Of the drawing in text: rows, columns, and those before them
Point = tuple[float, float]


def cost_curve(progress: Progress, compute: float | None) -> list[Entry]:
    """An entry for each model that was scored or judged, in their order.

    `compute` is the processor time of all nodes at the end, s; None if it is not known.
    """
    estimates = {one.number: (wall, one) for wall, one in progress.estimates}
    scores = {one.number: (wall, one) for wall, one in progress.scores}
    numbers = sorted(estimates | scores)
    curve = [_entry(progress, estimates.get(one), scores.get(one)) for one in numbers]
    if curve and compute is not None and progress.done is not None:
        curve[-1]["compute_s"] = compute
    for place, one in enumerate(curve):
        halved = _halved(one, curve[place + 1 :])
        foretold = one["forecast"]
        one["halved"], one["ratio"] = halved, None
        if halved is not None and foretold is not None and all(halved.values()):
            one["ratio"] = {key: foretold[key] / halved[key] for key in COSTS}
    return curve


def _entry(
    progress: Progress,
    judged: tuple[float, PlanEstimate] | None,
    scored: tuple[float, Score] | None,
) -> Entry:
    known_by = scored or judged
    assert known_by is not None
    wall, model = known_by
    wall = progress.made.get(model.number, wall)  # others may come long after it
    score, known = scored and scored[1], judged and judged[1]
    forecast = None
    if known is not None and known.halving_touches is not None:
        forecast = {"touches": known.halving_touches, "robot_time_s": known.halving_seconds}
    return {
        "contours": model.contours,
        "touches": model.touches,
        "robot_time_s": model.robot_time,
        "compute_s": progress.compute_at(wall),
        "wall_s": wall,
        "chamfer_m": score and score.chamfer,
        "rms_m": score and score.rms,
        "rms_bound_95_m": known and known.rms_bound_95,
        "largest_untouched_m": known and known.largest_untouched,
        "forecast": forecast,
    }


def _halved(one: Entry, later: Sequence[Entry]) -> dict[str, float] | None:
    """What it took, from one model on, until the bound was half as large; None if it never was."""
    if one[BOUND] is None:
        return None
    for other in later:
        # The final mesh is finer than those before, and costs no touch.
        found = other[BOUND] is not None and other["touches"] > one["touches"]
        if found and other[BOUND] <= 0.5 * one[BOUND]:
            return {key: other[key] - one[key] for key in COSTS}
    return None


def time_by_step(statuses: Mapping[str, NodeStatus]) -> dict[str, float]:
    """Processor time of all nodes, s, by step of the work, the longest first."""
    total: dict[str, float] = {}
    for status in statuses.values():
        rest = max(status.cpu - sum(status.steps.values()), 0.0)
        for name, seconds in (*status.steps.items(), (REST, rest)):
            total[name] = total.get(name, 0.0) + seconds
    return dict(sorted(total.items(), key=lambda one: -one[1]))


def halving_lines(curve: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the next halving of the bound will cost, and what the last one did, in words."""
    if not curve:
        return []
    told = ["no further slice halves the bound, as far as can be told"]
    if (forecast := curve[-1]["forecast"]) is not None:
        told = [f"next halving of the bound: about {_cost_text(forecast)}"]
    kept = [one for one in curve if one["ratio"] is not None]
    if kept:
        before, after = (_cost_text(kept[-1][key]) for key in ("forecast", "halved"))
        told.append(f"last halving of the bound: foretold {before}; took {after}")
    return told


def _cost_text(cost: Mapping[str, float]) -> str:
    return f"{cost['touches']:.0f} touches, {cost['robot_time_s']:.0f} s"


class Chart(NamedTuple):
    """Error and bound against one cost."""

    series: Mapping[str, Sequence[Point]]  # Points of cost and error, by key of the error
    forecast: tuple[Point, Point] | None  # From the last model to where the error is foretold
    floor: float | None  # The sampling floor, m; None if it is unknown, or far below
    tolerance: float | None = None  # The error asked for, m; None if nobody asked

    @property
    def points(self) -> list[Point]:
        """All that has to have room."""
        return [one for some in self.series.values() for one in some] + [*(self.forecast or ())]


def chart_of(summary: Mapping[str, Any], axis: str) -> Chart | None:
    """What is drawn against one cost; None if no model has both a cost and an error."""
    curve = summary["curve"]
    series = {
        key: [(one[axis], one[key]) for one in curve if one[axis] and one[key]]
        for key in (BOUND, ERROR)
    }
    if not any(series.values()):
        return None
    bounds, forecast = series[BOUND], None
    if bounds and axis in COSTS and curve[-1]["forecast"] is not None:
        cost, error = bounds[-1]
        forecast = (cost, error), (cost + curve[-1]["forecast"][axis], 0.5 * error)
    floor = summary["sampling_floor_m"]
    least = min(error for points in series.values() for _, error in points)
    shown = floor if floor and floor > least / FLOOR_REACH else None
    return Chart(series, forecast, shown, summary["tolerance_m"])


def draw_text(summary: Mapping[str, Any]) -> list[str]:
    """Error and bound against touches as lines of at most 69 columns; none without a model."""
    chart = chart_of(summary, "touches")
    if chart is None:
        return []
    points = [one for some in chart.series.values() for one in some]
    across = log_scale([cost for cost, _ in points])
    floors = [] if chart.floor is None else [chart.floor]
    up = log_scale([error for _, error in points] + floors)
    grid = [[" "] * COLUMNS for _ in range(ROWS)]
    for floor in floors:
        grid[round(_row(up, floor))] = [*"- " * (COLUMNS // 2)]
    for key, mark in ((BOUND, "o"), (ERROR, "*")):
        places = [(_column(across, cost), _row(up, error)) for cost, error in chart.series[key]]
        for column, row in _between(places):
            if grid[row][column] in " -":
                grid[row][column] = "."
        for place in places:
            column, row = round(place[0]), round(place[1])
            grid[row][column] = "@" if grid[row][column] not in f" -.{mark}" else mark
    ticks = up.ticks(2 * ROWS // 3)
    labels = {round(_row(up, value)): f"{1e3 * value:g} mm" for value in ticks}
    lines = [f"{labels.get(row, ''):>{LABEL - 1}} |{''.join(grid[row])}" for row in range(ROWS)]
    lines.append(f"{'':{LABEL}}+{'-' * COLUMNS}")
    lines += [_cost_line(summary["curve"], axis, across) for axis in AXES]
    return [line.rstrip() for line in [*lines, *_legend_lines(chart, grid)] if line]


def _column(across: LogScale, cost: float) -> float:
    return across.share(cost) * (COLUMNS - 1)


def _row(up: LogScale, error: float) -> float:
    return (1.0 - up.share(error)) * (ROWS - 1)


def _between(places: Sequence[Point]) -> Iterator[tuple[int, int]]:
    """Column and row of each column between neighbouring places."""
    for (left, high), (right, low) in pairwise(places):
        for column in range(round(left) + 1, round(right)):
            yield column, round(high + (column - left) / (right - left) * (low - high))


def _cost_line(curve: Sequence[Mapping[str, Any]], axis: str, across: LogScale) -> str:
    """One cost of the models under their marks, where there is room; the last always."""
    line, free = [" "] * (COLUMNS + 1), COLUMNS + 1
    for one in reversed(curve):
        if one[axis] is None or not one["touches"] > 0:
            continue
        text = f"{one[axis]:.0f}" if one[axis] >= 10.0 or axis == "touches" else f"{one[axis]:.1f}"
        end = min(round(_column(across, one["touches"])) + 1 + len(text) // 2 + 1, COLUMNS + 1)
        if end <= free and end >= len(text):
            line[end - len(text) : end] = text
            free = end - len(text) - 1
    text = "".join(line)
    return f"{AXES[axis][1]:>{LABEL - 1}} {text}" if text.strip() else ""


def _legend_lines(chart: Chart, grid: Sequence[Sequence[str]]) -> list[str]:
    parts = ["* true error (rms)"] if chart.series[ERROR] else []
    parts += ["o stated bound (95 %)"] if chart.series[BOUND] else []
    parts += ["@ both"] if any("@" in row for row in grid) else []
    lines = [f"{'':{LABEL}} {'  '.join(parts)}"]
    if chart.floor is not None:
        lines.append(f"{'':{LABEL}} - - sampling floor {1e3 * chart.floor:.3f} mm")
    return lines
