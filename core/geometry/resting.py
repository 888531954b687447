"""Sides on which a solid rests on a plane, and the side on which it comes to rest.

Its convex hull touches the plane. It rests on a facet of the hull if its centre of mass lies above
that facet (Goldberg, Mirtich, Zhuang et al., *Part pose statistics*, 1999); from any other facet it
rolls over the edge beyond which the centre of mass lies, which lowers it, until it rests.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.poses import axes_along, cross_matrices


class Rest(NamedTuple):
    """A side on which a solid rests."""

    down: Floats  # unit vector in the solid's frame that points downwards, (3,)
    height: float  # of the centre of mass above the plane [m]; lower ones are more stable


class RestingSolid:
    """The convex hull of a solid, and its centre of mass."""

    def __init__(self, vertices: Floats, faces: Ints, rounding: float = 1e-9):
        """From a closed mesh, (n, 3) [m] and (m, 3), of uniform density; ValueError if it is flat.

        `rounding`: least barycentric coordinate, below 0, that counts as on the facet's edge.
        """
        self._min_inside = -rounding
        points = finite_array("vertices", vertices, (None, 3))
        self.centre = centre_of_mass(points[faces])
        try:
            hull = scipy.spatial.ConvexHull(points)
        except scipy.spatial.QhullError:
            raise ValueError("vertices must enclose a volume to rest on a side") from None
        self._corners = points[hull.simplices]
        self._neighbours = hull.neighbors
        self._normals = hull.equations[:, :3]
        self._heights = -(self._normals @ self.centre + hull.equations[:, 3])
        self.hull: Floats = points[hull.vertices]  # its corners, (k, 3) [m]

    @cached_property
    def rests(self) -> tuple[Rest, ...]:
        """All sides on which it rests, the most stable first."""
        stable = np.flatnonzero(self._above.min(axis=1) >= self._min_inside)
        ordered = stable[np.argsort(self._heights[stable], kind="stable")]
        return tuple(Rest(self._normals[i], float(self._heights[i])) for i in ordered)

    def settled(self, down: Floats) -> Rest:
        """The side on which it comes to rest, set down with its direction `down` (3,) downwards.

        It lands on the facet that is most nearly level, and rolls from there.
        """
        above = self._above
        facet, visited = int((self._normals @ down).argmax()), np.zeros(len(above), np.bool_)
        while above[facet].min() < self._min_inside and not visited[facet]:
            visited[facet] = True
            facet = int(self._neighbours[facet, above[facet].argmin()])
        return Rest(self._normals[facet], float(self._heights[facet]))

    def is_firm(
        self, rest: Rest, lean: float, same: float = math.radians(20.0), n_directions: int = 8
    ) -> bool:
        """Whether it comes to rest on the same side after leaning by an angle [rad].

        `same`: largest angle between facets of one side [rad], because round sides have many
        facets. `n_directions`: of the leaning.
        """
        across = axes_along(rest.down)[:, :2]
        turns = np.linspace(0.0, 2.0 * np.pi, n_directions, endpoint=False)
        sides = np.column_stack([np.cos(turns), np.sin(turns)]) @ across.T
        downs = np.cos(lean) * rest.down + np.sin(lean) * sides
        return all(self.settled(leaning).down @ rest.down > np.cos(same) for leaning in downs)

    @cached_property
    def _above(self) -> Floats:
        """Barycentric coordinates (f, 3) of the centre of mass, projected into each facet."""
        foot = self.centre + self._heights[:, None] * self._normals
        u, v = (self._corners[:, k] - self._corners[:, 0] for k in (1, 2))
        area = np.cross(u, v)
        square = np.maximum((area**2).sum(axis=1), np.finfo(float).tiny)
        away = foot - self._corners[:, 0]
        second = (np.cross(away, v) * area).sum(axis=1) / square
        third = (np.cross(u, away) * area).sum(axis=1) / square
        return np.column_stack([1.0 - second - third, second, third])


def centre_of_mass(corners: Floats) -> Floats:
    """Centre of mass (3,) of a closed mesh (m, 3, 3) of uniform density; its mean if flat."""
    middle = corners.reshape(-1, 3).mean(axis=0)
    moved = corners - middle
    volumes = np.einsum("mi,mi->m", moved[:, 0], np.cross(moved[:, 1], moved[:, 2]))
    total = float(volumes.sum())
    if not abs(total) > np.finfo(float).eps * float(np.abs(volumes).sum()):
        return np.asarray(middle)
    return np.asarray(middle + (volumes[:, None] * moved.sum(axis=1)).sum(axis=0) / (4.0 * total))


def rotation_between(before: Floats, after: Floats) -> Floats:
    """The rotation (3, 3) by the smallest angle from one unit vector (3,) to another."""
    axis, cosine = np.cross(before, after), float(before @ after)
    if cosine < -1.0 + 1e-9:  # half a turn, about any perpendicular axis
        across = np.cross(before, np.eye(3)[int(np.argmin(np.abs(before)))])
        across /= np.linalg.norm(across)
        return np.asarray(2.0 * np.outer(across, across) - np.eye(3))
    cross = cross_matrices(axis[None])[0]
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
