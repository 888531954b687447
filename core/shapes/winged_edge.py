"""Winged edges: who borders on whom in a surface of polygons (Baumgart, 1972).

Each edge knows its two vertices, the faces on its two sides, and the edges before and after it
around both. All are arrays: a face's edges are a slice, a vertex's are found by going from
wing to wing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Ints

Longs = NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class WingedEdges:
    """A closed surface of polygons. Edges run with their left face's corners."""

    ends: Ints
    """First and last vertex of each edge, (e, 2)."""
    faces: Ints
    """Face on its left and on its right, (e, 2)."""
    before: Ints
    """Edge before it around the left face, and around the right one, (e, 2)."""
    after: Ints
    """Edge after it around the left face, and around the right one, (e, 2)."""
    begins: Ints
    """Where each face's corners begin in `corners`, and the end of the last, (f + 1,)."""
    corners: Ints
    """Vertices of all faces, face after face, counter-clockwise seen from outside."""
    sides: Ints
    """Edge from each of these corners to the next."""
    vertices: int
    """Number of vertices."""
    shells: int
    """Number of surfaces that do not hang together."""

    @property
    def euler(self) -> int:
        """V - E + F, which is 2 (shells - genus): Euler and Poincare."""
        return self.vertices - len(self.ends) + len(self.begins) - 1

    @property
    def genus(self) -> int:
        """Number of holes through the surfaces."""
        return self.shells - self.euler // 2

    def vertices_of_face(self, face: int) -> Ints:
        """Corners of a face in order, counter-clockwise seen from outside."""
        return self.corners[self.begins[face] : self.begins[face + 1]]

    def edges_of_face(self, face: int) -> Ints:
        """Edges around a face in order; the first begins at its first corner."""
        return self.sides[self.begins[face] : self.begins[face + 1]]

    def neighbours_of_face(self, face: int) -> Ints:
        """Faces across the edges of a face, in the order of these."""
        pairs = self.faces[self.edges_of_face(face)]
        return np.asarray(np.where(pairs[:, 0] == face, pairs[:, 1], pairs[:, 0]))

    def edges_of_vertex(self, vertex: int) -> Ints:
        """Edges around a vertex in order, counter-clockwise seen from outside."""
        first = int(np.flatnonzero((self.ends == vertex).any(axis=1))[0])
        found, edge = [first], self._next_around(first, vertex)
        while edge != first:
            found.append(edge)
            edge = self._next_around(edge, vertex)
        return np.array(found, np.int32)

    def faces_of_vertex(self, vertex: int) -> Ints:
        """Faces around a vertex in order; each lies before the edge of the same number."""
        edges = self.edges_of_vertex(vertex)
        starts_here = self.ends[edges, 0] == vertex
        return np.asarray(np.where(starts_here, self.faces[edges, 1], self.faces[edges, 0]))

    def _next_around(self, edge: int, vertex: int) -> int:
        """Edge that follows around a vertex: over the face on the left of the way out."""
        side = 0 if self.ends[edge, 0] == vertex else 1
        return int(self.before[edge, side])


