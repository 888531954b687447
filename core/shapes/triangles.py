"""A triangle mesh as a shape, cast by Embree, or by a z-buffer where Embree is missing."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Protocol

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.winding import is_closed, is_inside_out
from palpate.core.shapes.zbuffer import Hits, ZBuffer

HAS_EMBREE = find_spec("embreex") is not None
"""False where there is no wheel for this machine."""
MOST_LAYERS = 64
"""Back faces that a ray goes through on its way to a front face."""
NUDGE = 1e-6
"""How far behind a back face the ray starts anew, as a share of the mesh's extent: some ten
times what single precision can tell apart."""


class Backend(Protocol):
    """What finds the faces that rays meet."""

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces along parallel rays, seen from either side."""


class TriangleShape:
    """A triangle mesh.

    A mesh that is inside out is turned. A ray that starts inside a closed mesh says so, however
    far its exit lies. A mesh with holes has no inside: its faces are met from outside alone.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Corners, by number; neighbours turned alike.
    embree : bool
        False for the z-buffer, which needs nothing but numpy.
    """

    def __init__(self, vertices: Floats, faces: Ints, embree: bool = HAS_EMBREE):
        self._flipped = is_inside_out(vertices, faces)
        self._closed = is_closed(faces)
        faces = np.ascontiguousarray(faces[:, ::-1]) if self._flipped else faces
        self._mesh = Mesh(vertices, faces)
        a, b, c = vertices[faces].transpose(1, 0, 2)
        self._normals = np.cross(b - a, c - a)
        self._nudge = NUDGE * float(np.ptp(vertices, axis=0).max())
        self._backend = _backend(vertices, faces, embree)

    @property
    def closed(self) -> bool:
        """Whether the mesh has no holes."""
        return self._closed

    @property
    def flipped(self) -> bool:
        """Whether the faces were given inside out."""
        return self._flipped

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3), m."""
        return np.stack([self._mesh.vertices.min(axis=0), self._mesh.vertices.max(axis=0)])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        ranges = self.first_hits(origins, direction).ranges
        return np.where(ranges <= reach, ranges, MISS)

    def mesh(self, level: int) -> Mesh:
        """The mesh itself, turned outwards, whatever the level."""
        return self._mesh

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces met from outside along parallel rays, however far.

        The range is `INSIDE` where a ray starts inside.
        """
        hits = self._backend.first_hits(origins, direction)
        behind = np.flatnonzero(self._from_behind(hits, direction))
        if self._closed and len(behind):
            # A ray along a silhouette may show the back of an edge: look the other way too.
            back = self._backend.first_hits(origins[behind], -direction)
            inside = self._from_behind(back, -direction)
            hits.ranges[behind[inside]] = INSIDE
            behind = behind[~inside]
        for _ in range(MOST_LAYERS):
            if not len(behind):
                return hits
            way = hits.ranges[behind] + self._nudge
            beyond = self._backend.first_hits(origins[behind] + way[:, None] * direction, direction)
            hits.ranges[behind] = way + beyond.ranges
            hits.faces[behind], hits.weights[behind] = beyond.faces, beyond.weights
            behind = behind[self._from_behind(beyond, direction)]
        hits.ranges[behind], hits.faces[behind] = MISS, -1
        return hits

    def _from_behind(self, hits: Hits, direction: Floats) -> Bools:
        result: Bools = (hits.faces >= 0) & (self._normals[hits.faces] @ direction > 0.0)
        return result


def _backend(vertices: Floats, faces: Ints, embree: bool) -> Backend:
    if not embree:
        return ZBuffer(vertices, faces)
    from palpate.core.shapes.embree import Embree

    return Embree(vertices, faces)
