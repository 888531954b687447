"""Where rays are inside a solid: Roth, *Ray casting for modeling solids*, 1982.

The spans of n rays are an array (n, k, 2) of begins and ends, in order along each ray, from
where it starts on: a ray that starts inside has a first span that begins at -inf. Spans that
are not there begin and end at inf.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.certain_march import Below, certain_first_roots
from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape, Mesh

MOST_SPANS = 64
"""On one ray; the surface behind the last is not seen."""
NUDGE = 1e4
"""Tolerances between a surface and where the next one is looked for: spans, and gaps between
them, that are thinner are left out."""


class Solid(Protocol):
    """A solid that knows where rays enter it and leave it, and on which side a point lies.

    It need not be bounded: its enclosure may be infinite.
    """

    def enclosure(self) -> Floats:
        """Corners of an upright box that holds the solid, (2, 3), perhaps infinite, m."""

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """A function that is negative inside: see `ImplicitShape.inside_out`."""

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays from origins (n, 3) are inside, (n, k, 2), m."""


class BoundedSolid(Solid, Protocol):
    """A solid that can be meshed."""

    def mesh(self, level: int) -> Mesh:
        """A tessellation: see `Shape.mesh`."""


def convex_spans(shape: ImplicitShape, origins: Floats, direction: Floats) -> Floats:
    """The one span of each ray in a convex solid, (n, 1, 2): a cast forwards and one back."""
    low, high = shape.enclosure()
    farthest = np.where(direction > 0.0, high, low) @ direction
    size = float(np.linalg.norm(high - low))
    spans = np.full((len(origins), 1, 2), np.inf)
    begin = shape.cast(origins, direction, np.inf)
    met = np.flatnonzero(begin < MISS)
    origins, begin = origins[met], begin[met]
    far = farthest - origins @ direction + 0.01 * size
    end = far - shape.cast(origins + far[:, None] * direction, -direction, np.inf)
    thick = (end > np.maximum(begin, 0.0)) & np.isfinite(end)
    spans[met[thick], 0] = np.column_stack([begin, end])[thick]
    return spans


def marched_spans(
    entering: Below, leaving: Below, starts: Floats, ends: Floats, tolerance: float
) -> Floats:
    """Spans found by going from surface to surface.

    Parameters
    ----------
    entering, leaving : functions
        Bounds from below of a function that is negative inside, and of its negative.
    starts, ends : (n,) arrays
        The part of each ray in which the solid lies, from 0 on; outside it the ray is outside.
    tolerance : float
        How exactly ranges are wanted, m.

    Returns
    -------
    (n, k, 2) array
        At most 64 spans on each ray.
    """
    found: list[Floats] = []
    rows = np.flatnonzero(starts <= ends)
    places = starts[rows]
    for _ in range(MOST_SPANS):
        if not len(rows):
            break
        begin = certain_first_roots(_of(entering, rows), places, ends[rows], tolerance)
        met = begin < MISS
        rows, begin = rows[met], begin[met]
        within = np.minimum(begin + NUDGE * tolerance, ends[rows])
        end = certain_first_roots(_of(leaving, rows), within, ends[rows], tolerance)
        end = np.minimum(end, ends[rows])  # what ends the part ends the solid
        thick = end > within
        span = np.full((len(starts), 2), np.inf)
        span[rows[thick], 0] = np.where(begin == 0.0, INSIDE, begin)[thick]
        span[rows[thick], 1] = end[thick]
        found.append(span)
        places = np.maximum(end, within) + NUDGE * tolerance
        going = places < ends[rows]
        rows, places = rows[going], places[going]
    if not found:
        return np.full((len(starts), 1, 2), np.inf)
    return np.sort(np.stack(found, axis=1), axis=1)


def _of(below: Below, rows: np.ndarray) -> Below:
    """The same bounds for some of the rays."""
    return lambda places, lengths, which: below(places, lengths, rows[which])
