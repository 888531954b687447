"""The frame in which an object is sliced: its axis, its ends and its radius.

The axis is the axis of revolution, if there is one; else the longest principal axis, so that the
ends, which slices know least of, are its smallest faces; the shortest where the two longer ones are
alike (Fung, 1999, 6.1, takes the one that differs most); or near such an axis the one along which
the surface runs straight; else the world's z axis, which the frame states. The caller may give the
axis. A touched end lies where its contacts are; one that was not touched lies where the fitted
solid has it, if that fits, or where the platform cuts it off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, finite_array, positive
from palpate.core.explore.grasp.axes import (
    ExtrusionSettings,
    RevolutionAxis,
    RevolutionSettings,
    extrusion_axis,
    revolution_axis,
)
from palpate.core.explore.grasp.corrected_solid import (
    CorrectedSolid,
    SolidSettings,
    solid_on_platform,
)
from palpate.core.poses import Pose
from palpate.core.shapes import FittedSuperquadric

# "revolution": the surface was turned about it; "longest", "shortest": a principal axis; "none":
# the object has no axis of its own; "given": the caller's.
AxisKind = Literal["revolution", "longest", "shortest", "none", "given"]
MAX_ROUNDING = 1e-9  # [1] parts of unit vectors that are smaller are 0


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSettings:
    """Which axis a solid has, and when that is the vertical.

    Objects stand on platforms, so an axis near the vertical is snapped to it. Features that no
    contact has met turn the principal axes of vases and twisted columns by up to the snap angles,
    and slices that lean less are as good; with few contacts the axes turn farther.
    """

    min_normals: float = 0.6  # fraction of the contacts whose normals meet an axis of revolution
    min_lift: float = 0.045  # smallest `RevolutionAxis.lift`; a surface with less is nearly a ball
    max_error: float = math.radians(3.0)  # [rad] largest standard deviation of an axis
    bound_factor: float = 6.0  # of principal axes' errors, if a fitted parameter is at a bound
    min_ratio: float = 1.06  # of the lengths of two principal axes that count as different
    snap_deviations: float = 2.0  # [standard deviations] of lean; a smaller lean is snapped
    min_snap: float = math.radians(1.0)  # [rad] the same angle, at least
    max_snap: float = math.radians(3.0)  # [rad] the same angle, at most
    principal_snap: float = math.radians(15.0)  # [rad] largest lean of a snapped principal axis
    few_contacts: int = 60  # with fewer contacts, the next angle is used
    few_contacts_snap: float = math.radians(45.0)  # [rad] largest lean of a snapped principal axis


@dataclass(frozen=True, slots=True, kw_only=True)
class ExtentSettings:
    """Where an object ends along its axis, and how uncertain that is."""

    end_height: float = 0.06  # [extent of contacts] of an end's contacts below the outermost
    min_cosine: float = 0.9  # between the axis and the normal of a contact that gives the end
    min_round_cosine: float = 0.5  # the same, where the fitted solid does not fit
    bound_share: float = 0.3  # of `max_misfit`, allowed if a fitted parameter is at a bound
    foot_height: float = 0.25  # [extent of contacts] of contacts that may be on the foot's rim
    min_axis_cosine: float = 0.5  # between axis and vertical, above which the platform gives an end
    # [radius] standard deviations of ends that follow neither from contacts nor from the solid.
    free_error: float = 0.5
    platform_error: float = 0.25  # of an end on the platform
    round_error: float = 0.1  # of an end between an edge and a round cap


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameSettings:
    """How the frame of a grasped object is found."""

    min_contacts: int = 11  # for an axis
    max_misfit: float = 0.015  # [diameter] rms of contacts, up to which the solid gives the ends
    solid: SolidSettings = field(default_factory=SolidSettings)
    axis: AxisSettings = field(default_factory=AxisSettings)
    extent: ExtentSettings = field(default_factory=ExtentSettings)
    revolution: RevolutionSettings = field(default_factory=RevolutionSettings)
    extrusion: ExtrusionSettings = field(default_factory=ExtrusionSettings)


class ObjectFrame(NamedTuple):
    """Where and along which axis an object is sliced."""

    # Of the frame in the world: its z axis is the slicing axis, its origin lies on it. An upright
    # frame has the world's axes and heights.
    pose: Pose
    low: float  # [m] along the axis where the object begins, slicing frame
    high: float  # [m] where it ends
    radius: float  # [m] largest distance of its surface from the axis
    axis: AxisKind  # "none": the world's z axis
    axis_error: float  # [rad] standard deviation of the axis's angle; 0 for "none"
    place_error: float  # [m] standard deviation of the axis's place
    extent_error: float  # [m] standard deviation of `low` and `high`, the larger one

    @property
    def is_ambiguous(self) -> bool:
        """Whether the object showed no axis of its own."""
        return self.axis == "none"


class _Line(NamedTuple):
    """A slicing axis."""

    axis: Floats
    point: Floats
    kind: AxisKind
    angle_error: float  # [rad] standard deviation
    place_error: float  # [m] standard deviation


def fit_object_frame(
    fit: FittedSuperquadric,
    points: Floats,
    normals: Floats,
    platform: float,
    noise: float,
    axis: Floats | None = None,
    settings: FrameSettings = FrameSettings(),
) -> ObjectFrame:
    """The frame of a grasped object.

    `points`, `normals` (n, 3): contacts, at least one [m], and outward unit normals. `platform`:
    height on which it stands [m]. `noise`: standard deviation of a contact [m]. `axis` (3,): the
    slicing axis, a unit vector; None to look for it. Raises ValueError if there is no contact, an
    array is not finite or has another shape, or the noise is not positive.
    """
    points = finite_array("points", points, (None, 3))
    normals = finite_array("normals", normals, (len(points), 3))
    positive("noise", noise, "m")
    if not len(points):
        raise ValueError("points must hold at least one contact, got none")
    if not fit.fitted or len(points) < settings.min_contacts:
        return _about_contacts(points, platform, axis)
    solid = solid_on_platform(fit, points, platform, noise, settings.solid)
    if not solid.mass.is_sound:
        return _about_contacts(points, platform, axis)
    contacts = Contacts(points, normals)
    if axis is not None:
        line = _Line(axis, solid.mass.centroid, "given", 0.0, solid.place_error)
    else:
        line = _find_line(fit, solid, contacts, settings)
    return _framed(line, solid, fit, contacts, platform, settings)


def _find_line(
    fit: FittedSuperquadric, solid: CorrectedSolid, contacts: Contacts, settings: FrameSettings
) -> _Line:
    """The slicing axis that contacts and solid suggest."""
    revolution = revolution_axis(
        contacts.points, contacts.normals, solid.mass.axes.T, settings.revolution
    )
    line = _line(solid, revolution, "at a bound" in fit.warnings, settings)
    if line.kind in ("longest", "shortest"):
        straight = extrusion_axis(contacts.normals, line.axis, settings.extrusion)
        if straight is not None:
            return line._replace(axis=straight)
    return line


def _about_contacts(points: Floats, platform: float, given_axis: Floats | None) -> ObjectFrame:
    """A frame about contacts without a fitted solid: upright, unless an axis is given."""
    axis = np.array([0.0, 0.0, 1.0]) if given_axis is None else _upwards(given_axis)
    kind: AxisKind = "none" if given_axis is None else "given"
    turn = np.eye(3) if _is_vertical(axis) else _turn_to(axis)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    local_contacts = (points - middle) @ turn
    low, high = float(local_contacts[:, 2].min()), float(local_contacts[:, 2].max())
    radius = float(np.hypot(*local_contacts[:, :2].T).max())
    size = float(np.ptp(points, axis=0).max())
    if not _is_vertical(axis):
        return ObjectFrame(Pose(middle, turn), low, high, radius, kind, 0.0, size, size)
    # An upright frame has the world's heights.
    origin = np.array([middle[0], middle[1], 0.0])
    top = float(points[:, 2].max())
    return ObjectFrame(Pose(origin, turn), platform, top, radius, kind, 0.0, size, size)


def _is_vertical(axis: Floats) -> bool:
    return math.atan2(math.hypot(axis[0], axis[1]), axis[2]) <= MAX_ROUNDING


def _framed(
    line: _Line,
    solid: CorrectedSolid,
    fit: FittedSuperquadric,
    contacts: Contacts,
    platform: float,
    settings: FrameSettings,
) -> ObjectFrame:
    """The frame about a slicing axis."""
    axis = _upwards(line.axis)
    lean = math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    is_upright = lean <= _snap(line, len(contacts.points), settings.axis)
    pose = Pose(line.point, np.eye(3) if is_upright else _turn_to(axis))
    low, high, radius, error = extent_along(pose, solid, fit, contacts, platform, settings)
    # An upright frame has the world's heights.
    shift = -float(line.point[2]) if is_upright else 0.5 * (low + high)
    origin = line.point + shift * (np.array([0.0, 0.0, 1.0]) if is_upright else axis)
    return ObjectFrame(
        Pose(origin, pose.axes),
        low - shift,
        high - shift,
        radius,
        line.kind,
        line.angle_error,
        line.place_error,
        error,
    )


def _upwards(axis: Floats) -> Floats:
    """The axis or its opposite: that which points up, or if level along x, or else along y."""
    for part in (axis[2], axis[0], axis[1]):
        if abs(part) > MAX_ROUNDING:
            return axis * math.copysign(1.0, part)
    return axis


def _snap(line: _Line, n_contacts: int, settings: AxisSettings) -> float:
    """Largest lean of an axis that is taken for the vertical [rad]."""
    if line.kind == "given":
        return MAX_ROUNDING
    if line.kind == "revolution":
        snap = settings.snap_deviations * line.angle_error
        return min(max(snap, settings.min_snap), settings.max_snap)
    if n_contacts >= settings.few_contacts:
        return settings.principal_snap
    return settings.few_contacts_snap


def _turn_to(axis: Floats) -> Floats:
    """The smallest rotation (3, 3) that turns the world's z axis to an axis that points up."""
    x, y, z = axis.tolist()
    share = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - share * x * x, -share * x * y, x],
            [-share * x * y, 1.0 - share * y * y, y],
            [-x, -y, z],
        ]
    )


