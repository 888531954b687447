"""Single solids as data, and the lengths, poses and seeds that all descriptions share."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.core import rotation_matrix
from palpate.core.shapes import Superquadric

if TYPE_CHECKING:
    from palpate.core.shapes import (
        DeformedSuperquadric,
        GeneralisedCylinder,
        Hyperquadric,
        Polyhedron,
        Section,
    )

TaperShare = Annotated[float, Meta(gt=-1, lt=1, description="1")]
TermExponent = Annotated[float, Meta(ge=0.1, le=100, description="1")]
PlaneNumber = Annotated[float, Meta(ge=-1e6, le=1e6)]
SectionScale = Annotated[float, Meta(ge=0, le=100, description="1")]
TermPlane = tuple[PlaneNumber, PlaneNumber, PlaneNumber, PlaneNumber]
Length = Annotated[float, Meta(gt=0, le=10, description="m")]
Coordinate = Annotated[float, Meta(ge=-10, le=10, description="m")]
Degrees = Annotated[float, Meta(ge=-360, le=360, description="degrees")]
Exponent = Annotated[float, Meta(ge=0.02, le=2, description="1")]
Seed = Annotated[int, Meta(ge=0, le=1 << 53)]


# Farther off, a solid would lose the digits that its surface needs.
WorldCoordinate = Annotated[float, Meta(ge=-1000, le=1000, description="m")]


# Of a quaternion; so that its length, which must be 1, can be worked out.
QuaternionPart = Annotated[float, Meta(ge=-10, le=10)]


class PoseSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the object's own frame stands in the world."""

    # x, y, z, m.
    position: tuple[WorldCoordinate, WorldCoordinate, WorldCoordinate] = (0.0, 0.0, 0.0)
    # Unit quaternion x, y, z, w.
    rotation: tuple[QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart] = (
        0.0,
        0.0,
        0.0,
        1.0,
    )

    def __post_init__(self) -> None:
        if not np.isfinite([*self.position, *self.rotation]).all():
            raise ValueError("position and rotation must be finite")
        rotation_matrix(np.array(self.rotation))


class SolidSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One solid at most, and where it stands."""

    superquadric: SuperquadricSpec | None = None  # A superquadric, perhaps tapered and bent
    hyperquadric: HyperquadricSpec | None = None  # A sum of powers, perhaps with dents
    generalised_cylinder: GeneralisedCylinderSpec | None = None  # A section moved along an axis
    polyhedron: PolyhedronSpec | None = None  # A surface of polygons
    # Where it stands in what it is a part of: for an object, in the world.
    pose: PoseSpec = PoseSpec()


def build_solid(
    spec: SolidSpec,
) -> Superquadric | DeformedSuperquadric | Hyperquadric | GeneralisedCylinder | Polyhedron:
    """The solid that is described, in its own frame; there is one."""
    if spec.hyperquadric is not None:
        return build_hyperquadric(spec.hyperquadric)
    if spec.generalised_cylinder is not None:
        return build_generalised_cylinder(spec.generalised_cylinder)
    if spec.polyhedron is not None:
        return build_polyhedron(spec.polyhedron)
    assert spec.superquadric is not None
    return build_superquadric(spec.superquadric)


class SuperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A superquadric about its frame's origin."""

    size: tuple[Length, Length, Length]  # Semi-axes along x, y, z, m
    # e1 along z and e2 across: 0.02 nearly a box, 1 an ellipsoid, 2 an octahedron.
    exponents: tuple[Exponent, Exponent]
    taper: tuple[TaperShare, TaperShare] = (0.0, 0.0)  # Widening of x and y at the top, as a share
    bend: float = 0.0  # Curvature to which the tapered solid's axis is bent, 1/m
    bend_direction: Degrees = 0.0  # Azimuth towards which its ends are bent, degrees

    def __post_init__(self) -> None:
        if self.bend != 0.0:
            build_superquadric(self)  # which refuses to fold it

    @property
    def plain(self) -> bool:
        """Whether it is neither tapered nor bent."""
        return self.bend == 0.0 and self.taper == (0.0, 0.0)


def build_superquadric(spec: SuperquadricSpec) -> Superquadric | DeformedSuperquadric:
    """The solid, tapered, then bent."""
    base = plain_superquadric(spec)
    if spec.plain:
        return base
    from palpate.core.shapes import Bend, DeformedSuperquadric

    return DeformedSuperquadric(
        base, np.array(spec.taper), Bend(spec.bend, math.radians(spec.bend_direction))
    )


def plain_superquadric(spec: SuperquadricSpec) -> Superquadric:
    """The solid before taper and bend."""
    return Superquadric(np.array(spec.size), np.array(spec.exponents))


class TermSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One power |a x + b y + c z + d|^g."""

    plane: TermPlane  # a, b, c in 1/m, and d
    exponent: TermExponent  # g


class DentSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """depth exp(-sum of the terms): a dent where they are all small."""

    depth: Annotated[float, Meta(ge=-100, le=100)]  # Above 0 a dent, below 0 a bulge
    terms: Annotated[tuple[TermSpec, ...], Meta(min_length=1, max_length=24)]


class HyperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All points at which the sum of the terms and dents is at most 1."""

    terms: Annotated[tuple[TermSpec, ...], Meta(min_length=3, max_length=24)]
    dents: Annotated[tuple[DentSpec, ...], Meta(max_length=8)] = ()

    def __post_init__(self) -> None:
        build_hyperquadric(self)  # which refuses what is empty or unbounded


def build_hyperquadric(spec: HyperquadricSpec) -> Hyperquadric:
    """The hyperquadric that a description stands for."""
    from palpate.core.shapes import Dent, Hyperquadric

    dents = tuple(Dent(dent.depth, *_terms(dent.terms)) for dent in spec.dents)
    return Hyperquadric(*_terms(spec.terms), dents)


def _terms(terms: tuple[TermSpec, ...]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([term.plane for term in terms]), np.array([term.exponent for term in terms])


class SectionSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cross-section: radii at even azimuths, or a superellipse."""

    # Distances from the axis, the first along x, counter-clockwise, m.
    radii: Annotated[tuple[Length, ...], Meta(min_length=3, max_length=64)] | None = None
    size: tuple[Length, Length] | None = None  # Semi-axes of the superellipse along x and y, m
    # Of the superellipse: 0.02 nearly a rectangle, 1 an ellipse, 2 a rhombus.
    exponent: Exponent = 1.0

    def __post_init__(self) -> None:
        exactly_one(self, "a section", ("radii", "size"))


class GeneralisedCylinderSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A section that is scaled as it moves along a straight axis."""

    section: SectionSpec  # What is moved
    # Heights along the axis, m, and the section's scale at each.
    sweep: Annotated[tuple[tuple[Coordinate, SectionScale], ...], Meta(min_length=2, max_length=64)]
    smooth: bool = False  # Whether a smooth curve joins the scales, not straight lines
    # Angle between the axis and z, degrees; the sections stay level.
    tilt: Annotated[float, Meta(ge=-75, le=75, description="degrees")] = 0.0
    tilt_direction: Degrees = 0.0  # Azimuth towards which the axis leans, degrees

    def __post_init__(self) -> None:
        build_generalised_cylinder(self)


def build_generalised_cylinder(spec: GeneralisedCylinderSpec) -> GeneralisedCylinder:
    """The generalised cylinder that a description stands for."""
    from palpate.core.shapes import GeneralisedCylinder

    heights, scales = np.array(spec.sweep).T
    return GeneralisedCylinder(
        _section(spec.section),
        heights,
        scales,
        smooth=spec.smooth,
        tilt=math.radians(spec.tilt),
        tilt_direction=math.radians(spec.tilt_direction),
    )


def _section(spec: SectionSpec) -> Section:
    from palpate.core.shapes import SplineSection, SuperellipseSection

    if spec.radii is not None:
        return SplineSection(np.array(spec.radii))
    return SuperellipseSection(np.array(spec.size), spec.exponent)


class PolyhedronSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed surface of plane polygons."""

    # m.
    vertices: Annotated[
        tuple[tuple[Coordinate, Coordinate, Coordinate], ...], Meta(min_length=4, max_length=1024)
    ]
    # Corners by number, from 0, counter-clockwise seen from outside.
    faces: Annotated[tuple[tuple[int, ...], ...], Meta(min_length=4, max_length=2048)]

    def __post_init__(self) -> None:
        build_polyhedron(self)


def build_polyhedron(spec: PolyhedronSpec) -> Polyhedron:
    """The polyhedron that a description stands for."""
    from palpate.core.shapes import Polyhedron

    return Polyhedron(np.array(spec.vertices), spec.faces)


def pose_array(spec: PoseSpec) -> np.ndarray:
    """The pose as (7,) numbers."""
    return np.array([*spec.position, *spec.rotation])


def exactly_one(spec: Struct, what: str, names: tuple[str, ...]) -> str:
    """The one of a description's words that is given.

    Raises ValueError if it is none, or several.
    """
    given = [name for name in names if getattr(spec, name) is not None]
    if len(given) == 1:
        return given[0]
    raise ValueError(
        f"{what} is exactly one of {', '.join(names[:-1])} and {names[-1]}; "
        f"got {' and '.join(given) or 'none of them'}"
    )
