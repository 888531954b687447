"""Where parallel rays are inside a closed triangle mesh: all that they cross, in order.

Whether a ray passes an edge on its left or its right is asked once for both faces at the edge,
and a ray that meets it is taken to pass beside it, as if moved first along one axis across the
rays, then by far less along the other (Edelsbrunner and Muecke, *Simulation of simplicity*, 1990).
So no ray slips through between two faces, or counts a corner twice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.shapes.protocol import INSIDE

AT_ONCE = 1 << 19
"""Pairs of a ray and an edge."""
TRIES = 4
ASIDE = np.array([0.8, 0.6])
SHIFT = 1e-12
"""Of the mesh's extent: how far a ray is moved whose sides were rounded to what cannot be."""

Longs = NDArray[np.int64]


class CrossedMesh:
    """A closed mesh, ready to be crossed.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Corners by number, counter-clockwise seen from outside; each edge has two faces.
    """

    def __init__(self, vertices: Floats, faces: Ints):
        self._vertices, self._faces = vertices, faces
        first, last = faces, np.roll(faces, -1, axis=1)
        ends = np.sort(np.stack([first, last], axis=2).reshape(-1, 2), axis=1)
        self._edges, edge = np.unique(ends, axis=0, return_inverse=True)
        self._edge = edge.reshape(-1, 3)
        self._against = first > last
        self._extent = float(np.ptp(vertices, axis=0).max())

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays from origins (n, 3) are inside: see `spans`."""
        axes = _axes_across(direction)
        seen, rays = self._vertices @ axes, origins @ axes
        size = max(AT_ONCE // len(self._edges), 1)
        parts = [self._crossed(seen, rays[i : i + size]) for i in range(0, len(rays), size)]
        if not parts:
            return np.full((0, 1, 2), np.inf)
        width = max(part.shape[1] for part in parts)
        filled = [
            np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0)), constant_values=np.inf)
            for part in parts
        ]
        return np.concatenate(filled)

    def _crossed(self, seen: Floats, rays: Floats) -> Floats:
        """Spans (n, k, 2) of some rays; mesh and rays in axes of which the last is the rays'."""
        rays = rays.copy()
        for moved in range(TRIES):
            row, place, turn = self._hits(seen, rays)
            wrong = np.bincount(row, turn, len(rays)) != 0.0
            if not wrong.any():
                break
            rays[wrong, :2] += (moved + 1) * SHIFT * self._extent * ASIDE
        keep = ~wrong[row]
        return _spans_of(row[keep], place[keep], turn[keep], len(rays))

    def _hits(self, seen: Floats, rays: Floats) -> tuple[Longs, Floats, Longs]:
        """Rays, places on them and turns (1 inwards, -1 outwards) of all crossings, in order."""
        side, left = self._sides(seen, rays)
        left = left[:, self._edge] ^ self._against
        row, face = np.nonzero(left.all(axis=2) | ~left.any(axis=2))
        turn = np.where(left[row, face, 0], -1, 1)
        weight = np.abs(side[row[:, None], np.roll(self._edge[face], -1, axis=1)])
        depth = seen[self._faces[face], 2]
        total = weight.sum(axis=1)
        weight = np.where(total[:, None] > 0.0, weight, 1.0)
        place = (weight * depth).sum(axis=1) / weight.sum(axis=1) - rays[row, 2]
        order = np.lexsort((-turn, place, row))
        return row[order], place[order], turn[order]

    def _sides(self, seen: Floats, rays: Floats) -> tuple[Floats, Bools]:
        """On which side of each edge each ray passes, (n, e): twice an area, and whether left."""
        x, y = (seen[None, :, axis] - rays[:, axis, None] for axis in (0, 1))
        first, last = self._edges.T
        side = x[:, first] * y[:, last] - x[:, last] * y[:, first]
        rise = seen[first, 1] - seen[last, 1]
        tie = np.where(rise == 0.0, seen[last, 0] - seen[first, 0], rise) > 0.0
        return side, np.where(side == 0.0, tie, side > 0.0)


def _spans_of(row: Longs, place: Floats, turn: Longs, count: int) -> Floats:
    """Spans (n, k, 2) from crossings in order, of which each ray's turns add up to 0."""
    depth = np.cumsum(turn)
    begins = np.flatnonzero((depth > 0) & (depth - turn <= 0))
    ends = np.flatnonzero((depth <= 0) & (depth - turn > 0))
    ahead = (place[ends] > 0.0) & (place[ends] > place[begins])
    begins, ends = begins[ahead], ends[ahead]
    own = row[begins]
    number = np.arange(len(own)) - np.searchsorted(own, own)
    spans = np.full((count, int(number.max(initial=0)) + 1, 2), np.inf)
    begin = place[begins]
    spans[own, number, 0] = np.where(begin <= 0.0, INSIDE, begin)
    spans[own, number, 1] = place[ends]
    return spans


def _axes_across(direction: Floats) -> Floats:
    """Orthonormal right-handed axes as columns, the last along `direction`."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(direction)))] = 1.0
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(direction, first), direction])
