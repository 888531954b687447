"""The words for a single solid, which an object and a part of a boolean have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Struct

from palpate.nodes.object_models import (
    GeneralisedCylinderSpec,
    HyperquadricSpec,
    PolyhedronSpec,
    build_generalised_cylinder,
    build_hyperquadric,
    build_polyhedron,
)
from palpate.nodes.object_superquadric import SuperquadricSpec, build_superquadric
from palpate.nodes.object_units import PoseSpec

if TYPE_CHECKING:  # what only some scenes need is imported where they need it
    from palpate.core.shapes.generalised_cylinder import GeneralisedCylinder
    from palpate.core.shapes.hyperquadric import Hyperquadric
    from palpate.core.shapes.polyhedron import Polyhedron
    from palpate.core.shapes.superquadric import Superquadric
    from palpate.core.shapes.warped import WarpedSuperquadric


class SolidSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid at most, and where it stands."""

    superquadric: SuperquadricSpec | None = None
    """A superquadric, perhaps tapered and bent."""
    hyperquadric: HyperquadricSpec | None = None
    """A sum of powers, perhaps with dents."""
    generalised_cylinder: GeneralisedCylinderSpec | None = None
    """A section moved along an axis."""
    polyhedron: PolyhedronSpec | None = None
    """A surface of polygons."""
    pose: PoseSpec = PoseSpec()
    """Where it stands in what it is a part of: for an object, in the world."""


def build_solid(
    spec: SolidSpec,
) -> Superquadric | WarpedSuperquadric | Hyperquadric | GeneralisedCylinder | Polyhedron:
    """The solid that is described, in its own frame; there is one."""
    if spec.hyperquadric is not None:
        return build_hyperquadric(spec.hyperquadric)
    if spec.generalised_cylinder is not None:
        return build_generalised_cylinder(spec.generalised_cylinder)
    if spec.polyhedron is not None:
        return build_polyhedron(spec.polyhedron)
    assert spec.superquadric is not None
    return build_superquadric(spec.superquadric)
