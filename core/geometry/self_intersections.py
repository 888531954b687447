"""Where a triangle mesh passes through itself.

Two triangles cross where the line in which their planes meet runs through both of them at once:
Möller, *A fast triangle-triangle intersection test*, 1997. Neighbours meet at the vertices that
they share; only what they have in common beyond those is a crossing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry.meshes import areas_and_normals, checked_faces
from palpate.core.geometry.nearest import BoxTree

Indices = NDArray[np.intp]
# Of a triangle's longest edge: a corner that lies nearer to a plane lies in it, and what two
# triangles have in common over a shorter way is a touch.
TOUCHING = 1e-9
LEAST_SINE = 1e-9  # Of the angle between two planes: below it they are one
BLOCK = 400_000  # Pairs that are tested at once


@dataclass(frozen=True, slots=True, eq=False)
class SelfIntersection:
    """Crossings of a surface with itself."""

    faces: Ints  # (count, 2): pairs of faces that cross, the lower number first, in order
    places: Floats  # (count, 3): the middle of what each pair has in common

    @property
    def count(self) -> int:
        """Pairs of faces that cross."""
        return len(self.faces)


def self_intersection(vertices: ArrayLike, faces: ArrayLike) -> SelfIntersection:
    """Pairs of faces that pass through each other.

    `vertices` (n, 3): vertices in the same place count as one. `faces` (m, 3): rows of `vertices`.
    Faces without area cross nothing. Raises ValueError if a vertex is not finite, or a face names a
    vertex that is not there. Faces that only touch do not cross, nor do faces that lie on each
    other in one plane, and nor does one that has an edge in the other's plane: those are cases that
    the last digit decides.
    """
    places = finite_array("vertices", vertices, (None, 3))
    places, names = np.unique(places, axis=0, return_inverse=True)
    rows = names.reshape(-1)[checked_faces(faces, len(names.reshape(-1)))]
    corners = places[rows]
    areas, normals = areas_and_normals(corners)
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    flat = areas <= TOUCHING * longest**2
    normals[flat] = 0.0
    crossing, middles = [np.zeros((0, 2), np.int32)], [np.zeros((0, 3))]
    for one, other in _near(corners):
        pairs = _Pairs(rows, corners, normals, longest, one, other)
        hit, place = _crossings(pairs)
        crossing.append(np.column_stack([one[hit], other[hit]]).astype(np.int32))
        middles.append(place)
    found = np.concatenate(crossing)
    order = np.lexsort((found[:, 1], found[:, 0]))
    return SelfIntersection(found[order], np.concatenate(middles)[order])


class _Pairs(NamedTuple):
    """Pairs of triangles of a mesh."""

    rows: Indices
    corners: Floats
    normals: Floats
    longest: Floats
    one: Indices
    other: Indices

    def take(self, which: Bools | Indices) -> _Pairs:
        """Some of them."""
        return self._replace(one=self.one[which], other=self.other[which])

    def swapped(self) -> _Pairs:
        """The same, the other way round."""
        return self._replace(one=self.other, other=self.one)


def _near(corners: Floats) -> Iterator[tuple[Indices, Indices]]:
    """Pairs of triangles, each once, whose boxes overlap."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    centres = 0.5 * (low + high)
    reach = np.linalg.norm(high - low, axis=1) * (0.5 + 1e-9) + np.finfo(float).tiny
    for one, other in BoxTree.about(low, high).within(centres, reach):
        above = one < other
        one, other = one[above], other[above]
        meet = (low[one] <= high[other]).all(axis=1) & (low[other] <= high[one]).all(axis=1)
        one, other = one[meet], other[meet]
        for begin in range(0, len(one), BLOCK):
            yield one[begin : begin + BLOCK], other[begin : begin + BLOCK]


def _crossings(pairs: _Pairs) -> tuple[Indices, Floats]:
    """Which pairs cross, and where."""
    number = np.arange(len(pairs.one))
    for turn in (False, True):
        seen = pairs.swapped() if turn else pairs
        heights = _heights(seen)
        keep = (heights.max(axis=1) > 0.0) & (heights.min(axis=1) < 0.0)
        pairs, number = pairs.take(keep), number[keep]
    line = np.cross(pairs.normals[pairs.one], pairs.normals[pairs.other])
    sine = np.linalg.norm(line, axis=1)
    keep = sine > LEAST_SINE
    pairs, number, line = pairs.take(keep), number[keep], line[keep] / sine[keep, None]
    origin = pairs.corners[pairs.one, 0]
    begin, end = _interval(pairs, line, origin)
    begin_other, end_other = _interval(pairs.swapped(), line, origin)
    low, high = np.maximum(begin, begin_other), np.minimum(end, end_other)
    least = TOUCHING * np.maximum(pairs.longest[pairs.one], pairs.longest[pairs.other])
    hit = high - low > least
    return number[hit], _on_line(pairs.take(hit), line[hit], 0.5 * (low + high)[hit])


def _heights(pairs: _Pairs) -> Floats:
    """Heights (p, 3) of the first triangle's corners over the other's plane; 0 if in it."""
    normals = pairs.normals[pairs.other]
    offset = pairs.corners[pairs.one] - pairs.corners[pairs.other, :1]
    heights: Floats = np.einsum("pij,pj->pi", offset, normals)
    mine, yours = pairs.rows[pairs.one], pairs.rows[pairs.other]
    shared = (mine[:, :, None] == yours[:, None, :]).any(axis=2)
    least = TOUCHING * np.maximum(pairs.longest[pairs.one], pairs.longest[pairs.other])
    heights[shared | (np.abs(heights) <= least[:, None])] = 0.0
    return heights


def _interval(pairs: _Pairs, line: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Where the first triangles begin and end along the lines in which the planes meet."""
    heights = _heights(pairs)
    along = np.einsum("pij,pj->pi", pairs.corners[pairs.one] - origin[:, None], line)
    following, next_along = np.roll(heights, -1, axis=1), np.roll(along, -1, axis=1)
    passes = heights * following < 0.0
    share = heights / np.where(passes, heights - following, 1.0)
    met = along + share * (next_along - along)
    begin = np.where(passes, met, np.inf).min(axis=1)
    end = np.where(passes, met, -np.inf).max(axis=1)
    on = heights == 0.0
    begin = np.minimum(begin, np.where(on, along, np.inf).min(axis=1))
    end = np.maximum(end, np.where(on, along, -np.inf).max(axis=1))
    return begin, end


def _on_line(pairs: _Pairs, line: Floats, along: Floats) -> Floats:
    """The point (p, 3) at this place along the line in which two planes meet."""
    origin = pairs.corners[pairs.one, 0]
    one, other = pairs.normals[pairs.one], pairs.normals[pairs.other]
    height = np.einsum("pi,pi->p", pairs.corners[pairs.other, 0] - origin, other)
    # Within the first plane, across the line, the second plane rises as the sine.
    across = np.cross(line, one)
    slope = np.einsum("pi,pi->p", across, other)
    return np.asarray(origin + along[:, None] * line + (height / slope)[:, None] * across)
