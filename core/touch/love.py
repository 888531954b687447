"""Displacements of an elastic half-space under squares of uniform pressure."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.touch.pad import Pad


def displacements(pad: Pad) -> Floats:
    """Displacement of each taxel's middle under unit pressure on another, (n, n), m.

    The factor ``(1 - nu^2) / (pi E)`` is left out. Love, *The stress produced in a semi-infinite
    solid by pressure on part of the boundary*, 1929; Johnson, *Contact mechanics*, 1985, 3.3.
    """
    x = pad.pitch * np.arange(pad.cols, dtype=np.float64)[None, :]
    y = pad.pitch * np.arange(pad.rows, dtype=np.float64)[:, None]
    half = 0.5 * pad.pitch

    def corner(x: Floats, y: Floats) -> Floats:
        part: Floats = x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))
        return part

    table = corner(x + half, y + half) - corner(x - half, y + half)
    table += corner(x - half, y - half) - corner(x + half, y - half)
    row, col = np.divmod(np.arange(pad.rows * pad.cols), pad.cols)
    kernel: Floats = table[np.abs(row[:, None] - row), np.abs(col[:, None] - col)]
    return kernel
