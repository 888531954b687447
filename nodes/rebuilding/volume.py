"""What a closed mesh encloses: how deep places lie inside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import NearestSearch, nearest_points, nearest_search
from palpate.core.rebuild import surface
from palpate.core.shapes import Mesh, TriangleShape

UPWARD = np.array([0.0, 0.0, 1.0])  # Of rays out of a solid
MAX_RAY = 1.0  # [m] no object is larger


@dataclass(frozen=True, eq=False)
class MeshVolume:
    """What a closed mesh encloses."""

    mesh: Mesh | surface.SurfaceMesh

    @cached_property
    def search(self) -> NearestSearch:
        """Of its nearest points."""
        return nearest_search(self.mesh.vertices[self.mesh.faces])

    @cached_property
    def shape(self) -> TriangleShape:
        """The same, ready for rays."""
        return TriangleShape(self.mesh.vertices, self.mesh.faces)

    def depths(self, places: Floats, min_face_cosine: float = 0.5) -> Floats:
        """How deep places (n, 3) lie in it, (n,), m; 0 outside.

        A place above its nearest face, within the angle of `min_face_cosine` from the face's
        normal, is outside. Only for the others, which may lie beside a crease, rays are cast.
        """
        depths = np.zeros(len(places))
        if not len(places):
            return depths
        nearest = nearest_points(self.search, places)
        edges = self.search.triangles.edges[nearest.faces]
        normals = np.cross(edges[:, 0], edges[:, 1])
        over = np.einsum("ni,ni->n", places - nearest.points, normals)
        above = min_face_cosine * nearest.distances * np.linalg.norm(normals, axis=1)
        left = np.flatnonzero(over <= above)
        if len(left):
            inside = left[np.isneginf(self.shape.cast(places[left], UPWARD, MAX_RAY))]
            depths[inside] = nearest.distances[inside]
        return depths
