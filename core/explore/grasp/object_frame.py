"""The frame in which an object is sliced, where it begins and ends, and its coarse model.

Its axis is the one about which the object was turned, if there is one; else the longest principal
axis, so that the ends, which slices know least of, are its smallest faces; the shortest where the
two longer ones are alike (Fung, 1999, 6.1, takes the one that differs most); or beside it the one
along which the surface runs straight; else the world's own z axis, which the frame tells. Who knows
better may give the axis. An end that was touched is where its contacts tell; one that was not is
where the fitted solid has it, if that fits, or where the platform cuts it off.

What the fitted solid misses is a smooth field of displacements along its normals: a Gaussian
process that the contacts' residuals pin down where they are; elsewhere it returns to nothing, and
may be anything of the size of what the fit misses. So a bump that was touched moves the axis, and a
side that was not makes it uncertain. Rasmussen and Williams, *Gaussian processes for machine
learning*, 2006, (2.25) and (2.26).
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array, positive
from palpate.core.explore.grasp.axes import ROUND, RevolutionAxis, extrusion_axis, revolution_axis
from palpate.core.poses import Pose
from palpate.core.shapes import FittedSuperquadric, Mesh

# Which axis: that about which the surface was turned, a principal axis, no axis of its own, or one
# that was given.
AxisKind = Literal["revolution", "longest", "shortest", "none", "given"]
LEVEL = 4  # Of the tessellation in which volumes are summed
MOST_NORMALS = 0.6  # Of the contacts, at least, must be such normals
LIFT = 0.045  # Of the size for each radian: what is nearer to a ball has no axis of revolution
SURE = math.radians(3.0)  # An axis whose standard deviation is larger is none
# A fit that came to a bound reaches where nothing was touched: its axes are less certain by this.
STRAINED = 6.0
DISTINCT = 1.06  # Principal axes whose ratio is smaller are alike
EXACT = 1e-9  # A given axis that leans less is the vertical, rad
# An axis of revolution within two standard deviations of the vertical, but at least and at most
# this, is the vertical: objects stand on platforms.
LEAST_SNAP, MOST_SNAP = math.radians(1.0), math.radians(3.0)
# So is a principal axis that leans less: features that no contact has met turn the axes of vases
# and twisted columns by as much, and slices that lean less are as good. Fewer contacts turn
# them farther.
PRINCIPAL_SNAP, FEW_SNAP, FEW_CONTACTS = math.radians(15.0), math.radians(45.0), 60
FEWEST = 11  # Contacts below which there is no axis
TIE = 1e-9  # Parts of an axis that are smaller have no sign
FACING = 0.9  # Cosine to the axis from which on a contact's normal says where the end is
LEANING = 0.5  # The same, where the fitted solid is no help
NEAR = 0.06  # Of the extent: contacts as near as this to the outermost one belong to the end
BOUNDED = 0.3  # Share of this that is allowed to a fit that came to a bound
QUARTER = 0.25  # Of the extent: the widest contact so near to the lower end tells how wide that is
FITS = 0.015  # Of the diameter: a solid that misses its contacts by more tells of nothing beyond
LEAST_COSINE = 0.5  # The platform cuts off an axis that is steeper than this
REACH = 0.2  # Of the diameter: how far one residual speaks for its neighbourhood
UNSEEN = 5.0  # A fit follows the contacts: away from them it is off by so many times its misses
TIED = 1e-6  # Of the largest variance: no gap between two counts as smaller


class ObjectFrame(NamedTuple):
    """Where and along which axis an object is sliced."""

    # Of the frame in the world: its z axis is the slicing axis, its origin lies on it. An
    # upright frame has the world's axes, and its heights are the world's.
    pose: Pose
    low: float  # Where the object begins along the axis, slicing frame, m
    high: float  # Where it ends, m
    radius: float  # Largest distance of its surface from the axis, m
    axis: AxisKind  # Which axis it is; "none" is the world's z axis, for want of a better one
    axis_error: float  # Standard deviation of the axis's angle, rad; 0 for "none"
    place_error: float  # Standard deviation of its place, m
    extent_error: float  # Standard deviation of `low` and `high`, the larger one, m

    @property
    def ambiguous(self) -> bool:
        """Whether the object showed no axis of its own."""
        return self.axis == "none"


class _Line(NamedTuple):
    """A slicing axis."""

    axis: Floats
    point: Floats
    kind: AxisKind
    error: float  # rad
    shift: float  # m


def fit_object_frame(
    found: FittedSuperquadric,
    points: Floats,
    normals: Floats,
    platform: float,
    noise: float,
    axis: Floats | None = None,
) -> ObjectFrame:
    """The frame for an object that was grasped.

    `points`, `normals` (n, 3): contacts, at least one, m, and outward unit normals. `platform`:
    height on which it stands, m. `noise`: standard deviation of a contact, m. `axis` (3,): the
    slicing axis, a unit vector; else it is looked for. Raises ValueError if there is no contact, an
    array is not finite or has another shape, or the noise is not positive.
    """
    points = finite_array("points", points, (None, 3))
    normals = finite_array("normals", normals, (len(points), 3))
    positive("noise", noise, "m")
    if not len(points):
        raise ValueError("points must hold at least one contact, got none")
    if not found.fitted or len(points) < FEWEST:
        return _about_contacts(points, platform, axis)
    solid = solid_on_platform(found, points, platform, noise)
    if not solid.mass.sound:
        return _about_contacts(points, platform, axis)
    if axis is not None:
        line = _Line(axis, solid.mass.centroid, "given", 0.0, solid.shift)
        return _framed(line, solid, found, Contacts(points, normals), platform)
    strain = STRAINED if "at a bound" in found.warnings else 1.0
    line = _line(solid, revolution_axis(points, normals, solid.mass.axes.T), strain)
    straight = extrusion_axis(normals, line.axis) if line.kind in ("longest", "shortest") else None
    if straight is not None:
        line = line._replace(axis=straight)
    return _framed(line, solid, found, Contacts(points, normals), platform)


def _about_contacts(points: Floats, platform: float, given: Floats | None) -> ObjectFrame:
    """A frame about contacts that tell but where they are: upright, unless an axis is given."""
    axis = np.array([0.0, 0.0, 1.0]) if given is None else _upwards(given)
    kind: AxisKind = "none" if given is None else "given"
    turn = np.eye(3) if _is_vertical(axis) else _turn_to(axis)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    local_contacts = (points - middle) @ turn
    low, high = float(local_contacts[:, 2].min()), float(local_contacts[:, 2].max())
    away = float(np.hypot(*local_contacts[:, :2].T).max())
    size = float(np.ptp(points, axis=0).max())
    if not _is_vertical(axis):
        return ObjectFrame(Pose(middle, turn), low, high, away, kind, 0.0, size, size)
    # An upright frame has the world's heights.
    origin = np.array([middle[0], middle[1], 0.0])
    top = float(points[:, 2].max())
    return ObjectFrame(Pose(origin, turn), platform, top, away, kind, 0.0, size, size)


def _is_vertical(axis: Floats) -> bool:
    return math.atan2(math.hypot(axis[0], axis[1]), axis[2]) <= EXACT


def solid_on_platform(
    found: FittedSuperquadric, points: Floats, platform: float, noise: float
) -> CorrectedSolid:
    """The solid through its contacts, one of which it has with the platform.

    That one is below the middle of all that is about as low: a corner would draw it aside.
    """
    mesh = found.shape().mesh(LEVEL)
    heights = mesh.vertices[:, 2]
    lowest = float(heights.min())
    foot = heights <= lowest + FITS * float(np.ptp(mesh.vertices, axis=0).max())
    middle = np.average(mesh.vertices[foot, :2], axis=0, weights=_areas(*mesh)[0][foot])
    points = np.vstack([points, [*middle, lowest]])
    residuals = np.append(found.residuals, lowest - platform)
    return correct_solid(mesh, points, residuals, found.rms, noise)


def correct_solid(
    mesh: Mesh, points: Floats, residuals: Floats, rms: float, noise: float
) -> CorrectedSolid:
    """Move a solid's surface on to its contacts.

    `points` (n, 3): contacts, m. `residuals` (n,): how far outside it each lies, m. `rms`: what the
    fit misses, m. `noise`: standard deviation of a contact, m.
    """
    vertices, faces = mesh
    area, normals = _areas(vertices, faces)
    reach = REACH * float(np.ptp(vertices, axis=0).max())
    size = (UNSEEN * max(rms, noise)) ** 2
    among = size * _kernel(points, points, reach) + noise**2 * np.eye(len(points))
    towards = size * _kernel(vertices, points, reach)
    gain = np.linalg.solve(among, towards.T).T
    moved = vertices + normals * (gain @ residuals)[:, None]
    left = np.maximum(size - np.einsum("vn,vn->v", gain, towards), 0.0)
    mass = mass_properties(moved, faces)
    if not mass.sound:  # the contacts contradict the solid: it is left as it is
        moved, mass = vertices, mass_properties(vertices, faces)
    effects = _effects(mass, moved, area)
    at = (vertices - vertices.mean(axis=0)).astype(np.float32)  # It is an estimate, of many places
    covariance = size * effects @ (_kernel(at, at, reach) @ effects.T.astype(np.float32))
    covariance -= (effects @ gain) @ (effects @ towards).T
    return CorrectedSolid(
        moved,
        faces,
        mass,
        np.sqrt(left),
        covariance[:3, :3],
        float(np.sqrt(max(np.trace(covariance[3:, 3:]), 0.0))),
    )


def _areas(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Area of the surface about each vertex, (n,), and its normal, (n, 3)."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    third = np.cross(b - a, c - a) / 6.0
    areas = np.zeros_like(vertices)
    for corner in faces.T:
        np.add.at(areas, corner, third)
    area = np.linalg.norm(areas, axis=1)
    return area, areas / np.maximum(area, np.finfo(float).tiny)[:, None]


def _kernel(one: Floats, other: Floats, reach: float) -> Floats:
    """Correlation (n, m) of displacements at two sets of places."""
    found: Floats = one @ other.T
    found -= 0.5 * (one**2).sum(axis=1)[:, None]
    found -= 0.5 * (other**2).sum(axis=1)
    np.minimum(found, 0.0, out=found)
    found /= reach**2
    return np.exp(found, out=found)


def _effects(mass: MassProperties, vertices: Floats, area: Floats) -> Floats:
    """What a displacement of each vertex does, (6, n): turns of the principal axes, shifts.

    To first order: a layer of area A and thickness d at x adds A d x x^T to the second moment, and
    an axis turns by the mixed part over the gap of the two variances.
    """
    at = (vertices - mass.centroid) @ mass.axes
    spread = mass.spread
    least = TIED * spread[2]
    turns = [
        area * at[:, i] * at[:, j] / (mass.volume * max(spread[j] - spread[i], least))
        for i, j in ((1, 2), (0, 2), (0, 1))
    ]
    return np.vstack([*turns, area * at.T / mass.volume])


def _framed(
    line: _Line,
    solid: CorrectedSolid,
    found: FittedSuperquadric,
    contacts: Contacts,
    platform: float,
) -> ObjectFrame:
    axis = _upwards(line.axis)
    lean = math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    upright = lean <= _snap(line, len(contacts.points))
    pose = Pose(line.point, np.eye(3) if upright else _turn_to(axis))
    low, high, radius, error = extent_along(pose, solid, found, contacts, platform)
    # An upright frame has the world's heights.
    shift = -float(line.point[2]) if upright else 0.5 * (low + high)
    origin = line.point + shift * (np.array([0.0, 0.0, 1.0]) if upright else axis)
    return ObjectFrame(
        Pose(origin, pose.axes),
        low - shift,
        high - shift,
        radius,
        line.kind,
        line.error,
        line.shift,
        error,
    )


def _upwards(axis: Floats) -> Floats:
    """The axis or its opposite: that which points up, or else along x, or else along y."""
    for part in (axis[2], axis[0], axis[1]):
        if abs(part) > TIE:
            return axis * math.copysign(1.0, part)
    return axis


def _snap(line: _Line, contacts: int) -> float:
    """By how much an axis that so many contacts tell may lean and be the vertical, rad."""
    if line.kind == "given":
        return EXACT
    if line.kind == "revolution":
        return min(max(2.0 * line.error, LEAST_SNAP), MOST_SNAP)
    return PRINCIPAL_SNAP if contacts >= FEW_CONTACTS else FEW_SNAP


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
    found: FittedSuperquadric,
    contacts: Contacts,
    platform: float,
) -> tuple[float, float, float, float]:
    """Lower and upper end along the z axis of a frame, largest distance from it, error of ends."""
    local_contacts = Contacts(pose.to_local(contacts.points), contacts.normals @ pose.axes)
    vertices = pose.to_local(solid.vertices)
    allowed = FITS * float(np.ptp(vertices, axis=0).max())
    over = solid.vertices[:, 2] >= platform - allowed
    known = None
    if found.rms < (BOUNDED if "at a bound" in found.warnings else 1.0) * allowed:
        known = FittedSolid(vertices[over], solid.deviation[over], found.rms / allowed)
    down = np.array([1.0, 1.0, -1.0])
    foot = _foot(pose, local_contacts, platform)
    high, above = _end(local_contacts, known, None)
    turned = Contacts(local_contacts.points * down, local_contacts.normals * down)
    low, below = _end(turned, known and known._replace(vertices=known.vertices * down), foot)
    wide = local_contacts.points
    if known is not None:
        wide = np.vstack([wide, known.vertices])
    return -low, high, float(np.hypot(wide[:, 0], wide[:, 1]).max()), max(above, below)


def _foot(pose: Pose, local_contacts: Contacts, platform: float) -> float | None:
    """Where a level lower end that stands on the platform by its rim is, downwards, m."""
    cosine = float(pose.axes[2, 2])
    if cosine < LEAST_COSINE:
        return None
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    along = local_contacts.points[:, 2]
    lowest = along <= along.min() + QUARTER * np.ptp(along)
    rim = float(np.hypot(local_contacts.points[lowest, 0], local_contacts.points[lowest, 1]).max())
    return -(platform - float(pose.position[2]) + rim * sine) / cosine


def _end(
    local_contacts: Contacts, known: FittedSolid | None, foot: float | None
) -> tuple[float, float]:
    """Where the upper end is, and its standard deviation, m."""
    along = local_contacts.points[:, 2]
    outermost = float(along.max())
    near = along >= outermost - NEAR * (outermost - float(along.min()))
    touched_end = _touched_end(local_contacts, near & (local_contacts.normals[:, 2] > FACING))
    if touched_end is not None:
        return touched_end
    if known is not None:
        vertex = int(known.vertices[:, 2].argmax())
        end = max(outermost, float(known.vertices[vertex, 2]))
        return end, float(known.deviation[vertex]) + known.poor * (end - outermost)
    radius = float(np.hypot(local_contacts.points[:, 0], local_contacts.points[:, 1]).max())
    level = outermost if foot is None else max(outermost, foot)
    round_end = _touched_end(local_contacts, near & (local_contacts.normals[:, 2] > LEANING))
    if round_end is None:
        return level, (0.5 if foot is None else 0.25) * radius
    # An edge and a round end give the same contacts: between the two.
    return 0.5 * (level + round_end[0]), 0.5 * abs(round_end[0] - level) + 0.1 * radius


def _touched_end(local_contacts: Contacts, at_end: Bools) -> tuple[float, float] | None:
    """Where the top is of the paraboloid about the axis through a contact, across its normal."""
    if not at_end.any():
        return None
    points, normals = local_contacts.points[at_end], local_contacts.normals[at_end]
    outwards = (points[:, :2] * normals[:, :2]).sum(axis=1) / normals[:, 2]
    tops = points[:, 2] + 0.5 * np.maximum(outwards, 0.0)
    best = int(normals[:, 2].argmax())
    top = max(float(tops[best]), float(local_contacts.points[:, 2].max()))
    return top, 0.5 * abs(top - float(points[best, 2])) + float(np.ptp(points[:, 2])) / 4.0


def _line(solid: CorrectedSolid, turned: RevolutionAxis, strain: float) -> _Line:
    """The slicing axis and why; a principal axis is less certain by the factor `strain`."""
    body = solid.mass
    is_turned = turned.rms < ROUND and turned.share > MOST_NORMALS
    if is_turned and turned.lift > LIFT and turned.error < SURE:
        size = math.sqrt(float(body.spread.sum()))
        return _Line(turned.axis, turned.point, "revolution", turned.error, turned.rms * size)
    widths = np.sqrt(body.spread)
    found: tuple[tuple[AxisKind, int, float], ...] = (
        ("longest", 2, widths[2] / widths[1]),
        ("shortest", 0, widths[1] / widths[0]),
    )
    for kind, column, ratio in found:
        others = [one for one in range(3) if one != column]
        most = float(np.linalg.eigvalsh(solid.tilts[np.ix_(others, others)])[-1])
        error = strain * math.sqrt(max(most, 0.0))
        if ratio >= DISTINCT and error <= SURE:
            return _Line(body.axes[:, column], body.centroid, kind, error, solid.shift)
    return _Line(np.array([0.0, 0.0, 1.0]), body.centroid, "none", 0.0, solid.shift)


class Contacts(NamedTuple):
    """Contacts."""

    points: Floats  # (n, 3), m
    normals: Floats  # Outward unit normals, (n, 3)


class FittedSolid(NamedTuple):
    """A solid that fits."""

    vertices: Floats  # (n, 3), m
    deviation: Floats  # Standard deviation of each, (n,), m
    poor: float  # From 0 to 1: how much of what it may miss it misses


class CorrectedSolid(NamedTuple):
    """A solid with what its contacts added."""

    vertices: Floats  # (n, 3), m
    faces: Ints  # (m, 3)
    mass: MassProperties  # What it bounds
    deviation: Floats  # Standard deviation of each vertex along its normal, (n,), m
    # Covariance of the body's principal axes: turns about the first, second and third of them, (3,
    # 3), rad2.
    tilts: Floats
    shift: float  # Standard deviation of its centroid, m


class MassProperties(NamedTuple):
    """A solid of density 1."""

    volume: float  # m3
    centroid: Floats  # (3,), m
    axes: Floats  # Principal axes as columns, the longest last; a rotation
    spread: Floats  # Variances of the volume along them, ascending, (3,), m2

    @property
    def sound(self) -> bool:
        """False for a surface that is turned inside out, or encloses nothing."""
        return self.volume > 0.0 and float(self.spread[0]) > 0.0


def mass_properties(vertices: Floats, faces: Ints) -> MassProperties:
    """What a closed mesh bounds.

    `vertices` (n, 3): m. `faces` (m, 3): counter-clockwise seen from outside. Sums over the
    tetrahedra between faces and a point: the integral of x x^T over one is its volume / 20 times
    the sum of x_i x_i^T over its corners and of their sum with itself.
    """
    start = vertices.mean(axis=0)
    corners = (vertices - start)[faces]
    a, b, c = corners.transpose(1, 0, 2)
    volumes = np.einsum("mi,mi->m", a, np.cross(b, c)) / 6.0
    volume = float(volumes.sum())
    total = corners.sum(axis=1)
    centroid = volumes @ total / (4.0 * volume)
    second = np.einsum("m,mki,mkj->ij", volumes, corners, corners)
    second += np.einsum("m,mi,mj->ij", volumes, total, total)
    covariance = second / (20.0 * volume) - np.outer(centroid, centroid)
    spread, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes = axes * [-1.0, 1.0, 1.0]
    return MassProperties(volume, centroid + start, axes, spread)
