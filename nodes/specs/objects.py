"""Descriptions of the object of a scene: a solid, a tree of solids or a mesh, maybe deformed.

The structures check their values; `build_shape` makes the shape that can be touched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, TypeAlias

import numpy as np
from msgspec import Meta, Struct

from palpate.core import shapes, splines
from palpate.core.poses import IDENTITY_POSE, Pose, rotation_matrix
from palpate.nodes.specs.primitives import (
    BoxSpec,
    CapsuleSpec,
    ConeSpec,
    CylinderSpec,
    Length,
    SphereSpec,
    TorusSpec,
)

Solid: TypeAlias = (
    "shapes.Superquadric | shapes.DeformedSuperquadric | shapes.Hyperquadric"
    " | shapes.GeneralisedCylinder | shapes.Polyhedron"
)
TaperShare = Annotated[float, Meta(gt=-1, lt=1, description="1")]
TermExponent = Annotated[float, Meta(ge=0.1, le=100, description="1")]
PlaneNumber = Annotated[float, Meta(ge=-1e6, le=1e6)]
SectionScale = Annotated[float, Meta(ge=0, le=100, description="1")]
TermPlane = tuple[PlaneNumber, PlaneNumber, PlaneNumber, PlaneNumber]
Coordinate = Annotated[float, Meta(ge=-10, le=10, description="m")]
Shift = Annotated[float, Meta(description="m")]
Degrees = Annotated[float, Meta(ge=-360, le=360, description="degrees")]
Exponent = Annotated[float, Meta(ge=0.02, le=2, description="1")]
Seed = Annotated[int, Meta(ge=0, le=1 << 53)]
# Farther away, the coordinates of a surface would have too few digits.
WorldCoordinate = Annotated[float, Meta(ge=-1000, le=1000, description="m")]
# Of a quaternion; the limits keep its length finite before it is checked.
QuaternionPart = Annotated[float, Meta(ge=-10, le=10)]
Quaternion = tuple[QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReachSettings:
    """How the reach of the finger is fitted to the extents of an object."""

    mesh_level: int = 4  # subdivisions of the mesh for the extents, of 5k faces
    reach_ratio: float = 1.25  # reach over extent of the object: the hand opens to 0.8 of the reach
    min_reach: float = 0.15  # [m]
    max_reach: float = 10.0  # [m]


DEFAULT_REACH = ReachSettings()
IDENTITY = Pose.from_array(IDENTITY_POSE)


class PoseSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Pose of the object's own frame in the world."""

    # x, y, z [m].
    position: tuple[WorldCoordinate, WorldCoordinate, WorldCoordinate] = (0.0, 0.0, 0.0)
    # Unit quaternion x, y, z, w.
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not np.isfinite([*self.position, *self.rotation]).all():
            raise ValueError("position and rotation must be finite")
        rotation_matrix(np.array(self.rotation))

    def pose(self) -> Pose:
        """The pose."""
        return Pose(np.array(self.position), rotation_matrix(np.array(self.rotation)))


class SolidSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """At most one solid, and its pose."""

    sphere: SphereSpec | None = None
    box: BoxSpec | None = None  # with sharp edges
    cylinder: CylinderSpec | None = None
    cone: ConeSpec | None = None
    superquadric: SuperquadricSpec | None = None  # maybe tapered and bent
    hyperquadric: HyperquadricSpec | None = None  # a sum of powers, maybe with dents
    generalised_cylinder: GeneralisedCylinderSpec | None = None  # a section moved along an axis
    polyhedron: PolyhedronSpec | None = None  # a surface of polygons
    # In the frame of the whole; of an object, in the world.
    pose: PoseSpec = PoseSpec()

    def solid(self) -> Solid:
        """The solid, in its own frame; there must be one."""
        specs = (getattr(self, kind) for kind in (*SOLID_KINDS, "box", "polyhedron"))
        solid: Solid = next(spec.build() for spec in specs if spec is not None)
        return solid


class SuperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A superquadric about its frame's origin."""

    size: tuple[Length, Length, Length]  # semi-axes along x, y, z [m]
    # e1 along z and e2 across: 0.02 is nearly a box, 1 an ellipsoid, 2 an octahedron.
    exponents: tuple[Exponent, Exponent]
    taper: tuple[TaperShare, TaperShare] = (0.0, 0.0)  # relative widening of x and y at the top
    bend: float = 0.0  # curvature of the bent axis [1/m]
    bend_direction: Degrees = 0.0  # azimuth towards which the ends are bent [degrees]

    def __post_init__(self) -> None:
        if self.bend != 0.0:
            self.build()  # raises ValueError if it folds

    def build(self) -> shapes.Superquadric | shapes.DeformedSuperquadric:
        """The solid, tapered, then bent."""
        plain = shapes.Superquadric(np.array(self.size), np.array(self.exponents))
        if self.bend == 0.0 and self.taper == (0.0, 0.0):
            return plain
        bend = shapes.Bend(self.bend, math.radians(self.bend_direction))
        return shapes.DeformedSuperquadric(plain, np.array(self.taper), bend)


class TermSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One power |a x + b y + c z + d|^g."""

    plane: TermPlane  # a, b, c in 1/m, and d
    exponent: TermExponent  # g


class DentSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The summand depth * exp(-sum of the terms): a dent where all terms are small."""

    depth: Annotated[float, Meta(ge=-100, le=100)]  # no unit; above 0 a dent, below 0 a bulge
    terms: Annotated[tuple[TermSpec, ...], Meta(min_length=1, max_length=24)]


class HyperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All points at which the sum of the terms and dents is at most 1."""

    terms: Annotated[tuple[TermSpec, ...], Meta(min_length=3, max_length=24)]
    dents: Annotated[tuple[DentSpec, ...], Meta(max_length=8)] = ()

    def __post_init__(self) -> None:
        self.build()  # raises ValueError if it is empty or unbounded

    def build(self) -> shapes.Hyperquadric:
        """The hyperquadric."""
        dents = tuple(shapes.Dent(dent.depth, *_terms(dent.terms)) for dent in self.dents)
        return shapes.Hyperquadric(*_terms(self.terms), dents)


def _terms(terms: tuple[TermSpec, ...]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([term.plane for term in terms]), np.array([term.exponent for term in terms])


class SectionSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cross-section: radii at even azimuths, or a superellipse."""

    # Distances from the axis, counter-clockwise from x [m].
    radii: Annotated[tuple[Length, ...], Meta(min_length=3, max_length=64)] | None = None
    size: tuple[Length, Length] | None = None  # semi-axes of the superellipse along x and y [m]
    # Of the superellipse: 0.02 is nearly a rectangle, 1 an ellipse, 2 a rhombus.
    exponent: Exponent = 1.0

    def __post_init__(self) -> None:
        exactly_one(self, "a section", ("radii", "size"))


class GeneralisedCylinderSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A section that is scaled as it moves along a straight axis."""

    section: SectionSpec
    # Heights along the axis [m], and the scale of the section at each.
    sweep: Annotated[tuple[tuple[Coordinate, SectionScale], ...], Meta(min_length=2, max_length=64)]
    smooth: bool = False  # whether the scales are joined by a smooth curve
    # Angle between the axis and z; the sections stay level [degrees].
    tilt: Annotated[float, Meta(ge=-75, le=75, description="degrees")] = 0.0
    tilt_direction: Degrees = 0.0  # azimuth towards which the axis leans [degrees]

    def __post_init__(self) -> None:
        self.build()

    def build(self) -> shapes.GeneralisedCylinder:
        """The generalised cylinder."""
        section: shapes.Section
        if self.section.radii is not None:
            section = shapes.SplineSection(np.array(self.section.radii))
        else:
            section = shapes.SuperellipseSection(np.array(self.section.size), self.section.exponent)
        heights, scales = np.array(self.sweep).T
        return shapes.GeneralisedCylinder(
            section,
            heights,
            scales,
            smooth=self.smooth,
            tilt=math.radians(self.tilt),
            tilt_direction=math.radians(self.tilt_direction),
        )


class PolyhedronSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed surface of plane polygons."""

    # In m.
    vertices: Annotated[
        tuple[tuple[Coordinate, Coordinate, Coordinate], ...], Meta(min_length=4, max_length=1024)
    ]
    # Indices of corners, counter-clockwise seen from outside.
    faces: Annotated[tuple[tuple[int, ...], ...], Meta(min_length=4, max_length=2048)]

    def __post_init__(self) -> None:
        self.build()

    def build(self) -> shapes.Polyhedron:
        """The polyhedron."""
        return shapes.Polyhedron(np.array(self.vertices), self.faces)


