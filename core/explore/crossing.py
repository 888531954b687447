"""Where a touched surface meets the slice: one point in each column of taxels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.pad import Pad

Indices = NDArray[np.intp]

STEEP = 2.0
"""Two neighbouring taxels belong to one surface if they differ by less than this many pitches."""
WINDOWS = ((-1, 4), (-2, 4), (0, 4), (-1, 3), (0, 3), (0, 2))
"""First row, counted from the one before the slice, and number of rows that a polynomial goes
through: the first window of which all rows are touched."""
MOST_ROWS = 4
AMPLE = 6
"""Columns with more than two rows that do without those that have two: a corner of the pad in a
hollow has few of either."""
ROUNDS = 3
"""Newton steps from the straight line's crossing: the next changes less than rounding."""


class Crossings(NamedTuple):
    """Where columns meet the slice, in their order."""

    places: Floats
    """Pad frame, (n, 3), m."""
    rows: Indices
    """The row before each, (n,)."""
    columns: Indices
    """Its column, (n,)."""


def _coefficients(first: int, count: int) -> Floats:
    """What gives a polynomial's coefficients from its values on the rows, (4, 4)."""
    nodes = first + np.arange(count)
    matrix = np.zeros((MOST_ROWS, MOST_ROWS))
    matrix[:count, :count] = np.linalg.inv(np.vander(nodes, increasing=True).astype(float))
    return matrix


_OF_WINDOW = np.stack([_coefficients(*window) for window in WINDOWS])


def crossings(pad: Pad, above: Floats, surface: Floats, touched: Bools) -> Crossings:
    """Where the surface meets the slice, at most once in each column.

    Parameters
    ----------
    pad : Pad
        The array.
    above : (rows, cols) array
        Height of the surface over the slice, m.
    surface : (rows, cols) array
        Surface over the plane of the pad's face, m.
    touched : (rows, cols) array of bool
        Where the pad touches.

    Notes
    -----
    A straight line between two rows stands off by up to an eighth of the curvature times the
    pitch squared, 4 um on a ball of 30 mm; a cubic through four rows by less than 0.1 um.
    """
    x, y = pad.grid()
    meets = (above[:-1] <= 0.0) != (above[1:] <= 0.0)
    row, col = np.nonzero(meets & one_surface(pad, surface, touched))
    rows, window = _windows(touched, row, col)
    row, col, rows, window = _curved(row, col, rows, window)
    share = above[row, col] / (above[row, col] - above[row + 1, col])
    rise, depth = (_polynomials(field, rows, col, window) for field in (above, surface))
    straight = share
    for _ in range(ROUNDS):
        value, slope = _values(rise, share)
        share = share - value / np.where(slope == 0.0, 1.0, slope)
    share = np.where((share >= 0.0) & (share <= 1.0), share, straight)
    up = y[row, col] + share * pad.pitch
    found = np.column_stack([x[row, col], up, _values(depth, share)[0]])
    order = np.lexsort((np.abs(found[:, 1]), col))
    first = np.ones(len(found), bool)
    first[1:] = np.diff(col[order]) > 0
    chosen = order[first]
    return Crossings(found[chosen], row[chosen], col[chosen])


def one_surface(pad: Pad, surface: Floats, touched: Bools) -> Bools:
    """Whether two neighbouring rows touch one surface, (rows - 1, cols)."""
    level: Bools = np.abs(surface[1:] - surface[:-1]) < STEEP * pad.pitch
    return touched[:-1] & touched[1:] & level


def _windows(touched: Bools, row: Indices, col: Indices) -> tuple[Indices, Indices]:
    """Rows (n, 4) of each crossing's polynomial, and the number of its window (n,)."""
    last = len(touched) - 1
    window = np.full(len(row), len(WINDOWS) - 1)
    for number in reversed(range(len(WINDOWS) - 1)):
        begin, count = WINDOWS[number]
        wanted = row[:, None] + begin + np.arange(count)
        inside = (wanted >= 0) & (wanted <= last)
        whole = (inside & touched[np.clip(wanted, 0, last), col[:, None]]).all(axis=1)
        window[whole] = number
    begins = np.array([begin for begin, _ in WINDOWS])[window]
    return np.clip((row + begins)[:, None] + np.arange(MOST_ROWS), 0, last), window


def _curved(
    row: Indices, col: Indices, rows: Indices, window: Indices
) -> tuple[Indices, Indices, Indices, Indices]:
    """The crossings without those that only a straight line goes through, if enough remain."""
    kept = window < len(WINDOWS) - 1
    if kept.sum() < AMPLE:
        return row, col, rows, window
    return row[kept], col[kept], rows[kept], window[kept]


def _polynomials(field: Floats, rows: Indices, col: Indices, window: Indices) -> Floats:
    """Coefficients (n, 4) along the rows, 0 at the row before the slice."""
    coefficients: Floats = np.einsum("nij,nj->ni", _OF_WINDOW[window], field[rows, col[:, None]])
    return coefficients


def _values(polynomials: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Values and slopes (n,) of polynomials (n, 4) at places (n,)."""
    a, b, c, d = polynomials.T
    return a + share * (b + share * (c + share * d)), b + share * (2.0 * c + share * 3.0 * d)
