"""Results of exploratory procedures, and the models that they recover."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from palpate.messages.fields import (
    Array,
    Count,
    Direction,
    Directions,
    Floats,
    Lengths,
    Metres,
    Numbers,
    Points,
    Radians,
    Ratio,
    Seconds,
    Vector,
)
from palpate.reprs import readable

Pairs = Annotated[NDArray[np.int32], Array("<i4", (None, 2), "#")]
Counts = Annotated[NDArray[np.int32], Array("<i4", (None,), "#")]
Covariance = Annotated[Floats, Array("<f8", (3, 3), "m2")]


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ProcedureResult:
    """A procedure is over. Latched on ``/procedure/result``."""

    procedure: str  # Its name
    # ``unsuited``: the procedure cannot recover this kind of object; ``incomplete``: it could not
    # make the touches that it needs. Neither has a model
    status: Literal["done", "unsuited", "incomplete"]
    reason: str  # Reason for the end, in a sentence
    figures: dict[str, float] = field(default_factory=dict)  # With the unit in the name
    touches: Count  # Touches of all fingers
    contacts: Count  # Contacts of the hand
    robot_time: Seconds  # Robot time spent


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BoundaryRepresentation:
    """A polyhedron as winged edges (Baumgart). Latched on ``/model/boundary``."""

    vertices: Points  # Corners where its edges meet, world frame
    edge_vertices: Pairs  # First and last vertex of each edge
    edge_faces: Pairs  # Face on the left of each edge, and on its right
    edge_before: Pairs  # Edge before it around the left face, and around the right one
    edge_after: Pairs  # Edge after it around the left face, and around the right one
    face_begins: Counts  # Where each face's corners begin in `face_corners`, and the end of all
    face_corners: Counts  # Vertices of all faces, counter-clockwise seen from outside
    face_normals: Directions  # Outward unit normals
    face_offsets: Lengths  # Distance of each face's plane from the origin, along its normal
    face_touches: Counts  # Touches on each face; 0 of the face on which it stands
    residual: Metres  # Root mean square distance of the touched points from their planes


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GeneralisedCone:
    """A straight homogeneous generalised cone. Latched on ``/model/cone``."""

    # A surface of revolution; any section, with a straight profile; or any section and profile
    kind: Literal["revolution", "linear", "free"]
    point: Vector  # On the axis; heights are measured from here
    axis: Direction  # Along the axis
    axis_error: Radians  # Standard deviation of its angle
    azimuth_zero: Direction  # Direction of azimuth 0; azimuths are counter-clockwise about the axis
    heights: Lengths  # Heights between the ends that were touched
    radii: Lengths  # Mean radius at each of them
    section: Numbers  # Radius over the mean one at even azimuths; all 1 if it is round
    residual: Metres  # Root mean square distance of the touched points


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ConePose:
    """Axis and apex of a cone, from contact features. Latched on ``/model/cone_pose``."""

    axis: Direction  # From the apex towards the larger end
    phi: Radians  # Turn about z of R = Rz(phi) Ry(psi), which takes z to the axis
    psi: Radians  # Turn about y
    axis_error: Radians  # Standard deviation of the axis's angle
    apex: Vector  # Where all meridians meet, the origin of the cone
    apex_covariance: Covariance
    half_angles: Numbers  # Angles between the touched meridians and the axis, rad
    features: tuple[str, ...]  # Touched features, as F_T, E_m, P
    interpretations: tuple[str, ...]  # Interpretations of the features, the most likely first
    residual_sigma: Ratio  # Residual of all features, over its standard deviation


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Openings:
    """Holes and cavities of an object. Latched on ``/model/openings``."""

    # ``hole``: through the object; ``cavity``: with a touched bottom; ``open``: with an end that no
    # finger has reached
    kinds: tuple[Literal["hole", "cavity", "open"], ...]
    places: Points  # Middle of each opening's mouth, world frame
    axes: Directions  # Outward unit normals of the mouths
    widths: Lengths  # Diameter of a circle with the mouth's area
    depths: Lengths  # Distance from the mouth to the deepest known free place
