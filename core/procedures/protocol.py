"""What an exploratory procedure asks for, what it is told, and what it finds.

A procedure is a generator. It yields what the fingers or the hand shall do, is sent what they met,
and returns its findings: the loop of Lederman and Klatzky's *exploratory procedures*, as Allen
turned them into robot motions (Fung, 1999, 1.4.3.2), reads as it is printed. It sees nothing but
what it is sent, so that the same results in the same order give the same findings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.grasp import Hand, search_places
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.poses import Pose, axes_along
from palpate.core.shapes import Mesh
from palpate.core.touch import HITS, Pad, PatchKind, TouchOutcome

# Standard deviations of where a finger believes to be, along each axis, m, and how turned, rad.
POINT_ERROR, ANGLE_ERROR = 0.1e-3, math.radians(0.1)
UNSUITED = 3.0  # Standard deviations: what is farther off than that is another kind of object
WORST = 5.0  # The same of the worst touch, of some hundred
STANDOFF = 15.0e-3  # From where a surface is approached that has been touched, m
BACK_OFF, MOST_BACK = 25.0e-3, 2  # A move that began inside is begun so much farther off, m
CLEARANCE = 8.0e-3  # Half a fingertip: it stays this far above the platform, m
ABOVE = 1.0e-3  # So near to the platform a finger comes from above, m
SEARCH_SPACING = 12.0e-3  # Of the places at which an object is looked for, m


@dataclass(frozen=True, slots=True)
class TouchSetting:
    """What a procedure knows before it touches anything."""

    pad: Pad  # Of every finger
    noise: float  # Standard deviation of one taxel, m
    platform: float  # Height on which the object stands, m
    reach: float  # The fingers reach so far sideways from the axis and up from the platform, m
    fingers: int = 1  # How many there are
    point_error: float = POINT_ERROR  # Standard deviation of a finger's place along each axis, m
    angle_error: float = ANGLE_ERROR  # The same of how it is turned, rad

    @property
    def sigma(self) -> float:
        """Standard deviation of one touched point across the surface, m."""
        return math.hypot(self.noise, self.point_error)

    @property
    def width(self) -> float:
        """Of the pad, m."""
        return self.pad.pitch * max(self.pad.rows, self.pad.cols)


class FingerMove(NamedTuple):
    """A guarded move of one finger along its pad's z axis."""

    pose: Pose  # Where it starts
    reach: float  # Longest way to first contact, m
    depth: float = TOUCH_DEPTH  # Compression at which it ends, m


class HandMove(NamedTuple):
    """A closing of the hand."""

    hand: Hand
    pose: Pose  # Of the hand


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """What a guarded move met: the filter's and the curvature estimator's verdict, world frame."""

    outcome: TouchOutcome
    pose: Pose  # Of the pad at the end
    points: Floats  # Surface under the touched taxels, (n, 3), m
    kind: PatchKind
    normal: Floats  # Outward unit normal at the middle of the contact, (3,)
    normal_error: float  # Its standard deviation, rad
    curvatures: tuple[float, float]  # Principal curvatures k1 >= k2, 1/m; 0 unless it is smooth
    curvature_errors: tuple[float, float]  # Their standard deviations, 1/m
    direction: Floats  # Unit tangent of k1, (3,); 0 unless it is smooth
    hollow: Floats  # Places on the pad's face that nothing touched, between others, (k, 3), m
    robot_time: float  # At the end of the touch, s

    @property
    def met(self) -> bool:
        """Whether it tells where the surface is."""
        return self.outcome in HITS and len(self.points) > 0

    @property
    def middle(self) -> Floats:
        """The touched point (3,) nearest to the middle of those that are touched, m."""
        off = self.points - self.points.mean(axis=0)
        return np.asarray(self.points[int(np.einsum("ni,ni->n", off, off).argmin())])


class HandContacts(NamedTuple):
    """What a closing hand met."""

    points: Floats  # (n, 3), m
    normals: Floats  # Outward unit normals, (n, 3)
    fingers: Ints  # Which finger made each contact, from 0, (n,); the palm is the last
    robot_time: float  # When it had opened again, s


