"""Self-intersections of a triangle mesh.

Two triangles cross where the intersection line of their planes passes through both: Möller, *A fast
triangle-triangle intersection test*, 1997; for neighbours, beyond the vertices that they share.
Candidate pairs come from bounding boxes along a Morton curve.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry.boxes import morton_order, overlapping_pairs
from palpate.core.geometry.meshes import areas_and_normals, checked_faces
from palpate.reprs import readable

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class CrossingSettings:
    """Distinction of crossings from contact and rounding."""

    # Fraction of the mesh's largest extent by which each face must pass beyond the other's plane;
    # larger ones find fewer crossings. Single precision rounds by 6e-8 of the largest coordinate.
    min_depth: float = 1e-7
    # Fraction of the longer face's longest edge: a corner nearer to a plane lies in it, and two
    # faces with a shorter common segment only touch.
    touching: float = 1e-9
    min_sine: float = 1e-9  # of the angle between two planes; below it they are equal


@readable
@dataclass(frozen=True, slots=True, eq=False)
class SelfIntersection:
    """Crossings of a surface with itself."""

    faces: Ints  # (count, 2): pairs of faces that cross, the lower index first, sorted
    places: Floats  # (count, 3): the middle of each pair's common segment

    @property
    def count(self) -> int:
        """Number of pairs of faces that cross."""
        return len(self.faces)


def self_intersection(
    vertices: ArrayLike, faces: ArrayLike, settings: CrossingSettings = CrossingSettings()
) -> SelfIntersection:
    """Pairs of faces that pass through each other.

    `vertices` (n, 3): in any unit; equal ones count as one. `faces` (m, 3): indices of vertices;
    faces without area cross nothing. Raises ValueError as `triangle_corners`. Faces that only touch
    do not cross, nor do overlapping faces in one plane, nor does a face with an edge in the other's
    plane: rounding would decide these cases.
    """
    mesh = _prepared(vertices, faces, settings)
    crossing, middles = [np.zeros((0, 2), np.int32)], [np.zeros((0, 3))]
    for first, second in _candidates(mesh):
        hit, place = _crossings(_Pairs(mesh, first, second))
        crossing.append(np.column_stack([first[hit], second[hit]]).astype(np.int32))
        middles.append(place)
    pairs = np.concatenate(crossing)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    return SelfIntersection(pairs[order], np.concatenate(middles)[order])


class _Prepared(NamedTuple):
    """A mesh with distinct vertices."""

    rows: Indices  # (m, 3)
    corners: Floats  # (m, 3, 3)
    normals: Floats  # (m, 3), unit; 0 of a face without area
    touching: Floats  # (m,): distance from a plane within which a corner lies in it
    min_depth: float
    min_sine: float


def _prepared(vertices: ArrayLike, faces: ArrayLike, settings: CrossingSettings) -> _Prepared:
    places = finite_array("vertices", vertices, (None, 3))
    places, names = np.unique(places, axis=0, return_inverse=True)
    rows = names.reshape(-1)[checked_faces(faces, len(names.reshape(-1)))]
    corners = places[rows]
    areas, normals = areas_and_normals(corners)
    edges = corners[:, [1, 2, 0]] - corners
    longest = np.sqrt(np.einsum("ijk,ijk->ij", edges, edges).max(axis=1))
    extent = float(np.ptp(places[rows.ravel()], axis=0).max())
    touching, min_depth = settings.touching * longest, settings.min_depth * extent
    normals[2.0 * areas <= np.maximum(touching, min_depth) * longest] = 0.0
    return _Prepared(rows, corners, normals, touching, min_depth, settings.min_sine)


def _candidates(mesh: _Prepared) -> Iterator[tuple[Indices, Indices]]:
    """Pairs of faces that may cross, each once, the lower index first: their boxes overlap.

    Faces that share an edge do not cross.
    """
    a, b, c = mesh.corners.transpose(1, 0, 2)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    order = morton_order(0.5 * (low + high))
    rows = mesh.rows[order]
    for first, second in overlapping_pairs(low[order], high[order]):
        corners, other_corners = rows[first], rows[second]
        n_shared = sum((corners[:, [i]] == other_corners).sum(axis=1) for i in range(3))
        distinct = n_shared < 2
        first, second = order[first[distinct]], order[second[distinct]]
        yield np.minimum(first, second), np.maximum(first, second)


def _crossings(pairs: _Pairs) -> tuple[Indices, Floats]:
    number = np.arange(len(pairs.first))
    for turn in (False, True):
        heights = _heights(pairs.swapped() if turn else pairs)
        min_depth = pairs.mesh.min_depth
        separated = (heights > min_depth).any(axis=1) & (heights < -min_depth).any(axis=1)
        kept = np.flatnonzero(separated)
        pairs, number = pairs.take(kept), number[kept]
    line = np.cross(pairs.mesh.normals[pairs.first], pairs.mesh.normals[pairs.second])
    sine = np.linalg.norm(line, axis=1)
    kept = np.flatnonzero(sine > pairs.mesh.min_sine)
    pairs, number, line = pairs.take(kept), number[kept], line[kept] / sine[kept, None]
    origin = pairs.mesh.corners[pairs.first, 0]
    begin, end = _interval(pairs, line, origin)
    begin_other, end_other = _interval(pairs.swapped(), line, origin)
    low, high = np.maximum(begin, begin_other), np.minimum(end, end_other)
    hit = high - low > pairs.touching
    return number[hit], _on_line(pairs.take(hit), line[hit], 0.5 * (low + high)[hit])


def _interval(pairs: _Pairs, line: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Interval of each first triangle along the intersection line of the planes."""
    heights = _heights(pairs)
    along = np.einsum("pij,pj->pi", pairs.mesh.corners[pairs.first] - origin[:, None], line)
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