def extent_along(
    pose: Pose,
    solid: CorrectedSolid,
    fit: FittedSuperquadric,
    contacts: Contacts,
    platform: float,
    settings: FrameSettings = FrameSettings(),
) -> tuple[float, float, float, float]:
    """Lower and upper end along a frame's z axis, largest distance from it, error of ends [m]."""
    local_contacts = Contacts(pose.to_local(contacts.points), contacts.normals @ pose.axes)
    vertices = pose.to_local(solid.vertices)
    max_misfit = settings.max_misfit * float(np.ptp(vertices, axis=0).max())
    over = solid.vertices[:, 2] >= platform - max_misfit
    solid_shown = None
    share = settings.extent.bound_share if "at a bound" in fit.warnings else 1.0
    if fit.rms < share * max_misfit:
        solid_shown = FittedSolid(vertices[over], solid.deviation[over], fit.rms / max_misfit)
    down = np.array([1.0, 1.0, -1.0])
    foot = _foot(pose, local_contacts, platform, settings.extent)
    high, high_error = _end(local_contacts, solid_shown, None, settings.extent)
    turned = Contacts(local_contacts.points * down, local_contacts.normals * down)
    solid_turned = solid_shown and solid_shown._replace(vertices=solid_shown.vertices * down)
    low, low_error = _end(turned, solid_turned, foot, settings.extent)
    outer = local_contacts.points
    if solid_shown is not None:
        outer = np.vstack([outer, solid_shown.vertices])
    radius = float(np.hypot(outer[:, 0], outer[:, 1]).max())
    return -low, high, radius, max(high_error, low_error)


