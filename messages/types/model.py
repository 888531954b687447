"""What is rebuilt, from what, and how good it is."""

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
    # Contours that were not finished: what their touches met counts, their curves do not
    arcs: Ids = ()
    # Whether one of these could not be traced, for another reason than a spent budget
    failed: bool = False
    missed: Ids = ()  # Probes that met nothing: what they swept is free
    # Whether the last model was a general solid: then slices make no solid beside it any more
    general: bool = False
    # Closings of the hand that there were; without contours and probes, the coarse model is fitted
    # to their contacts
    closings: Count
    # Whether it is the last, with all that belongs to a final model: its PlanDone comes after it
    final: bool = False
    touches: Count  # Touches spent so far, failed contours included
    robot_time: Seconds  # Robot time spent so far


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanEstimate:
    """How good a model is, as far as can be told, and what the next halving of its error takes.

    Planner to whoever shows it, on ``/plan/estimate``, for each model and for the final one.
    """

    number: Count  # Number of the model
    contours: Count  # Contours used
    touches: Count  # Touches spent, failed contours included
    robot_time: Seconds  # Robot time spent
    # The root mean square error of the solid is below this in 95 of 100 runs; null where nobody can
    # tell
    rms_bound_95: Metres | None
    # Height of the largest stretch of the side that nothing has touched
    largest_untouched: Metres
    # Touches after which the error is expected to be half as large; null if no slice brings that
    halving_touches: Annotated[float, Unit("#")] | None
    halving_seconds: Seconds | None  # Robot time that they are expected to take
    open_share: Ratio | None = None  # Share of the surface that lies far from every touch
    open_width: Metres | None = None  # Width of the largest opening in what was touched


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanDone:
    """The exploration is over. Planner to reconstructor on ``/plan/done``."""

    number: Count  # Number of the final model
    contours: Ids  # Contours of the final model
    probes: Ids  # Probes of the final model
    arcs: Ids = ()  # Unfinished contours of the final model
    # Whether one of these could not be traced, for another reason than a spent budget
    failed: bool = False
    missed: Ids = ()  # Probes that met nothing: what they swept is free
    general: bool = False  # Whether the last model was a general solid
    closings: Count = 0  # Closings of the hand that there were
    touches: Count  # Touches spent, failed contours included
    robot_time: Seconds  # Robot time spent
    reason: str  # Why it is over
    # Whether every limit is kept, as far as can be told; null where nothing was asked
    reached: bool | None
    # The root mean square error of the solid is below this in 95 of 100 runs; null where nobody can
    # tell
    rms_bound_95: Metres | None
    # Width of the largest untouched gap: of the side's height, or of a general solid; null where
    # nobody looked
    largest_untouched: Metres | None
    uncovered: Metres  # Height of stretches of the side that no touch could reach
    # What is known of the solid, by the names of `palpate.planning.Findings`; m and shares
    findings: dict[str, float] = field(default_factory=dict)
    # What was asked, by the names of `palpate.planning.Limits`; m and shares
    limits: dict[str, float] = field(default_factory=dict)
    # Share of the surface that is unknown, for it lies farther than half a feature from every
    # touch, the underside apart; null where nobody looked
    open_share: Ratio | None = None
    open_width: Metres | None = None  # Width of the largest opening in what was touched
    # Middles of the largest openings, if there are any, the largest first
    open_places: Points = field(default_factory=lambda: np.zeros((0, 3)))
    # Outward unit normals of the solid there: a touch comes from where they point
    open_normals: Directions = field(default_factory=lambda: np.zeros((0, 3)))
    # Touches that it would take, if all of it could be reached
    open_touches: Annotated[float, Unit("#")] | None = None
    under_share: Ratio | None = None  # Share of the surface on which the object stands


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
    warnings: tuple[str, ...]  # Why not to believe the fit; none if there is no reason
    residual: Metres  # Root mean square distance of the contacts
    residuals: Lengths  # Distance of each contact, in the order of the closings; negative inside
    rank: Count  # Rank of the fit's Jacobian


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShapeModel:
    """A closed solid. Latched on ``/model/shape``.

    A prism deformed by a B-spline control lattice, and its ends; or a general solid, where an
    implicit spline is negative: it has no lattice of columns, rows and layers, and no heights; or
    the thesis's superquadric in a control lattice, which tells of no error; or what an exploratory
    procedure found, whose own model has a topic of its own.
    """

    MAX_BYTES = MAX_MESSAGE_BYTES  # All that was touched is kept in it: 9,500 touches are 80 MB

    number: Count  # Number of the goal that asked for it
    method: Literal["lattice", "general", "thesis", "procedure"] = "lattice"  # What it is
    # By method, root mean square distance at which touches were predicted before they were used,
    # m; none where there was nothing to predict, or nothing to predict it by
    predicted: dict[str, float] = field(default_factory=dict)
    contours: Ids  # Contours used
    probes: Ids  # Probes used
    dropped: Ids  # Contours asked for but not used
    dropped_reasons: tuple[str, ...]  # One reason for each dropped contour
    # Control points of the final model's lattice, (columns, rows, layers, 3), world frame; none of
    # models on the way, nor of a general solid
    control: ControlPoints = field(default_factory=lambda: np.zeros((0, 0, 0, 3)))
    # Where they were before, around an upright prism
    undeformed: ControlPoints = field(default_factory=lambda: np.zeros((0, 0, 0, 3)))
    # Knots of the cubic splines along the columns
    knots_columns: Numbers = field(default_factory=lambda: np.zeros(0))
    knots_rows: Numbers = field(default_factory=lambda: np.zeros(0))  # Along the rows
    knots_layers: Numbers = field(default_factory=lambda: np.zeros(0))  # Along the layers
    # Vertices of the closed surface, world frame; none if nothing could be rebuilt
    vertices: Points = field(default_factory=lambda: np.zeros((0, 3)))
    # Triangles, counter-clockwise seen from outside
    faces: Triangles = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    # Of the final model's mesh: whether every edge has exactly two faces, how many holes go through
    # it, and how many pairs of triangles cross; null of models on the way, for nobody looked
    closed: bool | None = None
    genus: Count | None = None
    self_crossings: Count | None = None
    # Error that is expected at each vertex of a general solid, of touches that were left out, by
    # their distance from the others; 0 where slices tell of theirs by height
    vertex_errors: Lengths = field(default_factory=lambda: np.zeros(0))
    vertex_bounds: Lengths = field(default_factory=lambda: np.zeros(0))  # Its bound of 95 %
    # Distance of each vertex from the nearest touched point
    vertex_distances: Lengths = field(default_factory=lambda: np.zeros(0))
    # Root mean square error over all of a general solid of what it lacks, as touches far off it
    # tell, and of touches that are misplaced if it lay otherwise since it was turned over
    missing: Metres = 0.0
    # Pose (n, 7) of the object in the world after each time that it was turned over, as far as they
    # are known; the solid is given where it lay at first
    placements: Poses = field(default_factory=lambda: np.zeros((0, 7)))
    # How far each of these may be off along the normals of what was touched, root mean square
    placement_errors: Lengths = field(default_factory=lambda: np.zeros(0))
    # What is wrong with placements, a sentence each; none if nothing is
    placement_faults: tuple[str, ...] = ()
    # Places in the solid at which a pad touched nothing but what is beside them: it is hollow there
    openings: Points = field(default_factory=lambda: np.zeros((0, 3)))
    frame: Pose  # Slicing frame in the world, along whose z axis heights count
    # Standard deviation of the surface, root mean square over all of it, ends included; null where
    # its method tells of none
    deviation: Metres | None = None
    ends_deviation: Metres = 0.0  # Of it, the part that the ends make
    # Heights at which `uncertainty` is given
    uncertainty_height: Lengths = field(default_factory=lambda: np.zeros(0))
    # Standard deviation of the surface at each such height
    uncertainty: Lengths = field(default_factory=lambda: np.zeros(0))
    # Solids that were fitted and not sent, for what contradicted each; this one stands in for them
    rejected: tuple[str, ...] = ()
    # Figures of the fit: residuals, condition, share of folds, fallbacks taken
    health: dict[str, float] = field(default_factory=dict)
    touches: Count  # Touches spent when the model was asked for
    robot_time: Seconds  # Robot time spent when the model was asked for
    final: bool  # True for the model that the exploration ends with
    # The solid with everything that belongs to it, packed; nothing if it is not sent along
    archive: PackedBytes = field(default_factory=lambda: np.zeros(0, np.uint8))


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Score:
    """A model measured against the truth. On ``/score``.

    Distances are point to triangle, from area-uniform samples each way: 20,000 of the final model,
    2,000 of those on the way.
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
    genus: Count  # Number of handles; -1 for a surface that is not closed and has none to count
    true_genus: Count = -1  # The same of the truth
    # Root mean square distance of what lies over 1 mm above the platform: what a finger may touch
    exposed_rms: Metres
    final: bool  # True for the score of the final model
