"""What touches felt of an end beyond the last row of the side: its edge, as mean radii.

Each felt point's distance from the axis is taken over that of the last row on its azimuth, so that
touches on any side of an oval or a box tell of one edge.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.ends.end_profiles import Beyond
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import FeltSkin

BINS = 12
"""Heights between the last row and the end at which points are averaged."""
LEAST_FACING = 0.2
"""Radial part of a normal: a point on a level face says nothing of the radius."""
SECTORS, FEWEST_SECTORS = 12, 4
"""Parts of a turn, and in how many of them points must be: one side alone may be a feature."""
REACH = 0.6
"""Of the way to the end: what was felt less far says the same of all ends, for they begin alike."""
NEARLY = 0.95
"""Of the way to the end: what was felt farther lies on it. A row of taxels over a sharp edge has
normals between both sides, and would pass for a rounding."""
WALL = 0.4
"""Mean radial part of the normals: where they lean over the end, nothing is an edge."""
TURNS = 192
"""At which the last row is taken."""


def felt_beyond(
    felt: FeltPoints, skin: FeltSkin, rim: float, end: float, radius: float, lean: Floats
) -> Beyond | None:
    """Mean radii between the last row and the end; None where too little was felt.

    Parameters
    ----------
    felt : FeltPoints
        With normals; as felt, for shifts that fit the smooth side would hide the edge.
    skin : FeltSkin
        The side.
    rim, end : float
        Heights of its last row, and of the end, m.
    radius : float
        Mean radius of that row, m.
    lean : (2,) array
        How far aside of that row's middle the end's middle lies, m.
    """
    assert felt.normals is not None
    sign = 1.0 if end > rim else -1.0
    depth = sign * (felt.points[:, 2] - rim)
    way = np.clip(depth / abs(end - rim), 0.0, 1.0)
    away = felt.points[:, :2] - skin.spine.at(felt.points[:, 2]) - way[:, None] * lean
    distance = np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)
    facing = np.einsum("ni,ni->n", felt.normals[:, :2], away) / distance
    told = (depth > 0.0) & (depth < NEARLY * abs(end - rim)) & (facing > LEAST_FACING)
    turns = np.mod(np.arctan2(away[told, 1], away[told, 0]) / (2.0 * np.pi), 1.0)
    at = np.arange(TURNS) / TURNS
    row = np.sqrt(skin.squared(np.array([rim]), at)[0])
    share = distance[told] / np.interp(turns, at, row, period=1.0)
    bins = np.minimum((depth[told] / abs(end - rim) * BINS).astype(int), BINS - 1)
    seen = np.zeros((BINS, SECTORS), np.bool_)
    seen[bins, (turns * SECTORS).astype(int)] = True
    enough = seen.sum(axis=1) >= FEWEST_SECTORS
    if not enough[int(REACH * BINS) :].any():
        return None

    def mean(values: Floats) -> Floats:
        sums = np.bincount(bins, values * facing[told], BINS)[enough]
        return np.asarray(sums / np.bincount(bins, facing[told], BINS)[enough])

    counts = np.bincount(bins, minlength=BINS)[enough]
    weights = np.bincount(bins, facing[told], BINS)[enough] / counts
    if weights.mean() < WALL:
        return None
    return Beyond(sign * rim + mean(depth[told]), radius * mean(share), weights)
