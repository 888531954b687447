"""Following a contour: one more arc ahead, around a corner, over a gap."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.aim import Stance
from palpate.core.explore.felt import Felt
from palpate.core.explore.routine import Routine
from palpate.core.explore.seek import seek
from palpate.core.touch.pad import Pad

JOINED = 2.3e-3
"""Points farther apart than this have a gap between them, m."""
AHEAD = 0.25e-3
"""A new point must lie this far ahead of the last one, m."""
PROGRESS = 0.6e-3
"""And the farthest of them this far, m."""
WINDOWS = (7.0e-3, 3.2e-3)
"""Lengths of the path's end to which the heading is fitted: the first whose fit is good, m."""
LONGEST_TAIL = 40
"""Points that belong to the path's end; near its closing the start lies within the window too."""
GOOD_FIT = 60.0e-6
"""A parabola within this of the points is good, m."""
PAD_STEP, CONTACT_STEP = 0.69, 1.1
"""Longest step, in half widths of the pad and of the contact."""
CURVATURES = (-200.0, 500.0)
"""Bounds of the path's curvature, 1/m."""
STANDOFF, GAP_STANDOFF, GAP_REACH = 3.0e-3, 6.0e-3, 8.0e-3
SHARP_TURN = 0.2
"""Beyond this turn, progress is measured along the new heading, rad."""


