"""What every shape answers: its bounds, rays cast at it, and a mesh of it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from palpate.core.arrays import Floats, Ints

INSIDE = float("-inf")
"""Range of a ray that starts inside the shape."""
MISS = float("inf")
"""Range of a ray that meets nothing within its reach."""


class Mesh(NamedTuple):
    """A triangle mesh."""

    vertices: Floats
    """(n, 3), m."""
    faces: Ints
    """(m, 3) indices, counter-clockwise seen from outside."""


class Shape(Protocol):
    """A solid. Rays, bounds and mesh are all in its own frame, in m."""

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3)."""

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range to the first surface along parallel rays.

        Parameters
        ----------
        origins : (n, 3) array
            Where the rays start.
        direction : (3,) array
            Their common unit direction.
        reach : float
            How far they go.

        Returns
        -------
        (n,) array
            Range in m; `MISS` where nothing is met, `INSIDE` where the ray starts inside.
        """

    def mesh(self, level: int) -> Mesh:
        """A tessellation; each level has four times the faces of the one before."""


class ImplicitShape(Shape, Protocol):
    """A solid that is known by a function, not only by its facets."""

    def enclosure(self) -> Floats:
        """Corners of an upright box that holds the solid, (2, 3); not always the smallest."""

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """A function that is negative inside, 0 on the surface and positive outside.

        Parameters
        ----------
        points, directions : (n, 3) arrays
            Where, near the solid, and the direction of its derivative, m.

        Returns
        -------
        value, slope : (n,) arrays
            The function and its derivative, 1 and 1/m.
        """
