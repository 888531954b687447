"""A solid after a deformation of space: cast as triangles, and from there exactly if asked.

From the facet to the exact surface by Newton's method. The unknowns are the place p in the
undeformed solid and the way s along the ray:

    deform(p) = start + s direction,    f(p) = 0

with the solid's inside-outside function f. Eliminating p leaves one division a ray.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.shapes.protocol import INSIDE, MISS, ImplicitShape, Mesh
from palpate.core.shapes.triangle_meshes import TriangleShape

# 82k faces: the facets of a 0.1 m ball stand off by less than 10 um, at a box's edges by more.
CAST_LEVEL = 6
MOST_STEPS = 12
STEP_TOLERANCE = 1e-8  # Of the solid's size. The step after it would be its square.
FARTHEST = 0.05  # Of the solid's size: a place that moves farther is on another part of the surface


class Deformation(Protocol):
    """Moves points of space."""

    def deform(self, points: Floats) -> Floats:
        """Where points (n, 3) go, m."""

    def deform_with_jacobian(self, points: Floats) -> tuple[Floats, Floats]:
        """That, and its derivative (n, 3, 3), a column for each of x, y, z."""


class Polished(NamedTuple):
    """Rays, and how many of them were taken to the exact surface."""

    ranges: Floats  # Range (n,), as `Shape.cast` gives it
    met: int  # Rays that meet a facet
    kept: int  # Those of them that keep the facet's range: their way to the exact surface failed


class DeformedShape:
    """A solid of which every point is moved.

    `base`: what is deformed. `deformation`: how; it must fold nothing. `exact`: whether rays are
    taken from the facets to the exact surface, at some six times the cost. Rays that pass a facet
    by still miss.
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


def polish(
    base: ImplicitShape, deformation: Deformation, places: Floats, starts: Floats, direction: Floats
) -> tuple[Floats, Bools]:
    """Ways along parallel rays from near a deformed surface onto it.

    `base`: what is deformed. `deformation`: how. `places` (n, 3): near the surface of the base, m.
    `starts` (n, 3): where they are on the rays, about, m. `direction` (3,): the rays' unit
    direction. Returns `ways` (n,): to the surface, m; negative backwards. `converged` (n,): where
    the way can be believed: the steps vanished, and on all of them the place stayed near and the
    surface faced the ray.
    """
    low, high = base.enclosure()  # a lattice says nothing of what lies beyond
    size = float((high - low).min())
    ways, first = np.zeros(len(places)), places
    lost = np.zeros(len(places), bool)
    for _ in range(MOST_STEPS):
        reached, slopes = deformation.deform_with_jacobian(places)
        residual = starts + ways[:, None] * direction - reached
        aside, along = _solved(slopes, residual, direction)
        value, slope_aside = base.inside_out(places, aside)
        slope = base.inside_out(places, along)[1]
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # those are lost
            way = -(value + slope_aside) / slope
            move = aside + way[:, None] * along
            step = np.maximum(np.abs(way), np.abs(move).max(axis=1))
            places, ways = np.clip(places + move, low, high), ways + way
            moved = np.maximum(np.abs(ways), np.abs(places - first).max(axis=1))
        lost |= ~((slope < 0.0) & (step < np.inf) & (moved <= FARTHEST * size))
        places, ways = np.where(lost[:, None], first, places), np.where(lost, 0.0, ways)
        done = ~lost & (step <= STEP_TOLERANCE * size)
        if (done | lost).all():
            break
    return ways, done


def _solved(matrices: Floats, first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Solutions (n, 3) of n systems of three equations for two right-hand sides.

    By Cramer's rule: the matrices are near to rotations, for no part of a solid is flattened.
    """
    x, y, z = matrices.transpose(2, 0, 1)
    rows = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)
    volume = np.einsum("ni,ni->n", rows[:, 0], x)[:, None]
    return (rows @ first[:, :, None])[:, :, 0] / volume, (rows @ second) / volume
