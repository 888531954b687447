"""What accuracy cost a run: error and bound of each model against touches, robot and compute time.

The forecast cost of each halving of the bound stands beside its actual cost, and the processor
time is added up by step of the work. As text it is drawn as a small curve: costs and errors on log
scales, with a mark for each model's stated bound, and for its true error where the truth is known.
`palpate.launch.cost_chart` draws it as a picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from palpate.launch.log_scale import LogScale, log_scale
from palpate.launch.progress import Progress
from palpate.messages.types import NodeStatus, PlanEstimate, Score

REST = "rest"  # name of the time outside all steps: starting, receiving and sending
HALVING_COSTS = ("touches", "robot_time_s")  # keys of the costs that are forecast for a halving
Entry = dict[str, Any]
# Halvings are those of the bound, which a run knows without the truth.
ERROR, BOUND = "rms_m", "rms_bound_95_m"
# Keys of costs, each with its name and its short name.
AXES = {
    "touches": ("touches", "touches"),
    "robot_time_s": ("robot time, s", "robot s"),
    "compute_s": ("compute time, s", "compute s"),
}
Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TextChartSettings:
    """Size of a chart that is drawn as text."""

    n_rows: int = 9
    n_columns: int = 58
    label_width: int = 10  # [columns] before the chart


def cost_curve(progress: Progress, compute: float | None) -> list[Entry]:
    """An entry for each model that has a score or an estimate, in the order of the models.

    `compute`: processor time of all nodes at the end [s]; None if it is not known.
    """
    estimates = {estimate.number: (wall, estimate) for wall, estimate in progress.estimates}
    scores = {score.number: (wall, score) for wall, score in progress.scores}
    numbers = sorted(estimates | scores)
    curve = [_entry(progress, estimates.get(n), scores.get(n)) for n in numbers]
    if curve and compute is not None and progress.done is not None:
        curve[-1]["compute_s"] = compute
    for index, entry in enumerate(curve):
        halved = _halving_cost(entry, curve[index + 1 :])
        forecast = entry["forecast"]
        entry["halved"], entry["ratio"] = halved, None
        if halved is not None and forecast is not None and all(halved.values()):
            entry["ratio"] = {key: forecast[key] / halved[key] for key in HALVING_COSTS}
    return curve


def _entry(
    progress: Progress,
    timed_estimate: tuple[float, PlanEstimate] | None,
    timed_score: tuple[float, Score] | None,
) -> Entry:
    first_known = timed_score or timed_estimate
    assert first_known is not None
    wall, model = first_known
    wall = progress.model_times.get(model.number, wall)  # the score may come long after the model
    score, estimate = timed_score and timed_score[1], timed_estimate and timed_estimate[1]
    forecast = None
    if estimate is not None and estimate.halving_touches is not None:
        forecast = {"touches": estimate.halving_touches, "robot_time_s": estimate.halving_seconds}
    return {
        "contours": model.contours,
        "touches": model.touches,
        "robot_time_s": model.robot_time,
        "compute_s": progress.compute_at(wall),
        "wall_s": wall,
        "chamfer_m": score and score.chamfer,
        "rms_m": score and score.rms,
        "rms_bound_95_m": estimate and estimate.rms_bound_95,
        "largest_untouched_m": estimate and estimate.largest_untouched,
        "forecast": forecast,
    }


def _halving_cost(first: Entry, later: Sequence[Entry]) -> dict[str, float] | None:
    """Cost from one model to the first with half its bound; None if there is no such model."""
    if first[BOUND] is None:
        return None
    for entry in later:
        # The final mesh is finer than those before, and costs no touch.
        is_touched = entry[BOUND] is not None and entry["touches"] > first["touches"]
        if is_touched and entry[BOUND] <= 0.5 * first[BOUND]:
            return {key: entry[key] - first[key] for key in HALVING_COSTS}
    return None


def time_by_step(statuses: Mapping[str, NodeStatus]) -> dict[str, float]:
    """Processor time of all nodes by step of the work [s], the longest first."""
    total: dict[str, float] = {}
    for status in statuses.values():
        rest = max(status.cpu - sum(status.steps.values()), 0.0)
        for name, seconds in (*status.steps.items(), (REST, rest)):
            total[name] = total.get(name, 0.0) + seconds
    return dict(sorted(total.items(), key=lambda item: -item[1]))


def halving_lines(curve: Sequence[Mapping[str, Any]]) -> list[str]:
    """Forecast of the next halving of the bound, and forecast and cost of the last one."""
    if not curve:
        return []
    lines = ["no further slice is expected to halve the bound"]
    if (forecast := curve[-1]["forecast"]) is not None:
        lines = [f"next halving of the bound: about {_cost_text(forecast)}"]
    halved = [entry for entry in curve if entry["ratio"] is not None]
    if halved:
        expected, actual = (_cost_text(halved[-1][key]) for key in ("forecast", "halved"))
        lines.append(f"last halving of the bound: expected {expected}; took {actual}")
    return lines


def _cost_text(cost: Mapping[str, float]) -> str:
    return f"{cost['touches']:.0f} touches, {cost['robot_time_s']:.0f} s"


class Chart(NamedTuple):
    """Error and bound against one cost."""

    series: Mapping[str, Sequence[Point]]  # points (cost, error) by the key of the error
    forecast: tuple[Point, Point] | None  # from the last model to the forecast error
    floor: float | None  # sampling floor [m]; None if it is unknown, or far below all errors
    tolerance: float | None = None  # requested error [m]; None if there is none

    @property
    def points(self) -> list[Point]:
        """All points that the chart has to contain."""
        return [point for points in self.series.values() for point in points] + [
            *(self.forecast or ())
        ]


def chart_of(summary: Mapping[str, Any], axis: str, max_floor_ratio: float = 20.0) -> Chart | None:
    """The chart against one cost; None if no model has both a cost and an error.

    The sampling floor is left out where all errors are more than `max_floor_ratio` times as large.
    """
    curve = summary["curve"]
    series = {
        key: [(entry[axis], entry[key]) for entry in curve if entry[axis] and entry[key]]
        for key in (BOUND, ERROR)
    }
    if not any(series.values()):
        return None
    bounds, forecast = series[BOUND], None
    if bounds and axis in HALVING_COSTS and curve[-1]["forecast"] is not None:
        cost, error = bounds[-1]
        forecast = (cost, error), (cost + curve[-1]["forecast"][axis], 0.5 * error)
    floor = summary["sampling_floor_m"]
    min_error = min(error for points in series.values() for _, error in points)
    shown_floor = floor if floor and floor > min_error / max_floor_ratio else None
    return Chart(series, forecast, shown_floor, summary["tolerance_m"])


def draw_text(
    summary: Mapping[str, Any], settings: TextChartSettings = TextChartSettings()
) -> list[str]:
    """Error and bound against touches as lines of text; no lines without a model."""
    chart = chart_of(summary, "touches")
    if chart is None:
        return []
    points = [point for points in chart.series.values() for point in points]
    floors = [] if chart.floor is None else [chart.floor]
    costs = log_scale([cost for cost, _ in points])
    errors = log_scale([error for _, error in points] + floors)
    grid = _marked_grid(chart, costs, errors, settings)
    n_rows, width = settings.n_rows, settings.label_width
    ticks = errors.ticks(2 * n_rows // 3)
    labels = {round(_row(errors, value, n_rows)): f"{1e3 * value:g} mm" for value in ticks}
    lines = [f"{labels.get(row, ''):>{width - 1}} |{''.join(grid[row])}" for row in range(n_rows)]
    lines.append(f"{'':{width}}+{'-' * settings.n_columns}")
    lines += [_cost_line(summary["curve"], axis, costs, settings) for axis in AXES]
    return [line.rstrip() for line in [*lines, *_legend_lines(chart, grid, width)] if line]


def _marked_grid(
    chart: Chart, costs: LogScale, errors: LogScale, settings: TextChartSettings
) -> list[list[str]]:
    """Characters of the chart by row and column: the floor, then lines, then marks over them."""
    n_rows, n_columns = settings.n_rows, settings.n_columns
    grid = [[" "] * n_columns for _ in range(n_rows)]
    if chart.floor is not None:
        grid[round(_row(errors, chart.floor, n_rows))] = [*"- " * (n_columns // 2)]
    for key, mark in ((BOUND, "o"), (ERROR, "*")):
        places = [
            (_column(costs, cost, n_columns), _row(errors, error, n_rows))
            for cost, error in chart.series[key]
        ]
        for column, row in _line_cells(places):
            if grid[row][column] in " -":
                grid[row][column] = "."
        for place in places:
            column, row = round(place[0]), round(place[1])
            grid[row][column] = "@" if grid[row][column] not in f" -.{mark}" else mark
    return grid


def _column(costs: LogScale, cost: float, n_columns: int) -> float:
    return costs.share(cost) * (n_columns - 1)


def _row(errors: LogScale, error: float, n_rows: int) -> float:
    return (1.0 - errors.share(error)) * (n_rows - 1)


def _line_cells(places: Sequence[Point]) -> Iterator[tuple[int, int]]:
    """Column and row of each cell of the straight lines between successive places."""
    for (left, high), (right, low) in pairwise(places):
        for column in range(round(left) + 1, round(right)):
            yield column, round(high + (column - left) / (right - left) * (low - high))


def _cost_line(
    curve: Sequence[Mapping[str, Any]], axis: str, costs: LogScale, settings: TextChartSettings
) -> str:
    """One cost of the models under their marks: of the last model, and of others that fit."""
    n_columns = settings.n_columns
    line, free = [" "] * (n_columns + 1), n_columns + 1
    for entry in reversed(curve):
        cost = entry[axis]
        if cost is None or not entry["touches"] > 0:
            continue
        text = f"{cost:.0f}" if cost >= 10.0 or axis == "touches" else f"{cost:.1f}"
        column = round(_column(costs, entry["touches"], n_columns))
        end = min(column + 1 + len(text) // 2 + 1, n_columns + 1)
        if end <= free and end >= len(text):
            line[end - len(text) : end] = text
            free = end - len(text) - 1
    text = "".join(line)
    return f"{AXES[axis][1]:>{settings.label_width - 1}} {text}" if text.strip() else ""


def _legend_lines(chart: Chart, grid: Sequence[Sequence[str]], indent: int) -> list[str]:
    parts = ["* true error (rms)"] if chart.series[ERROR] else []
    parts += ["o stated bound (95 %)"] if chart.series[BOUND] else []
    parts += ["@ both"] if any("@" in row for row in grid) else []
    lines = [f"{'':{indent}} {'  '.join(parts)}"]
    if chart.floor is not None:
        lines.append(f"{'':{indent}} - - sampling floor {1e3 * chart.floor:.3f} mm")
    return lines
