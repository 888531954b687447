"""A shape, moved to where it stands in the world."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.shapes.protocol import Mesh, Shape

BOUNDS_LEVEL = 6


class PosedShape:
    """A shape in a rotated and shifted frame.

    Parameters
    ----------
    base : Shape
        The shape in its own frame.
    pose : (7,) array
        Its pose in the world.
    """

    def __init__(self, base: Shape, pose: Floats):
        self._base = base
        self._position, self._axes = split_pose(pose)

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a fine tessellation, (2, 3), m."""
        if np.array_equal(self._axes, np.eye(3)):
            return self._base.bounds() + self._position
        vertices = self.mesh(BOUNDS_LEVEL).vertices
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays of the world: see `Shape.cast`."""
        local = (origins - self._position) @ self._axes
        return self._base.cast(local, direction @ self._axes, reach)

    def mesh(self, level: int) -> Mesh:
        """The tessellation in the world: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        return Mesh(vertices @ self._axes.T + self._position, faces)
