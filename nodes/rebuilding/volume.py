"""The volume of a closed mesh, and depths of places inside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import NearestSearch, nearest_points, nearest_search
from palpate.core.rebuild import surface
from palpate.core.shapes import Mesh, TriangleShape

UPWARD = np.array([0.0, 0.0, 1.0])  # direction of rays that decide whether a place is inside
MAX_RAY = 1.0  # length of rays [m]; no object is larger


@dataclass(frozen=True, eq=False)
class MeshVolume:
    """The volume of a closed mesh."""

    mesh: Mesh | surface.SurfaceMesh

    @cached_property
    def search(self) -> NearestSearch:
        """Search structure for nearest points of the mesh."""
        return nearest_search(self.mesh.vertices[self.mesh.faces])

    @cached_property
    def shape(self) -> TriangleShape:
        """The mesh as a shape for casting rays."""
        return TriangleShape(self.mesh.vertices, self.mesh.faces)

    def depths(self, places: Floats, min_face_cosine: float = 0.5) -> Floats:
        """Depths (n,) of places (n, 3) inside the mesh [m]; 0 outside.

        A place is outside if the direction to it from its nearest point has a cosine above
        `min_face_cosine` with the normal of that face. Rays decide on all other places.
        """
        depths = np.zeros(len(places))
        if not len(places):
            return depths
        nearest = nearest_points(self.search, places)
        edges = self.search.triangles.edges[nearest.faces]
        normals = np.cross(edges[:, 0], edges[:, 1])
        over = np.einsum("ni,ni->n", places - nearest.points, normals)
        above = min_face_cosine * nearest.distances * np.linalg.norm(normals, axis=1)
        undecided = np.flatnonzero(over <= above)
        if len(undecided):
            inside = undecided[np.isneginf(self.shape.cast(places[undecided], UPWARD, MAX_RAY))]
            depths[inside] = nearest.distances[inside]
        return depths
