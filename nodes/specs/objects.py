"""The object of a scene as data: a solid, a tree of solids or a mesh, perhaps deformed.

The structures check what they are given; `build_shape` turns an object into something that can
be touched.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core import IDENTITY_POSE, compose_poses, split_pose
from palpate.core.shapes import PosedShape, Shape
from palpate.nodes.specs.solids import Coordinate, SolidSpec, build_solid, exactly_one, pose_array

if TYPE_CHECKING:
    from palpate.core.shapes import BooleanShape, HalfSpace, ImplicitShape, Tree
    from palpate.core.splines import Lattice

OBJECT_KINDS = (
    "superquadric",
    "hyperquadric",
    "generalised_cylinder",
    "boolean",
    "polyhedron",
    "mesh",
)
FACETED = ("polyhedron", "mesh")  # Solids without a function: they are nothing but their faces
PART_KINDS = (
    "superquadric",
    "hyperquadric",
    "generalised_cylinder",
    "polyhedron",
    "half_space",
    "union",
    "intersection",
    "difference",
    "complement",
)


class LayerSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What happens to one layer of a control lattice."""

    scale: Annotated[float, Meta(gt=0, le=10)] = 1.0  # Widens the layer
    shift: tuple[float, float] = (0.0, 0.0)  # Moves it along x and y, m
    turn: Annotated[float, Meta(ge=-180, le=180)] = 0.0  # Turns it about z, degrees

    def __post_init__(self) -> None:
        if not np.isfinite(self.shift).all():
            raise ValueError("shift must be finite")


class MeshSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed triangle mesh, in m."""

    vertices: bytes  # (n, 3) float64, little endian
    faces: bytes  # (m, 3) int32, little endian


class ObjectSpec(SolidSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid of one kind, perhaps deformed by a control lattice."""

    boolean: PartSpec | None = None  # A combination of solids
    mesh: MeshSpec | None = None  # The solid as triangles
    # Layers of 4 by 4 control points, from the bottom to the top; after taper and bend.
    lattice: Annotated[tuple[LayerSpec, ...], Meta(min_length=4, max_length=64)] | None = None
    # Whether rays meet the surface that a lattice deforms, not facets of it; some six times slower.
    exact: bool = False

    def __post_init__(self) -> None:
        kind = exactly_one(self, "an object", OBJECT_KINDS)
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


def _check_tree(tree: PartSpec) -> None:
    """Refuse a tree that is unbounded, empty or too large."""
    try:
        build_boolean(tree)
    except ValueError as error:
        raise ValueError(f"boolean: {error}") from None


def _check_folds(spec: ObjectSpec, layers: tuple[LayerSpec, ...]) -> None:
    """Refuse a lattice that turns a part of the solid inside out, or squeezes it flat."""
    from palpate.core.splines import folded_share

    share = folded_share(_lattice(_implicit(spec), layers))
    if share > 0.0:
        raise ValueError(
            f"the lattice folds or flattens {share:.1%} of its box: bring the layers' scale, "
            "shift and turn closer to their neighbours'"
        )


def build_shape(spec: ObjectSpec) -> Shape:
    """The solid that a description stands for, where it stands."""
    return PosedShape(_shape_in_its_frame(spec), pose_array(spec.pose))


def _shape_in_its_frame(spec: ObjectSpec) -> Shape:
    if spec.mesh is not None:
        from palpate.core.shapes import TriangleShape

        vertices = np.frombuffer(spec.mesh.vertices, "<f8").reshape(-1, 3)
        faces = np.frombuffer(spec.mesh.faces, "<i4").reshape(-1, 3)
        return TriangleShape(vertices, faces)
    base = _implicit(spec)
    if spec.lattice is None:
        return base
    from palpate.core.shapes import DeformedShape

    return DeformedShape(base, _lattice(base, spec.lattice), spec.exact)


def _implicit(spec: ObjectSpec) -> ImplicitShape:
    """The solid before a lattice deforms it."""
    return build_solid(spec) if spec.boolean is None else build_boolean(spec.boolean)


@lru_cache(maxsize=8)  # each check of a scene builds it again, and looks whether it is empty
def build_boolean(spec: PartSpec) -> BooleanShape:
    """The solid that a tree stands for.

    Raises ValueError if it is unbounded or empty.
    """
    from palpate.core.shapes import BooleanShape

    return BooleanShape(_tree(spec, IDENTITY_POSE))


def _tree(spec: PartSpec, outer: np.ndarray) -> Tree:
    from palpate.core.shapes import Intersection, Union, complement_of, difference

    pose = compose_poses(outer, pose_array(spec.pose))
    if spec.union is not None:
        return Union(tuple(_tree(part, pose) for part in spec.union))
    if spec.intersection is not None:
        return Intersection(tuple(_tree(part, pose) for part in spec.intersection))
    if spec.difference is not None:
        return difference(*(_tree(part, pose) for part in spec.difference))
    if spec.complement is not None:
        return complement_of(_tree(spec.complement, pose))
    if spec.half_space is not None:
        return _half_space(spec.half_space, pose)
    from palpate.core.shapes import PosedSolid

    return PosedSolid(build_solid(spec), pose)


def _lattice(base: ImplicitShape, layers: tuple[LayerSpec, ...]) -> Lattice:
    from palpate.core.splines import LatticeLayer, layered_lattice

    made = [
        LatticeLayer(published.scale, math.radians(published.turn), published.shift)
        for published in layers
    ]
    return layered_lattice(base.enclosure(), made)


def encode_mesh(vertices: np.ndarray, faces: np.ndarray) -> MeshSpec:
    """A mesh as the scene's data; vertices (n, 3) in m, faces (m, 3)."""
    return MeshSpec(
        vertices=np.ascontiguousarray(vertices, "<f8").tobytes(),
        faces=np.ascontiguousarray(faces, "<i4").tobytes(),
    )


class HalfSpaceSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that lies behind a plane."""

    normal: tuple[float, float, float]  # Outwards, of any length
    offset: Coordinate = 0.0  # Distance of the plane from the origin along the normal, m

    def __post_init__(self) -> None:
        _half_space(self)


def _half_space(spec: HalfSpaceSpec, pose: np.ndarray = IDENTITY_POSE) -> HalfSpace:
    from palpate.core.shapes import HalfSpace

    own = HalfSpace(np.array(spec.normal), spec.offset)
    position, axes = split_pose(pose)
    normal = axes @ own.normal
    return HalfSpace(normal, own.offset + float(normal @ position))


class PartSpec(SolidSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A solid of a tree, or a combination of others."""

    half_space: HalfSpaceSpec | None = None
    union: Parts | None = None  # All that is in any of these
    intersection: Parts | None = None  # All that is in each of these
    difference: Parts | None = None  # All that is in the first and in no other
    complement: PartSpec | None = None  # All that is not in this

    def __post_init__(self) -> None:
        word = exactly_one(self, "a part of a boolean", PART_KINDS)
        if word in ("union", "intersection", "difference"):
            _refuse_duplicates(word, getattr(self, word))


def _refuse_duplicates(word: str, parts: tuple[PartSpec, ...]) -> None:
    """Refuse the same part in the same place, which says nothing and takes long to mesh."""
    for i, part in enumerate(parts):
        if part in parts[:i]:
            raise ValueError(
                f"{word}[{i}] is the same as {word}[{parts.index(part)}], in the same place; "
                "move one, or leave it out"
            )


Parts = Annotated[tuple[PartSpec, ...], Meta(min_length=2, max_length=32)]
