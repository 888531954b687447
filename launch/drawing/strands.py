"""Wires, taken apart: what runs on to the right, what goes back, and in which lane each runs.

To the next column a strand runs straight. What goes further rises into a lane above all boxes,
what goes back sinks into one below, so that no line meets a box.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from palpate.launch.drawing.sketch import Wire, joined

Way = Literal["above", "straight", "loose", "below"]
"""Where a strand runs; a loose one ends where it begins, for nobody but sinks hears it."""
_ORDER: Mapping[Way, int] = {"above": 0, "straight": 1, "loose": 2, "below": 3}


@dataclass(frozen=True)
class Strand:
    """A wire, or the part of one, that runs one way."""

    wire: Wire
    """With the targets that it reaches this way."""
    way: Way
    """Where it runs."""
    column: int
    """Of its source."""
    reach: tuple[int, ...]
    """Columns of its targets, ascending."""
    row: int = 0
    """Its lane above or below; 0 is the one next to the boxes."""

    @cached_property
    def span(self) -> tuple[int, int]:
        """First and last gutter of its lane; gutter i is left of column i."""
        if self.way == "below":
            return self.reach[0], self.column + 1
        return self.column + 1, self.reach[-1]


def strands_of(wires: Sequence[Wire], column_of: Mapping[int, int]) -> list[Strand]:
    """Strands with their lanes, in the order of the wires."""
    ahead = [_part(wire, lambda a, b: b > a, column_of) for wire in wires]
    behind = [_part(wire, lambda a, b: b <= a, column_of) for wire in wires]
    kept = [
        part for part, wire in zip(ahead, wires, strict=True) if part.targets or not wire.targets
    ]
    strands = [_strand(wire, column_of, back=False) for wire in joined(kept)]
    back = joined(part for part in behind if part.targets)
    strands += [_strand(wire, column_of, back=True) for wire in back]
    return _with_rows(strands)


def ports_right(strands: Sequence[Strand], box: int) -> list[Strand]:
    """What leaves a box at its right side, from top to bottom, so that lines rarely cross."""
    own = [strand for strand in strands if strand.wire.source == box]
    return sorted(own, key=lambda strand: (_ORDER[strand.way], -strand.row))


def ports_left(strands: Sequence[Strand], box: int, column: int) -> list[Strand]:
    """What enters a box at its left side, from top to bottom, so that lines rarely cross."""

    def key(strand: Strand) -> tuple[int, int]:
        straight = strand.way != "below" and strand.column == column - 1
        if straight:
            return 1, _ORDER[strand.way]
        return (0, -strand.row) if strand.way == "above" else (2, -strand.row)

    return sorted((one for one in strands if box in one.wire.targets), key=key)


def _part(wire: Wire, runs: Callable[[int, int], bool], column_of: Mapping[int, int]) -> Wire:
    start = column_of[wire.source]
    return replace(wire, targets=tuple(t for t in wire.targets if runs(start, column_of[t])))


def _strand(wire: Wire, column_of: Mapping[int, int], *, back: bool) -> Strand:
    column = column_of[wire.source]
    reach = tuple(sorted({column_of[target] for target in wire.targets}))
    if not reach:
        return Strand(wire, "loose", column, reach)
    far: Way = "above" if reach[-1] > column + 1 else "straight"
    return Strand(wire, "below" if back else far, column, reach)


def _with_rows(strands: Sequence[Strand]) -> list[Strand]:
    """The strands, each with the lane next to the boxes that is free where it runs."""
    taken: dict[tuple[Way, int], list[tuple[int, int]]] = {}
    rows: dict[int, int] = {}
    in_lanes = [i for i, one in enumerate(strands) if one.way in ("above", "below")]
    # The shortest first: what goes far arches over what does not.
    for i in sorted(in_lanes, key=lambda i: strands[i].span[1] - strands[i].span[0]):
        way, (first, last) = strands[i].way, strands[i].span
        row = 0
        while any(a <= last and first <= b for a, b in taken.get((way, row), ())):
            row += 1
        taken.setdefault((way, row), []).append((first, last))
        rows[i] = row
    return [replace(one, row=rows.get(i, 0)) for i, one in enumerate(strands)]