Move = tuple[FingerMove, ...] | HandMove  # Fingers move at once, the first is finger 1
Met = tuple[Contact, ...] | HandContacts
Status = Literal["done", "unsuited", "incomplete"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Findings:
    """What a procedure came to. What it could not serve has no shape and no mesh."""

    status: Status
    reason: str  # Why it is over, in a sentence
    shape: Any = None  # The recovered value, of the procedure's own type
    mesh: Mesh | None = None  # Its closed surface, world frame, m
    figures: Mapping[str, float] = field(default_factory=dict)  # With the unit in the name


Exploration = Generator[Move, Met, Findings]
# ``procedure(setting, **settings)`` begins an exploration.
Procedure = Callable[..., Exploration]
Touching = Generator[Move, Met, Contact]


def touch(setting: TouchSetting, move: FingerMove) -> Touching:
    """One guarded move of finger 1, begun anew from farther off if it began inside the object."""
    for _ in range(MOST_BACK + 1):
        (met,) = yield from touch_pair((move,))
        if met.outcome != "inside":
            break
        back = move.pose.advanced(-BACK_OFF)
        farther = kept_clear(setting, FingerMove(back, move.reach + BACK_OFF, move.depth))
        if farther is None:
            break
        move = farther
    return met


def touch_pair(moves: tuple[FingerMove, ...]) -> Generator[Move, Met, tuple[Contact, ...]]:
    """Guarded moves of as many fingers at once."""
    met = yield moves
    assert len(met) == len(moves) and all(isinstance(one, Contact) for one in met)
    return tuple(one for one in met if isinstance(one, Contact))


def close(move: HandMove) -> Generator[Move, Met, HandContacts]:
    """One closing of the hand."""
    met = yield move
    assert isinstance(met, HandContacts)
    return met


def approach(place: Floats, outward: Floats, standoff: float, beyond: float) -> FingerMove:
    """The move towards a place (3,) of the surface, against its outward unit normal (3,).

    It starts `standoff` before the place and may go on `beyond` it, m.
    """
    start = place + standoff * outward
    return FingerMove(Pose(start, axes_along(-outward)), standoff + beyond)


def kept_clear(setting: TouchSetting, move: FingerMove) -> FingerMove | None:
    """The move, shortened so that the finger stays above the platform; None if it cannot."""
    axis = move.pose.axes[:, 2]
    room = (
        move.pose.position[2]
        - setting.platform
        - CLEARANCE * math.sqrt(max(1.0 - axis[2] ** 2, 0.0))
    )
    if room < -1e-9 * setting.reach:
        return None
    if axis[2] >= -1e-9:
        return move
    reach = min(move.reach, room / -float(axis[2]))
    return move._replace(reach=reach) if reach > 0.0 else None


UP: Floats = np.array([0.0, 0.0, 1.0])
UP.setflags(write=False)


def touch_from_above(setting: TouchSetting) -> Generator[Move, Met, Contact | None]:
    """Look for the object from above, on rings about the axis; None if nothing is within reach."""
    top = setting.platform + setting.reach
    for x, y in search_places(setting.reach, SEARCH_SPACING):
        move = approach(np.array([x, y, top]), UP, 0.0, setting.reach - ABOVE)
        contact = yield from touch(setting, move)
        if contact.met:
            return contact
    return None


def square_on(setting: TouchSetting, contact: Contact, turns: int = 3) -> Touching:
    """The contact, touched again along its own normal until the pad stands square to it."""
    for _ in range(turns):
        outward = -contact.pose.axes[:, 2]
        normal = contact.normal if contact.kind == "smooth" else _plane_normal(contact, outward)
        if contact.kind == "smooth" and normal @ outward > math.cos(math.radians(3.0)):
            break
        move = kept_clear(setting, approach(contact.middle, normal, STANDOFF, 5.0e-3))
        if move is None:
            break
        again = yield from touch(setting, move)
        if not again.met:
            break
        contact = again
    return contact


def _plane_normal(contact: Contact, outward: Floats) -> Floats:
    """Normal (3,) of the plane through what was touched; `outward` where that is but a line."""
    centred = contact.points - contact.points.mean(axis=0)
    if len(centred) < 6:
        return outward
    spread, axes = np.linalg.eigh(centred.T @ centred)
    if spread[1] < 1e-2 * spread[2]:
        return outward
    normal = axes[:, 0]
    return np.asarray(normal if normal @ outward > 0.0 else -normal)


class Session:
    """A procedure under way, which gives the next move after any results it is told of.

    Results that go on where the last ones ended are sent to the generator that waits for them; for
    any others it begins anew. So the next move is a function of the results alone.
    """

    def __init__(self, begin: Callable[[], Exploration]) -> None:
        self._begin = begin
        self._running: Exploration | None = None
        self._sent: tuple[Met, ...] = ()

    def after(self, results: tuple[Met, ...]) -> Move | Findings:
        """The next move after these results, or the findings."""
        pairs = zip(results, self._sent, strict=False)
        going_on = self._running is not None and len(results) == len(self._sent) + 1
        if not going_on or not all(one is other for one, other in pairs):
            self._running, self._sent = self._begin(), ()
            step = self._step(None)
            for number in range(len(results)):
                step = self._step(results[number])
        else:
            step = self._step(results[-1])
        self._sent = results
        return step

    def _step(self, met: Met | None) -> Move | Findings:
        assert self._running is not None
        try:
            return next(self._running) if met is None else self._running.send(met)
        except StopIteration as end:
            self._running = None
            found: Findings = end.value
            return found