def winged_edges(faces: Sequence[Sequence[int]], vertices: int) -> WingedEdges:
    """The edges of a closed surface.

    Parameters
    ----------
    faces : sequence of sequences of int
        Corners of each face in order, by number, at least 3.
    vertices : int
        How many vertices there are.

    Raises
    ------
    ValueError
        If a face has too few corners, or one of them twice, or names a vertex that is not
        there; if an edge does not have a face on each side, or these are turned opposite
        ways; if a vertex belongs to no face, or joins parts that only touch there.
    """
    counts = np.array([len(face) for face in faces])
    _refuse(counts < 3, "faces[{0}] must have at least 3 corners, got {1}", counts)
    begins = np.concatenate([[0], np.cumsum(counts)])
    corners = np.array([corner for face in faces for corner in face])
    face = np.repeat(np.arange(len(counts)), counts)
    _check_corners(corners, face, vertices)
    after = np.arange(len(corners)) + 1
    after[begins[1:] - 1] = begins[:-1]
    before = np.empty_like(after)
    before[after] = np.arange(len(after))
    twin = _twins(corners, corners[after], face, vertices)
    _check_fans(twin[before], corners, vertices)
    pairs = np.column_stack([np.arange(len(twin)), twin])[corners < corners[after]]
    edge = np.empty(len(corners), np.int64)
    edge[pairs] = np.arange(len(pairs))[:, None]
    return WingedEdges(
        ends=corners[pairs].astype(np.int32),
        faces=face[pairs].astype(np.int32),
        before=edge[before[pairs]].astype(np.int32),
        after=edge[after[pairs]].astype(np.int32),
        begins=begins.astype(np.int32),
        corners=corners.astype(np.int32),
        sides=edge.astype(np.int32),
        vertices=vertices,
        shells=len(np.unique(_least_of_each(np.stack([after, twin])))),
    )


def _check_corners(corners: Longs, face: Longs, vertices: int) -> None:
    bad = (corners < 0) | (corners >= vertices)
    if bad.any():
        first = int(bad.argmax())
        raise ValueError(
            f"faces[{face[first]}] names vertex {corners[first]}, but there are only "
            f"{vertices}, counted from 0"
        )
    pairs, first, times = np.unique(
        face.astype(np.int64) * vertices + corners, return_index=True, return_counts=True
    )
    if len(pairs) < len(corners):
        twice = first[times > 1].min()
        raise ValueError(f"faces[{face[twice]}] has the corner {corners[twice]} twice")
    used = np.bincount(corners, minlength=vertices) > 0
    if not used.all():
        raise ValueError(f"vertices[{used.argmin()}] belongs to no face")


def _twins(first: Longs, last: Longs, face: Longs, vertices: int) -> Longs:
    """For each side of a face the same edge as its neighbour walks it."""
    there = first.astype(np.int64) * vertices + last
    back = last.astype(np.int64) * vertices + first
    order = there.argsort(kind="stable")
    same = np.flatnonzero(np.diff(there[order]) == 0)
    if len(same):
        one, two = order[same[0]], order[same[0] + 1]
        raise ValueError(
            f"faces[{face[one]}] and faces[{face[two]}] both walk the edge from vertex "
            f"{first[one]} to {last[one]} in this direction; turn one of them, or take it away"
        )
    place = np.minimum(np.searchsorted(there[order], back), len(order) - 1)
    twin: Longs = order[place]
    open_ones = there[twin] != back
    if open_ones.any():
        side = int(open_ones.argmax())
        raise ValueError(
            f"faces[{face[side]}] has no neighbour at the edge from vertex {first[side]} to "
            f"{last[side]}; the surface must be closed"
        )
    return twin


def _check_fans(turned: Longs, corners: Longs, vertices: int) -> None:
    """Around each vertex there must be one ring of faces."""
    fans = np.unique(_least_of_each(turned[None]))
    rings = np.bincount(corners[fans], minlength=vertices)
    _refuse(rings > 1, "vertices[{0}] joins {1} parts of the surface that only touch there", rings)


def _least_of_each(neighbours: Longs) -> Longs:
    """For each element the least that is reached from it, by permutations (k, n)."""
    label: Longs = np.arange(neighbours.shape[1])
    while True:
        lower = label
        for step in neighbours:
            # Both ways along a cycle, so that it is one whatever way it is walked.
            lower = np.minimum(lower, lower[step])
            back = lower.copy()
            np.minimum.at(back, step, lower)
            lower = back
        lower = lower[lower]
        if np.array_equal(lower, label):
            return label
        label = lower


def _refuse(bad: Bools, sentence: str, values: Longs) -> None:
    if bad.any():
        first = int(bad.argmax())
        raise ValueError(sentence.format(first, values[first]))
