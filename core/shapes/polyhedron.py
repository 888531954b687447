"""Polyhedron: a closed surface of plane polygons, convex or not."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.shapes.crossed_mesh import CrossedMesh
from palpate.core.shapes.polygon import triangulated
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.triangles import HAS_EMBREE, TriangleShape
from palpate.core.shapes.winged_edge import WingedEdges, winged_edges

if TYPE_CHECKING:  # only lattices ask for distances
    from palpate.core.measure.nearest import NearestSearch

PLANE = 1e-4
"""Share of the polyhedron's extent by which a corner may lie beside its face's plane: the
digits that people type."""
LEAST_EDGE = 1e-6
"""Of its extent."""
LEAST_VOLUME = 1e-9
"""Of a cube as large as its extent."""
ASKEW = np.array([0.36, 0.48, 0.8])
"""Direction in which it is asked whether points are inside."""
FEW_TRIANGLES = 500
"""So many are looked at one by one, in double precision; of more, Embree finds the first."""


class Polyhedron:
    """One closed surface of polygons.

    Faces may all be turned inwards: they are then turned around. Whether faces cross each
    other is not looked at.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : sequence of sequences of int
        Corners of each face by number, from 0, counter-clockwise seen from outside.

    Raises
    ------
    ValueError
        If the surface is not closed, in one piece and of plane faces with an area, or encloses
        nothing: the sentence names the face, the edge or the vertex.

    Notes
    -----
    Fung, 1999, section 2.5.3. Rays are cast at the planes of the faces' triangles.
    """

    def __init__(self, vertices: Floats, faces: Sequence[Sequence[int]]):
        self._vertices = finite_array("vertices", vertices, (None, 3))
        edges = winged_edges(faces, len(self._vertices))
        if edges.shells != 1:
            raise ValueError(f"faces must form one surface, got {edges.shells} that do not touch")
        self._check_edges(edges)
        normals = self._normals(edges)
        triangles = triangulated(self._vertices, edges.begins, edges.corners, normals)
        volume = _volume(self._vertices, triangles)
        if abs(volume) <= LEAST_VOLUME * self._extent**3:
            raise ValueError("faces enclose nothing: those on the two sides lie on one another")
        if volume < 0.0:
            edges = winged_edges([face[::-1] for face in faces], len(self._vertices))
            triangles, volume = np.ascontiguousarray(triangles[:, ::-1]), -volume
        self._edges, self._volume = edges, volume
        embree = HAS_EMBREE and len(triangles) > FEW_TRIANGLES
        self._triangles = TriangleShape(self._vertices, triangles, embree)

    @property
    def edges(self) -> WingedEdges:
        """Who borders on whom, turned outwards."""
        return self._edges

    @property
    def volume(self) -> float:
        """Volume, m3."""
        return self._volume

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3), m."""
        return self._triangles.bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        return self._triangles.cast(origins, direction, reach)

    def enclosure(self) -> Floats:
        """The bounds: see `ImplicitShape.enclosure`."""
        return self.bounds()

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`."""
        return self._crossings.spans(origins, direction)

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distance from the surface, negative inside, and its slope (n,), m and 1."""
        from palpate.core.measure.nearest import nearest_points

        mesh = self._triangles.mesh(0)
        near = nearest_points(self._search, points)
        inside = self._crossings.spans(points, ASKEW)[:, 0, 0] < 0.0
        sign = np.where(inside, -1.0, 1.0)
        a, b, c = mesh.vertices[mesh.faces[near.faces]].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        away = sign[:, None] * (points - near.points)
        # On the surface there is no way to it, from which to tell the direction.
        there = near.distances <= LEAST_EDGE * self._extent
        away = np.where(there[:, None], normal, away)
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        return sign * near.distances, np.einsum("ni,ni->n", away, directions)

    def mesh(self, level: int) -> Mesh:
        """The faces as triangles, whatever the level."""
        return self._triangles.mesh(level)

    def _check_edges(self, edges: WingedEdges) -> None:
        first, last = self._vertices[edges.ends].transpose(1, 0, 2)
        short = np.linalg.norm(last - first, axis=1) <= LEAST_EDGE * self._extent
        if short.any():
            one, two = edges.ends[short.argmax()]
            raise ValueError(f"vertices[{one}] and vertices[{two}] are an edge without length")

    def _normals(self, edges: WingedEdges) -> Floats:
        """Unit normals of the faces (Newell), which must be plane and have an area."""
        begins, corners = edges.begins[:-1], edges.corners
        count = np.diff(edges.begins)
        places = self._vertices[corners]
        middle = np.add.reduceat(places, begins) / count[:, None]
        local = places - np.repeat(middle, count, axis=0)
        after = np.arange(len(corners)) + 1
        after[edges.begins[1:] - 1] = begins
        area = 0.5 * np.add.reduceat(np.cross(local, local[after]), begins)
        size = np.linalg.norm(area, axis=1)
        flat = size <= (LEAST_EDGE * self._extent) ** 2
        if flat.any():
            raise ValueError(f"faces[{flat.argmax()}] has no area: its corners lie on a line")
        normals = area / size[:, None]
        beside = np.abs(np.einsum("ni,ni->n", local, np.repeat(normals, count, axis=0)))
        if beside.max() > PLANE * self._extent:
            corner = int(beside.argmax())
            face = int(np.searchsorted(edges.begins, corner, side="right")) - 1
            raise ValueError(
                f"faces[{face}] is not plane: vertex {corners[corner]} lies {beside[corner]:.3g} m "
                f"beside it, at most {PLANE * self._extent:.3g} m will do; split the face"
            )
        return np.asarray(normals)

    @cached_property
    def _crossings(self) -> CrossedMesh:
        return CrossedMesh(*self._triangles.mesh(0))

    @cached_property
    def _search(self) -> NearestSearch:
        from palpate.core.measure.nearest import search_of

        vertices, faces = self._triangles.mesh(0)
        return search_of(vertices[faces])

    @property
    def _extent(self) -> float:
        return float(np.ptp(self._vertices, axis=0).max())


def _volume(vertices: Floats, triangles: Ints) -> float:
    """Signed volume, from the mesh's middle, m3."""
    a, b, c = (vertices - vertices.mean(axis=0))[triangles].transpose(1, 0, 2)
    return float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0
