"""The frame in which an object is sliced: along the axis that its first contacts let expect.

The axis about which it was turned, if there is one; else the principal axis that differs most from
the others (Fung, 1999, 6.1), or beside it the one along which the surface runs straight; else the
world's own z axis, and that is said. Who knows better may give the axis.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, finite_array, positive
from palpate.core.explore.grasp.ends import Touched, ends_along
from palpate.core.explore.grasp.fit import Fit
from palpate.core.explore.grasp.misfit import Corrected, corrected
from palpate.core.explore.grasp.revolution import ROUND, Revolution, revolution
from palpate.core.explore.grasp.straight import straight_axis
from palpate.core.frames import pose_of

Axis = Literal["revolution", "longest", "shortest", "none", "given"]
"""Which axis: that about which the surface was turned, a principal axis, no axis of its own, or one
that was given."""

LEVEL = 4
"""Of the tessellation in which volumes are summed."""
MOST_NORMALS = 0.6
"""Of the contacts, at least, must be such normals."""
LIFT = 0.045
"""Of the size for each radian: what is nearer to a ball has no axis of revolution."""
SURE = math.radians(3.0)
"""An axis whose standard deviation is larger is none."""
STRAINED = 6.0
"""A fit that came to a bound reaches where nothing was felt: its axes are less certain by this."""
DISTINCT = 1.06
"""Principal axes whose ratio is smaller are alike."""
SLENDER = 1.25
"""The longest principal axis is taken if it is by this ratio longer than the next; else that which
differs more."""
EXACT = 1e-9
"""A given axis that leans less is the vertical, rad."""
LEAST_SNAP, MOST_SNAP = math.radians(1.0), math.radians(3.0)
"""An axis of revolution within two standard deviations of the vertical, but at least and at most
this, is the vertical: objects stand on platforms."""
PRINCIPAL_SNAP = math.radians(15.0)
"""So is a principal axis that leans less: features that no contact has met turn the axes of vases
and twisted columns by as much, and slices that lean less are as good."""
FEWEST = 11
"""Contacts below which there is no axis."""
TIE = 1e-9
"""Parts of an axis that are smaller have no sign."""


class SlicingFrame(NamedTuple):
    """Where and along which axis an object is sliced."""

    pose: Floats
    """Of the frame in the world, (7,): its z axis is the slicing axis, its origin lies on it. An
    upright frame has the world's axes, and its heights are the world's."""
    low: float
    """Where the object begins along the axis, slicing frame, m."""
    high: float
    """Where it ends, m."""
    radius: float
    """Largest distance of its surface from the axis, m."""
    axis: Axis
    """Which axis it is; "none" is the world's z axis, for want of a better one."""
    axis_error: float
    """Standard deviation of the axis's angle, rad; 0 for "none"."""
    place_error: float
    """Standard deviation of its place, m."""
    extent_error: float
    """Standard deviation of `low` and `high`, the larger one, m."""

    @property
    def ambiguous(self) -> bool:
        """Whether the object showed no axis of its own."""
        return self.axis == "none"


class _Line(NamedTuple):
    """A slicing axis."""

    axis: Floats
    point: Floats
    kind: Axis
    error: float
    """rad."""
    shift: float
    """m."""


def slicing_frame(
    found: Fit,
    points: Floats,
    normals: Floats,
    platform: float,
    noise: float,
    axis: Floats | None = None,
) -> SlicingFrame:
    """The frame for an object that was grasped.

    Parameters
    ----------
    found : Recovery
        The superquadric fitted to its contacts.
    points, normals : (n, 3) arrays
        Contacts, at least one, m, and outward unit normals.
    platform : float
        Height on which it stands, m.
    noise : float
        Standard deviation of a contact, m.
    axis : (3,) array, optional
        The slicing axis, a unit vector; else it is looked for.

    Raises
    ------
    ValueError
        If there is no contact, an array is not finite or has another shape, or the noise is not
        positive.
    """
    points = finite_array("points", points, (None, 3))
    normals = finite_array("normals", normals, (len(points), 3))
    positive("noise", noise, "m")
    if not len(points):
        raise ValueError("points must hold at least one contact, got none")
    if not found.fitted or len(points) < FEWEST:
        return _about_contacts(points, platform, axis)
    solid = _on_platform(found, points, platform, noise)
    if not solid.body.sound:
        return _about_contacts(points, platform, axis)
    if axis is not None:
        line = _Line(axis, solid.body.centroid, "given", 0.0, solid.shift)
        return _framed(line, solid, found, Touched(points, normals), platform)
    strain = STRAINED if "at a bound" in found.doubts else 1.0
    line = _line(solid, revolution(points, normals, solid.body.axes.T), strain)
    straight = straight_axis(normals, line.axis) if line.kind in ("longest", "shortest") else None
    if straight is not None:
        line = line._replace(axis=straight)
    return _framed(line, solid, found, Touched(points, normals), platform)


