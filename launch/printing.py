"""What is printed: aligned tables, titled blocks of 80 columns, and figures with units.

All of it is plain text, on a terminal as in a pipe. Rich is imported when a table is made.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Sequence
from typing import Literal

TEXT_WIDTH = 80  # Columns of what is printed; no number and no path is broken
MAX_INDENT = 60  # Columns before the last cell of a row: beyond it a long one stands below
TITLE_WIDTH = 11  # Columns before the parts of a block
GAP = "  "  # Between two columns, and between two parts of a block


def text_table(
    rows: Sequence[Sequence[str]], right: Collection[int] = (), least: Sequence[int] = ()
) -> list[str]:
    """Rows of cells, the heads first, as lines in which columns are aligned.

    Columns whose numbers are in `right` stand to the right, as numbers do; `least` is the least
    width of each. What a row lacks at its end is empty. A last cell of words is broken between them
    so that lines have 80 columns; if that is not enough, the columns beyond stand below each row.
    """
    lines = _table_lines(rows, right, least)
    if max(map(len, lines), default=0) <= TEXT_WIDTH:
        return lines
    columns = max(map(len, rows))
    full = [[*row, *[""] * (columns - len(row))] for row in rows]
    found: list[list[str]] = [[] for _ in rows]
    for begin, end in _column_groups([max(map(len, cells)) for cells in zip(*full, strict=True)]):
        part = [one - begin for one in right if begin <= one < end]
        blank = " " * 4 if begin else ""
        grid = _grid([row[begin:end] for row in full], part, least[begin:end])
        for below, line in zip(found, grid, strict=True):
            below += [f"{blank}{line}"] if len(line) < TEXT_WIDTH - 4 else _wrapped(line, blank)
    return [line for below in found for line in below if line.strip()]


def _wrapped(line: str, blank: str) -> list[str]:
    return textwrap.wrap(
        line,
        TEXT_WIDTH,
        initial_indent=blank,
        subsequent_indent=" " * 8,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _column_groups(widths: Sequence[int]) -> list[tuple[int, int]]:
    """Columns that fit side by side, by the first and the one after the last."""
    groups, begin, used = [], 0, 0
    for place, width in enumerate(widths):
        if used and used + len(GAP) + width > TEXT_WIDTH - (4 if begin else 0):
            groups.append((begin, place))
            begin, used = place, 0
        used += width + (len(GAP) if used else 0)
    return [*groups, (begin, len(widths))]


def _table_lines(
    rows: Sequence[Sequence[str]], right: Collection[int], least: Sequence[int]
) -> list[str]:
    lines = _grid(rows, right, least)
    return [
        piece for line, row in zip(lines, rows, strict=True) for piece in _folded(line, row[-1])
    ]


def _grid(rows: Sequence[Sequence[str]], right: Collection[int], least: Sequence[int]) -> list[str]:
    """A line a row, however long."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, len(GAP), 0, 0))
    for column, width in enumerate([*least, *[0] * (max(map(len, rows)) - len(least))]):
        side: Literal["left", "right"] = "right" if column in right else "left"
        grid.add_column(justify=side, min_width=width, no_wrap=True)
    for row in rows:
        grid.add_row(*(Text(cell.replace("\t", " ")) for cell in row))
    console = Console(width=1_000_000, no_color=True, force_terminal=False)
    with console.capture() as printed:
        console.print(grid)
    return [line.rstrip() for line in printed.get().splitlines()]


def _folded(line: str, last: str) -> list[str]:
    """A line of a table whose last cell, if it is long, goes on below it, or stands below."""
    begins = len(line) - len(last.rstrip())
    if len(line) <= TEXT_WIDTH or " " not in last:
        return [line]
    head, indent = ("", begins) if begins <= MAX_INDENT else (line[:begins].rstrip(), 4)
    rest = textwrap.wrap(last, TEXT_WIDTH - indent, break_long_words=False, break_on_hyphens=False)
    lines = [f"{'':{indent}}{piece}" for piece in rest]
    return [head, *lines] if head else [line[:begins] + rest[0], *lines[1:]]


def titled(title: str, *parts: str, width: int = TITLE_WIDTH) -> list[str]:
    """Parts behind a title, in lines of 80 columns that break between parts where they can.

    A part longer than a line is broken between its words; `width` columns stand before them.
    """
    lines = [""]
    for part in parts:
        joined = f"{lines[-1]}{GAP}{part}" if lines[-1] else part
        if len(joined) <= TEXT_WIDTH - width or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(part)
    broken = [
        piece
        for line in lines
        for piece in textwrap.wrap(
            line, TEXT_WIDTH - width, break_long_words=False, break_on_hyphens=False
        )
    ]
    heads = [title, *[""] * len(broken)]
    return [f"{head:<{width}}{piece}" for head, piece in zip(heads, broken or [""], strict=False)]


def counted(count: int, one: str, more: str = "") -> str:
    """A number of things: ``1 touch``, ``3 touches``."""
    return f"{count} {one if count == 1 else more or f'{one}s'}"


def millimetres(metres: float) -> str:
    """A length to a micrometre, in mm."""
    return f"{1000.0 * metres:.3f} mm"


def size_text(size: int) -> str:
    """A number of bytes in the unit that suits it."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size} B"
