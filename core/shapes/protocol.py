"""What every solid answers: its bounds, rays cast at it, a mesh of it; and a solid at a pose."""

from __future__ import annotations

import itertools
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import Pose
from palpate.reprs import readable

INSIDE = float("-inf")  # Range of a ray that starts inside the shape
MISS = float("inf")  # Range of a ray that meets nothing within its reach
BOUNDS_LEVEL = 6


@readable
class Mesh(NamedTuple):
    """A triangle mesh."""

    vertices: Floats  # (n, 3), m
    faces: Ints  # (m, 3) indices, counter-clockwise seen from outside


class Shape(Protocol):
    """A solid. Rays, bounds and mesh are all in its own frame, in m."""

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3): those of a fine tessellation, unless known."""
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range to the first surface along parallel rays.

        `origins` (n, 3): where the rays start. `direction` (3,): their common unit direction.
        `reach`: how far they go. Returns (n,), range in m; `MISS` where nothing is met, `INSIDE`
        where the ray starts inside.
        """

    def mesh(self, level: int) -> Mesh:
        """A tessellation; each level has four times the faces of the one before."""


class ImplicitShape(Shape, Protocol):
    """A solid that is known by a function, not only by its facets."""

    def enclosure(self) -> Floats:
        """Corners of an upright box that holds the solid, (2, 3): the bounds, or a larger one."""
        return self.bounds()

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """A function that is negative inside, 0 on the surface and positive outside.

        `points` and `directions` (n, 3): where, near the solid, and the direction of its
        derivative, m. Returns `value`, `slope` (n,): the function and its derivative, 1 and 1/m.
        """


class CsgSolid(Protocol):
    """A solid that knows where rays enter it and leave it, and on which side a point lies."""

    def enclosure(self) -> Floats:
        """Corners of an upright box that holds the solid, (2, 3), m."""

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """A function that is negative inside: see `ImplicitShape.inside_out`."""

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays from origins (n, 3) are inside, (n, k, 2), m."""

    def mesh(self, level: int) -> Mesh:
        """A tessellation: see `Shape.mesh`."""


Base = TypeVar("Base", Shape, CsgSolid)


class _Posed(Generic[Base]):
    def __init__(self, base: Base, pose: Pose):
        self._base: Base = base
        self._position, self._axes = pose

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, moved: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        return Mesh(vertices @ self._axes.T + self._position, faces)


class PosedShape(_Posed[Shape], Shape):
    """A shape, `base`, in a rotated and shifted frame: `pose`, its pose in the world."""

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, if turned of a fine tessellation, (2, 3), m."""
        if np.array_equal(self._axes, np.eye(3)):
            return self._base.bounds() + self._position
        return super().bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays of the world: see `Shape.cast`."""
        local = (origins - self._position) @ self._axes
        return self._base.cast(local, direction @ self._axes, reach)


class PosedSolid(_Posed[CsgSolid]):
    """A solid that can be combined, `base`, in a rotated and shifted frame: `pose`."""

    def enclosure(self) -> Floats:
        """The box about the turned corners of the base's: see `ImplicitShape.enclosure`."""
        corners = np.array(list(itertools.product(*self._base.enclosure().T)))
        moved = corners @ self._axes.T + self._position
        return np.stack([moved.min(axis=0), moved.max(axis=0)])

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The base's function: see `ImplicitShape.inside_out`."""
        local = (points - self._position) @ self._axes
        return self._base.inside_out(local, directions @ self._axes)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `CsgSolid.spans`."""
        return self._base.spans((origins - self._position) @ self._axes, direction @ self._axes)
