"""First hits of parallel rays on triangles, as a z-buffer along the rays' direction.

Seen along the rays the problem is flat: each triangle is three half-planes and a plane of
depths, all affine in the two coordinates across, evaluated for all rays at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints

EDGE_TOLERANCE = 1e-9
"""Of barycentric coordinates: a ray through an edge must not slip between two triangles."""


class Hits(NamedTuple):
    """First hits of rays."""

    ranges: Floats
    """Range, (n,), m; infinite for a ray that meets nothing."""
    faces: Ints
    """Face, (n,); -1 for a ray that meets nothing."""
    weights: Floats
    """Weights of the face's second and third corner, (n, 2)."""


class ZBuffer:
    """Triangles, ready to be seen from any direction."""

    def __init__(self, vertices: Floats, faces: Ints):
        self._vertices = vertices
        self._faces = faces

    def first_hits(self, origins: Floats, direction: Floats) -> Hits:
        """First faces along parallel rays, seen from either side."""
        axes = _axes_across(direction)
        seen = self._vertices @ axes  # columns: across, across, along
        rays = origins @ axes
        near = self._faces_near(seen, rays)
        count = len(origins)
        if not len(near):
            return Hits(np.full(count, np.inf), np.full(count, -1, np.int32), np.zeros((count, 2)))
        depth, second, third = _depths(seen[self._faces[near]], rays)
        first = np.arange(count), depth.argmin(axis=1)
        ranges = depth[first]
        faces = np.where(np.isfinite(ranges), near[first[1]], -1).astype(np.int32)
        return Hits(ranges, faces, np.column_stack([second[first], third[first]]))

    def _faces_near(self, seen: Floats, rays: Floats) -> Ints:
        corners = seen[self._faces]
        low, high = corners.min(axis=1), corners.max(axis=1)
        first, last = rays.min(axis=0), rays.max(axis=0)
        across = (low[:, :2] <= last[:2]) & (high[:, :2] >= first[:2])
        ahead = high[:, 2] >= first[2]
        found: Ints = np.flatnonzero(across.all(axis=1) & ahead).astype(np.int32)
        return found


def _axes_across(direction: Floats) -> Floats:
    """Orthonormal axes as columns, the last along `direction`."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(direction)))] = 1.0
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(direction, first), direction])


def _depths(corners: Floats, rays: Floats) -> tuple[Floats, Floats, Floats]:
    """Range from each ray's origin to each triangle, (rays, triangles); infinite if none.

    Then the weights of the triangle's second and third corner there, likewise.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1])
    edge_on = area == 0.0
    area = np.where(edge_on, 1.0, area)
    x, y = rays[:, :1], rays[:, 1:2]
    of_a = ((b[:, 0] - x) * (c[:, 1] - y) - (c[:, 0] - x) * (b[:, 1] - y)) / area
    of_b = ((c[:, 0] - x) * (a[:, 1] - y) - (a[:, 0] - x) * (c[:, 1] - y)) / area
    of_c = 1.0 - of_a - of_b
    within = np.minimum(np.minimum(of_a, of_b), of_c) >= -EDGE_TOLERANCE
    depth = of_a * a[:, 2] + of_b * b[:, 2] + of_c * c[:, 2] - rays[:, 2:]
    return np.where(within & ~edge_on & (depth >= 0.0), depth, np.inf), of_b, of_c
