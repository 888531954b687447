"""What a run would have cost other robots, as lines for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.launch.robot_time import PARTS, Costs

TITLE, COLUMN = 12, 10
"""Widths, in letters."""


def robot_time_text(costs: Costs) -> str:
    """The figures of `palpate.launch.robot_time.robot_time`."""
    fingers, closings = costs["fingers"], costs["closings"]
    counts = [_many(costs["touches"], "touch", "touches")]
    counts += [f"{_many(closings, 'closing', 'closings')} of the hand"] if closings else []
    counts += [f"{fingers} fingers"] if fingers > 1 else []
    lines = [_line("read", f"{costs['recording']}: {', '.join(counts)}"), *_recorded(costs)]
    for name, cost in costs["robots"].items():
        lines += ["", *_table(name, cost, costs)]
    return "\n".join(lines)


def _recorded(costs: Costs) -> list[str]:
    recorded = costs["recorded"]
    robot, ended = recorded["robot"], recorded["robot_time_s"]
    if recorded["agrees"]:
        lines = [_line("recorded", f"{robot}, {ended:.1f} s: its moves add up to that")]
    elif recorded["agrees"] is None:
        lines = [
            _line("recorded", f"{ended:.1f} s"),
            _line("doubtful", "which robot made that is not known, so it cannot be checked"),
        ]
    else:
        lines = [
            _line("recorded", f"{robot}, {ended:.1f} s"),
            _line(
                "doubtful", f"its moves miss that by {recorded['missing_s']:.3g} s: some are lost"
            ),
        ]
    if not costs["complete"]:
        lines.append(_line("doubtful", "the recording was never closed: its end may be missing"))
    return lines


def _table(name: str, cost: Mapping[str, Any], costs: Costs) -> list[str]:
    """One robot: where its time goes, phase by phase; of several fingers, the slowest."""
    phases = {phase: one for phase, one in cost["phases"].items() if one["moves"]}
    rows = [_row(f"{name}, s", [*phases, "all"])]
    for part in (*PARTS, "total"):
        each = [one[f"{part}_s"] for one in (*phases.values(), cost)]
        rows.append(_row(part, [f"{value:.1f}" for value in each]))
    moves = [one["moves"] for one in phases.values()]
    rows.append(_row("moves", [str(count) for count in (*moves, sum(moves))]))
    if costs["fingers"] > 1:
        totals = [f"{number} {total:.1f} s" for number, total in cost["finger_s"].items()]
        rows.append(_line("fingers", f"{', '.join(totals)}; the table is of the slowest"))
    if cost["per_touch_s"] is not None:
        rows.append(_line("a touch", f"{cost['per_touch_s']:.2f} s, all counted"))
    return rows


def _many(count: int, one: str, more: str) -> str:
    return f"{count} {one if count == 1 else more}"


def _line(title: str, text: str) -> str:
    return f"{title:<{TITLE}}{text}"


def _row(title: str, cells: list[str]) -> str:
    return f"{title:<{TITLE}}" + "".join(f"{cell:>{COLUMN}}" for cell in cells)
