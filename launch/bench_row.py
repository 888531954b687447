"""One line of a table of figures."""

from __future__ import annotations

from typing import NamedTuple

WIDTH = 60
"""Of a name, in letters."""


class Row(NamedTuple):
    """One figure."""

    name: str
    """What was measured."""
    value: str
    """With its unit."""
    target: str
    """What is demanded; empty if nothing is."""
    holds: bool
    """Whether it is met."""

    def __str__(self) -> str:
        line = f"{self.name:<{WIDTH}}{self.value:>14}  {self.target}"
        return line.rstrip() if self.holds else f"{line}   MISSED"
