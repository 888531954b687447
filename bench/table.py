"""Rows of a table of figures, what is demanded of each, and the table printed as it is known."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any, NamedTuple, Protocol, TypeVar

Key = TypeVar("Key")
Found = TypeVar("Found")
WIDTH = 60  # Of a name, in letters


class Line(Protocol):
    """What a group yields: it is printed as text or as its fields in JSON."""

    @property
    def holds(self) -> bool:
        """Whether every demand on it is met."""
        ...

    def _asdict(self) -> dict[str, Any]: ...


class Row(NamedTuple):
    """One figure."""

    name: str  # What was measured
    value: str  # With its unit
    target: str = ""  # What is demanded; empty if nothing is
    holds: bool = True  # Whether it is met

    def __str__(self) -> str:
        line = f"{self.name:<{WIDTH}}{self.value:>14}  {self.target}"
        return line.rstrip() if self.holds else f"{line}   MISSED"


# Measures some figures, one at a time; fewer trials if told to be quick. Text is not of JSON.
Group = Callable[[bool], Iterable[Line | str]]


def at_most(name: str, value: float, most: float, form: str = ".2f", unit: str = "") -> Row:
    """A figure that may not be larger than this; `form` is the value's."""
    return Row(name, f"{value:{form}}{unit}", f"<= {_bound(most, form)}{unit}", value <= most)


def at_least(name: str, value: float, least: float, form: str = ".2f", unit: str = "") -> Row:
    """A figure that may not be smaller than this; `form` is the value's."""
    return Row(name, f"{value:{form}}{unit}", f">= {_bound(least, form)}{unit}", value >= least)


def _bound(value: float, form: str) -> str:
    return f"{100.0 * value:g}%" if form.endswith("%") else f"{value:g}"


class SilentWatcher:
    """Watches a graph and keeps nothing."""

    def ready(self, seconds: float) -> None:
        """All nodes are up."""

    def received(self, topic: str, message: object) -> None:
        """A message of a topic that is watched."""

    def log(self, record: object) -> None:
        """A node's log record."""

    def tick(self, statuses: Mapping[str, Any]) -> None:
        """Time has gone by."""


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


def in_turns(calls: Mapping[Key, Callable[[], Found]], turns: int) -> dict[Key, list[Found]]:
    """What each call returns in each turn: whatever else the machine does, all meet the same."""
    found: dict[Key, list[Found]] = {key: [] for key in calls}
    for _ in range(turns):
        for key, call in calls.items():
            found[key].append(call())
    return found


def run_groups(
    groups: Mapping[str, str],
    *,
    quick: bool,
    as_json: bool = False,
    echo: Callable[[str], None] = print,
) -> int:
    """Print figures, one a line, each as soon as it is known; 0 if every demand is met, else 1.

    `groups`: what to measure, ``module:function`` by name; a module is imported at its turn.
    `quick`: fewer trials. `as_json`: one JSON object a line, with the group's name.
    """
    missed = False
    for name, place in groups.items():
        if len(groups) > 1 and not as_json:
            echo(f"-- {name}")
        group: Group = named(place)
        for line in group(quick):
            missed = missed or not (isinstance(line, str) or line.holds)
            if not as_json:
                echo(str(line))
            elif not isinstance(line, str):
                echo(json.dumps({"group": name, **line._asdict()}, default=sorted))
    return int(missed)


def named(place: str) -> Any:
    """What ``module:name`` stands for."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)
