"""What a closed mesh encloses: how deep places lie inside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import NearestSearch, nearest_points, nearest_search
from palpate.core.rebuild import surface
from palpate.core.shapes import Mesh, TriangleShape

OVER = 0.5  # Cosine to a face's normal above which a place lies over it, not inside beside a crease
UPWARD, FARTHEST = np.array([0.0, 0.0, 1.0]), 1.0  # Rays out of a solid, and their length, m


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

    def depths(self, places: Floats) -> Floats:
        """How deep places (n, 3) lie in it, (n,), m; 0 outside."""
        depths = np.zeros(len(places))
        if not len(places):
            return depths
        nearest = nearest_points(self.search, places)
        edges = self.search.triangles.edges[nearest.faces]
        normals = np.cross(edges[:, 0], edges[:, 1])
        over = np.einsum("ni,ni->n", places - nearest.points, normals)
        # Who stands over the nearest face is outside; rays, which take long to prepare, tell of
        # whoever does not.
        left = np.flatnonzero(over <= OVER * nearest.distances * np.linalg.norm(normals, axis=1))
        if len(left):
            inside = left[np.isneginf(self.shape.cast(places[left], UPWARD, FARTHEST))]
            depths[inside] = nearest.distances[inside]
        return depths
