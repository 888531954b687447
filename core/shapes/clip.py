"""The part of a ray that lies in an upright box."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats

LEAST_DIRECTION = 1e-200
"""Stands for a direction of 0, so that no division by it is 0 / 0 or overflows."""
ROOM = 1e-12
"""Share by which the box is widened: what lies in its faces is in it."""


def through_box(origins: Floats, direction: Floats, half: Floats) -> tuple[Floats, Floats]:
    """Where parallel rays enter and leave a box about the origin.

    Parameters
    ----------
    origins : (3, n) array
        Where the rays start, by coordinate, m.
    direction : (3,) array
        Their direction.
    half : (3,) array
        Half the box's edges, m.

    Returns
    -------
    starts, ends : (n,) arrays
        Ranges, at least 0; a ray that misses the box starts after its end.
    """
    away = direction < 0
    towards = np.where(away, np.minimum(direction, -LEAST_DIRECTION), direction)
    towards = np.where(away, towards, np.maximum(towards, LEAST_DIRECTION))
    near = np.where(away, half, -half) * (1.0 + ROOM)
    entries = (near[:, None] - origins) / towards[:, None]
    exits = (-near[:, None] - origins) / towards[:, None]
    return np.maximum(entries.max(axis=0), 0.0), exits.min(axis=0)
