"""Axes that points suggest for a superquadric, the same whichever way the points are turned.

Principal axes find solids of unequal extents. Where extents are alike they find nothing, and the
fourth moments decide: those of a box are largest along its diagonals and smallest along its edges.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats

SWEEPS = 6
"""Of plane rotations; each is exact, and three or four end it."""
HALF = np.sqrt(0.5)
EIGHTH_TURN: Floats = np.array([[HALF, -HALF, 0.0], [HALF, HALF, 0.0], [0.0, 0.0, 1.0]])
ORDERS: Floats = np.stack([np.eye(3)[:, order] for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])])
"""Rotations that make each of three axes the z axis."""


def suggested_axes(points: Floats) -> Floats:
    """Axes in which to start, as columns.

    Parameters
    ----------
    points : (n, 3) array
        At least one; need not be centred.

    Returns
    -------
    (12, 3, 3) array
        Rotations: principal axes and these turned by 45 degrees, axes of the largest and of the
        smallest fourth moments; each with each axis as z.
    """
    centred = points - points.mean(axis=0)
    principal = principal_axes(centred)
    most = _quartic_axes(centred, principal, largest=True)
    least = _quartic_axes(centred, principal, largest=False)
    upright = np.stack([principal, most, least])[:, None] @ ORDERS
    eighths = upright[0] @ EIGHTH_TURN
    result: Floats = np.concatenate([upright[0], eighths, upright[1], upright[2]])
    return result


def principal_axes(centred: Floats) -> Floats:
    """Principal axes (3, 3) of points about the origin, the longest last; a rotation."""
    axes = np.linalg.eigh(centred.T @ centred)[1]
    result: Floats = axes if np.linalg.det(axes) > 0.0 else axes * [-1.0, 1.0, 1.0]
    return result


def _quartic_axes(centred: Floats, axes: Floats, *, largest: bool) -> Floats:
    """Turn axes until the sum of the fourth powers of the coordinates is largest or smallest.

    In a plane that sum is constant but for a cosine of four times the angle, so that the best
    turn of two axes is an arc tangent.
    """
    way = 1.0 if largest else -1.0
    for _ in range(SWEEPS):
        for i, j in ((0, 1), (1, 2), (0, 2)):
            x, y = centred @ axes[:, i], centred @ axes[:, j]
            u, v = x * x - y * y, 2.0 * x * y
            angle = 0.25 * np.arctan2(way * 2.0 * float(u @ v), way * float(u @ u - v @ v))
            turn = np.eye(3)
            turn[[i, j], [i, j]] = np.cos(angle)
            turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
            axes = axes @ turn
    return axes
