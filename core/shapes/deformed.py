"""A shape after a deformation of space: tessellated once, then cast as triangles."""

from __future__ import annotations

from collections.abc import Callable

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import Mesh, Shape
from palpate.core.shapes.triangles import TriangleShape

Deformation = Callable[[Floats], Floats]
"""Points (n, 3) to points (n, 3), m."""

CAST_LEVEL = 6
"""82k faces: the facets of a 0.1 m ball stand off by less than 10 um, at a box's edges by more."""


class DeformedShape:
    """A base shape whose points are moved by deformations, one after the other.

    Parameters
    ----------
    base : Shape
        What is deformed.
    deformations : tuple of functions
        Each takes and gives points (n, 3).
    """

    def __init__(self, base: Shape, deformations: tuple[Deformation, ...]):
        self._base = base
        self._deformations = deformations
        self._cast_mesh = self.mesh(CAST_LEVEL)
        self._triangles = TriangleShape(self._cast_mesh.vertices, self._cast_mesh.faces)

    def bounds(self) -> Floats:
        """Smallest and largest coordinates, (2, 3), m."""
        return self._triangles.bounds()

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the facets along parallel rays: see `Shape.cast`."""
        return self._triangles.cast(origins, direction, reach)

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, deformed: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        for deformation in self._deformations:
            vertices = deformation(vertices)
        return Mesh(vertices, faces)
