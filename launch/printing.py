"""Printed text: aligned tables, titled blocks of 80 columns, and figures with units.

It is plain text, in a terminal as in a pipe. Rich is imported when a table is made.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Sequence
from typing import Literal

TEXT_WIDTH = 80  # [columns] of printed lines; numbers and paths are never broken
TITLE_WIDTH = 11  # [columns] of the titles of blocks
GAP = "  "  # between two columns, and between two parts of a block


def text_table(
    rows: Sequence[Sequence[str]], right: Collection[int] = (), min_widths: Sequence[int] = ()
) -> list[str]:
    """Rows of cells, the heads first, as lines with aligned columns.

    Columns with numbers in `right` are aligned to the right; `min_widths` are minimum widths of the
    first columns. Missing cells at the end of a row are empty. A last cell of words is broken
    between words so that lines have 80 columns; if that is not enough, further columns are put on
    lines below each row.
    """
    lines = _table_lines(rows, right, min_widths)
    if max(map(len, lines), default=0) <= TEXT_WIDTH:
        return lines
    columns = max(map(len, rows))
    full = [[*row, *[""] * (columns - len(row))] for row in rows]
    row_lines: list[list[str]] = [[] for _ in rows]
    for begin, end in _column_groups([max(map(len, cells)) for cells in zip(*full, strict=True)]):
        part = [column - begin for column in right if begin <= column < end]
        indent = " " * 4 if begin else ""
        grid = _grid([row[begin:end] for row in full], part, min_widths[begin:end])
        for its_lines, line in zip(row_lines, grid, strict=True):
            is_short = len(line) < TEXT_WIDTH - 4
            its_lines += [f"{indent}{line}"] if is_short else _wrapped(line, indent)
    return [line for its_lines in row_lines for line in its_lines if line.strip()]


def _wrapped(line: str, indent: str) -> list[str]:
    return textwrap.wrap(
        line,
        TEXT_WIDTH,
        initial_indent=indent,
        subsequent_indent=" " * 8,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _column_groups(widths: Sequence[int]) -> list[tuple[int, int]]:
    """Groups of columns that fit side by side: the first of each, and the one after the last."""
    groups, begin, used = [], 0, 0
    for column, width in enumerate(widths):
        if used and used + len(GAP) + width > TEXT_WIDTH - (4 if begin else 0):
            groups.append((begin, column))
            begin, used = column, 0
        used += width + (len(GAP) if used else 0)
    return [*groups, (begin, len(widths))]


def _table_lines(
    rows: Sequence[Sequence[str]], right: Collection[int], min_widths: Sequence[int]
) -> list[str]:
    lines = _grid(rows, right, min_widths)
    return [
        piece for line, row in zip(lines, rows, strict=True) for piece in _folded(line, row[-1])
    ]


def _grid(
    rows: Sequence[Sequence[str]], right: Collection[int], min_widths: Sequence[int]
) -> list[str]:
    """One line for each row, of any length."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, len(GAP), 0, 0))
    further = max(map(len, rows)) - len(min_widths)
    for column, width in enumerate([*min_widths, *[0] * further]):
        side: Literal["left", "right"] = "right" if column in right else "left"
        grid.add_column(justify=side, min_width=width, no_wrap=True)
    for row in rows:
        grid.add_row(*(Text(cell.replace("\t", " ")) for cell in row))
    console = Console(width=1_000_000, no_color=True, force_terminal=False)
    with console.capture() as printed:
        console.print(grid)
    return [line.rstrip() for line in printed.get().splitlines()]


def _folded(line: str, last: str, max_indent: int = 60) -> list[str]:
    """A line of a table whose last cell is wrapped if the line is too long.

    Further lines are aligned with the cell; if it begins beyond `max_indent` columns, the whole
    cell is put on separate lines.
    """
    begins = len(line) - len(last.rstrip())
    if len(line) <= TEXT_WIDTH or " " not in last:
        return [line]
    head, indent = ("", begins) if begins <= max_indent else (line[:begins].rstrip(), 4)
    rest = textwrap.wrap(last, TEXT_WIDTH - indent, break_long_words=False, break_on_hyphens=False)
    lines = [f"{'':{indent}}{piece}" for piece in rest]
    return [head, *lines] if head else [line[:begins] + rest[0], *lines[1:]]


def titled(title: str, *parts: str, width: int = TITLE_WIDTH) -> list[str]:
    """A title and parts, in lines of 80 columns that break between parts where they can.

    A part longer than a line is broken between words. The title takes `width` columns.
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


def counted(count: int, singular: str, plural: str = "") -> str:
    """A number with its noun: ``1 touch``, ``3 touches``."""
    return f"{count} {singular if count == 1 else plural or f'{singular}s'}"


def millimetres(metres: float) -> str:
    """A length [m] in mm, to a micrometre."""
    return f"{1000.0 * metres:.3f} mm"


def size_text(size: int) -> str:
    """A number of bytes, in GB, MB, kB or B."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size} B"
