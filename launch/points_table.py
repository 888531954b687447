"""Points in a text file: one a line, with a header that names the columns, or x, y and z alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.launch.bounded_file import read_bounded
from palpate.launch.located import InputError

MAX_BYTES = 256 << 20
"""Largest file."""
PLACE, NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
CONTOUR, TOUCH = "contour", "touch"
KNOWN = (*PLACE, CONTOUR, *NORMAL, TOUCH)
"""Columns that mean something; others are passed over."""
MOST_NUMBER = 2**31 - 1
"""Largest number of a contour or a touch."""
SHOWN = 6
"""Most line numbers in a sentence."""


class Table(NamedTuple):
    """The known columns of a file, without the rows that are not finite."""

    columns: dict[str, Floats]
    """(n,) each, by name."""
    lines: Sequence[int]
    """Line of each row."""
    notes: tuple[str, ...]
    """What was left out."""


def read_table(path: Path) -> Table:
    """The columns of a text file.

    Parameters
    ----------
    path : Path
        UTF-8, parted by commas, semicolons, tabs or blanks; ``#`` begins a comment.

    Raises
    ------
    InputError
        If the file cannot be read, lacks x, y or z, or a line is no row of it.
    """
    rows = list(_rows(path))
    if not rows:
        raise InputError(f"{path}: holds no points")
    number, first = rows[0]
    mark = next((mark for mark in (",", ";", "\t") if mark in first), None)
    names = [name.strip().strip('"').lower() for name in first.split(mark)]
    named = any(_number(name) is None for name in names)
    if named:
        rows = rows[1:]
    elif len(names) == len(PLACE):
        names = list(PLACE)
    else:
        raise InputError(
            f"{path}:{number}: has {len(names)} columns and no header; name them, "
            f"as in {','.join(PLACE)},{CONTOUR}"
        )
    _check_names(f"{path}:{number}", names)
    if not rows:
        raise InputError(f"{path}:{number}: holds no points under its header")
    values = np.array([_values(path, line, text, mark, names) for line, text in rows])
    return _finite(names, values, [line for line, _ in rows])


def _rows(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that say something, with their numbers from 1."""
    data = read_bounded(path, MAX_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{path}:{line}: is no text in UTF-8") from None
    for number, row in enumerate(text.splitlines(), start=1):
        said = row.partition("#")[0].strip()
        if said:
            yield number, said


def _check_names(place: str, names: Sequence[str]) -> None:
    missing = [name for name in PLACE if name not in names]
    if missing:
        raise InputError(f"{place}: lacks the column {missing[0]}; known: {', '.join(KNOWN)}")
    twice = [name for name in KNOWN if names.count(name) > 1]
    if twice:
        raise InputError(f"{place}: has the column {twice[0]} more than once")
    some = [name for name in NORMAL if name in names]
    if 0 < len(some) < len(NORMAL):
        raise InputError(f"{place}: has {', '.join(some)} alone; nx, ny and nz belong together")


def _values(
    path: Path, line: int, text: str, mark: str | None, names: Sequence[str]
) -> list[float]:
    cells = text.split(mark)
    if len(cells) != len(names):
        raise InputError(f"{path}:{line}: has {len(cells)} columns where {len(names)} are named")
    values = []
    for name, cell in zip(names, cells, strict=True):
        value = _number(cell.strip().strip('"')) if name in KNOWN else 0.0
        if value is None:
            raise InputError(f"{path}:{line}: {name} must be a number, got {cell.strip()!r:.40}")
        if name in (CONTOUR, TOUCH) and math.isfinite(value):
            if value != int(value):
                raise InputError(f"{path}:{line}: {name} must be a whole number, got {value:g}")
            if abs(value) > MOST_NUMBER:
                raise InputError(
                    f"{path}:{line}: {name} must be at most {MOST_NUMBER}, got {value:g}"
                )
        values.append(value)
    return values


def _finite(names: Sequence[str], values: Floats, lines: Sequence[int]) -> Table:
    """Without the rows that are not finite, and a sentence about them."""
    good: Bools = np.asarray(np.isfinite(values).all(axis=1))
    left = [line for line, kept in zip(lines, good.tolist(), strict=True) if not kept]
    notes: tuple[str, ...] = ()
    if left:
        shown = ", ".join(str(line) for line in left[:SHOWN])
        more = f" and {len(left) - SHOWN} more" if len(left) > SHOWN else ""
        one = len(left) == 1
        notes = (
            f"left out {len(left)} point{'' if one else 's'} not finite, "
            f"line{'' if one else 's'} {shown}{more}",
        )
    columns = {name: values[good, names.index(name)] for name in KNOWN if name in names}
    return Table(
        columns, [line for line, kept in zip(lines, good.tolist(), strict=True) if kept], notes
    )


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
