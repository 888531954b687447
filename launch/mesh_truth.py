"""A true surface with which rebuilt meshes are compared."""

from __future__ import annotations

from typing import NamedTuple

from palpate.core.measure.distance import Prepared, compare, prepare
from palpate.core.measure.facet_sag import facet_sag
from palpate.core.measure.solidity import solidity
from palpate.core.shapes.protocol import Mesh


class Errors(NamedTuple):
    """How far a mesh is from the truth; lengths in the truth's unit."""

    chamfer: float
    hausdorff: float
    normal_deg: float
    """Mean angle between normals, degrees."""
    volume: float
    """Over the true one, less 1."""


class Truth(NamedTuple):
    """A true surface, ready to be compared with."""

    surface: Prepared
    volume: float
    """In the mesh's unit, cubed."""
    floor: float
    """What its own facets are off by on average, in the truth's unit: less cannot be told."""
    unit: float
    """Length in which errors are told."""

    def errors_of(self, mesh: Mesh) -> Errors:
        """How far a closed mesh is from it."""
        found = compare(prepare(*mesh), self.surface)
        volume = solidity(*mesh).volume / self.volume - 1.0
        return Errors(
            found.chamfer / self.unit, found.hausdorff / self.unit, found.normal_deg, volume
        )


def truth_of_mesh(mesh: Mesh, unit: float = 1.0) -> Truth:
    """The truth that a fine closed mesh stands for."""
    floor = facet_sag(mesh.vertices, mesh.faces) / unit
    return Truth(prepare(*mesh), solidity(*mesh).volume, floor, unit)
