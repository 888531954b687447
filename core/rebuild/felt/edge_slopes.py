"""Slopes of a touched patch where an edge runs through it, which no smooth surface follows.

Each taxel has the slopes of the plane, through a small square of taxels with it among them, that
fits best: of those on its own side of the edge (Nagao and Matsuyama, *Edge preserving smoothing*,
1979, who take the square that varies least). Where none fits, nobody can say how it leans.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from palpate.core.arrays import Bools, Floats

SIDE = 3
"""Taxels along the side of a square."""
WORSE, LEAST = 3.0, 0.02
"""An edge is where a smooth surface leaves the taxels of a square by so many times more than its
plane does, and by this share of the pitch besides, which is more than their noise."""
UNLIKE = 6.0
"""How a taxel leans is unknown if neither plane nor smooth surface follows it to within so many
times what planes leave of most taxels, and the same share of the pitch."""


class EdgeSlopes(NamedTuple):
    """Of each taxel of an array (rows, cols)."""

    slope_x: Floats
    """Along the columns."""
    slope_y: Floats
    """Along the rows."""
    edge: Bools
    """Where they are to be believed rather than the smooth surface's."""
    unknown: Bools
    """Where neither is to be believed."""


def edge_slopes(surface: Floats, smooth: Floats, touched: Bools, pitch: float) -> EdgeSlopes:
    """Slopes next to edges.

    Parameters
    ----------
    surface, smooth : (rows, cols) arrays
        Heights of the taxels, and of a smooth surface fitted to them, m.
    touched : (rows, cols) array of bool
        Which taxels count.
    pitch : float
        Distance of neighbouring taxels, m.
    """
    nowhere = np.zeros(surface.shape)
    if min(surface.shape) < SIDE:
        none = np.zeros(surface.shape, np.bool_)
        return EdgeSlopes(nowhere, nowhere, none, none)
    steps = pitch * (np.arange(SIDE) - SIDE // 2)
    squares = sliding_window_view(np.where(touched, surface, np.nan), (SIDE, SIDE))
    missed = sliding_window_view(np.where(touched, surface - smooth, np.nan), (SIDE, SIDE))
    spread = SIDE * float(steps @ steps)
    along_x = np.einsum("ijkl,l->ij", squares, steps) / spread
    along_y = np.einsum("ijkl,k->ij", squares, steps) / spread
    plane = along_y[..., None, None] * steps[:, None] + along_x[..., None, None] * steps
    left = squares - squares.mean(axis=(2, 3), keepdims=True) - plane
    off = np.where(np.isnan(along_x), np.inf, np.sqrt(np.mean(left**2, axis=(2, 3))))
    smooth_off = np.sqrt(np.mean(missed**2, axis=(2, 3)))
    best = _best_square(off)
    chosen, followed = off.ravel()[best], smooth_off.ravel()[best]
    found = touched & np.isfinite(chosen)
    edge = found & (followed > WORSE * chosen + LEAST * pitch)
    alone = np.abs(surface - smooth)
    known = chosen[found] if found.any() else alone[touched]
    usual = float(np.median(known)) if known.size else 0.0
    left = np.where(found, np.fmin(chosen, followed), alone)
    unknown = touched & ~edge & (left > UNLIKE * usual + LEAST * pitch)
    return EdgeSlopes(along_x.ravel()[best], along_y.ravel()[best], edge, unknown)


def _best_square(off: Floats) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """For each taxel, the number of the square with it in which `off` (a, b) is least."""
    rows, cols = off.shape
    around = np.pad(off, SIDE - 1, constant_values=np.inf)
    numbers = np.pad(np.arange(rows * cols).reshape(rows, cols), SIDE - 1)
    choices = sliding_window_view(around, (SIDE, SIDE)).reshape(
        rows + SIDE - 1, cols + SIDE - 1, -1
    )
    numbers = sliding_window_view(numbers, (SIDE, SIDE)).reshape(choices.shape)
    return np.take_along_axis(numbers, choices.argmin(axis=2)[..., None], axis=2)[..., 0]
