"""Discs about triangles: how near a triangle can be, more sharply than its box says."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.measure.triangles import areas_and_normals

SLIVER = 1e-6
"""Area over squared radius below which a normal is mostly rounding, and is not relied on."""
SLACK = 1e-13
"""Of the squared distance to the centre: what rounding may take from the bound."""


class Discs(NamedTuple):
    """The disc about the centre of each triangle, in its plane, that holds it."""

    centres: Floats
    """(n, 3), m."""
    normals: Floats
    """(n, 3), unit; 0 for a sliver, whose disc becomes a ball."""
    radii: Floats
    """(n,), m."""

    @classmethod
    def about(cls, corners: Floats) -> Self:
        """From the corners (n, 3, 3) of triangles."""
        centres = corners.mean(axis=1)
        offset = corners - centres[:, None]
        square = np.einsum("ijk,ijk->ij", offset, offset).max(axis=1)
        areas, normals = areas_and_normals(corners)
        normals[areas <= SLIVER * square] = 0.0
        return cls(centres, normals, np.sqrt(square))

    def within(self, discs: NDArray[np.intp], points: Floats, reach: Floats) -> NDArray[np.bool_]:
        """Whether each disc (n,) may come within the reach (n,) of a point (n, 3)."""
        offset = points - self.centres[discs]
        height = np.einsum("ij,ij->i", offset, self.normals[discs])
        square = np.einsum("ij,ij->i", offset, offset)
        beside = np.sqrt(np.maximum(square - height * height, 0.0)) - self.radii[discs]
        beside = np.maximum(beside, 0.0)
        near: NDArray[np.bool_] = (
            height * height + beside * beside <= reach * reach + SLACK * square
        )
        return near
