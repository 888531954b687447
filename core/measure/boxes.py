"""A hierarchy of boxes, searched for many points at once.

The boxes are sorted along a Morton curve, which keeps neighbours together; each four of them
get a box about them, each four of those another, up to the root. A search descends one level
for all points together and keeps the boxes that begin nearer than each point's reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats

Indices = NDArray[np.intp]

CHILDREN = 4
MORTON_BITS = 16
"""Of each coordinate: finer than any neighbourhood that matters."""
BLOCK = 4096
"""Points that descend together."""
MOST_PAIRS = 1 << 20
"""Pairs of point and box that are held at once, unless a single point has more."""


@dataclass(frozen=True, slots=True, eq=False)
class BoxTree:
    """Boxes about things, boxes about four of those, and so on."""

    levels: tuple[tuple[Floats, Floats], ...]
    """Centres and half extents (n, 3, 4) of the boxes of each level, four of one parent
    together, m; the root's children come last."""
    order: Indices
    """The thing in each box of the first level."""

    @classmethod
    def about(cls, low: Floats, high: Floats) -> Self:
        """From the smallest and largest coordinates (n, 3) of each thing."""
        order = np.argsort(_morton(0.5 * (low + high)), kind="stable")
        low, high = low[order], high[order]
        levels = [_padded(low, high)]
        while len(low) > CHILDREN:
            first = np.arange(0, len(low), CHILDREN)
            low = np.minimum.reduceat(low, first)
            high = np.maximum.reduceat(high, first)
            levels.append(_padded(low, high))
        return cls(tuple(levels), order)

    def within(self, points: Floats, reach: Floats) -> Iterator[tuple[Indices, Indices]]:
        """Things whose boxes begin nearer to a point than its reach.

        Parameters
        ----------
        points : (n, 3) array
            m.
        reach : (n,) array
            m.

        Yields
        ------
        point, thing : (p,) arrays
            All such pairs, by ascending point; all pairs of a point come together.
        """
        square = reach * reach
        blocks = np.split(np.arange(len(points)), range(BLOCK, len(points), BLOCK))[::-1]
        while blocks:
            rows = blocks.pop()
            pairs = self._descend(points, square, rows)
            if pairs is None:
                half = len(rows) // 2
                blocks += [rows[half:], rows[:half]]
            else:
                yield pairs

    def _descend(
        self, points: Floats, square: Floats, rows: Indices
    ) -> tuple[Indices, Indices] | None:
        """Pairs of the points in these rows; None if they are too many to be held."""
        point, box = rows, np.zeros(len(rows), np.intp)
        for centre, half in reversed(self.levels):
            if len(point) * CHILDREN > MOST_PAIRS and len(rows) > 1:
                return None
            gap = points[point][:, :, None] - centre[box]
            np.abs(gap, out=gap)
            gap -= half[box]
            np.maximum(gap, 0.0, out=gap)
            near = np.einsum("ijk,ijk->ik", gap, gap) < square[point, None]
            parent, child = np.nonzero(near)
            point, box = point[parent], box[parent] * CHILDREN + child
        return point, self.order[box]


def _padded(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Centres and half extents by fours, (n, 3, 4), filled up with boxes that nothing reaches."""
    missing = -len(low) % CHILDREN
    centre = np.concatenate([0.5 * (low + high), np.zeros((missing, 3))])
    half = np.concatenate([0.5 * (high - low), np.full((missing, 3), -np.inf)])
    fours = (-1, CHILDREN, 3)
    centre, half = (np.swapaxes(a.reshape(fours), 1, 2).copy() for a in (centre, half))
    return centre, half


def _morton(points: Floats) -> NDArray[np.uint64]:
    """Place of each point along the curve that interleaves the bits of its coordinates."""
    low = points.min(axis=0)
    size = float(np.ptp(points, axis=0).max()) or 1.0
    cells = ((points - low) * ((1 << MORTON_BITS) - 1) / size).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            digit = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= digit << np.uint64(3 * bit + axis)
    return code