def _foot(
    pose: Pose, local_contacts: Contacts, platform: float, settings: ExtentSettings
) -> float | None:
    """Where a level lower end that stands on the platform by its rim is, downwards [m]."""
    cosine = float(pose.axes[2, 2])
    if cosine < settings.min_axis_cosine:
        return None
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    along = local_contacts.points[:, 2]
    lowest = along <= along.min() + settings.foot_height * np.ptp(along)
    rim = float(np.hypot(local_contacts.points[lowest, 0], local_contacts.points[lowest, 1]).max())
    return -(platform - float(pose.position[2]) + rim * sine) / cosine


def _end(
    local_contacts: Contacts,
    solid: FittedSolid | None,
    foot: float | None,
    settings: ExtentSettings,
) -> tuple[float, float]:
    """Where the upper end is, and its standard deviation [m].

    `solid`: None if it does not fit. `foot`: where the platform cuts the end off, or None.
    """
    along = local_contacts.points[:, 2]
    outermost = float(along.max())
    is_near = along >= outermost - settings.end_height * (outermost - float(along.min()))
    facing = local_contacts.normals[:, 2]
    touched_end = _touched_end(local_contacts, is_near & (facing > settings.min_cosine))
    if touched_end is not None:
        return touched_end
    if solid is not None:
        vertex = int(solid.vertices[:, 2].argmax())
        end = max(outermost, float(solid.vertices[vertex, 2]))
        return end, float(solid.deviation[vertex]) + solid.misfit * (end - outermost)
    radius = float(np.hypot(local_contacts.points[:, 0], local_contacts.points[:, 1]).max())
    level = outermost if foot is None else max(outermost, foot)
    round_end = _touched_end(local_contacts, is_near & (facing > settings.min_round_cosine))
    if round_end is None:
        share = settings.free_error if foot is None else settings.platform_error
        return level, share * radius
    # An edge and a round end give the same contacts: between the two.
    error = 0.5 * abs(round_end[0] - level) + settings.round_error * radius
    return 0.5 * (level + round_end[0]), error


