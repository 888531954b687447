"""A solid of a boolean tree, moved to where it stands in the tree."""

from __future__ import annotations

import itertools

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.spans import BoundedSolid


class PosedSolid:
    """A bounded solid in a rotated and shifted frame.

    Parameters
    ----------
    base : BoundedSolid
        The solid in its own frame.
    pose : (7,) array
        Its pose.
    """

    def __init__(self, base: BoundedSolid, pose: Floats):
        self._base = base
        self._position, self._axes = split_pose(pose)

    def enclosure(self) -> Floats:
        """The box about the turned corners of the base's: see `ImplicitShape.enclosure`."""
        corners = np.array(list(itertools.product(*self._base.enclosure().T)))
        moved = corners @ self._axes.T + self._position
        return np.stack([moved.min(axis=0), moved.max(axis=0)])

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The base's function: see `ImplicitShape.inside_out`."""
        return self._base.inside_out(
            (points - self._position) @ self._axes, directions @ self._axes
        )

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`."""
        return self._base.spans((origins - self._position) @ self._axes, direction @ self._axes)

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, moved: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        return Mesh(vertices @ self._axes.T + self._position, faces)
