"""A solid after a deformation of space: cast as triangles, and from there exactly if asked."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.polish import polish
from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape, Mesh
from palpate.core.shapes.triangles import TriangleShape

CAST_LEVEL = 6
"""82k faces: the facets of a 0.1 m ball stand off by less than 10 um, at a box's edges by more."""


class Deformation(Protocol):
    """Moves points of space."""

    def deform(self, points: Floats) -> Floats:
        """Where points (n, 3) go, m."""

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """That, and its derivative (n, 3, 3), a column for each of x, y, z."""


class Polished(NamedTuple):
    """Rays, and how many of them were taken to the exact surface."""

    ranges: Floats
    """Range (n,), as `Shape.cast` gives it."""
    met: int
    """Rays that meet a facet."""
    kept: int
    """Those of them that keep the facet's range: their way to the exact surface failed."""


class DeformedShape:
    """A solid of which every point is moved.

    Parameters
    ----------
    base : ImplicitShape
        What is deformed.
    deformation : Deformation
        How; it must fold nothing.
    exact : bool
        Whether rays are taken from the facets to the exact surface, at some six times the
        cost. Rays that pass a facet by still miss.
    """

    def __init__(self, base: ImplicitShape, deformation: Deformation, exact: bool = False):
        self._base, self._deformation, self._exact = base, deformation, exact
        self._undeformed = base.mesh(CAST_LEVEL)
        self._triangles = TriangleShape(
            deformation.deform(self._undeformed.vertices), self._undeformed.faces
        )

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of the facets, (2, 3), m."""
        return self._triangles.bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays: see `Shape.cast`."""
        if self._exact:
            return self.cast_exactly(origins, direction, reach).ranges
        return self._triangles.cast(origins, direction, reach)

    def cast_exactly(self, origins: Floats, direction: Floats, reach: float) -> Polished:
        """Rays to the exact surface, beginning at the facets that they meet."""
        hits = self._triangles.first_hits(origins, direction)
        met = np.flatnonzero(np.isfinite(hits.ranges))
        if not len(met):
            return Polished(hits.ranges, 0, 0)
        corners = self._undeformed.vertices[self._undeformed.faces[hits.faces[met]]]
        second, third = hits.weights[met].T
        weights = np.stack([1.0 - second - third, second, third])
        exact, done = polish(
            self._base,
            self._deformation,
            np.einsum("kn,nkc->nc", weights, corners),
            origins[met] + hits.ranges[met, None] * direction,
            direction,
        )
        ranges = hits.ranges
        ranges[met[done]] += exact[done]
        # A ray that starts between the facets and the exact surface starts inside.
        started = met[done & (ranges[met] < 0.0)]
        ranges = np.where(ranges <= reach, ranges, MISS)
        ranges[started] = INSIDE
        return Polished(ranges, len(met), int(np.count_nonzero(~done)))

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, deformed: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        return Mesh(self._deformation.deform(vertices), faces)
