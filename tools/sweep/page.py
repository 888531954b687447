"""The page of a sweep: its Pareto front drawn by hand, a dot a run, and the table below it.

One file without network or library; without a script the fronts over touches, robot seconds and
compute seconds stand below each other, with one they take turns.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import NamedTuple

from palpate.launch import counted, millimetres
from palpate.tools.sweep.results import (
    Row,
    asked_of,
    front_of,
    measured,
    shortened,
    state_of,
    told,
    varying,
)

COSTS = {"touches": "touches", "robot_time_s": "robot seconds", "compute_s": "compute seconds"}
ERRORS = ("rms_m", "rms_bound_95_m", "sampling_floor_m")  # What is drawn upwards
MM, SHARE = "mm", "% of the height"  # Units of errors: of one object, and of several
LINKS = ("cost.svg", "summary.json")  # Of a run, where they are there
COLOURS = 8
LEFT, RIGHT, TOP, BOTTOM, HEIGHT = 66.0, 884.0, 14.0, 416.0, 462.0  # Pixels
APART = 16.0  # Pixels between the numbers of two runs on the front
LEAST = 1.0e-6  # What is drawn of less than that, in any unit
STEPS = ((1,), (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 8), [n / 10 for n in range(10, 100)])


class Axis(NamedTuple):
    """A logarithmic axis: values, and the pixels at which its ends stand."""

    low: float
    high: float
    start: float
    end: float

    @classmethod
    def over(cls, values: Sequence[float], start: float, end: float) -> Axis:
        """With room on both sides of the values."""
        low, high = (max(LEAST, pick(values)) for pick in (min, max))
        room = max((high / low) ** 0.06, 1.12)
        return cls(low / room, high * room, start, end)

    def at(self, value: float) -> float:
        """Where a value stands."""
        share = math.log(max(LEAST, value) / self.low) / math.log(self.high / self.low)
        return round(self.start + share * (self.end - self.start), 1)

    def ticks(self) -> list[float]:
        """Some four to twelve round values."""
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)))
        for steps in STEPS:
            found = [step * 10.0**power for power in decades for step in steps]
            found = [value for value in found if self.low <= value <= self.high]
            if len(found) >= 4:
                break
        return found[:: 1 + len(found) // 12]


class Plot(NamedTuple):
    """One picture: error upwards, a cost to the right, and what colours tell."""

    cost: str
    unit: str
    x: Axis
    y: Axis
    series: str  # The column; empty for none
    kinds: Sequence[str]  # Its values

    def place(self, row: Row, key: str = ERRORS[0]) -> tuple[float, float]:
        """Where a row stands with one of its errors."""
        return self.x.at(row[self.cost]), self.y.at(height(row, key, self.unit))

    def colour(self, row: Row) -> str:
        """Class of a row's colour."""
        return f"c{self.kinds.index(told(row.get(self.series))) % COLOURS}"


def height(row: Row, key: str, unit: str) -> float:
    """An error in a unit."""
    return float(row[key] * (1000.0 if unit == MM else 100.0 / row["size_m"]))


def page_text(name: str, rows: Sequence[Row], folder: Path) -> str:
    """The page of a sweep of this name; `folder` is where it will lie, and its runs' folders."""
    asked = asked_of(rows)
    names = varying(rows, asked)
    same = [f"{one} {told(rows[0][one])}" for one in asked if one not in names and rows[0][one]]
    lost = len(rows) - len(measured(rows, "touches"))
    same += [f"{counted(lost, 'run')} without a model that was measured"] if lost else []
    series = _series(rows, names)
    kinds = list(dict.fromkeys(told(row.get(series)) for row in rows))
    dots = [f'<b class="c{i % COLOURS}">●</b> {escape(kind)}' for i, kind in enumerate(kinds)]
    return Template(Path(__file__).with_name("page.html").read_text("utf-8")).substitute(
        title=escape(f"{name}: {counted(len(rows), 'run')}"),
        about=escape("; ".join(same)),
        key=f"{escape(series)}: <span>{'</span><span>'.join(dots)}</span>" if series else "",
        charts="\n".join(_chart(rows, cost, series, kinds) for cost in COSTS),
        table="\n".join(_table(rows, names, folder)),
    )


def _series(rows: Sequence[Row], names: Sequence[str]) -> str:
    """The column that colours tell: of few values, of words if there is one."""
    few = [name for name in names if len({told(row[name]) for row in rows}) <= COLOURS]
    words = [name for name in few if any(isinstance(row[name], str) for row in rows)]
    return next(iter([*words, *few]), "")


def _chart(rows: Sequence[Row], cost: str, series: str, kinds: Sequence[str]) -> str:
    """A figure; nothing if no run has both cost and error."""
    kept = measured(rows, cost)
    if not kept:
        return ""
    unit = MM if len({row["scene"] for row in kept}) == 1 else SHARE
    across = Axis.over([row[cost] for row in kept], LEFT, RIGHT)
    errors = [height(row, key, unit) for row in kept for key in ERRORS if row[key]]
    plot = Plot(cost, unit, across, Axis.over(errors or [LEAST], BOTTOM, TOP), series, kinds)
    head = f'<figure data-cost="{COSTS[cost]}"><figcaption>Error against {COSTS[cost]}</figcaption>'
    svg = f'<svg viewBox="0 0 {RIGHT + APART:g} {HEIGHT:g}" role="img">'
    front = front_of(kept, cost)
    lines = [*_frame(plot), *_fronts(plot, front), *_dots(plot, kept, front)]
    return "\n".join([head, svg, *lines, "</svg></figure>"])


