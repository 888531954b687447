"""Boxes and discs about triangles, searched for many points at once.

The boxes are sorted along a Morton curve, which keeps neighbours together; each four of them
get a box about them, each four of those another, up to the root. A search descends one level
for all points together and keeps the boxes that begin nearer than each point's reach. Large
triangles are cut up, so that long thin ones do not lie in boxes that are mostly empty.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.geometry.meshes import areas_and_normals

Indices = NDArray[np.intp]
CHILDREN = 4
MORTON_BITS = 16  # Of each coordinate: finer than any neighbourhood that matters
BLOCK = 4096  # Points that descend together
MOST_PAIRS = 1 << 20  # Pairs of point and box that are held at once, unless a single point has more
# Area over squared radius below which a normal is mostly rounding, and is not relied on.
SLIVER_AREA = 1e-6
SLACK = 1e-13  # Of the squared distance to the centre: what rounding may take from the bound
EXTRA_PIECES = 50_000  # Pieces that may be cut beyond twice the number of faces
# Longest edge over the root of the mean area, at which a piece is left whole: 1.5 for equilateral
# triangles.
COMPACT = 2.0
NEXT_LIMIT = 0.7  # Each round cuts what is longer than this share of the round before


@dataclass(frozen=True, slots=True, eq=False)
class BoxTree:
    """Boxes about things, boxes about four of those, and so on."""

    # Centres and half extents (n, 3, 4) of the boxes of each level, four of one parent together, m;
    # the root's children come last.
    levels: tuple[tuple[Floats, Floats], ...]
    order: Indices  # The thing in each box of the first level

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

        `points` (n, 3), m. `reach` (n,), m. Yields `point`, `thing` (p,): all such pairs, by
        ascending point; all pairs of a point come together.
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


def _padded(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Centres and half extents by fours, (n, 3, 4), filled up with boxes that nothing reaches."""
    missing = -len(low) % CHILDREN
    centre = np.concatenate([0.5 * (low + high), np.zeros((missing, 3))])
    half = np.concatenate([0.5 * (high - low), np.full((missing, 3), -np.inf)])
    fours = (-1, CHILDREN, 3)
    centre, half = (np.swapaxes(a.reshape(fours), 1, 2).copy() for a in (centre, half))
    return centre, half


class BoundingDiscs(NamedTuple):
    """The disc about the centre of each triangle, in its plane, that holds it."""

    centres: Floats  # (n, 3), m
    normals: Floats  # (n, 3), unit; 0 for a sliver, whose disc becomes a ball
    radii: Floats  # (n,), m

    @classmethod
    def about(cls, corners: Floats) -> Self:
        """From the corners (n, 3, 3) of triangles."""
        centres = corners.mean(axis=1)
        offset = corners - centres[:, None]
        square = np.einsum("ijk,ijk->ij", offset, offset).max(axis=1)
        areas, normals = areas_and_normals(corners)
        normals[areas <= SLIVER_AREA * square] = 0.0
        return cls(centres, normals, np.sqrt(square))

    def within(self, discs: NDArray[np.intp], points: Floats, reach: Floats) -> NDArray[np.bool_]:
        """Whether each disc (n,) may come within the reach (n,) of a point (n, 3)."""
        offset = points - self.centres[discs]
        height = np.einsum("ij,ij->i", offset, self.normals[discs])
        square = np.einsum("ij,ij->i", offset, offset)
        beside = np.sqrt(np.maximum(square - height * height, 0.0)) - self.radii[discs]
        beside = np.maximum(beside, 0.0)
        near: NDArray[np.bool_] = (
            height * height + beside * beside <= reach * reach + SLACK * square
        )
        return near


def cut_long_triangles(corners: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Cut triangles across their longest edges until all are short, or there are too many.

    `corners` (m, 3, 3): corners of the triangles, m. Returns `pieces` (p, 3, 3): corners of the
    pieces, m; together they are the same surface. `faces` (p,): the triangle that each was cut
    from.
    """
    pieces, faces = corners, np.arange(len(corners))
    most = 2 * len(corners) + EXTRA_PIECES
    area = float(areas_and_normals(corners)[0].sum())
    length = _longest(pieces)[0]
    limit = float(length.max())
    while limit > COMPACT * math.sqrt(area / len(pieces)):
        long = length > limit
        if len(pieces) + np.count_nonzero(long) > most:
            break
        if long.any():
            pieces = np.concatenate([pieces[~long], _halves(pieces[long])])
            faces = np.concatenate([faces[~long], np.tile(faces[long], 2)])
            length = _longest(pieces)[0]
        else:
            limit *= NEXT_LIMIT
    return pieces, faces


def _halves(corners: Floats) -> Floats:
    """Both halves of triangles (m, 3, 3), cut from the longest edge to the corner opposite."""
    order = (_longest(corners)[1][:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _longest(corners: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Length (m,) of each triangle's longest edge, and the corner (m,) at which it begins."""
    edges = np.roll(corners, -1, axis=1) - corners
    square = np.einsum("ijk,ijk->ij", edges, edges)
    return np.sqrt(square.max(axis=1)), square.argmax(axis=1)
