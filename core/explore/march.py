"""Following a contour: one more arc ahead, around a corner, over a gap."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from palpate.core.explore.aim import Stance
from palpate.core.explore.course import Course
from palpate.core.explore.cut import Cut
from palpate.core.explore.felt import Felt
from palpate.core.explore.fill import fill
from palpate.core.explore.path import Gap, Path, path_of
from palpate.core.explore.routine import Routine
from palpate.core.explore.seek import Target, seek

AHEAD = 0.25 / 15.0
"""A new point must lie this far ahead of the last one; in widths of the pad."""
PROGRESS = 0.6 / 15.0
"""And the farthest of them this far; in widths of the pad."""
PAD_STEP, CONTACT_STEP = 0.69, 1.05
"""Longest step, in half widths of the pad and of the contact."""
KEPT_STEP = 0.5
"""How far a kept stance may step beyond half of the arc that it felt first, in the distance of
points that still join."""
LEAST_BULGE = 0.015
"""Of contour and pad together, in 1 / widths of the pad: nothing is flatter."""
STANDOFF = 0.2
"""Of a plain touch, in widths of the pad."""
SHARP_TURN = 0.2
"""Beyond this turn, progress is measured along the new heading, rad."""


class Stride(NamedTuple):
    """A found continuation of the path."""

    new: Path
    """Points ahead of the path's end."""
    heading: float
    """Azimuth of the outward normal with which they were touched, rad."""
    stance: Stance
    """How the pad was held."""
    gaps: tuple[Gap, ...] = ()
    """Stretches from the path's end on that could not be felt."""
    leapt: bool = False
    """True if the contour could not be followed but was met again from outside."""


class Attempt(NamedTuple):
    """One way to go on from the path's end; lengths in widths of the pad."""

    way: float
    """Distance ahead."""
    turn: float
    """Turn of the heading, rad."""
    standoff: float
    """Distance from which the pad starts."""


AROUND_A_CORNER = tuple(
    [Attempt(0.0, math.radians(turn), STANDOFF) for turn in (50, 25, 75, 100, -25, -50)]
    + [Attempt(4 / 15, 0.0, 8 / 15), Attempt(8 / 15, 0.0, 10 / 15)]
    + [Attempt(8 / 15, math.radians(30), 10 / 15), Attempt(12 / 15, 0.0, 12 / 15)]
)
"""Convex turns on the spot, concave ones, then hops ahead from farther away."""
OVER_A_GAP = (Attempt(0.0, math.radians(-25), STANDOFF),)
"""One turn on the spot, into the hollow that the pad may have bridged; more turns find less
than they cost, for the gap's middle is probed in any case."""


def extend(cut: Cut, path: Path, course: Course, stance: Stance) -> Routine[Stride | None]:
    """One more arc of the contour, or None if there is no way on.

    The plain step comes first. If it feels nothing ahead, the corner is marched around; if it
    feels an arc beyond a gap, other headings are tried, and last of all the gap is probed.
    """
    plain = _plain_step(cut, course, stance)
    attempts = deque([plain])
    beyond: Stride | None = None
    while attempts:
        attempt = attempts.popleft()
        felt, stance = yield from seek(cut, stance, _target(cut, path, course, attempt))
        new = None if felt is None else _new_points(cut, path, course, felt, attempt)
        if attempt is plain:
            attempts.extend(_after_plain(new, stance))
        if new is None:
            continue
        stride = Stride(new, course.heading + attempt.turn, stance)
        if beyond is None or _gap(path, stride) < _gap(path, beyond):
            beyond = stride
        if _gap(path, stride) <= cut.joined or attempt.standoff > STANDOFF:
            break
    return None if beyond is None else (yield from filled(cut, path, beyond))


def filled(cut: Cut, path: Path, stride: Stride) -> Routine[Stride]:
    """A stride of which every gap has been probed."""
    chain, gaps = yield from fill(cut, path.part(slice(-1, None)).joined(stride.new), stride.stance)
    return stride._replace(new=chain.part(slice(1, None)), gaps=gaps)


def _plain_step(cut: Cut, course: Course, stance: Stance) -> Attempt:
    """As far ahead as the new arc still joins the old one."""
    bulge = max(course.curvature + cut.pad.dome, LEAST_BULGE / cut.width)
    contact = math.sqrt(2.0 * stance.depth / bulge)
    way = min(
        PAD_STEP * 0.5 * cut.width,
        CONTACT_STEP * contact,
        stance.contact + KEPT_STEP * cut.joined,
    )
    return Attempt(way / cut.width, course.curvature * way, STANDOFF)


def _after_plain(new: Path | None, stance: Stance) -> tuple[Attempt, ...]:
    """What is tried after the plain step; a kept stance is not turned into a hollow."""
    if new is None:
        return AROUND_A_CORNER
    return () if stance.frozen else OVER_A_GAP


def _target(cut: Cut, path: Path, course: Course, attempt: Attempt) -> Target:
    outward = np.array([course.tangent[1], -course.tangent[0]])
    bend = course.curvature if attempt.standoff == STANDOFF else 0.0
    way = attempt.way * cut.width
    place = path.points[-1, :2] + way * course.tangent - 0.5 * bend * way**2 * outward
    standoff = attempt.standoff * cut.width
    return Target(place, course.heading + attempt.turn, standoff, standoff)


def _new_points(cut: Cut, path: Path, course: Course, felt: Felt, attempt: Attempt) -> Path | None:
    """The part of a felt arc that lies ahead of the path's end, if there is enough of it."""
    forward = course.tangent
    if abs(attempt.turn) > SHARP_TURN:
        towards = course.heading + attempt.turn
        forward = np.array([-math.sin(towards), math.cos(towards)])
    ahead = (felt.points[:, :2] - path.points[-1, :2]) @ forward
    new = ahead > AHEAD * cut.width
    if not new.any() or ahead.max() <= PROGRESS * cut.width:
        return None
    return path_of(felt).part(new)


def _gap(path: Path, stride: Stride) -> float:
    return float(np.linalg.norm(stride.new.points[0] - path.points[-1]))
