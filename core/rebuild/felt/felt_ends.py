"""Where an object ends that was felt: heights of touched ends, and how the side runs into them."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.ends import End, close_ends
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import FeltSkin

UPRIGHT = 0.9
"""Upward part of a normal from which on a taxel lies on the top."""
NOISES = 2.0
"""Standard deviations of a pose by which touches of one level top may differ."""
ROWS = 14
"""Rows from which an end is told."""
STRETCH = 0.15
"""Share of the side over which they lie."""


def felt_top(felt: FeltPoints, last: float, pose: float) -> float | None:
    """Height of the top, m; None if nobody touched it.

    Each touch's highest taxel errs by its pose, and the highest of many by the luckiest one's:
    so those that may be one height are averaged.

    Parameters
    ----------
    felt : FeltPoints
        All taxels.
    last : float
        Height of the last contour, m: what lies lower tells nothing of the top.
    pose : float
        Standard deviation of a touch's height, m.
    """
    if felt.normals is None:
        return None
    above = (felt.normals[:, 2] > UPRIGHT) & (felt.points[:, 2] > last)
    if not above.any():
        return None
    touch = felt.touch[above]
    highest = np.full(int(touch.max()) + 1, -np.inf)
    np.maximum.at(highest, touch, felt.points[above, 2])
    highest = highest[np.isfinite(highest)]
    return float(highest[highest >= highest.max() - NOISES * pose].mean())


def felt_end(
    skin: FeltSkin, turns: Floats, rim: float, inwards: float, end: float | None, noise: float
) -> End:
    """How the side goes on from its first or last row.

    Parameters
    ----------
    skin : FeltSkin
        The side.
    turns : (k,) array
        Of the rows.
    rim : float
        Height of that row, m.
    inwards : float
        Height of the side from there on, negative downwards, m.
    end : float or None
        Height at which it was touched, m.
    noise : float
        Standard deviation of a point of a row, m.
    """
    heights = np.sort(rim + STRETCH * inwards * np.arange(ROWS) / (ROWS - 1))
    grid = skin.rings(heights, turns)
    if inwards > 0.0:
        return close_ends(heights, grid, bottom=end, noise=noise, dense=True)[0]
    return close_ends(heights, grid, top=end, noise=noise, dense=True)[1]
