"""On which sides a solid rests on a plane, and on which of them it comes to rest.

What touches the plane is its convex hull. It rests on a facet of it when its centre of mass lies
above that facet (Goldberg, Mirtich, Zhuang et al., *Part pose statistics*, 1999); on any other it
rolls over the edge that the centre of mass is beyond, which lowers it, until it rests.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.poses import axes_along, cross_matrices

LEANS = 8  # Directions in which a solid is leant
SAME_SIDE = np.radians(20.0)  # Angle between facets of what is one side of a round solid
INSIDE = -1e-9  # Barycentric coordinate of a point on a facet's edge, but for rounding


class Rest(NamedTuple):
    """A side on which a solid rests."""

    down: Floats  # Unit vector, in the solid's own frame, that then points downwards, (3,)
    height: float  # of the centre of mass above the plane [m]; lower ones are more stable


class RestingSolid:
    """The convex hull of a solid, and where its centre of mass lies."""

    def __init__(self, vertices: Floats, faces: Ints):
        """Of a closed mesh, (n, 3) [m] and (m, 3), of even density; ValueError if it is flat."""
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
        stable = np.flatnonzero(self._above.min(axis=1) >= INSIDE)
        ordered = stable[np.argsort(self._heights[stable], kind="stable")]
        return tuple(Rest(self._normals[one], float(self._heights[one])) for one in ordered)

    def settled(self, down: Floats) -> Rest:
        """The side on which it comes to rest, set down with a direction (3,) of its own downwards.

        It goes down on the facet that lies most nearly level, and rolls from there.
        """
        above = self._above
        facet, seen = int((self._normals @ down).argmax()), np.zeros(len(above), np.bool_)
        while above[facet].min() < INSIDE and not seen[facet]:
            seen[facet] = True
            facet = int(self._neighbours[facet, above[facet].argmin()])
        return Rest(self._normals[facet], float(self._heights[facet]))

    def is_firm(self, rest: Rest, lean: float, same: float = SAME_SIDE) -> bool:
        """Whether it comes to rest on the same side, leaning by an angle [rad] to any direction.

        `same`: angle between directions of one side [rad], for round ones have many facets.
        """
        across = axes_along(rest.down)[:, :2]
        turns = np.linspace(0.0, 2.0 * np.pi, LEANS, endpoint=False)
        sides = np.column_stack([np.cos(turns), np.sin(turns)]) @ across.T
        downs = np.cos(lean) * rest.down + np.sin(lean) * sides
        return all(self.settled(one).down @ rest.down > np.cos(same) for one in downs)

    @cached_property
    def _above(self) -> Floats:
        """Barycentric coordinates (f, 3) in each facet of the place below the centre of mass."""
        foot = self.centre + self._heights[:, None] * self._normals
        one, other = (self._corners[:, k] - self._corners[:, 0] for k in (1, 2))
        area = np.cross(one, other)
        square = np.maximum((area**2).sum(axis=1), np.finfo(float).tiny)
        away = foot - self._corners[:, 0]
        second = (np.cross(away, other) * area).sum(axis=1) / square
        third = (np.cross(one, away) * area).sum(axis=1) / square
        return np.column_stack([1.0 - second - third, second, third])


def centre_of_mass(corners: Floats) -> Floats:
    """Of a closed mesh of even density with these corners (m, 3, 3), (3,); the mean if flat."""
    middle = corners.reshape(-1, 3).mean(axis=0)
    moved = corners - middle
    volumes = np.einsum("mi,mi->m", moved[:, 0], np.cross(moved[:, 1], moved[:, 2]))
    total = float(volumes.sum())
    if not abs(total) > np.finfo(float).eps * float(np.abs(volumes).sum()):
        return np.asarray(middle)
    return np.asarray(middle + (volumes[:, None] * moved.sum(axis=1)).sum(axis=0) / (4.0 * total))


def rotation_between(before: Floats, after: Floats) -> Floats:
    """The rotation (3, 3) by the smallest angle that takes one unit vector (3,) to another."""
    axis, cosine = np.cross(before, after), float(before @ after)
    if cosine < -1.0 + 1e-9:  # half a turn, about any axis across
        across = np.cross(before, np.eye(3)[int(np.argmin(np.abs(before)))])
        across /= np.linalg.norm(across)
        return np.asarray(2.0 * np.outer(across, across) - np.eye(3))
    cross = cross_matrices(axis[None])[0]
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))
