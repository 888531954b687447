"""Polyhedron: a closed surface of plane polygons, convex or not, as winged edges (Baumgart, 1972).

Each edge has its two vertices, the faces on its two sides, and the edges before and after it around
both. All are arrays: a face's edges are a slice, a vertex's are found from wing to wing. Polygons
are triangulated: fans for convex ones, ear clipping for others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.geometry import linked_groups, signed_volume
from palpate.core.shapes.face_cutting import by_ears
from palpate.core.shapes.protocol import ImplicitShape
from palpate.core.shapes.triangle_meshes import HAS_EMBREE, CrossedMesh, TriangleShape

if TYPE_CHECKING:
    from palpate.core.geometry import NearestSearch

PROBE_DIRECTION = np.array([0.36, 0.48, 0.8])  # of rays that test whether points are inside
Longs = NDArray[np.integer]


@dataclass(frozen=True, slots=True, kw_only=True)
class PolyhedronSettings:
    """Tolerances of a polyhedron, as fractions of its extent."""

    max_plane_distance: float = 1e-4  # of a corner from its face's plane: rounded input
    min_edge: float = 1e-6  # shorter edges have no length
    min_volume: float = 1e-9  # of a cube as large as its extent; smaller ones enclose nothing
    max_exact_triangles: int = 500  # cast in double precision; more are cast by Embree


class Polyhedron(TriangleShape, ImplicitShape):
    """One closed surface of polygons.

    If all faces are oriented inwards, they are reversed. Crossings of faces are not tested.
    `vertices` (n, 3) [m]. `faces`: indices of each face's vertices, from 0, counter-clockwise seen
    from outside. Raises ValueError if the surface is not closed, in one piece and of plane faces
    with an area, or encloses nothing, naming the face, edge or vertex. Fung, 1999, section 2.5.3.
    Rays are cast at the planes of the faces' triangles.
    """

    def __init__(
        self,
        vertices: Floats,
        faces: Sequence[Sequence[int]],
        settings: PolyhedronSettings = PolyhedronSettings(),
    ):
        self._settings = settings
        self._vertices = finite_array("vertices", vertices, (None, 3))
        edges = winged_edges(faces, len(self._vertices))
        if edges.shells != 1:
            raise ValueError(f"faces must form one surface, got {edges.shells} that do not touch")
        first, last = self._vertices[edges.ends].transpose(1, 0, 2)
        short = np.linalg.norm(last - first, axis=1) <= settings.min_edge * self._extent
        if short.any():
            begin, end = edges.ends[short.argmax()]
            raise ValueError(f"vertices[{begin}] and vertices[{end}] are an edge without length")
        normals = self._face_normals(edges)
        triangles = triangulate_polygons(self._vertices, edges.begins, edges.corners, normals)
        middle = self._vertices.mean(axis=0)
        volume = signed_volume((self._vertices - middle)[triangles])
        if abs(volume) <= settings.min_volume * self._extent**3:
            raise ValueError("faces enclose nothing: those on the two sides lie on one another")
        if volume < 0.0:
            edges = winged_edges([face[::-1] for face in faces], len(self._vertices))
            triangles, volume = np.ascontiguousarray(triangles[:, ::-1]), -volume
        self.edges = edges  # of outward faces
        self.volume = volume  # [m3]
        is_large = len(triangles) > settings.max_exact_triangles
        super().__init__(self._vertices, triangles, HAS_EMBREE and is_large)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside: see `CsgSolid.spans`."""
        return self._crossings.spans(origins, direction)

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distance [m] from the surface, negative inside, and its slope, (n,) each."""
        from palpate.core.geometry import nearest_points

        near = nearest_points(self._search, points)
        inside = self._crossings.spans(points, PROBE_DIRECTION)[:, 0, 0] < 0.0
        sign = np.where(inside, -1.0, 1.0)
        a, b, c = self._vertices[self._mesh.faces[near.faces]].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        away = sign[:, None] * (points - near.points)
        # On the surface the offset has no direction: the normal replaces it.
        there = near.distances <= self._settings.min_edge * self._extent
        away = np.where(there[:, None], normal, away)
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        return sign * near.distances, np.einsum("ni,ni->n", away, directions)

    def _face_normals(self, edges: WingedEdges) -> Floats:
        """Unit normals of the faces (Newell), which must be plane and have an area."""
        tolerance = self._settings.max_plane_distance * self._extent
        begins, corners = edges.begins[:-1], edges.corners
        count = np.diff(edges.begins)
        places = self._vertices[corners]
        middle = np.add.reduceat(places, begins) / count[:, None]
        local = places - np.repeat(middle, count, axis=0)
        area = 0.5 * np.add.reduceat(np.cross(local, local[_after(edges.begins)]), begins)
        size = np.linalg.norm(area, axis=1)
        flat = size <= (self._settings.min_edge * self._extent) ** 2
        if flat.any():
            raise ValueError(f"faces[{flat.argmax()}] has no area: its corners lie on a line")
        normals = area / size[:, None]
        beside = np.abs(np.einsum("ni,ni->n", local, np.repeat(normals, count, axis=0)))
        if beside.max() > tolerance:
            corner = int(beside.argmax())
            face = int(np.searchsorted(edges.begins, corner, side="right")) - 1
            raise ValueError(
                f"faces[{face}] is not plane: vertex {corners[corner]} lies {beside[corner]:.3g} m "
                f"beside it, at most {tolerance:.3g} m is allowed; split the face"
            )
        return np.asarray(normals)

    @cached_property
    def _crossings(self) -> CrossedMesh:
        return CrossedMesh(*self._mesh)

    @cached_property
    def _search(self) -> NearestSearch:
        from palpate.core.geometry import nearest_search

        return nearest_search(self._vertices[self._mesh.faces])

    @property
    def _extent(self) -> float:
        return float(np.ptp(self._vertices, axis=0).max())


def winged_edges(faces: Sequence[Sequence[int]], vertices: int) -> WingedEdges:
    """The edges of a closed surface; ValueError with the face, edge or vertex at fault."""
    counts = np.array([len(face) for face in faces])
    _check(counts < 3, "faces[{0}] must have at least 3 corners, got {1}", counts)
    begins = np.concatenate([[0], np.cumsum(counts)])
    corners = np.array([corner for face in faces for corner in face])
    face = np.repeat(np.arange(len(counts)), counts)
    _check_corners(corners, face, vertices)
    after = _after(begins)
    before = np.empty_like(after)
    before[after] = np.arange(len(after))
    twin = _twins(corners, corners[after], face, vertices)
    # Around each vertex there must be one ring of faces.
    groups = linked_groups(len(twin), np.arange(len(twin)), twin[before])
    rings = np.bincount(corners[np.unique(groups, return_index=True)[1]], minlength=vertices)
    _check(rings > 1, "vertices[{0}] joins {1} parts of the surface that only touch there", rings)
    pairs = np.column_stack([np.arange(len(twin)), twin])[corners < corners[after]]
    steps = np.concatenate([after, twin])
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
        shells=int(linked_groups(len(face), np.tile(np.arange(len(face)), 2), steps).max()) + 1,
    )


def _check_corners(corners: Longs, face: Longs, vertices: int) -> None:
    bad = (corners < 0) | (corners >= vertices)
    if bad.any():
        first = int(bad.argmax())
        raise ValueError(
            f"faces[{face[first]}] names vertex {corners[first]}, but there are only "
            f"{vertices}, counted from 0"
        )
    numbers = face.astype(np.int64) * vertices + corners
    pairs, first, times = np.unique(numbers, return_index=True, return_counts=True)
    if len(pairs) < len(corners):
        twice = first[times > 1].min()
        raise ValueError(f"faces[{face[twice]}] has the corner {corners[twice]} twice")
    used = np.bincount(corners, minlength=vertices) > 0
    if not used.all():
        raise ValueError(f"vertices[{used.argmin()}] belongs to no face")


def _twins(first: Longs, last: Longs, face: Longs, vertices: int) -> Longs:
    """For each side of a face the same edge of the neighbour, in the opposite direction."""
    there = first.astype(np.int64) * vertices + last
    back = last.astype(np.int64) * vertices + first
    order = there.argsort(kind="stable")
    same = np.flatnonzero(np.diff(there[order]) == 0)
    if len(same):
        side, other = order[same[0]], order[same[0] + 1]
        raise ValueError(
            f"faces[{face[side]}] and faces[{face[other]}] both pass the edge from vertex "
            f"{first[side]} to {last[side]} in this direction; reverse one of them, or remove it"
        )
    place = np.minimum(np.searchsorted(there[order], back), len(order) - 1)
    twin: Longs = order[place]
    is_open = there[twin] != back
    if is_open.any():
        side = int(is_open.argmax())
        raise ValueError(
            f"faces[{face[side]}] has no neighbour at the edge from vertex {first[side]} to "
            f"{last[side]}; the surface must be closed"
        )
    return twin


def _after(begins: Longs) -> Longs:
    after = np.arange(begins[-1]) + 1
    after[begins[1:] - 1] = begins[:-1]
    return after


def _check(bad: Bools, sentence: str, values: Longs) -> None:
    if bad.any():
        first = int(bad.argmax())
        raise ValueError(sentence.format(first, values[first]))


def triangulate_polygons(vertices: Floats, begins: Ints, corners: Ints, normals: Floats) -> Ints:
    """Triangles (k, 3) of plane polygons with their orientation; ValueError for self-crossings."""
    count = np.diff(begins)
    convex = _convex(vertices, begins, corners, normals)
    fan = np.where(convex, count - 2, 0)
    polygon = np.repeat(np.arange(len(count)), fan)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(fan) - fan, fan)
    first = begins[polygon]
    triangles = [corners[np.column_stack([first, first + step + 1, first + step + 2])]]
    for face in np.flatnonzero(~convex):
        own = corners[begins[face] : begins[face + 1]]
        triangles.append(own[by_ears(vertices[own], normals[face], int(face))])
    return np.concatenate(triangles).astype(np.int32)


def _convex(
    vertices: Floats, begins: Ints, corners: Ints, normals: Floats, rounding: float = 1e-9
) -> Bools:
    """Whether each polygon turns left at all corners, once around.

    `rounding`: of the sine of a turn.
    """
    after = _after(begins)
    places = vertices[corners]
    side = places[after] - places
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    normal = np.repeat(normals, np.diff(begins), axis=0)
    sine = np.einsum("ni,ni->n", np.cross(side, side[after]), normal)
    cosine = np.einsum("ni,ni->n", side, side[after])
    turn = np.add.reduceat(np.arctan2(sine, cosine), begins[:-1])
    lefts = np.minimum.reduceat(sine, begins[:-1]) >= -rounding
    return np.asarray(lefts & (turn < 3.0 * np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class WingedEdges:
    """A closed surface of polygons. Edges are directed along their left face's corners."""

    ends: Ints  # first and last vertex of each edge, (e, 2)
    faces: Ints  # face on its left and on its right, (e, 2)
    before: Ints  # edge before it around the left face, and around the right one, (e, 2)
    after: Ints  # edge after it around the left face, and around the right one, (e, 2)
    begins: Ints  # first index of each face in `corners`, and the end of the last, (f + 1,)
    corners: Ints  # vertices of all faces, face after face, counter-clockwise seen from outside
    sides: Ints  # edge from each of these corners to the next
    vertices: int  # number of vertices
    shells: int  # number of connected surfaces

    @property
    def euler(self) -> int:
        """V - E + F, which is 2 (shells - genus): Euler and Poincare."""
        return self.vertices - len(self.ends) + len(self.begins) - 1

    @property
    def genus(self) -> int:
        """Number of holes through the surfaces."""
        return self.shells - self.euler // 2

    def edges_of_face(self, face: int) -> Ints:
        """Edges around a face in order; the first begins at its first corner."""
        return self.sides[self.begins[face] : self.begins[face + 1]]

    def neighbours_of_face(self, face: int) -> Ints:
        """Faces across the edges of a face, in the order of the edges."""
        pairs = self.faces[self.edges_of_face(face)]
        return np.asarray(np.where(pairs[:, 0] == face, pairs[:, 1], pairs[:, 0]))
