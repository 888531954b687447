"""Requests for models, rebuilt solids, their estimated errors, and scores."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from palpate.messages.fields import (
    MAX_MESSAGE_BYTES,
    Array,
    ControlPoints,
    Count,
    Degrees,
    Directions,
    Floats,
    Lengths,
    Metres,
    Numbers,
    PackedBytes,
    PerMetre,
    Points,
    Pose,
    Poses,
    Radians,
    Ratio,
    Seconds,
    Triangles,
    Unit,
    Vector,
)
from palpate.reprs import readable

Ids = tuple[int, ...]


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelGoal:
    """A set of contours and probes to fit. Planner to reconstructor on ``/model/goal``."""

    number: Count  # Counts up by one
    contours: Ids  # Contours in the order in which the planner took them
    probes: Ids  # Probes in the order in which the planner took them
    # Unfinished contours: the contacts of their touches are used, their curves are not
    arcs: Ids = ()
    # Whether a contour could not be traced, for another reason than a spent budget
    failed: bool = False
    missed: Ids = ()  # Probes without contact: the space that they swept is free
    # Whether the last model was a general solid: then no more solids in slices are made
    general: bool = False
    # Number of closings of the hand; without contours and probes the coarse model is fitted to
    # their contacts
    closings: Count
    # Whether it is the final model: its PlanDone comes after it
    final: bool = False
    touches: Count  # Touches spent so far, failed contours included
    robot_time: Seconds  # Robot time spent so far


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanEstimate:
    """Estimated error of a model, and expected cost of halving it.

    Planner to displays on ``/plan/estimate``, for each model and for the final one.
    """

    number: Count  # Number of the model
    contours: Count  # Contours used
    touches: Count  # Touches spent, failed contours included
    robot_time: Seconds  # Robot time spent
    # The root mean square error of the solid is below this in 95 of 100 runs; null if unknown
    rms_bound_95: Metres | None
    # Height of the largest untouched stretch of the side
    largest_untouched: Metres
    # Touches after which the error is expected to be half as large; null if no slice brings that
    halving_touches: Annotated[float, Unit("#")] | None
    halving_seconds: Seconds | None  # Expected robot time of these touches
    open_share: Ratio | None = None  # Unknown share of the surface, as of PlanDone
    open_width: Metres | None = None  # Width of the largest untouched opening


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanDone:
    """The exploration is over. Planner to reconstructor on ``/plan/done``."""

    number: Count  # Number of the final model
    contours: Ids  # Contours of the final model
    probes: Ids  # Probes of the final model
    arcs: Ids = ()  # Unfinished contours of the final model
    # Whether a contour could not be traced, for another reason than a spent budget
    failed: bool = False
    missed: Ids = ()  # Probes without contact: the space that they swept is free
    general: bool = False  # Whether the last model was a general solid
    closings: Count = 0  # Number of closings of the hand
    touches: Count  # Touches spent, failed contours included
    robot_time: Seconds  # Robot time spent
    reason: str  # Reason for the end
    # Whether all limits are met, as far as known; null without limits
    reached: bool | None
    # The root mean square error of the solid is below this in 95 of 100 runs; null if it is
    # unknown
    rms_bound_95: Metres | None
    # Largest untouched gap: height between contours, or width of an opening in a general solid;
    # null if unknown
    largest_untouched: Metres | None
    uncovered: Metres  # Height of stretches of the side that touches cannot reach
    # Findings about the solid, by the names of `palpate.planning.Findings`; m and shares
    findings: dict[str, float] = field(default_factory=dict)
    # Limits on the solid, by the names of `palpate.planning.Limits`; m and shares
    limits: dict[str, float] = field(default_factory=dict)
    # Share of the surface that is unknown: farther than half a feature from all touches, without
    # the underside; null if not measured
    open_share: Ratio | None = None
    open_width: Metres | None = None  # Width of the largest opening in what was touched
    # Middles of the largest openings, if there are any, the largest first
    open_places: Points = field(default_factory=lambda: np.zeros((0, 3)))
    # Outward unit normals of the solid there: a touch comes from where they point
    open_normals: Directions = field(default_factory=lambda: np.zeros((0, 3)))
    # Touches that the unknown surface would need, if all of it could be reached
    open_touches: Annotated[float, Unit("#")] | None = None
    under_share: Ratio | None = None  # Share of the underside in the surface


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Superquadric:
    """A superquadric, tapered and bent. Latched on ``/model/coarse``."""

    number: Count  # Number of the fit
    size: Vector  # Semi-axes
    # Shape exponents e1 (along z) and e2 (across)
    exponents: Annotated[Floats, Array("<f8", (2,), "1")]
    pose: Pose  # Pose of the superquadric in the world
    taper: Annotated[Floats, Array("<f8", (2,), "1")]  # Taper along x and y
    bend: PerMetre  # Curvature of the bent axis
    bend_direction: Radians  # Azimuth towards which both ends are bent, its own frame
    warnings: tuple[str, ...]  # Reasons to doubt the fit
    residual: Metres  # Root mean square distance of the contacts
    residuals: Lengths  # Distance of each contact, in the order of the closings; negative inside
    rank: Count  # Rank of the fit's Jacobian


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShapeModel:
    """A closed solid. Latched on ``/model/shape``.

    ``lattice``: a prism deformed by a B-spline control lattice, with its ends. ``general``: the
    region where an implicit spline is negative, without lattice and heights. ``thesis``: the
    thesis's superquadric in a control lattice, without an error bound. ``procedure``: the surface
    of an exploratory procedure, whose model has its own topic.
    """

    MAX_BYTES = MAX_MESSAGE_BYTES  # It has all contacts: 9,500 touches are 80 MB

    number: Count  # Number of its goal
    method: Literal["lattice", "general", "thesis", "procedure"] = "lattice"  # Kind of solid
    # By method, root mean square distance of touches from the solid before they were fitted, m;
    # empty if no touch was predicted
    predicted: dict[str, float] = field(default_factory=dict)
    contours: Ids  # Contours used
    probes: Ids  # Probes used
    dropped: Ids  # Requested contours that were not used
    dropped_reasons: tuple[str, ...]  # One reason for each dropped contour
    # Control points of the final model's lattice, (columns, rows, layers, 3), world frame; empty
    # for earlier models and general solids
    control: ControlPoints = field(default_factory=lambda: np.zeros((0, 0, 0, 3)))
    # Control points before the deformation, around an upright prism
    undeformed: ControlPoints = field(default_factory=lambda: np.zeros((0, 0, 0, 3)))
    # Knots of the cubic splines along the columns
    knots_columns: Numbers = field(default_factory=lambda: np.zeros(0))
    knots_rows: Numbers = field(default_factory=lambda: np.zeros(0))  # Along the rows
    knots_layers: Numbers = field(default_factory=lambda: np.zeros(0))  # Along the layers
    # Vertices of the closed surface, world frame; empty if no solid could be rebuilt
    vertices: Points = field(default_factory=lambda: np.zeros((0, 3)))
    # Triangles, counter-clockwise seen from outside
    faces: Triangles = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    # Of the final mesh: whether all edges have exactly two faces, the number of holes through it,
    # and the number of crossing pairs of triangles; null for earlier models, which are not checked
    closed: bool | None = None
    genus: Count | None = None
    self_crossings: Count | None = None
    # Expected error at each vertex of a general solid, calibrated by the errors of touches that
    # were left out of fits; 0 for a solid in slices, whose error is stated by height
    vertex_errors: Lengths = field(default_factory=lambda: np.zeros(0))
    vertex_bounds: Lengths = field(default_factory=lambda: np.zeros(0))  # Its bound of 95 %
    # Distance of each vertex from the nearest touched point
    vertex_distances: Lengths = field(default_factory=lambda: np.zeros(0))
    # Root mean square error over the surface of a general solid: of parts that it lacks, as touches
    # far from it show, and of touches that are misplaced if its pose after a turn is wrong
    missing: Metres = 0.0
    # Known poses (n, 7) of the object in the world after each turn; the solid is given at its first
    # pose
    placements: Poses = field(default_factory=lambda: np.zeros((0, 7)))
    # Root mean square error of each of these poses along the normals at contacts
    placement_errors: Lengths = field(default_factory=lambda: np.zeros(0))
    # Faults of placements, a sentence each
    placement_faults: tuple[str, ...] = ()
    # Hollow places of the solid, which a pad spanned without contact
    openings: Points = field(default_factory=lambda: np.zeros((0, 3)))
    frame: Pose  # Slicing frame in the world; heights are measured along its z axis
    # Standard deviation of the surface, root mean square over sides and ends; null if its method
    # states none
    deviation: Metres | None = None
    ends_deviation: Metres = 0.0  # Part of the deviation due to the ends
    # Heights at which `uncertainty` is given
    uncertainty_height: Lengths = field(default_factory=lambda: np.zeros(0))
    # Standard deviation of the surface at each such height
    uncertainty: Lengths = field(default_factory=lambda: np.zeros(0))
    # Reasons against solids that were fitted and rejected; this model replaces them
    rejected: tuple[str, ...] = ()
    # Figures of the fit: residuals, condition, share of folds, used fallbacks
    health: dict[str, float] = field(default_factory=dict)
    touches: Count  # Touches spent when the model was requested
    robot_time: Seconds  # Robot time spent when the model was requested
    final: bool  # Whether it is the last model of the exploration
    # The packed solid with all its data; empty if it is not sent
    archive: PackedBytes = field(default_factory=lambda: np.zeros(0, np.uint8))


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Score:
    """A model measured against the truth. On ``/score``.

    Distances are point to triangle, from area-uniform samples each way: 20,000 for the final model,
    1,000 for earlier ones.
    """

    number: Count  # Number of the model
    contours: Count  # Contours used
    touches: Count  # Touches spent
    robot_time: Seconds  # Robot time spent
    chamfer: Metres  # Mean of the two one-way mean distances
    rms: Metres  # Root mean square distance over both ways
    p95: Metres  # The larger of the two 95 % quantiles
    hausdorff: Metres  # The largest distance of both ways
    normal: Degrees  # Mean angle between the normals at the samples and at their nearest points
    volume_error: Ratio  # Relative error of the volume, with its sign
    # The Chamfer distance between two tessellations of the truth, from as many samples
    sampling_floor: Metres
    size: Metres  # True height of the object
    watertight: bool  # True if every edge has exactly two faces
    genus: Count  # Number of handles; -1 for a surface that is not closed
    true_genus: Count = -1  # The same of the truth
    # Root mean square distance of the surface higher than 1 mm over the platform, within reach
    exposed_rms: Metres
    final: bool  # True for the score of the final model