def _heights(pairs: _Pairs) -> Floats:
    """Heights (p, 3) of the first triangle's corners over the second's plane; 0 if in it."""
    normals = pairs.mesh.normals[pairs.second]
    offset = pairs.mesh.corners[pairs.first] - pairs.mesh.corners[pairs.second, :1]
    heights: Floats = np.einsum("pij,pj->pi", offset, normals)
    corners, other_corners = pairs.mesh.rows[pairs.first], pairs.mesh.rows[pairs.second]
    shared = (corners[:, :, None] == other_corners[:, None, :]).any(axis=2)
    heights[shared | (np.abs(heights) <= pairs.touching[:, None])] = 0.0
    return heights


def _on_line(pairs: _Pairs, line: Floats, along: Floats) -> Floats:
    """Points (p, 3) at places along the intersection lines of the planes."""
    origin = pairs.mesh.corners[pairs.first, 0]
    normal, other_normal = pairs.mesh.normals[pairs.first], pairs.mesh.normals[pairs.second]
    height = np.einsum("pi,pi->p", pairs.mesh.corners[pairs.second, 0] - origin, other_normal)
    across = np.cross(line, normal)  # along it, in the first plane, the second's height changes
    slope = np.einsum("pi,pi->p", across, other_normal)
    return np.asarray(origin + along[:, None] * line + (height / slope)[:, None] * across)


class _Pairs(NamedTuple):
    """Pairs of triangles of a mesh."""

    mesh: _Prepared
    first: Indices
    second: Indices

    @property
    def touching(self) -> Floats:
        """Distance (p,) within which a corner of one face lies in the other's plane."""
        return np.maximum(self.mesh.touching[self.first], self.mesh.touching[self.second])

    def take(self, which: Bools | Indices) -> _Pairs:
        """Pairs with a mask or indices."""
        return self._replace(first=self.first[which], second=self.second[which])

    def swapped(self) -> _Pairs:
        """The pairs with first and second exchanged."""
        return self._replace(first=self.second, second=self.first)