def _frame(plot: Plot) -> Iterator[str]:
    size = f'width="{RIGHT - LEFT}" height="{BOTTOM - TOP}"'
    yield f'<rect class="frame" x="{LEFT}" y="{TOP}" {size}/>'
    for value in plot.x.ticks():
        x = plot.x.at(value)
        yield f'<path class="grid" d="M{x} {BOTTOM}V{TOP}"/>'
        yield f'<text x="{x}" y="{BOTTOM + 17}" text-anchor="middle">{value:g}</text>'
    for value in plot.y.ticks():
        y = plot.y.at(value)
        yield f'<path class="grid" d="M{LEFT} {y}H{RIGHT}"/>'
        yield f'<text x="{LEFT - 7}" y="{y + 4}" text-anchor="end">{value:g}</text>'
    for place, turn, text in (
        (f"{(LEFT + RIGHT) / 2} {HEIGHT - 8}", 0, COSTS[plot.cost]),
        (f"15 {(TOP + BOTTOM) / 2}", -90, f"root mean square error, {plot.unit}"),
    ):
        turned = f'transform="translate({place}) rotate({turn})"'
        yield f'<text class="name" {turned} text-anchor="middle">{text}</text>'


def _fronts(plot: Plot, front: Sequence[Row]) -> Iterator[str]:
    """The front of each scene as steps, and its sampling floor."""
    for scene in dict.fromkeys(row["scene"] for row in front):
        best = [row for row in front if row["scene"] == scene]
        if best[0]["sampling_floor_m"]:
            _, floor = plot.place(best[0], "sampling_floor_m")
            yield f'<path class="floor" d="M{LEFT} {floor}H{RIGHT}"/>'
        places = [plot.place(row) for row in best]
        steps = "".join(f"H{x}V{y}" for x, y in places[1:])
        colour = plot.colour(best[0]) if plot.series == "scene" else "all"
        yield f'<path class="{colour} front" d="M{places[0][0]} {places[0][1]}{steps}H{RIGHT}"/>'


def _dots(plot: Plot, rows: Sequence[Row], front: Sequence[Row]) -> Iterator[str]:
    """A dot a run, the way up to its bound, and on the front its number."""
    best, marked = {row["run"] for row in front}, -APART
    for row in sorted(rows, key=lambda row: row[plot.cost]):
        x, y = plot.place(row)
        yield f'<a class="{plot.colour(row)}" href="{escape(row["folder"])}/">'
        asked = [f"{name} {told(row[name])}" for name in asked_of([row]) if told(row[name])]
        costs = [f"{row[key]:.4g} {text}" for key, text in COSTS.items() if row[key] is not None]
        words = f"{', '.join(asked)}\nrms {millimetres(row['rms_m'])}, {', '.join(costs)}"
        yield f"<title>{row['run']}: {escape(words)}</title>"
        if row["rms_bound_95_m"]:
            yield f'<path class="bound" d="M{x} {y}V{plot.place(row, "rms_bound_95_m")[1]}"/>'
        kind = "dot" if row["exit_code"] == 0 else "dot open"
        yield f'<circle class="{kind}" cx="{x}" cy="{y}" r="5"/></a>'
        if row["run"] in best and x - marked >= APART:
            marked = x
            yield f'<text class="mark" x="{x}" y="{y + 18}">{row["run"]}</text>'


def _table(rows: Sequence[Row], names: Sequence[str], folder: Path) -> Iterator[str]:
    """A row a run; those on the front of touches stand out."""
    best = {row["run"] for row in front_of(rows, "touches")}
    heads = [f'<th class="text">{escape(name)}</th>' for name in (*shortened(names), "status")]
    heads += [f"<th>{name}</th>" for name in ("rms, mm", "bound, mm", *COSTS.values(), "")]
    yield f"<tr><th>run</th>{''.join(heads)}</tr>"
    for row in rows:
        cells = [f'<td class="text">{escape(told(row[name]))}</td>' for name in names]
        cells.append(f'<td class="text" title="{escape(row["reason"])}">{state_of(row)}</td>')
        for key, factor, digits in [(key, 1000.0, 4) for key in ERRORS[:2]] + [
            (key, 1.0, int(key == "compute_s")) for key in COSTS
        ]:
            cells.append(
                f"<td>{'' if row[key] is None else f'{factor * row[key]:.{digits}f}'}</td>"
            )
        there = [one for one in LINKS if (folder / row["folder"] / one).exists()]
        links = [
            f'<a href="{escape(row["folder"])}/{one}">{one or "folder"}</a>' for one in ("", *there)
        ]
        kind = "bad" if row["exit_code"] == 3 else "best" if row["run"] in best else ""
        yield f'<tr class="{kind}"><td>{row["run"]}</td>{"".join(cells)}'
        yield f'<td class="text">{" ".join(links)}</td></tr>'
