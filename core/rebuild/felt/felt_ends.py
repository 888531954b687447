"""Where an object ends that was felt: heights of touched ends, and how the side runs into them."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.rebuild.ends.ends import End, close_ends
from palpate.core.rebuild.felt.crown import crown_height
from palpate.core.rebuild.felt.end_middle import with_felt_middle
from palpate.core.rebuild.felt.feet import feet_of
from palpate.core.rebuild.felt.felt_beyond import felt_beyond
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_skin import FeltSkin

FEW = 3
"""Level touches that tell the height of an end by themselves."""
UPRIGHT = 0.9
"""Part of a normal along the axis from which on a taxel lies on an end."""
NOISES, LEVEL_NOISES = 3.0, 4.0
"""Standard deviations by which a touch of one height may lie below the mean of higher ones; and of
level touches, which scatter, but do not fall away."""
ROWS = 14
"""Rows from which an end is told."""
STRETCH = 0.15
"""Share of the side over which they lie."""
LEANS = 0.15
"""Of the last row's radius: an end whose middle lies farther aside of where the rows lead is seen
about its own axis."""


def touched_end(
    felt: FeltPoints, last: float, way: float, pose: float | None, given: float | None
) -> float | None:
    """Height of an end, m, from the taxels that touched it; as given, if none did.

    Each touch errs by its pose, and the farthest of many by the luckiest one's: so those that may
    be one height are averaged, from the highest on.

    Parameters
    ----------
    felt : FeltPoints
        All taxels.
    last : float
        Height of the last contour, m: what does not lie beyond tells nothing of the end.
    way : float
        1 for the upper end, -1 for the lower one.
    pose : float or None
        Standard deviation of a touch's height, m; None if there is no noise to be seen.
    given : float or None
        Height at which the end was touched by whatever means, m.
    """
    beyond = on_end(felt, last, way)
    if not beyond.any():
        return given
    within = NOISES * (pose or 0.0)
    level, others = _touched_heights(felt, beyond, way)
    told = _one_height(np.concatenate([level, others]), within)
    # Level touches decide if nothing that was felt reaches over them.
    is_level = len(level) >= FEW and told <= float(level.max()) + within
    found = told
    if is_level:
        found = _one_height(level, LEVEL_NOISES * (pose or 0.0))
    elif pose is not None:
        crown = crown_height(felt, beyond, way)
        found = told if crown is None else crown
    farthest = float((way * felt.points[beyond, 2]).max())
    if given is None or way * given <= farthest:
        return way * found
    # Without noise the farthest is the truest; with it, the mean of what may be one height.
    is_one = pose is not None and way * given - found <= within
    return way * (found if is_one else max(found, way * given))


def _touched_heights(felt: FeltPoints, beyond: Bools, way: float) -> tuple[Floats, Floats]:
    """How far touches of an end say that it reaches, m: level ones, and others.

    A level touch says it by all its taxels, another by the farthest; one across an edge says
    nothing, nor do a few taxels beside whole touches.
    """
    heights = np.full(int(felt.touch.max()) + 1, -np.inf)
    np.maximum.at(heights, felt.touch[beyond], way * felt.points[beyond, 2])
    feet = [one for one in feet_of(felt, way) if np.isfinite(heights[one.touch])]
    level = [way * float(one.place[2]) for one in feet if one.level]
    others = [float(heights[one.touch]) for one in feet if one.kind != "edge" and not one.level]
    if not level and not others:
        return np.zeros(0), heights[np.isfinite(heights)]
    return np.array(level), np.array(others)


def _one_height(heights: Floats, within: float) -> float:
    """Mean of the highest and of those that each lie within so much of the mean of higher ones."""
    falling = np.sort(heights)[::-1]
    means = np.cumsum(falling) / np.arange(1, len(falling) + 1)
    beyond = np.flatnonzero(falling[1:] < means[:-1] - within)
    return float(means[beyond[0] if len(beyond) else -1])


def on_end(felt: FeltPoints, last: float, way: float) -> Bools:
    """Which taxels (n,) lie on an end, way 1 or -1, beyond the last contour at a height, m."""
    if felt.normals is None:
        return np.zeros(len(felt.points), np.bool_)
    found: Bools = (way * felt.normals[:, 2] > UPRIGHT) & (way * (felt.points[:, 2] - last) > 0.0)
    return found


def felt_end(
    felt: FeltPoints,
    skin: FeltSkin,
    turns: Floats,
    rim: float,
    inwards: float,
    end: float | None,
    noise: float,
) -> End:
    """How the side goes on from its first or last row.

    Parameters
    ----------
    felt : FeltPoints
        All taxels.
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
    row = grid[0 if inwards > 0.0 else -1]
    radius = float(np.sqrt(np.mean(np.sum((row - area_centroid(row)) ** 2, axis=1))))

    def closed(lean: Floats) -> End:
        beyond = None if end is None else felt_beyond(felt, skin, rim, end, radius, lean)
        if inwards > 0.0:
            below = beyond, None
            ends = close_ends(heights, grid, bottom=end, noise=noise, dense=True, beyond=below)
            return with_felt_middle(ends[0], row, felt)
        above = None, beyond
        ends = close_ends(heights, grid, top=end, noise=noise, dense=True, beyond=above)
        return with_felt_middle(ends[1], row, felt)

    ahead = _lean(heights, grid) * (0.0 if end is None else end - rim)
    first = closed(ahead)
    lean = first.middle - area_centroid(row)
    if end is None or float(np.hypot(*(lean - ahead))) < LEANS * radius:
        return first
    return closed(lean)


def _lean(heights: Floats, grid: Floats) -> Floats:
    """By how much the middles of rows (m, k, 2) move aside along the height, (2,)."""
    away = heights - heights.mean()
    middles = np.array([area_centroid(ring) for ring in grid])
    lean: Floats = away @ middles / float(away @ away)
    return lean