def exactly_one(spec: Struct, what: str, names: tuple[str, ...]) -> str:
    """The only key of a description that is set; ValueError if none or several are."""
    present = [name for name in names if getattr(spec, name) is not None]
    if len(present) == 1:
        return present[0]
    raise ValueError(
        f"{what} is exactly one of {', '.join(names[:-1])} and {names[-1]}; "
        f"got {' and '.join(present) or 'none of them'}"
    )


SOLID_KINDS = (
    "sphere", "cylinder", "cone", "superquadric", "hyperquadric", "generalised_cylinder"
)  # fmt: skip
OBJECT_KINDS = (
    *SOLID_KINDS, "box", "capsule", "torus", "boolean", "polyhedron", "mesh"
)  # fmt: skip
# Solids without an implicit function.
FACETED = ("box", "capsule", "torus", "polyhedron", "mesh")
COMBINATIONS = ("union", "intersection", "difference")
PART_KINDS = (*SOLID_KINDS, "box", "polyhedron", "half_space", *COMBINATIONS, "complement")


class LayerSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Deformation of one layer of a control lattice."""

    scale: Annotated[float, Meta(gt=0, le=10)] = 1.0  # factor of the layer's size in x and y
    shift: tuple[Shift, Shift] = (0.0, 0.0)  # along x and y [m]
    turn: Annotated[float, Meta(ge=-180, le=180)] = 0.0  # about z [degrees]

    def __post_init__(self) -> None:
        if not np.isfinite(self.shift).all():
            raise ValueError("shift must be finite")


class MeshSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed triangle mesh, in m."""

    vertices: bytes  # (n, 3) float64, little endian
    faces: bytes  # (m, 3) int32, little endian


