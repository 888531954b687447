"""A triangle mesh as a shape, cast by Embree, or by a z-buffer where Embree is missing."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.zbuffer import ZBuffer

try:
    from embreex.mesh_construction import TriangleMesh as _EmbreeMesh
    from embreex.rtcore_scene import EmbreeScene
except ImportError:  # there is no wheel for this machine
    EmbreeScene = None


class TriangleShape:
    """A closed triangle mesh.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Counter-clockwise seen from outside. That the mesh is closed and turned the right way
        is for the reader of the file to check.
    embree : bool
        False for the z-buffer, which needs nothing but numpy.

    Notes
    -----
    A ray starts inside if the first surface that it meets, however far, is seen from behind.
    Embree works in single precision: ranges are right to about 1e-7 of the object's size.
    """

    def __init__(self, vertices: Floats, faces: Ints, embree: bool = EmbreeScene is not None):
        self._mesh = Mesh(vertices, faces)
        corners = vertices[faces]
        self._normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        if embree:
            self._scene = EmbreeScene()
            self._kept = _EmbreeMesh(self._scene, corners.astype(np.float32))
        else:
            self._zbuffer = ZBuffer(vertices, faces)
        self._embree = embree

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3), m."""
        return np.stack([self._mesh.vertices.min(axis=0), self._mesh.vertices.max(axis=0)])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        if self._embree:
            ranges, faces = self._cast_embree(origins, direction)
        else:
            ranges, faces = self._zbuffer.first_hits(origins, direction)
        met = faces >= 0
        behind = np.zeros(len(origins), bool)
        behind[met] = self._normals[faces[met]] @ direction > 0.0
        result = np.where(met & (ranges <= reach), ranges, MISS)
        result[behind] = INSIDE
        return result

    def mesh(self, level: int) -> Mesh:
        """The mesh itself, whatever the level."""
        return self._mesh

    def _cast_embree(self, origins: Floats, direction: Floats) -> tuple[Floats, Ints]:
        towards = np.broadcast_to(direction.astype(np.float32), origins.shape)
        hits = self._scene.run(
            origins.astype(np.float32), np.ascontiguousarray(towards), query="INTERSECT", output=1
        )
        return hits["tfar"].astype(np.float64), hits["primID"]
