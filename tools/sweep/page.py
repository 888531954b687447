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

from palpate.launch import counted
from palpate.tools.sweep.results import Row, fronts, measured, on_front, table_of, told, varying

COSTS = {"touches": "touches", "robot_time_s": "robot seconds", "compute_s": "compute seconds"}
ERROR, BOUND, FLOOR = "rms_m", "rms_bound_95_m", "sampling_floor_m"  # What is drawn upwards
LINKS = ("", "cost.svg", "summary.json")  # Of a run, where they are there
COLOURS = 8
LEFT, RIGHT, TOP, BOTTOM, WIDTH, HEIGHT = 66.0, 884.0, 14.0, 416.0, 900.0, 462.0  # Pixels
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
    return Template(Path(__file__).with_name("page.html").read_text("utf-8")).substitute(
        title=escape(f"{name}: {counted(len(rows), 'run')}"),
        about=escape("; ".join(about)),
        key=f"{escape(series)}: {key}",
        charts="\n".join(line for cost in COSTS for line in _chart(rows, cost, series, kinds)),
        table="\n".join(_table(rows, folder)),
    )


def _chart(rows: Sequence[Row], cost: str, series: str, kinds: dict[str, str]) -> Iterator[str]:
    """A figure: error against one cost; nothing if no run has both."""
    kept, best = measured(rows, cost), fronts(rows, cost)
    if not kept:
        return
    unit = "mm" if len(best) == 1 else "% of the height"

    def height(row: Row, key: str = ERROR) -> float:
        value: float = row.record[key] or 0.0
        return value * (1000.0 if len(best) == 1 else 100.0 / row.record["size_m"])

    x = Axis.over([row.record[cost] for row in kept], LEFT, RIGHT)
    drawn = [height(row, key) for row in kept for key in (ERROR, BOUND, FLOOR)]
    y = Axis.over([value for value in drawn if value] or [LEAST], BOTTOM, TOP)
    yield f'<figure data-cost="{COSTS[cost]}"><figcaption>Error against {COSTS[cost]}</figcaption>'
    yield f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">'
    yield from _frame(x, y, COSTS[cost], f"root mean square error, {unit}")
    for scene, own in best.items():
        if floor := height(own[0], FLOOR):
            yield f'<path class="floor" d="M{LEFT} {y.at(floor)}H{RIGHT}"/>'
        way = "".join(f"H{x.at(row.record[cost])}V{y.at(height(row))}" for row in own)
        way = way.replace("H", "M", 1).replace("V", " ", 1)
        colour = kinds.get(scene, "all") if series == "scene" else "all"
        yield f'<path class="{colour} front" d="{way}H{RIGHT}"/>'
    for row in kept:
        at = x.at(row.record[cost]), y.at(height(row)), y.at(height(row, BOUND))
        yield from _dot(row, kinds[told(row.asked[series])], *at)
    marked = -APART
    for row in sorted((row for own in best.values() for row in own), key=lambda r: r.record[cost]):
        if (place := x.at(row.record[cost])) - marked >= APART:
            marked = place
            yield f'<text class="mark" x="{place}" y="{y.at(height(row)) + 18}">{row.number}</text>'
    yield "</svg></figure>"


def _dot(row: Row, colour: str, x: float, y: float, bound: float) -> Iterator[str]:
    """A run, what is seen where the mouse rests on it, and the way up to its bound."""
    asked = [f"{name} {told(value)}" for name, value in row.asked.items() if told(value)]
    costs = [f"{row.record[key]} {name}" for key, name in COSTS.items()]
    words = escape(", ".join((*asked, f"{1000.0 * row.record[ERROR]:.4f} mm", *costs)))
    yield f'<a class="{colour}" href="{escape(row.record["folder"])}/">'
    yield f"<title>{row.number}: {words}</title>"
    if row.record[BOUND]:
        yield f'<path class="bound" d="M{x} {y}V{bound}"/>'
    kind = "dot" if row.record["exit_code"] == 0 else "dot open"
    yield f'<circle class="{kind}" cx="{x}" cy="{y}" r="5"/></a>'


def _frame(x: Axis, y: Axis, across: str, up: str) -> Iterator[str]:
    size = f'width="{RIGHT - LEFT}" height="{BOTTOM - TOP}"'
    yield f'<rect class="frame" x="{LEFT}" y="{TOP}" {size}/>'
    for value in x.ticks():
        yield f'<path class="grid" d="M{x.at(value)} {BOTTOM}V{TOP}"/>'
        yield f'<text class="mid" x="{x.at(value)}" y="{BOTTOM + 17}">{value:g}</text>'
    for value in y.ticks():
        yield f'<path class="grid" d="M{LEFT} {y.at(value)}H{RIGHT}"/>'
        yield f'<text class="end" x="{LEFT - 7}" y="{y.at(value) + 4}">{value:g}</text>'
    middle = f"{(LEFT + RIGHT) / 2} {HEIGHT - 8}"
    yield f'<text class="mid" transform="translate({middle})">{across}</text>'
    turned = f"translate(15 {(TOP + BOTTOM) / 2}) rotate(-90)"
    yield f'<text class="mid" transform="{turned}">{up}</text>'


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
