"""Where a solid that is known by a function lies deepest, and whether it is there at all."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats

GRID = 17
"""Points along each axis of the first look."""
NEAR_GRID = 5
ROUNDS = 40
SHRINKAGE = 0.7
"""Of the box that is looked at next."""
CONCURRENT = 1e-9
PARALLEL = 1e-9


def deepest(level: Callable[[Floats], Floats], box: Floats, planes: Floats) -> tuple[Floats, float]:
    """Point at which a function is least, and its value there.

    Parameters
    ----------
    level : function
        Values (n,) at points (n, 3).
    box : (2, 3) array
        Where to look, m.
    planes : (n, 4) array
        Planes a x + b y + c z + d = 0 in whose common points the function may be least.

    Notes
    -----
    A grid, then ever smaller boxes about the best point. Powers below 1 are least in corners
    of the planes' arrangement, which are looked at as they are.
    """
    points = np.concatenate([_grid(box, GRID), _corners(planes)])
    points = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
    best, least = _best(level, points, box.mean(axis=0), np.inf)
    half = np.ptp(box, axis=0) / (GRID - 1)
    for _ in range(ROUNDS):
        near = np.clip(_grid(np.stack([best - half, best + half]), NEAR_GRID), *box)
        best, least = _best(level, near, best, least)
        half = SHRINKAGE * half
    return best, least


def in_one_point(planes: Floats) -> bool:
    """Whether all planes (n, 4) go through one point."""
    scaled = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    point = np.linalg.lstsq(scaled[:, :3], -scaled[:, 3], rcond=None)[0]
    missed = np.abs(scaled[:, :3] @ point + scaled[:, 3])
    # Compared with the strips' widths, which are 1 / |(a, b, c)|.
    return bool((missed * np.linalg.norm(planes[:, :3], axis=1) < CONCURRENT).all())


def _best(
    level: Callable[[Floats], Floats], points: Floats, best: Floats, least: float
) -> tuple[Floats, float]:
    values = level(points)
    lowest = int(values.argmin())
    return (points[lowest], float(values[lowest])) if values[lowest] < least else (best, least)


def _grid(box: Floats, count: int) -> Floats:
    axes = np.linspace(box[0], box[1], count).T
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _corners(planes: Floats) -> Floats:
    """Points in which three planes meet."""
    three = np.array(list(itertools.combinations(range(len(planes)), 3)))
    unit = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    matrices = unit[three]
    meet = np.abs(np.linalg.det(matrices[:, :, :3])) > PARALLEL
    found: Floats = np.linalg.solve(matrices[meet, :, :3], -matrices[meet, :, 3:])[:, :, 0]
    return found