def _on_platform(found: Fit, points: Floats, platform: float, noise: float) -> Corrected:
    """The solid through its contacts, the lowest of which it has with the platform."""
    mesh = found.shape().mesh(LEVEL)
    lowest = int(mesh.vertices[:, 2].argmin())
    points = np.vstack([points, mesh.vertices[lowest]])
    residuals = np.append(found.residuals, mesh.vertices[lowest, 2] - platform)
    return corrected(mesh, points, residuals, found.rms, noise)


def _line(solid: Corrected, turned: Revolution, strain: float) -> _Line:
    """The slicing axis and why; a principal axis is less certain by the factor `strain`."""
    body = solid.body
    is_turned = turned.rms < ROUND and turned.share > MOST_NORMALS
    if is_turned and turned.lift > LIFT and turned.error < SURE:
        size = math.sqrt(float(body.spread.sum()))
        return _Line(turned.axis, turned.point, "revolution", turned.error, turned.rms * size)
    widths = np.sqrt(body.spread)
    slender, flat = widths[2] / widths[1], widths[1] / widths[0]
    kind: Axis = "longest" if slender >= min(SLENDER, flat) else "shortest"
    column, others = (2, (0, 1)) if kind == "longest" else (0, (1, 2))
    most = float(np.linalg.eigvalsh(solid.tilts[np.ix_(others, others)])[-1])
    error = strain * math.sqrt(max(most, 0.0))
    if max(slender, flat) < DISTINCT or error > SURE:
        return _Line(np.array([0.0, 0.0, 1.0]), body.centroid, "none", 0.0, solid.shift)
    return _Line(body.axes[:, column], body.centroid, kind, error, solid.shift)


def _framed(
    line: _Line, solid: Corrected, found: Fit, touched: Touched, platform: float
) -> SlicingFrame:
    axis = _upwards(line.axis)
    lean = math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    upright = lean <= _snap(line)
    pose = pose_of(line.point, np.eye(3) if upright else _turn_to(axis))
    ends = ends_along(pose, solid, found, touched, platform)
    # An upright frame has the world's heights.
    shift = -float(line.point[2]) if upright else 0.5 * (ends.low + ends.high)
    origin = line.point + shift * (np.array([0.0, 0.0, 1.0]) if upright else axis)
    return SlicingFrame(
        np.concatenate([origin, pose[3:]]),
        ends.low - shift,
        ends.high - shift,
        ends.radius,
        line.kind,
        line.error,
        line.shift,
        ends.error,
    )


def _snap(line: _Line) -> float:
    """By how much an axis may lean and be the vertical, rad."""
    if line.kind == "given":
        return EXACT
    if line.kind == "revolution":
        return min(max(2.0 * line.error, LEAST_SNAP), MOST_SNAP)
    return PRINCIPAL_SNAP


def _about_contacts(points: Floats, platform: float, given: Floats | None) -> SlicingFrame:
    """A frame about contacts that tell but where they are: upright, unless an axis is given."""
    axis = np.array([0.0, 0.0, 1.0]) if given is None else _upwards(given)
    kind: Axis = "none" if given is None else "given"
    turn = np.eye(3) if _is_vertical(axis) else _turn_to(axis)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    here = (points - middle) @ turn
    low, high = float(here[:, 2].min()), float(here[:, 2].max())
    away, size = float(np.hypot(*here[:, :2].T).max()), float(np.ptp(points, axis=0).max())
    if not _is_vertical(axis):
        return SlicingFrame(pose_of(middle, turn), low, high, away, kind, 0.0, size, size)
    # An upright frame has the world's heights.
    origin = np.array([middle[0], middle[1], 0.0])
    top = float(points[:, 2].max())
    return SlicingFrame(pose_of(origin, turn), platform, top, away, kind, 0.0, size, size)


def _is_vertical(axis: Floats) -> bool:
    return math.atan2(math.hypot(axis[0], axis[1]), axis[2]) <= EXACT


def _upwards(axis: Floats) -> Floats:
    """The axis or its opposite: that which points up, or else along x, or else along y."""
    for part in (axis[2], axis[0], axis[1]):
        if abs(part) > TIE:
            return axis * math.copysign(1.0, part)
    return axis


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
