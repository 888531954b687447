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
    slowness = 1.0 / np.where(np.abs(direction) < LEAST_DIRECTION, LEAST_DIRECTION, direction)
    middle = origins * -slowness[:, None]
    halfway = (np.abs(slowness) * half * (1.0 + ROOM))[:, None]
    x, y, z = middle - halfway
    starts = np.maximum(np.maximum(x, y), np.maximum(z, 0.0))
    x, y, z = middle + halfway
    return starts, np.minimum(np.minimum(x, y), z)
