"""Where a triangle mesh passes through itself.

Two triangles cross where the line in which their planes meet runs through both: Möller, *A fast
triangle-triangle intersection test*, 1997; neighbours, where it does so beyond the vertices that
they share. Pairs are found by boxes about ever fewer faces along a Morton curve.
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

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class CrossingSettings:
    """What counts as a crossing, and not as a touch or as rounding."""

    # Fraction of the mesh's largest extent by which each face must pass beyond the other's plane.
    # Coordinates of single precision are rounded by 6e-8 of the largest.
    min_depth: float = 1e-7
    # Fraction of the longer face's longest edge: a corner nearer to a plane lies in it, and what
    # two faces have in common over a shorter way is a touch.
    touching: float = 1e-9
    min_sine: float = 1e-9  # of the angle between two planes; below it they are one


@dataclass(frozen=True, slots=True, eq=False)
class SelfIntersection:
    """Crossings of a surface with itself."""

    faces: Ints  # (count, 2): pairs of faces that cross, the lower number first, in order
    places: Floats  # (count, 3): the middle of what each pair has in common

    @property
    def count(self) -> int:
        """Pairs of faces that cross."""
        return len(self.faces)


def self_intersection(
    vertices: ArrayLike, faces: ArrayLike, settings: CrossingSettings | None = None
) -> SelfIntersection:
    """Pairs of faces that pass through each other.

    `vertices` (n, 3): in any unit; those in the same place count as one. `faces` (m, 3): rows of
    those; faces without area cross nothing. Raises ValueError as `triangle_corners`. Faces that
    only touch do not cross, nor do faces that lie on each other in one plane, nor does one that has
    an edge in the other's plane: the last digit decides those.
    """
    mesh = _prepared(vertices, faces, settings or CrossingSettings())
    crossing, middles = [np.zeros((0, 2), np.int32)], [np.zeros((0, 3))]
    for one, other in _near(mesh):
        hit, place = _crossings(_Pairs(mesh, one, other))
        crossing.append(np.column_stack([one[hit], other[hit]]).astype(np.int32))
        middles.append(place)
    found = np.concatenate(crossing)
    order = np.lexsort((found[:, 1], found[:, 0]))
    return SelfIntersection(found[order], np.concatenate(middles)[order])


class _Prepared(NamedTuple):
    """A mesh, its vertices each in a place of its own."""

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


def _near(mesh: _Prepared) -> Iterator[tuple[Indices, Indices]]:
    """Pairs of faces, each once, the lower number first, whose boxes overlap and which may cross.

    Faces that share an edge do not.
    """
    a, b, c = mesh.corners.transpose(1, 0, 2)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    order = morton_order(0.5 * (low + high))
    rows = mesh.rows[order]
    for one, other in overlapping_pairs(low[order], high[order]):
        mine, yours = rows[one], rows[other]
        shared = sum((mine[:, [i]] == yours).sum(axis=1) for i in range(3))
        apart = shared < 2
        one, other = order[one[apart]], order[other[apart]]
        yield np.minimum(one, other), np.maximum(one, other)


def _crossings(pairs: _Pairs) -> tuple[Indices, Floats]:
    number = np.arange(len(pairs.one))
    for turn in (False, True):
        heights = _heights(pairs.swapped() if turn else pairs)
        least = pairs.mesh.min_depth
        apart = (heights > least).any(axis=1) & (heights < -least).any(axis=1)
        keep = np.flatnonzero(apart)
        pairs, number = pairs.take(keep), number[keep]
    line = np.cross(pairs.mesh.normals[pairs.one], pairs.mesh.normals[pairs.other])
    sine = np.linalg.norm(line, axis=1)
    keep = np.flatnonzero(sine > pairs.mesh.min_sine)
    pairs, number, line = pairs.take(keep), number[keep], line[keep] / sine[keep, None]
    origin = pairs.mesh.corners[pairs.one, 0]
    begin, end = _interval(pairs, line, origin)
    begin_other, end_other = _interval(pairs.swapped(), line, origin)
    low, high = np.maximum(begin, begin_other), np.minimum(end, end_other)
    hit = high - low > pairs.touching
    return number[hit], _on_line(pairs.take(hit), line[hit], 0.5 * (low + high)[hit])


def _interval(pairs: _Pairs, line: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Where the first triangles begin and end along the lines in which the planes meet."""
    heights = _heights(pairs)
    along = np.einsum("pij,pj->pi", pairs.mesh.corners[pairs.one] - origin[:, None], line)
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
    """Heights (p, 3) of the first triangle's corners over the other's plane; 0 if in it."""
    normals = pairs.mesh.normals[pairs.other]
    offset = pairs.mesh.corners[pairs.one] - pairs.mesh.corners[pairs.other, :1]
    heights: Floats = np.einsum("pij,pj->pi", offset, normals)
    mine, yours = pairs.mesh.rows[pairs.one], pairs.mesh.rows[pairs.other]
    shared = (mine[:, :, None] == yours[:, None, :]).any(axis=2)
    heights[shared | (np.abs(heights) <= pairs.touching[:, None])] = 0.0
    return heights


def _on_line(pairs: _Pairs, line: Floats, along: Floats) -> Floats:
    """The point (p, 3) at this place along the line in which two planes meet."""
    origin = pairs.mesh.corners[pairs.one, 0]
    one, other = pairs.mesh.normals[pairs.one], pairs.mesh.normals[pairs.other]
    height = np.einsum("pi,pi->p", pairs.mesh.corners[pairs.other, 0] - origin, other)
    across = np.cross(line, one)  # In the first plane the second rises as the sine
    slope = np.einsum("pi,pi->p", across, other)
    return np.asarray(origin + along[:, None] * line + (height / slope)[:, None] * across)


class _Pairs(NamedTuple):
    """Pairs of triangles of a mesh."""

    mesh: _Prepared
    one: Indices
    other: Indices

    @property
    def touching(self) -> Floats:
        """Distance (p,) within which a corner of one lies in the other's plane."""
        return np.maximum(self.mesh.touching[self.one], self.mesh.touching[self.other])

    def take(self, which: Bools | Indices) -> _Pairs:
        """Some of them."""
        return self._replace(one=self.one[which], other=self.other[which])

    def swapped(self) -> _Pairs:
        """The same, the other way round."""
        return self._replace(one=self.other, other=self.one)
