"""First hits of parallel rays on triangles, by Embree; imported only where installed."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.triangle_meshes import Hits

# A range in double precision that differs by more than this share of it, or of the mesh's extent,
# from Embree's is not believed: the face is seen edge-on.
SINGLE = 1e-5


class Embree:
    """Triangles, ready for rays.

    Embree works in single precision: it finds the face, and the range is then that of the
    face's plane in double precision.
    """

    def __init__(self, vertices: Floats, faces: Ints):
        corners = vertices[faces]
        self._places = corners[:, 0]
        self._normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._extent = float(np.ptp(vertices, axis=0).max())
        self._scene = EmbreeScene(robust=True)  # no ray slips between two triangles
        self._kept = TriangleMesh(self._scene, corners.astype(np.float32))

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces along parallel rays, seen from either side."""
        towards = np.broadcast_to(direction.astype(np.float32), origins.shape)
        found = self._scene.run(
            origins.astype(np.float32), np.ascontiguousarray(towards), query="INTERSECT", output=1
        )
        faces = np.asarray(found["primID"], np.int32)
        ranges = np.where(faces >= 0, found["tfar"], np.inf).astype(np.float64)
        weights = np.column_stack([found["u"], found["v"]]).astype(np.float64)
        return Hits(self._refined(origins, direction, ranges, faces), faces, weights)

    def _refined(self, origins: Floats, direction: Floats, ranges: Floats, faces: Ints) -> Floats:
        normals = self._normals[faces]
        with np.errstate(divide="ignore", invalid="ignore"):
            exact = np.einsum("ni,ni->n", self._places[faces] - origins, normals) / (
                normals @ direction
            )
            near = np.abs(exact - ranges) <= SINGLE * (ranges + self._extent)
        return np.where(near & (faces >= 0), np.maximum(exact, 0.0), ranges)
