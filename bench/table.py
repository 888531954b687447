"""Rows of a table of figures, what is demanded of each, and the table printed as it is known.

Beside its text a line has its figures as numbers, by which a later run is compared with it.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, Literal, NamedTuple, TypeVar

import msgspec

from palpate.launch.files.source_map import InputError

Key = TypeVar("Key")
Found = TypeVar("Found")
Kind = Literal["time", "count", "error"]
MOST_SECONDS = 300.0  # A run that takes longer has hung, s
WIDTH = 60  # Of a name, in letters
TIME_UNITS = ("s", "ms", "us", "ns", "/s")
# A number as it is printed, and its unit; commas part thousands.
PRINTED = re.compile(
    r"(?<![\w.])([-+]?\d+(?:,\d{3})*(\.\d+)?(e[-+]?\d+)?)(?: ?(%|/s|(?:[mun]?s|[mu]?m|deg|x)\b))?"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number of a line."""

    value: float | None  # None where it is not finite
    unit: str = ""
    kind: Kind  # A time, a count that is exact, or any other size
    spread: float = 0.0  # Half of what repeats differ by, or, without, half of the last digit
    repeated: bool = False  # Whether the spread is of repeats
    name: str = ""  # Which of several figures of its line


def figure_of(
    value: float,
    unit: str = "",
    *,
    kind: Kind | None = None,
    repeats: Sequence[float] = (),
    name: str = "",
) -> Figure:
    """A number with its unit; `repeats` are what it is the middle or the least of."""
    unit, whole, several = unit.strip(), isinstance(value, int), len(repeats) > 1
    return Figure(
        value=(value if whole else float(value)) if abs(value) < float("inf") else None,
        unit=unit,
        kind=kind or ("time" if unit in TIME_UNITS else "count" if whole and not unit else "error"),
        spread=0.5 * (max(repeats) - min(repeats)) if several else 0.0,
        repeated=several,
        name=name,
    )


def printed_figures(text: str) -> tuple[Figure, ...]:
    """The numbers in a text, each as exact as its last digit."""
    found = []
    for match in PRINTED.finditer(text):
        digits, decimals, power = match[1].replace(",", ""), match[2] or ".", match[3] or ""
        whole = decimals == "." and not power
        one = figure_of(int(digits) if whole else float(digits), match[4] or "")
        step = 0.0 if one.kind == "count" else float(f"1{power}") * 10.0 ** (1 - len(decimals))
        found.append(replace(one, spread=0.5 * step))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Measured:
    """A line as it is kept in a file."""

    group: str
    name: str
    value: str  # As it is printed
    target: str
    holds: bool
    figures: tuple[Figure, ...]


def measured(group: str, line: Any) -> Measured:
    """A line for a file; a row's value and demand are told without its name."""
    value, target = (line.value, line.target) if isinstance(line, Row) else (str(line), "")
    return Measured(group, line.name, value, target, bool(line.holds), tuple(line.figures))


class Row(NamedTuple):
    """One figure, or a few in a text."""

    name: str  # What was measured
    value: str  # With its unit
    target: str = ""  # What is demanded; empty if nothing is
    holds: bool = True  # Whether it is met
    numbers: tuple[Figure, ...] = ()  # Of the value, where they are known better than it tells
    text: str = ""  # The whole line, where it is one of a table of its own

    @property
    def figures(self) -> Sequence[Figure]:
        """Its number, or those of its text."""
        return self.numbers or printed_figures(self.value)

    def __str__(self) -> str:
        line = self.text or f"{self.name:<{WIDTH - 1}} {self.value:>14}  {self.target}"
        return line.rstrip() if self.holds else f"{line}   MISSED"


# Measures some figures, one at a time; fewer trials if told to be quick. What it yields is text,
# which is not of JSON, or a row, or anything else that has `name`, `holds` and `figures` as a row
# has them, printed by its own ``str``.
Group = Callable[[bool], Iterable[Any]]


def figure(
    name: str, value: float, form: str = ".2f", unit: str = "", target: str = "", **more: Any
) -> Row:
    """A figure of which nothing is demanded; `form` is the value's, `more` as of `figure_of`."""
    known, of = (100.0 * value, "%") if form.endswith("%") else (value, unit)
    return Row(name, f"{value:{form}}{unit}", target, True, (figure_of(known, of, **more),))


def at_most(
    name: str, value: float, most: float, form: str = ".2f", unit: str = "", **more: Any
) -> Row:
    """A figure that may not be larger than this; `form` is the value's."""
    row = figure(name, value, form, unit, f"<= {_bound(most, form)}{unit}", **more)
    return row._replace(holds=value <= most)


def at_least(
    name: str, value: float, least: float, form: str = ".2f", unit: str = "", **more: Any
) -> Row:
    """A figure that may not be smaller than this; `form` is the value's."""
    row = figure(name, value, form, unit, f">= {_bound(least, form)}{unit}", **more)
    return row._replace(holds=value >= least)


def _bound(value: float, form: str) -> str:
    return f"{100.0 * value:g}%" if form.endswith("%") else f"{value:g}"


def in_turns(calls: Mapping[Key, Callable[[], Found]], turns: int) -> dict[Key, list[Found]]:
    """What each call returns in each turn: whatever else the machine does, all meet the same."""
    found: dict[Key, list[Found]] = {key: [] for key in calls}
    for _ in range(turns):
        for key, call in calls.items():
            found[key].append(call())
    return found


def best_seconds(
    call: Callable[[], object], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """The least time of some rounds: what a busy computer adds is not the call's."""
    times = []
    for _ in range(rounds):
        began = clock()
        call()
        times.append(clock() - began)
    return min(times)


def run_groups(
    groups: Mapping[str, str | Group],
    *,
    quick: bool,
    as_json: bool = False,
    strict: bool = False,
    echo: Callable[[str], None] = print,
    keep: Callable[[str, Sequence[Measured], str], object] = lambda group, lines, failure: None,
) -> int:
    """Print figures, one a line, each as soon as it is known; 0 if all groups were measured.

    `groups`: what to measure, ``module:function`` by name; a module is imported at its turn. One
    that fails is told and is not the end of the others; then the result is 1. `strict`: also if a
    demand is missed. `quick`: fewer trials. `as_json`: one JSON object a line, with the group's
    name. `keep` is handed the lines of each group, and why it failed or nothing. Raises InputError
    if a single group says that it was asked for what cannot be.
    """
    bad = False
    for name, place in groups.items():
        if len(groups) > 1 and not as_json:
            echo(f"-- {name}")
        lines, failure = list[Measured](), ""
        try:
            for line in (named(place) if isinstance(place, str) else place)(quick):
                if not isinstance(line, str):
                    lines.append(measured(name, line))
                    bad = bad or (strict and not line.holds)
                if not as_json:
                    echo(str(line))
                elif not isinstance(line, str):
                    echo(msgspec.json.encode(lines[-1]).decode())
        except Exception as error:  # of a peer, say: the others are measured all the same
            if isinstance(error, InputError) and len(groups) == 1:
                raise
            failure, bad = f"{type(error).__name__}: {error}", True
            failed = Row(f"{name}: FAILED", failure)
            echo(msgspec.json.encode(measured(name, failed)).decode() if as_json else str(failed))
        keep(name, lines, failure)
    return int(bad)


def named(place: str) -> Any:
    """What ``module:name`` stands for."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
