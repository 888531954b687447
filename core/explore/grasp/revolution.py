"""The axis about which a surface was turned, from its normals alone.

Every normal of a surface of revolution meets its axis; those of a screw surface have one pitch.
Both are linear in the axis's Pluecker coordinates, so that neither the profile nor where along it
the contacts lie matters: bottles, vases and steps are as good as cylinders.

Pottmann and Randrup, *Rotational and helical surface approximation for reverse engineering*, 1998.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

SWEEPS, PLACING = 25, 6
"""Of reweighting, and of these with the axis's direction held, until it has found its place."""
CUT = 3.0
"""Normals that miss the axis by more than this many standard deviations count for nothing: those
at edges, which are felt as something between their faces."""
ROUND = 0.015
"""Of the size: normals that miss an axis by more than this do not belong to it."""
QUIET = 5e-4
"""Of the size: no standard deviation is taken for smaller."""
RIDGE = 1e-6
"""Of the mean: the axis of a cylinder may slide along itself."""
PARAMETERS = 5
LEAST = 6
"""Contacts: an axis has four parameters, and a screw a fifth."""


class Revolution(NamedTuple):
    """An axis that normals meet."""

    axis: Floats
    """Unit vector (3,); its sign means nothing."""
    point: Floats
    """On the axis, nearest to the middle of the contacts, (3,), m."""
    error: float
    """Standard deviation of the axis's angle, rad; at most pi."""
    rms: float
    """Spread of the distances of normals from the axis, as a share of the contacts' size."""
    share: float
    """Share of the contacts whose normals meet it within `ROUND`."""
    lift: float
    """How fast normals leave another axis through the same point, as a share of the size for each
    radian of its turn: 0 for a ball."""


def revolution(points: Floats, normals: Floats, axes: Floats) -> Revolution:
    """The axis that most normals meet best.

    Parameters
    ----------
    points, normals : (n, 3) arrays
        At least 6, m, and unit vectors.
    axes : (k, 3) array
        Axes with which to start, beside three that the normals suggest.

    Raises
    ------
    ValueError
        If there are fewer than 6 contacts.
    """
    if len(points) < LEAST:
        raise ValueError(f"points must be at least {LEAST}, got {len(points)}")
    middle = points.mean(axis=0)
    centred = points - middle
    size = math.sqrt(float((centred**2).sum(axis=1).mean())) or 1.0
    lines = np.hstack([np.cross(centred / size, normals), normals])
    starts = [*_axes(lines, np.ones(len(lines)))[1].T, *axes]
    weights, scale, _ = min((_settle(lines, start) for start in starts), key=lambda one: one[2])
    spread, turned, slides = _axes(lines, weights)
    axis = turned[:, 0]
    beside = -slides @ axis
    missed = lines @ np.concatenate([axis, beside])
    total = float(weights.sum())
    variance = scale**2 * total / max(total - PARAMETERS, 1.0)
    lift = max(float(spread[1] - max(spread[0], 0.0)), 0.0)
    error = math.sqrt(variance / total / lift) if lift > 0.0 else math.pi
    return Revolution(
        axis,
        middle + size * np.cross(axis, beside),
        min(error, math.pi),
        scale,
        float((np.abs(missed) < ROUND).mean()),
        math.sqrt(lift),
    )


def _settle(lines: Floats, axis: Floats) -> tuple[Floats, float, float]:
    """Weights (n,) of the normals that meet an axis near this one, their spread, and its cost."""
    weights, scale, missed = np.ones(len(lines)), math.inf, np.zeros(len(lines))
    for sweep in range(SWEEPS):
        _, turned, slides = _axes(lines, weights)
        if sweep >= PLACING:
            axis = turned[:, 0]
        missed = lines @ np.concatenate([axis, -slides @ axis])
        scale = max(1.4826 * float(np.median(np.abs(missed))), QUIET)
        off = np.minimum(np.abs(missed) / (CUT * scale), 1.0)
        weights = (1.0 - off * off) ** 2
    # Not the least spread: half of the contacts may agree on an axis that the others refute.
    cost = float(np.minimum(np.abs(missed) / ROUND, 1.0).mean())
    return weights, scale, cost


def _axes(lines: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean square misses (3,) ascending, their axes as columns, and how the moment follows, (3, 3).

    The best moment of an axis a is -slides @ a; it leaves a problem in a alone.
    """
    square = (lines * weights[:, None]).T @ lines / max(float(weights.sum()), RIDGE)
    mixed, own = square[3:, :3], square[3:, 3:] + RIDGE * np.trace(square) / 6.0 * np.eye(3)
    slides = np.linalg.solve(own, mixed)
    spread, axes = np.linalg.eigh(square[:3, :3] - mixed.T @ slides)
    return spread, axes, slides