class Path(NamedTuple):
    """What has been traced so far, in the slicing frame."""

    points: Floats
    """(n, 3), m."""
    normals: Floats
    """(n, 3)."""
    across: Floats
    """(n,), 1/m."""

    def joined(self, other: Path) -> Path:
        """Append another path."""
        return Path(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def part(self, chosen: Bools | slice) -> Path:
        """Take some of its points."""
        return Path(self.points[chosen], self.normals[chosen], self.across[chosen])


class Stride(NamedTuple):
    """A found continuation of the path."""

    new: Path
    """Points ahead of the path's end."""
    heading: float
    """Azimuth of the outward normal with which they were touched, rad."""
    stance: Stance
    """How the pad was held."""


class Course(NamedTuple):
    """Where the path is going at its end."""

    tangent: Floats
    """(2,) unit vector."""
    curvature: float
    """1/m, positive where the contour bulges outwards."""
    heading: float
    """Azimuth of the outward normal, rad, without jumps of a whole turn."""


class Attempt(NamedTuple):
    """One way to go on from the path's end."""

    way: float
    """Distance ahead, m."""
    turn: float
    """Turn of the heading, rad."""
    standoff: float
    """Distance from which the pad starts, m."""


AROUND_A_CORNER = tuple(
    [Attempt(0.0, math.radians(turn), STANDOFF) for turn in (50, 25, 75, 100, -25, -50)]
    + [Attempt(4e-3, 0.0, 8e-3), Attempt(8e-3, 0.0, 10e-3)]
    + [Attempt(8e-3, math.radians(30), 10e-3), Attempt(12e-3, 0.0, 12e-3)]
)
"""Convex turns on the spot, concave ones, then hops ahead from farther away."""
OVER_A_GAP = (Attempt(0.0, math.radians(-25), STANDOFF),)
"""One turn on the spot, into the hollow that the pad may have bridged; more turns find less
than they cost, for the gap's middle is probed in any case."""


def extend(
    pad: Pad, path: Path, course: Course, stance: Stance, height: float
) -> Routine[Stride | None]:
    """One more arc of the contour, or None if there is no way on.

    The plain step comes first. If it feels nothing ahead, the corner is marched around; if it
    feels an arc beyond a gap, other headings are tried, and last of all the gap's middle.
    """
    plain = _plain_step(pad, course, stance)
    attempts = deque([plain])
    beyond: Stride | None = None
    while attempts:
        attempt = attempts.popleft()
        place = _ahead(path, course, attempt)
        towards = course.heading + attempt.turn
        felt, stance = yield from seek(
            stance, place, towards, attempt.standoff, max(attempt.standoff, STANDOFF), height
        )
        new = None if felt is None else _new_points(path, course, felt, attempt)
        if attempt is plain:
            attempts.extend(AROUND_A_CORNER if new is None else OVER_A_GAP)
        if new is None:
            continue
        stride = Stride(new, towards, stance)
        if _gap(path, stride) <= JOINED:
            return stride
        if beyond is None or _gap(path, stride) < _gap(path, beyond):
            beyond = stride
        if attempt.standoff > STANDOFF:
            break
    return None if beyond is None else (yield from _fill_gap(path, beyond, height))


def course_at_end(path: Path, heading: float) -> Course:
    """Direction and curvature of a path at its last point.

    A parabola is fitted to the last 7 mm, or to the last 3.2 mm where that does not fit: a
    longer window would mix two faces. The felt normal is a better heading than the chord.

    Parameters
    ----------
    path : Path
        At least one point.
    heading : float
        Azimuth of the outward normal at the last touch, rad.
    """
    tangent = np.array([-math.sin(heading), math.cos(heading)])
    curvature = 0.0
    end = path.points[-1]
    tail = path.points[-LONGEST_TAIL:]
    distance = np.linalg.norm(tail - end, axis=1)
    for window in WINDOWS:
        near = tail[distance < window][:, :2] - end[:2]
        if len(near) < 3:
            break
        tangent, curvature, misfit = _parabola(near)
        if misfit < GOOD_FIT:
            break
    normal = path.normals[-1]
    level = math.hypot(normal[0], normal[1])
    if level > 0.2:
        felt = np.array([-normal[1], normal[0]]) / level
        tangent = felt if felt @ tangent > 0.8 else tangent
    azimuth = math.atan2(-tangent[0], tangent[1])
    change = math.remainder(azimuth - heading, 2 * math.pi)
    return Course(tangent, min(max(curvature, CURVATURES[0]), CURVATURES[1]), heading + change)


def _parabola(near: Floats) -> tuple[Floats, float, float]:
    """Tangent at the end, curvature and largest misfit of points (n, 2) that end at 0."""
    centred = near - near.mean(axis=0)
    (xx, xy), (_, yy) = (centred.T @ centred).tolist()
    lean = 0.5 * math.atan2(2.0 * xy, xx - yy)  # of the scatter's long axis
    axis = np.array([math.cos(lean), math.sin(lean)])
    if axis @ (near[-1] - near[0]) < 0.0:
        axis = -axis
    along, outward = near @ axis, np.array([axis[1], -axis[0]])
    off = near @ outward
    if len(near) < 5:
        return axis, 0.0, math.inf
    basis = np.column_stack([along**2, along, np.ones(len(near))])
    coefficients = np.linalg.lstsq(basis, off, rcond=None)[0]
    tangent = axis + coefficients[1] * outward
    misfit = float(np.abs(basis @ coefficients - off).max())
    return tangent / np.linalg.norm(tangent), -2.0 * float(coefficients[0]), misfit


def _plain_step(pad: Pad, course: Course, stance: Stance) -> Attempt:
    """As far ahead as the new arc still joins the old one."""
    half_pad = 0.5 * pad.pitch * (min(pad.rows, pad.cols) - 1)
    bulge = max(course.curvature + pad.dome, 1.0)
    contact = math.sqrt(2.0 * stance.depth / bulge)
    way = min(PAD_STEP * half_pad, CONTACT_STEP * contact)
    return Attempt(way, course.curvature * way, STANDOFF)


def _ahead(path: Path, course: Course, attempt: Attempt) -> Floats:
    outward = np.array([course.tangent[1], -course.tangent[0]])
    bend = course.curvature if attempt.standoff == STANDOFF else 0.0
    place: Floats = path.points[-1, :2] + attempt.way * course.tangent
    return place - 0.5 * bend * attempt.way**2 * outward


def _new_points(path: Path, course: Course, felt: Felt, attempt: Attempt) -> Path | None:
    """The part of a felt arc that lies ahead of the path's end, if there is enough of it."""
    forward = course.tangent
    if abs(attempt.turn) > SHARP_TURN:
        towards = course.heading + attempt.turn
        forward = np.array([-math.sin(towards), math.cos(towards)])
    ahead = (felt.points[:, :2] - path.points[-1, :2]) @ forward
    new = ahead > AHEAD
    if not new.any() or ahead.max() <= PROGRESS:
        return None
    return Path(felt.points, felt.normals, felt.across).part(new)


def _gap(path: Path, stride: Stride) -> float:
    return float(np.linalg.norm(stride.new.points[0] - path.points[-1]))


def _fill_gap(path: Path, beyond: Stride, height: float) -> Routine[Stride]:
    """Probe once between the path's end and an arc that does not join it."""
    start = path.points[-1, :2]
    chord = beyond.new.points[0, :2] - start
    length = float(np.linalg.norm(chord))
    towards = math.atan2(-chord[0], chord[1])
    felt, _ = yield from seek(
        beyond.stance, start + 0.5 * chord, towards, GAP_STANDOFF, GAP_REACH, height
    )
    if felt is None:
        return beyond
    along = (felt.points[:, :2] - start) @ chord / length
    between = (along > AHEAD) & (along < length - AHEAD)
    filling = Path(felt.points, felt.normals, felt.across).part(between)
    return beyond._replace(new=filling.joined(beyond.new))
