"""One line of a table of figures, with what is demanded of it.

And the table printed as it becomes known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

WIDTH = 60  # Of a name, in letters


class Row(NamedTuple):
    """One figure."""

    name: str  # What was measured
    value: str  # With its unit
    target: str  # What is demanded; empty if nothing is
    holds: bool  # Whether it is met

    def __str__(self) -> str:
        line = f"{self.name:<{WIDTH}}{self.value:>14}  {self.target}"
        return line.rstrip() if self.holds else f"{line}   MISSED"


# Measures some figures, one at a time; fewer trials if told to be quick.
Group = Callable[[bool], Iterable[Row]]


def print_groups(groups: Iterable[Group], *, quick: bool, echo: Callable[[str], None]) -> int:
    """Print figures, one a line, each as soon as it is known.

    Parameters
    ----------
    groups : iterable of groups
        What to measure.
    quick : bool
        Fewer trials.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every demand is met, else 1.
    """
    missed = False
    for group in groups:
        for row in group(quick):
            missed = missed or not row.holds
            echo(str(row))
    return int(missed)
