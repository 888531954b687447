"""What accuracy cost a run: error and bound of each model against touches, robot and compute time.

What the next halving of the bound was foretold to cost stands beside what it then did cost; and
where the processor's time went, by step of the work. Drawn, as a small curve in text and as a page
of SVG: costs and errors on log scales, a mark for each model, its true error where the truth is
known, and the bound that the run states itself; what lies below the sampling floor cannot be
measured. The dashed line leads to where the next halving of the bound is foretold.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from palpate.launch.colours import COLOURS, ERROR_ON_DARK
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
LEAST = 1e-9  # What is less is drawn as that, in any unit
LEAST_SPAN = 1.5  # Of a scale, highest over lowest, and what it leaves free at either end
FREE = 1.12
FLOOR_REACH = 20.0  # A floor that is farther than so many times below all errors is not drawn
STEPS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0),
         tuple(n / 2.0 for n in range(2, 20)))  # fmt: skip
ROWS, COLUMNS, LABEL = 9, 58, 10  # Of the drawing in text: rows, columns, and those before them
# Of that in SVG, in pixels.
MARGIN, LEFT, PANEL, HIGH, APART = 24.0, 62.0, 270.0, 250.0, 30.0
LINE, LIST = 20.0, 470.0  # Height of a row; width of a list of bars
MOST_BARS = 14
TICK_ROOM, LINE_ROOM = 28.0, 12.0  # Between the labels of two ticks, across and upwards
_STYLE = Template(Path(__file__).with_name("cost.css").read_text("utf-8")).substitute(
    COLOURS, error_on_dark=ERROR_ON_DARK
)
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


class Scale(NamedTuple):
    """A log scale from a place to another, in columns, rows or pixels."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """The place of a value."""
        share = math.log(max(value, LEAST) / self.low) / math.log(self.high / self.low)
        return round(self.start + share * (self.end - self.start), 1)

    def ticks(self, most: int) -> list[float]:
        """Round values on it: as many as there may be."""
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        best: list[float] = []
        for steps in STEPS:
            found = [step * 10.0**power for power in decades for step in steps]
            found = [value for value in found if self.low <= value <= self.high]
            best = found if len(best) < len(found) <= most else best
        return best


def scale(values: Sequence[float], start: float, end: float) -> Scale:
    """The scale on which all values have room."""
    low, high = (max(LEAST, pick(values)) for pick in (min, max))
    widen = math.sqrt(max(LEAST_SPAN / (high / low), 1.0)) * FREE
    return Scale(low / widen, high * widen, start, end)


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
    across = scale([cost for cost, _ in points], 0, COLUMNS - 1)
    floors = [] if chart.floor is None else [chart.floor]
    up = scale([error for _, error in points] + floors, ROWS - 1, 0)
    grid = [[" "] * COLUMNS for _ in range(ROWS)]
    for floor in floors:
        grid[round(up.at(floor))] = [*"- " * (COLUMNS // 2)]
    for key, mark in ((BOUND, "o"), (ERROR, "*")):
        places = [(across.at(cost), up.at(error)) for cost, error in chart.series[key]]
        for column, row in _between(places):
            if grid[row][column] in " -":
                grid[row][column] = "."
        for place in places:
            column, row = round(place[0]), round(place[1])
            grid[row][column] = "@" if grid[row][column] not in f" -.{mark}" else mark
    labels = {round(up.at(value)): f"{1e3 * value:g} mm" for value in up.ticks(2 * ROWS // 3)}
    lines = [f"{labels.get(row, ''):>{LABEL - 1}} |{''.join(grid[row])}" for row in range(ROWS)]
    lines.append(f"{'':{LABEL}}+{'-' * COLUMNS}")
    lines += [_cost_line(summary["curve"], axis, across) for axis in AXES]
    return [line.rstrip() for line in [*lines, *_legend_lines(chart, grid)] if line]


def _between(places: Sequence[Point]) -> Iterator[tuple[int, int]]:
    """Column and row of each column between neighbouring places."""
    for (left, high), (right, low) in pairwise(places):
        for column in range(round(left) + 1, round(right)):
            yield column, round(high + (column - left) / (right - left) * (low - high))


def _cost_line(curve: Sequence[Mapping[str, Any]], axis: str, across: Scale) -> str:
    """One cost of the models under their marks, where there is room; the last always."""
    line, free = [" "] * (COLUMNS + 1), COLUMNS + 1
    for one in reversed(curve):
        if one[axis] is None or not one["touches"] > 0:
            continue
        text = f"{one[axis]:.0f}" if one[axis] >= 10.0 or axis == "touches" else f"{one[axis]:.1f}"
        end = min(round(across.at(one["touches"])) + 1 + len(text) // 2 + 1, COLUMNS + 1)
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


class Layout(NamedTuple):
    """How the drawing is laid out."""

    width: int  # pixels
    columns: int  # panels beside each other
    bar: float  # length of the longest bar, pixels
    alone: bool  # as a file of its own, which says all figures; a report says some of them itself


COST_FILE = Layout(980, 3, 190.0, alone=True)
COST_IN_REPORT = COST_FILE._replace(alone=False)
COST_ON_PHONE = Layout(358, 1, 110.0, alone=False)


def draw_svg(summary: Mapping[str, Any], layout: Layout = COST_FILE) -> str:
    """Error and bound against each cost, and where the time went, as the text of an SVG file."""
    charts = [(axis, chart) for axis in AXES if (chart := chart_of(summary, axis)) is not None]
    parts, top = _heading(summary) if layout.alone else [], 58.0 if layout.alone else 6.0
    legend, top = _legend(charts[0][1] if charts else None, layout, top)
    parts += legend
    errors = [error for _, chart in charts for _, error in chart.points]
    levels = [level for _, chart in charts for level in (chart.floor, chart.tolerance)]
    errors += [level for level in levels if level is not None]
    for number, (axis, chart) in enumerate(charts):
        row, column = divmod(number, layout.columns)
        corner = LEFT + column * (PANEL + APART), top + 22.0 + row * (HIGH + 72.0)
        up = scale(errors, corner[1] + HIGH, corner[1])
        parts += _panel(chart, axis, corner, up, labelled=column == 0)
    top += 40.0 + (HIGH + 72.0) * math.ceil(len(charts) / layout.columns)
    lists = {"Processor time by step": summary["steps"]}
    if layout.alone:  # a report has a table of nodes
        lists["by node"] = {name: one["cpu_s"] for name, one in summary["nodes"].items()}
    for number, (title, times) in enumerate(lists.items()):
        longest = max([one for some in lists.values() for one in some.values()], default=0.0)
        parts += _bars(title, times, longest, (LEFT + number * LIST, top), layout)
    rows = max(min(len(times), MOST_BARS) for times in lists.values())
    high = math.ceil(top + LINE * rows + MARGIN)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {layout.width} {high}" '
            f'width="{layout.width}" height="{high}" role="img">',
            f"<title>What accuracy cost</title>\n<style>\n{_STYLE}</style>",
            f'<rect class="page" x="0.5" y="0.5" width="{layout.width - 1}" height="{high - 1}"/>',
            *parts,
            "</svg>\n",
        ]
    )


def _heading(summary: Mapping[str, Any]) -> list[str]:
    told = [f"{summary['contours']} contours", f"{summary['touches']} touches"]
    told.append(f"robot {summary['robot_time_s']:.0f} s")
    if summary["compute_s"] is not None:
        told.append(f"compute {summary['compute_s']:.1f} s")
    if summary["largest_untouched_m"] is not None:
        told.append(f"untouched gap {1e3 * summary['largest_untouched_m']:.3g} mm")
    ended = summary["status"] + (", goal missed" if summary["missed"] else "")
    name = f": {summary['scene']}" if summary["scene"] else ""
    return [
        _text("title", LEFT, 32.0, f"What accuracy cost{name} ({ended})"),
        _text("small", LEFT, 52.0, ", ".join(told)),
    ]


def _legend(chart: Chart | None, layout: Layout, top: float) -> tuple[list[str], float]:
    """What the lines mean, and where the legend ends; in a report its tiles say the figures."""
    if chart is None:
        return [_text("small", LEFT, top + 20.0, "no model was judged")], top + 28.0
    told = [
        (kind, words, 172.0)
        for key, kind, words in (
            (ERROR, "true", "true error (rms)"),
            (BOUND, "stated", "error bound (95 %)"),
        )
        if chart.series[key]
    ]
    if chart.forecast:
        told.append(("forecast", "next halving of the bound", 204.0))
    for kind, words, level in (
        ("floor", "sampling floor", chart.floor),
        ("tolerance", "tolerance", chart.tolerance),
    ):
        if level is not None:
            figure = f" {1e3 * level:.3g} mm" if layout.alone else ""
            told.append((kind, words + figure, 182.0))
    parts, left, y = list[str](), LEFT, top + 18.0
    for kind, words, width in told:
        if left > LEFT and left + width > layout.width:
            left, y = LEFT, y + LINE
        parts += [*_line(kind, [(left, y), (left + 26.0, y)])]
        parts.append(_text("small", left + 32.0, y + 4.0, words))
        if kind in ("true", "stated"):
            parts.append(_mark(kind, left + 13.0, y))
        left += width
    return parts, y + 10.0


def _panel(chart: Chart, axis: str, corner: Point, up: Scale, *, labelled: bool) -> list[str]:
    left, top = corner
    across = scale([cost for cost, _ in chart.points], left, left + PANEL)
    bottom, right = top + HIGH, left + PANEL
    parts, labelled_to = [], -math.inf
    for value in across.ticks(7):
        x = across.at(value)
        parts += _line("grid", [(x, top), (x, bottom)])
        if x >= labelled_to:
            parts.append(_text("small middle", x, bottom + 17.0, f"{value:g}"))
            labelled_to = x + TICK_ROOM
    labelled_from = math.inf
    for value in up.ticks(9):
        y = up.at(value)
        parts += _line("grid", [(left, y), (right, y)])
        if labelled and y <= labelled_from:
            labelled_from = y - LINE_ROOM
            parts.append(_text("small right", left - 7.0, y + 4.0, f"{1e3 * value:g}"))
    if labelled:
        parts.append(_text("small right", left - 7.0, top - 10.0, "mm"))
    if chart.floor is not None:
        y = up.at(chart.floor)
        parts.append(_rect("below", left, y, PANEL, bottom - y))
        parts += _line("floor", [(left, y), (right, y)])
    if chart.tolerance is not None:
        y = up.at(chart.tolerance)
        parts += _line("tolerance", [(left, y), (right, y)])
    for name, points in (
        ("forecast", chart.forecast or ()),
        ("stated", chart.series[BOUND]),
        ("true", chart.series[ERROR]),
    ):
        places = [(across.at(cost), up.at(error)) for cost, error in points]
        marked = places[1:] if name == "forecast" else places
        parts += _line(name, places, *(_mark(name, *place) for place in marked))
    parts.append(_rect("frame", left, top, PANEL, HIGH))
    return [*parts, _text("head middle", left + 0.5 * PANEL, bottom + 40.0, AXES[axis][0])]


def _bars(
    title: str, times: Mapping[str, float], longest: float, corner: Point, layout: Layout
) -> list[str]:
    """Times as bars, the longest first; the shortest are one where there are too many."""
    rows = sorted(times.items(), key=lambda one: -one[1])
    if len(rows) > MOST_BARS:
        rest = sum(seconds for _, seconds in rows[MOST_BARS - 1 :])
        rows = [*rows[: MOST_BARS - 1], (f"{len(rows) - MOST_BARS + 1} others", rest)]
    (left, top), total = corner, sum(times.values())
    title += f", {total:.1f} s" if total and layout.alone else ""
    left = left if layout.columns > 1 else 0.0
    parts = [_text("head", max(left, 12.0), top - 14.0, title)]
    for number, (name, seconds) in enumerate(rows):
        y, width = top + LINE * number, layout.bar * seconds / longest if longest > 0.0 else 0.0
        share = f" ({100.0 * seconds / total:.0f} %)" if seconds > 0.01 * total else ""
        parts += [
            _text("small right", left + 118.0, y + 12.0, name),
            _rect("bar", left + 126.0, y + 2.0, max(width, 0.5), LINE - 7.0),
            _text("small", left + 132.0 + width, y + 12.0, f"{seconds:.2f} s{share}"),
        ]
    return parts


def _text(kind: str, x: float, y: float, text: str) -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}">{escape(text)}</text>'


def _rect(kind: str, x: float, y: float, width: float, height: float) -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'
    return f'<rect class="{kind}" {place}/>'


def _mark(kind: str, x: float, y: float) -> str:
    if kind == "stated":
        return _rect(kind, x - 4.5, y - 4.5, 9.0, 9.0)
    return f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="3.4"/>'


def _line(kind: str, places: Sequence[Point], *marks: str) -> list[str]:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    line = [f'<polyline class="{kind}" points="{path}"/>'] if len(places) > 1 else []
    return [*line, *marks]
