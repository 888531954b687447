"""What stands in the scene, as data: the words with which scenes describe objects.

The structures check what they are given; `build_shape` turns an object into something that
can be touched.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core.shapes.posed import PosedShape
from palpate.core.shapes.protocol import Shape
from palpate.nodes.object_boolean import PartSpec, build_boolean
from palpate.nodes.object_solid import SolidSpec, build_solid
from palpate.nodes.object_superquadric import SuperquadricSpec
from palpate.nodes.object_units import Length, PoseSpec, Seed, only_one, pose_array

if TYPE_CHECKING:  # what only some scenes need is imported where they need it
    from palpate.core.shapes.protocol import ImplicitShape
    from palpate.core.splines.lattice import Lattice

__all__ = [
    "Length",
    "ObjectSpec",
    "PoseSpec",
    "Seed",
    "SuperquadricSpec",
    "build_shape",
    "encode_mesh",
]

SOLIDS = ("superquadric", "hyperquadric", "generalised_cylinder", "boolean", "polyhedron", "mesh")
FACETED = ("polyhedron", "mesh")
"""Solids without a function: they are nothing but their faces."""


class LayerSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What happens to one layer of a control lattice."""

    scale: Annotated[float, Meta(gt=0, le=10)] = 1.0
    """Widens the layer."""
    shift: tuple[float, float] = (0.0, 0.0)
    """Moves it along x and y, m."""
    turn: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    """Turns it about z, degrees."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.shift).all():
            raise ValueError("shift must be finite")


class MeshSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed triangle mesh, in m."""

    vertices: bytes
    """(n, 3) float64, little endian."""
    faces: bytes
    """(m, 3) int32, little endian."""


class ObjectSpec(SolidSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid of one kind, perhaps deformed by a control lattice."""

    boolean: PartSpec | None = None
    """A combination of solids."""
    mesh: MeshSpec | None = None
    """The solid as triangles."""
    lattice: Annotated[tuple[LayerSpec, ...], Meta(min_length=4, max_length=64)] | None = None
    """Layers of 4 by 4 control points, from the bottom to the top; after taper and bend."""
    exact: bool = False
    """Whether rays meet the surface that a lattice deforms, not facets of it; some six times
    slower."""

    def __post_init__(self) -> None:
        kind = only_one(self, "an object", SOLIDS)
        faceted = kind in FACETED
        if self.lattice is not None and faceted:
            raise ValueError(f"a lattice deforms no {kind}, which is only faces: leave one out")
        if self.exact and self.lattice is None:
            raise ValueError(
                "exact is for an object with a lattice: leave it out, a "
                f"{kind.replace('_', ' ')} is {'cast as it is' if faceted else 'exact anyway'}"
            )
        if self.boolean is not None:
            _check_tree(self.boolean)
        if self.lattice is not None:
            _check_folds(self, self.lattice)


def build_shape(spec: ObjectSpec) -> Shape:
    """The solid that a description stands for, where it stands."""
    return PosedShape(_shape_in_its_frame(spec), pose_array(spec.pose))


def _shape_in_its_frame(spec: ObjectSpec) -> Shape:
    if spec.mesh is not None:
        from palpate.core.shapes.triangles import TriangleShape

        vertices = np.frombuffer(spec.mesh.vertices, "<f8").reshape(-1, 3)
        faces = np.frombuffer(spec.mesh.faces, "<i4").reshape(-1, 3)
        return TriangleShape(vertices, faces)
    base = _implicit(spec)
    if spec.lattice is None:
        return base
    from palpate.core.shapes.deformed import DeformedShape

    return DeformedShape(base, _lattice(base, spec.lattice), spec.exact)


def _implicit(spec: ObjectSpec) -> ImplicitShape:
    """The solid before a lattice deforms it."""
    return build_solid(spec) if spec.boolean is None else build_boolean(spec.boolean)


def _lattice(base: ImplicitShape, layers: tuple[LayerSpec, ...]) -> Lattice:
    from palpate.core.splines.layers import Layer, layered_lattice

    made = [Layer(said.scale, math.radians(said.turn), said.shift) for said in layers]
    return layered_lattice(base.enclosure(), made)


def _check_tree(tree: PartSpec) -> None:
    """Refuse a tree that is unbounded, empty or too large."""
    try:
        build_boolean(tree)
    except ValueError as error:
        raise ValueError(f"boolean: {error}") from None


def _check_folds(spec: ObjectSpec, layers: tuple[LayerSpec, ...]) -> None:
    """Refuse a lattice that turns a part of the solid inside out, or squeezes it flat."""
    from palpate.core.splines.layers import flattened_share

    share = flattened_share(_lattice(_implicit(spec), layers))
    if share > 0.0:
        raise ValueError(
            f"the lattice folds or flattens {share:.1%} of its box: bring the layers' scale, "
            "shift and turn closer to their neighbours'"
        )


def encode_mesh(vertices: np.ndarray, faces: np.ndarray) -> MeshSpec:
    """A mesh as the scene's data; vertices (n, 3) in m, faces (m, 3)."""
    return MeshSpec(
        vertices=np.ascontiguousarray(vertices, "<f8").tobytes(),
        faces=np.ascontiguousarray(faces, "<i4").tobytes(),
    )
