"""Rows of a table of figures with their demands, printed as soon as each is known.

Beside its text a row holds its figures as numbers, with which a later run is compared.
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
Result = TypeVar("Result")
Kind = Literal["time", "count", "error"]
TIME_UNITS = ("s", "ms", "us", "ns", "/s")
# A printed number and its unit; commas separate thousands.
PRINTED_NUMBER = re.compile(
    r"(?<![\w.])([-+]?\d+(?:,\d{3})*(\.\d+)?(e[-+]?\d+)?)(?: ?(%|/s|(?:[mun]?s|[mu]?m|deg|x)\b))?"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number of a line."""

    value: float | None  # None where it is not finite
    unit: str = ""
    kind: Kind  # A time, an exact count, or any other quantity
    spread: float = 0.0  # Half the range of the repeats; without repeats, half of the last digit
    repeated: bool = False  # Whether the spread comes from repeats
    name: str = ""  # Distinguishes several figures of one row


def figure_of(
    value: float,
    unit: str = "",
    *,
    kind: Kind | None = None,
    repeats: Sequence[float] = (),
    name: str = "",
) -> Figure:
    """A number with its unit; it is the median or the smallest of the `repeats`."""
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
    figures = []
    for match in PRINTED_NUMBER.finditer(text):
        digits, decimals, power = match[1].replace(",", ""), match[2] or ".", match[3] or ""
        whole = decimals == "." and not power
        number = figure_of(int(digits) if whole else float(digits), match[4] or "")
        step = 0.0 if number.kind == "count" else float(f"1{power}") * 10.0 ** (1 - len(decimals))
        figures.append(replace(number, spread=0.5 * step))
    return tuple(figures)


@dataclass(frozen=True, slots=True)
class Measured:
    """A row as it is stored in a file."""

    group: str
    name: str
    value: str  # As it is printed
    target: str
    holds: bool
    figures: tuple[Figure, ...]


def measured(group: str, line: Any) -> Measured:
    """A row as it is stored in a file: the value and the demand of a `Row` without its name."""
    value, target = (line.value, line.target) if isinstance(line, Row) else (str(line), "")
    return Measured(group, line.name, value, target, bool(line.holds), tuple(line.figures))


class Row(NamedTuple):
    """One figure, or a few in a text."""

    name: str  # What is measured
    value: str  # With its unit
    target: str = ""  # Demand; empty if there is none
    holds: bool = True  # Whether the demand is met
    numbers: tuple[Figure, ...] = ()  # Figures more exact than the printed value
    text: str = ""  # The whole line, if it belongs to a table with columns of its own

    @property
    def figures(self) -> Sequence[Figure]:
        """Its exact figures, or else those of its printed value."""
        return self.numbers or printed_figures(self.value)

    def __str__(self) -> str:
        line = self.text or f"{self.name:<59} {self.value:>14}  {self.target}"
        return line.rstrip() if self.holds else f"{line}   MISSED"


# Measures figures one at a time, with fewer trials if its argument `quick` is true. It yields rows,
# anything else with the `name`, `holds` and `figures` of a row, printed by its own ``str``, and
# plain text, which is left out of JSON.
Group = Callable[[bool], Iterable[Any]]


def figure(
    name: str, value: float, form: str = ".2f", unit: str = "", target: str = "", **more: Any
) -> Row:
    """A figure without a demand; `form` formats the value, `more` is passed to `figure_of`."""
    number, its_unit = (100.0 * value, "%") if form.endswith("%") else (value, unit)
    return Row(name, f"{value:{form}}{unit}", target, True, (figure_of(number, its_unit, **more),))


def at_most(
    name: str, value: float, maximum: float, form: str = ".2f", unit: str = "", **more: Any
) -> Row:
    """A figure with an upper bound; `form` formats the value."""
    row = figure(name, value, form, unit, f"<= {_bound(maximum, form)}{unit}", **more)
    return row._replace(holds=value <= maximum)


def at_least(
    name: str, value: float, minimum: float, form: str = ".2f", unit: str = "", **more: Any
) -> Row:
    """A figure with a lower bound; `form` formats the value."""
    row = figure(name, value, form, unit, f">= {_bound(minimum, form)}{unit}", **more)
    return row._replace(holds=value >= minimum)


def _bound(value: float, form: str) -> str:
    return f"{100.0 * value:g}%" if form.endswith("%") else f"{value:g}"


def in_turns(calls: Mapping[Key, Callable[[], Result]], turns: int) -> dict[Key, list[Result]]:
    """Results of all calls, called in turns so that all meet the same load of the machine."""
    results: dict[Key, list[Result]] = {key: [] for key in calls}
    for _ in range(turns):
        for key, call in calls.items():
            results[key].append(call())
    return results


def best_seconds(
    call: Callable[[], object], n_rounds: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """The shortest time [s] of `n_rounds` calls: other load on the computer only adds to it."""
    durations = []
    for _ in range(n_rounds):
        start = clock()
        call()
        durations.append(clock() - start)
    return min(durations)


def run_groups(
    groups: Mapping[str, str | Group],
    *,
    quick: bool,
    as_json: bool = False,
    strict: bool = False,
    echo: Callable[[str], None] = print,
    keep: Callable[[str, Sequence[Measured], str], object] = lambda group, lines, failure: None,
) -> int:
    """Print each figure on a line as soon as it is known; return 0 if all groups were measured.

    `groups`: what to measure, ``module:function`` by name; each module is imported at its turn.
    After a group that fails the others are still measured, and the result is 1. `strict`: the
    result is 1 also if a demand is missed. `quick`: fewer trials. `as_json`: one JSON object a
    line, with the group's name. `keep` receives a group's name, its rows, and the reason of its
    failure or an empty string. Raises InputError if the only group does.
    """
    is_bad = False
    for name, place in groups.items():
        if len(groups) > 1 and not as_json:
            echo(f"-- {name}")
        lines, failure = list[Measured](), ""
        try:
            for line in (named(place) if isinstance(place, str) else place)(quick):
                if not isinstance(line, str):
                    lines.append(measured(name, line))
                    is_bad = is_bad or (strict and not line.holds)
                if not as_json:
                    echo(str(line))
                elif not isinstance(line, str):
                    echo(msgspec.json.encode(lines[-1]).decode())
        except (
            Exception
        ) as error:  # of a compared package, say: the other groups are still measured
            if isinstance(error, InputError) and len(groups) == 1:
                raise
            failure, is_bad = f"{type(error).__name__}: {error}", True
            failed = Row(f"{name}: FAILED", failure)
            echo(msgspec.json.encode(measured(name, failed)).decode() if as_json else str(failed))
        keep(name, lines, failure)
    return int(is_bad)


def named(place: str) -> Any:
    """The object that ``module:name`` names."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
