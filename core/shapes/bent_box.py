"""The part of a ray that lies in a bent box: a sector of a ring, of some thickness."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import LEAST_CURVATURE
from palpate.core.shapes.clip import ROOM, through_box
from palpate.core.shapes.first_root import Gap

NOWHERE = np.inf, -np.inf
EVERYWHERE = -np.inf, np.inf
LEAST_SQUARE = 1e-200
"""Stands for a vanishing coefficient of t^2, so that no quotient is 0 / 0."""


class Clipped(NamedTuple):
    """Where rays may meet what is in a bent box."""

    starts: Floats
    """Where they enter, at least 0, (n,), m; after the end for a ray that misses."""
    ends: Floats
    """Where they leave for good, (n,), m."""
    gaps: tuple[Gap, ...]
    """Where they are outside in between."""


def through_bent_box(
    origins: Floats, direction: Floats, half: Floats, curvature: float
) -> Clipped:
    """Where parallel rays enter and leave a box that was bent with its axis.

    Parameters
    ----------
    origins : (3, n) array
        Where the rays start, by coordinate: towards the centre of curvature, square to the
        bend's plane, up, m.
    direction : (3,) array
        Their unit direction.
    half : (3,) array
        Half the edges of the box before it was bent, m.
    curvature : float
        1/m; smaller than 1 over the first half edge and than pi over the last.
    """
    if abs(curvature) < LEAST_CURVATURE:
        return Clipped(*through_box(origins, direction, half), ())
    half = half * (1.0 + ROOM)
    outer, inner = _ring(origins, direction, float(half[0]), curvature)
    side = _between(origins[1], float(direction[1]), float(half[1]))
    starts = np.maximum(np.maximum(outer[0], side[0]), 0.0)
    ends = np.minimum(outer[1], side[1])
    above, below = _ends(origins, direction, float(half[2]), curvature)
    if abs(curvature) * half[2] < 0.5 * math.pi:
        starts = np.maximum(starts, np.maximum(above[0], below[0]))
        ends = np.minimum(ends, np.minimum(above[1], below[1]))
        return Clipped(starts, ends, (inner,))
    # More than half a circle: what is left out is a wedge, between the two ends.
    return Clipped(starts, ends, (inner, _gap(_meet(_rest(above), _rest(below)))))
