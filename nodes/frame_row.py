"""One tactile frame as a line of text: maybe a time, the pad's pose, and the taxels' values."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

POSE = 7
"""Numbers of a pose: x, y, z in m, and a quaternion x, y, z, w."""
LEAST, MOST = 4, 64
"""Rows or columns of an array."""
UNIT = 0.01
"""A quaternion may be rounded; its length is 1 within this."""
Shape = tuple[int, int]


class FrameRow(NamedTuple):
    """What a line says."""

    time: float | None
    """When the frame was taken, s; None if the line does not say."""
    pose: Floats
    """Pose of the pad, (7,), its quaternion of length 1."""
    image: Floats
    """What the taxels sent, (rows, cols)."""


def parse_row(text: str, where: str, shape: Shape | None) -> FrameRow:
    """The frame in a line.

    Parameters
    ----------
    text : str
        ``x,y,z,qx,qy,qz,qw``, then the values row by row; a time may come first.
    where : str
        Where the line stands, for complaints.
    shape : rows and columns, or None
        Of the array; None for a square one, as large as the line tells.

    Raises
    ------
    ValueError
        If the line has another number of columns, or one of them is no finite number, or the
        quaternion is none.
    """
    cells = text.split(",")
    shape = shape or square(len(cells))
    if shape is None:
        raise ValueError(
            f"{where}: has {len(cells)} columns; expected {POSE} of the pose and those of a square "
            "array, or say how many rows and columns it has"
        )
    wanted = POSE + shape[0] * shape[1]
    if len(cells) not in (wanted, wanted + 1):
        raise ValueError(
            f"{where}: has {len(cells)} columns; expected {wanted}: x,y,z,qx,qy,qz,qw and "
            f"{shape[0]} by {shape[1]} values, or one more with the time first"
        )
    values = _numbers(cells, where)
    time, rest = (float(values[0]), values[1:]) if len(cells) > wanted else (None, values)
    return FrameRow(time, unit_pose(rest[:POSE], where), rest[POSE:].reshape(shape))


def square(columns: int) -> Shape | None:
    """Rows and columns of the square array of a line with so many columns; None if there is none.

    With or without a time: no two squares from 4 by 4 on differ by one.
    """
    for rest in (columns - POSE, columns - POSE - 1):
        side = math.isqrt(max(rest, 0))
        if side * side == rest and LEAST <= side <= MOST:
            return side, side
    return None


def unit_pose(pose: Floats, where: str) -> Floats:
    """The pose with a quaternion of length 1.

    Raises
    ------
    ValueError
        If its length is another one, and not by rounding.
    """
    length = float(np.linalg.norm(pose[3:]))
    if not abs(length - 1.0) <= UNIT:
        raise ValueError(f"{where}: the quaternion has length {length:.3g}; expected 1")
    return np.concatenate([pose[:3], pose[3:] / length])


def is_header(text: str) -> bool:
    """Whether a line names columns, and is no frame."""
    return any(_is_word(cell) for cell in text.split(","))


def _is_word(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return bool(cell.strip())
    return False


def _numbers(cells: list[str], where: str) -> Floats:
    values = []
    for cell in cells:
        try:
            values.append(float(cell))
        except ValueError:
            values.append(math.nan)
        if not math.isfinite(values[-1]):
            shown = f"column {len(values)} is {cell.strip()!r:.40}"
            raise ValueError(f"{where}: {shown}; expected a finite number")
    return np.array(values)