def _touched_end(local_contacts: Contacts, at_end: Bools) -> tuple[float, float] | None:
    """Where the upper end is, and its standard deviation [m], from contacts of a mask (n,).

    It is the top of the paraboloid about the axis through the contact that faces the axis most.
    """
    if not at_end.any():
        return None
    points, normals = local_contacts.points[at_end], local_contacts.normals[at_end]
    outwards = (points[:, :2] * normals[:, :2]).sum(axis=1) / normals[:, 2]
    tops = points[:, 2] + 0.5 * np.maximum(outwards, 0.0)
    best = int(normals[:, 2].argmax())
    top = max(float(tops[best]), float(local_contacts.points[:, 2].max()))
    return top, 0.5 * abs(top - float(points[best, 2])) + float(np.ptp(points[:, 2])) / 4.0


def _line(
    solid: CorrectedSolid, revolution: RevolutionAxis, is_at_bound: bool, settings: FrameSettings
) -> _Line:
    """The slicing axis and its kind; principal axes of a fit at a bound are less certain."""
    body, limits = solid.mass, settings.axis
    is_turned = (
        revolution.rms < settings.revolution.max_miss
        and revolution.share > limits.min_normals
        and revolution.lift > limits.min_lift
        and revolution.error < limits.max_error
    )
    if is_turned:
        place_error = revolution.rms * math.sqrt(float(body.variances.sum()))
        return _Line(revolution.axis, revolution.point, "revolution", revolution.error, place_error)
    widths = np.sqrt(body.variances)
    candidates: tuple[tuple[AxisKind, int, float], ...] = (
        ("longest", 2, widths[2] / widths[1]),
        ("shortest", 0, widths[1] / widths[0]),
    )
    for kind, column, ratio in candidates:
        across = [number for number in range(3) if number != column]
        variance = float(np.linalg.eigvalsh(solid.tilts[np.ix_(across, across)])[-1])
        error = (limits.bound_factor if is_at_bound else 1.0) * math.sqrt(max(variance, 0.0))
        if ratio >= limits.min_ratio and error <= limits.max_error:
            return _Line(body.axes[:, column], body.centroid, kind, error, solid.place_error)
    return _Line(np.array([0.0, 0.0, 1.0]), body.centroid, "none", 0.0, solid.place_error)


class Contacts(NamedTuple):
    """Contacts."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3) outward unit normals


class FittedSolid(NamedTuple):
    """A solid that fits."""

    vertices: Floats  # (n, 3) [m]
    deviation: Floats  # (n,) [m] standard deviation of each vertex
    misfit: float  # rms over the largest allowed one, 0 to 1