class ObjectSpec(SolidSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid, maybe deformed by a control lattice."""

    capsule: CapsuleSpec | None = None
    torus: TorusSpec | None = None
    boolean: PartSpec | None = None  # a combination of solids
    mesh: MeshSpec | None = None  # the solid as triangles
    # Layers of 4 by 4 control points from bottom to top; they act after taper and bend.
    lattice: Annotated[tuple[LayerSpec, ...], Meta(min_length=4, max_length=64)] | None = None
    # Whether rays meet the deformed surface itself, not facets of it; about six times slower.
    exact: bool = False

    def __post_init__(self) -> None:
        kind = exactly_one(self, "an object", OBJECT_KINDS)
        is_faceted = kind in FACETED
        if self.lattice is not None and is_faceted:
            raise ValueError(f"a lattice deforms no {kind}, which is only faces: leave one out")
        if self.exact and self.lattice is None:
            raise ValueError(
                "exact is for an object with a lattice: leave it out, a "
                f"{kind.replace('_', ' ')} is {'cast as it is' if is_faceted else 'exact anyway'}"
            )
        if self.boolean is not None:  # it may be unbounded, empty or too large
            try:
                build_boolean(self.boolean)
            except ValueError as error:
                raise ValueError(f"boolean: {error}") from None
        if self.lattice is not None:
            _check_folds(self, self.lattice)


def _check_folds(spec: ObjectSpec, layers: tuple[LayerSpec, ...]) -> None:
    """Raise ValueError for a lattice that folds or flattens a part of the solid."""
    share = splines.folded_share(_lattice(_implicit(spec), layers))
    if share > 0.0:
        raise ValueError(
            f"the lattice folds or flattens {share:.1%} of its box: bring the layers' scale, "
            "shift and turn closer to their neighbours'"
        )


def build_shape(spec: ObjectSpec) -> shapes.Shape:
    """The solid of a description, at its pose."""
    return shapes.PosedShape(_shape_in_its_frame(spec), spec.pose.pose())


@lru_cache(maxsize=64)
def object_extents(
    spec: ObjectSpec, mesh_level: int = DEFAULT_REACH.mesh_level
) -> tuple[tuple[float, float, float], float]:
    """Extents along x, y and z, to about 0.1 mm, and the largest distance from the z axis [m]."""
    vertices = build_shape(spec).mesh(mesh_level).vertices
    x, y, z = np.ptp(vertices, axis=0).tolist()
    return (x, y, z), float(np.linalg.norm(vertices[:, :2], axis=1).max())


def fitted_reach(spec: ObjectSpec, settings: ReachSettings = DEFAULT_REACH) -> float:
    """The finger's reach for an object [m]: the hand, which opens less, fits around it."""
    size, radius = object_extents(spec, settings.mesh_level)
    reach = max(settings.min_reach, settings.reach_ratio * max(radius, size[2]))
    return min(reach, settings.max_reach)


def _shape_in_its_frame(spec: ObjectSpec) -> shapes.Shape:
    if spec.mesh is not None:
        vertices = np.frombuffer(spec.mesh.vertices, "<f8").reshape(-1, 3)
        faces = np.frombuffer(spec.mesh.faces, "<i4").reshape(-1, 3)
        return shapes.TriangleShape(vertices, faces)
    for rounded in (spec.capsule, spec.torus):
        if rounded is not None:
            return rounded.build()
    base = _implicit(spec)
    if spec.lattice is None:
        return base
    return shapes.DeformedShape(base, _lattice(base, spec.lattice), spec.exact)


def _implicit(spec: ObjectSpec) -> shapes.ImplicitShape:
    """The solid before a lattice deforms it."""
    return spec.solid() if spec.boolean is None else build_boolean(spec.boolean)


@lru_cache(maxsize=8)  # each check of a scene builds it again
def build_boolean(spec: PartSpec) -> shapes.BooleanShape:
    """The solid of a tree; ValueError if it is unbounded or empty."""
    return shapes.BooleanShape(_tree(spec, IDENTITY))


def _tree(spec: PartSpec, outer: Pose) -> shapes.Tree:
    pose = outer @ spec.pose.pose()
    if spec.union is not None:
        return shapes.Union(tuple(_tree(part, pose) for part in spec.union))
    if spec.intersection is not None:
        return shapes.Intersection(tuple(_tree(part, pose) for part in spec.intersection))
    if spec.difference is not None:
        return shapes.difference(*(_tree(part, pose) for part in spec.difference))
    if spec.complement is not None:
        return shapes.complement_of(_tree(spec.complement, pose))
    if spec.half_space is not None:
        return _half_space(spec.half_space, pose)
    return shapes.PosedSolid(spec.solid(), pose)


def _lattice(base: shapes.ImplicitShape, layers: tuple[LayerSpec, ...]) -> splines.Lattice:
    return splines.layered_lattice(
        base.enclosure(),
        [splines.LatticeLayer(item.scale, math.radians(item.turn), item.shift) for item in layers],
    )


def encode_mesh(vertices: np.ndarray, faces: np.ndarray) -> MeshSpec:
    """A mesh as data of a scene; vertices (n, 3) [m], faces (m, 3)."""
    return MeshSpec(
        vertices=np.ascontiguousarray(vertices, "<f8").tobytes(),
        faces=np.ascontiguousarray(faces, "<i4").tobytes(),
    )


class HalfSpaceSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The half space behind a plane."""

    normal: tuple[float, float, float]  # outward, of any length
    offset: Coordinate = 0.0  # distance of the plane from the origin along the normal [m]

    def __post_init__(self) -> None:
        _half_space(self)


def _half_space(spec: HalfSpaceSpec, pose: Pose = IDENTITY) -> shapes.HalfSpace:
    own = shapes.HalfSpace(np.array(spec.normal), spec.offset)
    normal = pose.axes @ own.normal
    return shapes.HalfSpace(normal, own.offset + float(normal @ pose.position))


class PartSpec(SolidSpec, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A solid of a tree, or a combination of parts."""

    half_space: HalfSpaceSpec | None = None
    union: Parts | None = None  # points in any part
    intersection: Parts | None = None  # points in all parts
    difference: Parts | None = None  # points in the first part and no other
    complement: PartSpec | None = None  # points that are not in the part

    def __post_init__(self) -> None:
        word = exactly_one(self, "a part of a boolean", PART_KINDS)
        if word in COMBINATIONS:
            _refuse_duplicates(word, getattr(self, word))


def _refuse_duplicates(word: str, parts: tuple[PartSpec, ...]) -> None:
    """Raise ValueError for two equal parts, which have no effect and take long to mesh."""
    for i, part in enumerate(parts):
        if part in parts[:i]:
            raise ValueError(
                f"{word}[{i}] is the same as {word}[{parts.index(part)}], in the same place; "
                "move one, or leave it out"
            )


Parts = Annotated[tuple[PartSpec, ...], Meta(min_length=2, max_length=32)]
