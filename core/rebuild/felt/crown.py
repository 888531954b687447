"""How high a domed end is that several touches felt, each off by the error of its pose.

The highest of them is the luckiest, and the others lie lower, for the end falls away. How it does
their taxels tell, whatever their poses: one quadric is fitted to all, with a shift of each touch.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.rebuild.felt.felt_points import FeltPoints

FACING = 0.995
"""Part of a normal along the axis from which on a taxel belongs to the crown."""
DEEP = 0.01
"""Of the extent: how far below the farthest taxel it still does."""
FEWEST = 3
"""Touches: of fewer, the highest is as good."""
SURER = 0.1
"""Taxels err so much less than the poses; the quadric may be as wrong."""


def crown_height(felt: FeltPoints, on: Bools, way: float) -> float | None:
    """How far an end reaches, along the axis in its own direction, m; None if few touched it.

    Parameters
    ----------
    felt : FeltPoints
        All taxels; with normals.
    on : (n,) array of bool
        Which of them lie on the end.
    way : float
        1 for the upper end, -1 for the lower one.
    """
    assert felt.normals is not None
    reach = way * felt.points[:, 2]
    deep = DEEP * float(np.ptp(reach))
    used = on & (way * felt.normals[:, 2] > FACING) & (reach > reach[on].max() - deep)
    touch, counts = np.unique(felt.touch[used], return_inverse=True)
    if len(touch) < FEWEST:
        return None
    places = felt.points[used, :2]
    middle = places.mean(axis=0)
    scale = max(float(np.abs(places - middle).max()), np.finfo(float).tiny)
    quadric = _quadric((places - middle) / scale)
    shifts = np.eye(len(touch))
    rows = np.block([[quadric, shifts[counts]], [np.zeros((len(touch), 6)), SURER * shifts]])
    right = np.concatenate([reach[used], np.zeros(len(touch))])
    found = np.linalg.lstsq(rows, right, rcond=None)[0]
    return float((quadric @ found[:6]).max())


def _quadric(places: Floats) -> Floats:
    """Monomials up to the second degree at places (n, 2), (n, 6)."""
    x, y = places.T
    return np.column_stack([np.ones(len(x)), x, y, x * x, x * y, y * y])
