"""Protocols of solids: bounds, ray casting and mesh; and solids at a pose."""

from __future__ import annotations

import itertools
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import Pose
from palpate.reprs import readable

INSIDE = float("-inf")  # range of a ray that starts inside the shape
MISS = float("inf")  # range of a ray that meets no surface within its reach
BOUNDS_LEVEL = 6  # of the tessellation that defines bounds


@readable
class Mesh(NamedTuple):
    """A triangle mesh."""

    vertices: Floats  # (n, 3) [m]
    faces: Ints  # (m, 3) indices, counter-clockwise seen from outside


class Shape(Protocol):
    """A solid. Rays, bounds and mesh are in its own frame [m]."""

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3): by default of a fine tessellation."""
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range to the first surface along parallel rays.

        `origins` (n, 3): of the rays. `direction` (3,): their common unit direction. `reach`: their
        length. Returns ranges (n,) [m]; `MISS` where no surface is met, `INSIDE` where the ray
        starts inside.
        """

    def mesh(self, level: int) -> Mesh:
        """A tessellation; each level has four times the faces of the one before."""


class ImplicitShape(Shape, Protocol):
    """A solid with an implicit function."""

    def enclosure(self) -> Floats:
        """Corners of an upright box that contains the solid, (2, 3): the bounds, or larger."""
        return self.bounds()

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """A function that is negative inside, 0 on the surface and positive outside.

        `points` (n, 3): near the solid [m]. `directions` (n, 3): of the derivative [m]. Returns
        `value`, `slope` (n,): the function and its derivative [1/m].
        """


class CsgSolid(Protocol):
    """A solid that can be combined: it has spans of rays and an implicit function."""

    def enclosure(self) -> Floats:
        """Corners of an upright box that contains the solid, (2, 3) [m]."""

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """A function that is negative inside: see `ImplicitShape.inside_out`."""

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Ranges (n, k, 2) [m] over which parallel rays from origins (n, 3) are inside."""

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
    """A shape `base` at a `pose` in the world."""

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3) [m]; if rotated, of a fine tessellation."""
        if np.array_equal(self._axes, np.eye(3)):
            return self._base.bounds() + self._position
        return super().bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays of the world: see `Shape.cast`."""
        local = (origins - self._position) @ self._axes
        return self._base.cast(local, direction @ self._axes, reach)


class PosedSolid(_Posed[CsgSolid]):
    """A solid `base` that can be combined, at a `pose`."""

    def enclosure(self) -> Floats:
        """The box around the moved corners of the base's box: see `ImplicitShape.enclosure`."""
        corners = np.array(list(itertools.product(*self._base.enclosure().T)))
        moved = corners @ self._axes.T + self._position
        return np.stack([moved.min(axis=0), moved.max(axis=0)])

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The base's function: see `ImplicitShape.inside_out`."""
        local = (points - self._position) @ self._axes
        return self._base.inside_out(local, directions @ self._axes)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside: see `CsgSolid.spans`."""
        return self._base.spans((origins - self._position) @ self._axes, direction @ self._axes)
