"""The words with which scenes describe hyperquadrics, generalised cylinders and polyhedra."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta, Struct

from palpate.nodes.object_units import Coordinate, Degrees, Exponent, Length, only_one

if TYPE_CHECKING:  # what only some scenes need is imported where they need it
    from palpate.core.shapes.generalised_cylinder import GeneralisedCylinder
    from palpate.core.shapes.hyperquadric import Hyperquadric
    from palpate.core.shapes.polyhedron import Polyhedron
    from palpate.core.shapes.section import Section

Power = Annotated[float, Meta(ge=0.1, le=100, description="1")]
Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
Scale = Annotated[float, Meta(ge=0, le=100, description="1")]
Plane = tuple[Number, Number, Number, Number]


class TermSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One power |a x + b y + c z + d|^g."""

    plane: Plane
    """a, b, c in 1/m, and d."""
    exponent: Power
    """g."""


class DentSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """depth exp(-sum of the terms): a dent where they are all small."""

    depth: Annotated[float, Meta(ge=-100, le=100)]
    """Above 0 a dent, below 0 a bulge."""
    terms: Annotated[tuple[TermSpec, ...], Meta(min_length=1, max_length=24)]


class HyperquadricSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All points at which the sum of the terms and dents is at most 1."""

    terms: Annotated[tuple[TermSpec, ...], Meta(min_length=3, max_length=24)]
    dents: Annotated[tuple[DentSpec, ...], Meta(max_length=8)] = ()

    def __post_init__(self) -> None:
        build_hyperquadric(self)  # which refuses what is empty or unbounded


class SectionSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A cross-section: radii at even azimuths, or a superellipse."""

    radii: Annotated[tuple[Length, ...], Meta(min_length=3, max_length=64)] | None = None
    """Distances from the axis, the first along x, counter-clockwise, m."""
    size: tuple[Length, Length] | None = None
    """Semi-axes of the superellipse along x and y, m."""
    exponent: Exponent = 1.0
    """Of the superellipse: 0.02 nearly a rectangle, 1 an ellipse, 2 a rhombus."""

    def __post_init__(self) -> None:
        only_one(self, "a section", ("radii", "size"))


class GeneralisedCylinderSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A section that is scaled as it moves along a straight axis."""

    section: SectionSpec
    """What is moved."""
    sweep: Annotated[tuple[tuple[Coordinate, Scale], ...], Meta(min_length=2, max_length=64)]
    """Heights along the axis, m, and the section's scale at each."""
    smooth: bool = False
    """Whether a smooth curve joins the scales, not straight lines."""
    tilt: Annotated[float, Meta(ge=-75, le=75, description="degrees")] = 0.0
    """Angle between the axis and z, degrees; the sections stay level."""
    tilt_direction: Degrees = 0.0
    """Azimuth towards which the axis leans, degrees."""

    def __post_init__(self) -> None:
        build_generalised_cylinder(self)


class PolyhedronSpec(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A closed surface of plane polygons."""

    vertices: Annotated[
        tuple[tuple[Coordinate, Coordinate, Coordinate], ...], Meta(min_length=4, max_length=1024)
    ]
    """m."""
    faces: Annotated[tuple[tuple[int, ...], ...], Meta(min_length=4, max_length=2048)]
    """Corners by number, from 0, counter-clockwise seen from outside."""

    def __post_init__(self) -> None:
        build_polyhedron(self)


def build_hyperquadric(spec: HyperquadricSpec) -> Hyperquadric:
    """The hyperquadric that a description stands for."""
    from palpate.core.shapes.dent import Dent
    from palpate.core.shapes.hyperquadric import Hyperquadric

    dents = tuple(Dent(dent.depth, *_terms(dent.terms)) for dent in spec.dents)
    return Hyperquadric(*_terms(spec.terms), dents)


def build_generalised_cylinder(spec: GeneralisedCylinderSpec) -> GeneralisedCylinder:
    """The generalised cylinder that a description stands for."""
    from palpate.core.shapes.generalised_cylinder import GeneralisedCylinder

    heights, scales = np.array(spec.sweep).T
    return GeneralisedCylinder(
        _section(spec.section),
        heights,
        scales,
        smooth=spec.smooth,
        tilt=math.radians(spec.tilt),
        tilt_direction=math.radians(spec.tilt_direction),
    )


def build_polyhedron(spec: PolyhedronSpec) -> Polyhedron:
    """The polyhedron that a description stands for."""
    from palpate.core.shapes.polyhedron import Polyhedron

    return Polyhedron(np.array(spec.vertices), spec.faces)


def _terms(terms: tuple[TermSpec, ...]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([term.plane for term in terms]), np.array([term.exponent for term in terms])


def _section(spec: SectionSpec) -> Section:
    from palpate.core.shapes.section import SplineSection, SuperellipseSection

    if spec.radii is not None:
        return SplineSection(np.array(spec.radii))
    return SuperellipseSection(np.array(spec.size), spec.exponent)
