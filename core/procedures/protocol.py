"""What an exploratory procedure requests, what it receives, and what it returns.

A procedure is a generator: it yields moves of the fingers or the hand, is sent their results, and
returns its findings. So Lederman and Klatzky's *exploratory procedures*, as Allen turned them into
robot motions (Fung, 1999, 1.4.3.2), read as they are printed. The results are a procedure's only
input: the same results in the same order give the same findings.
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

UP: Floats = np.array([0.0, 0.0, 1.0])
UP.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonSettings:
    """What all procedures share: how fingers approach, and when a model is refused."""

    max_rms: float = 3.0  # [standard deviations] of a model's residuals; beyond it: unsuited
    max_touch_error: float = 5.0  # [standard deviations] of the worst touch among a few hundred
    standoff: float = 15.0e-3  # [m] from a touched surface, where the next approach begins
    back_off: float = 25.0e-3  # [m] by which a move that began inside is repeated from farther off
    max_back_offs: int = 2  # of such a move
    fingertip_radius: float = 8.0e-3  # [m] a level finger's axis stays this far above the platform
    min_height: float = 1.0e-3  # [m] above the platform, where a search from above ends
    search_spacing: float = 12.0e-3  # [m] between the places of a search


@dataclass(frozen=True, slots=True)
class TouchSetup:
    """What a procedure knows before it touches anything."""

    pad: Pad  # of every finger
    noise: float  # [m] standard deviation of one taxel
    platform: float  # [m] height on which the object stands
    reach: float  # [m] of the fingers, sideways from the axis and up from the platform
    fingers: int = 1  # number of fingers
    point_error: float = 0.1e-3  # [m] standard deviation of a finger's position along each axis
    angle_error: float = math.radians(0.1)  # [rad] standard deviation of a finger's orientation
    common: CommonSettings = CommonSettings()

    @property
    def sigma(self) -> float:
        """Standard deviation of one touched point along the surface's normal [m]."""
        return math.hypot(self.noise, self.point_error)

    @property
    def width(self) -> float:
        """Width of the pad [m]."""
        return self.pad.pitch * max(self.pad.rows, self.pad.cols)


class FingerMove(NamedTuple):
    """A guarded move of one finger along its pad's z axis."""

    pose: Pose  # at the start
    reach: float  # [m] longest path to the first contact
    depth: float = TOUCH_DEPTH  # [m] compression at which the move ends


class HandMove(NamedTuple):
    """A closing of the hand."""

    hand: Hand
    pose: Pose  # of the hand


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """Result of a guarded move, from the filter and the curvature estimator, in the world frame."""

    outcome: TouchOutcome
    pose: Pose  # of the pad at the end
    points: Floats  # surface under the touched taxels, (n, 3) [m]
    kind: PatchKind
    normal: Floats  # outward unit normal at the middle of the contact, (3,)
    normal_error: float  # [rad] its standard deviation
    curvatures: tuple[float, float]  # [1/m] principal, k1 >= k2; 0 unless `kind` is smooth
    curvature_errors: tuple[float, float]  # [1/m] their standard deviations
    direction: Floats  # unit tangent of k1, (3,); 0 unless `kind` is smooth
    hollow: Floats  # untouched places on the pad's face between touched ones, (k, 3) [m]
    robot_time: float  # [s] at the end of the touch

    @property
    def is_hit(self) -> bool:
        """Whether the surface was touched."""
        return self.outcome in HITS and len(self.points) > 0

    @property
    def middle(self) -> Floats:
        """The touched point (3,) nearest to the mean of all touched points [m]."""
        offsets = self.points - self.points.mean(axis=0)
        return np.asarray(self.points[int(np.einsum("ni,ni->n", offsets, offsets).argmin())])


class HandContacts(NamedTuple):
    """Contacts of a closing hand."""

    points: Floats  # (n, 3) [m]
    normals: Floats  # outward unit normals, (n, 3)
    fingers: Ints  # finger of each contact, counted from 0, (n,); the palm is the last
    robot_time: float  # [s] when the hand has opened again


Move = tuple[FingerMove, ...] | HandMove  # fingers move at once; the first is finger 1
MoveResult = tuple[Contact, ...] | HandContacts
Status = Literal["done", "unsuited", "incomplete"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Findings:
    """Result of a procedure; unless it is done, it has no shape and no mesh."""

    status: Status
    reason: str  # why the procedure ended, in a sentence
    shape: Any = None  # the recovered model, of the procedure's own type
    mesh: Mesh | None = None  # its closed surface in the world frame [m]
    figures: Mapping[str, float] = field(default_factory=dict)  # with the unit in the name


Exploration = Generator[Move, MoveResult, Findings]
# ``procedure(setup, **settings)`` begins an exploration.
Procedure = Callable[..., Exploration]
Touching = Generator[Move, MoveResult, Contact]


def touch(setup: TouchSetup, move: FingerMove) -> Touching:
    """One guarded move of finger 1, repeated from farther off if it began inside the object."""
    back_off = setup.common.back_off
    for _ in range(setup.common.max_back_offs + 1):
        (contact,) = yield from touch_pair((move,))
        if contact.outcome != "inside":
            break
        pose = move.pose.advanced(-back_off)
        farther = clear_of_platform(setup, FingerMove(pose, move.reach + back_off, move.depth))
        if farther is None:
            break
        move = farther
    return contact


def touch_pair(moves: tuple[FingerMove, ...]) -> Generator[Move, MoveResult, tuple[Contact, ...]]:
    """Simultaneous guarded moves, one for each finger."""
    result = yield moves
    assert len(result) == len(moves) and all(isinstance(item, Contact) for item in result)
    return tuple(item for item in result if isinstance(item, Contact))


def close(move: HandMove) -> Generator[Move, MoveResult, HandContacts]:
    """One closing of the hand."""
    result = yield move
    assert isinstance(result, HandContacts)
    return result


def approach(place: Floats, outward: Floats, standoff: float, overshoot: float) -> FingerMove:
    """The move towards a place (3,) of the surface, against its outward unit normal (3,).

    It starts `standoff` [m] before the place and ends at most `overshoot` [m] behind it.
    """
    start = place + standoff * outward
    return FingerMove(Pose(start, axes_along(-outward)), standoff + overshoot)


def clear_of_platform(setup: TouchSetup, move: FingerMove) -> FingerMove | None:
    """The move, shortened to stay above the platform; None if it begins below."""
    axis = move.pose.axes[:, 2]
    radius = setup.common.fingertip_radius * math.sqrt(max(1.0 - axis[2] ** 2, 0.0))
    room = move.pose.position[2] - setup.platform - radius
    if room < -1e-9 * setup.reach:
        return None
    if axis[2] >= -1e-9:
        return move
    reach = min(move.reach, room / -float(axis[2]))
    return move._replace(reach=reach) if reach > 0.0 else None


def touch_from_above(setup: TouchSetup) -> Generator[Move, MoveResult, Contact | None]:
    """Search for the object from above, on rings about the axis; None if nothing is in reach."""
    top = setup.platform + setup.reach
    depth = setup.reach - setup.common.min_height
    for x, y in search_places(setup.reach, setup.common.search_spacing):
        contact = yield from touch(setup, approach(np.array([x, y, top]), UP, 0.0, depth))
        if contact.is_hit:
            return contact
    return None


def touch_squarely(
    setup: TouchSetup,
    contact: Contact,
    max_repeats: int = 3,
    max_tilt: float = math.radians(3.0),
    overshoot: float = 5.0e-3,
) -> Touching:
    """Repeat a touch along the surface's normal until the pad is square to it.

    Square is within `max_tilt` [rad]; `overshoot` [m] is how far a repeat may pass the place.
    """
    for _ in range(max_repeats):
        outward = -contact.pose.axes[:, 2]
        normal = contact.normal if contact.kind == "smooth" else _plane_normal(contact, outward)
        if contact.kind == "smooth" and normal @ outward > math.cos(max_tilt):
            break
        target = approach(contact.middle, normal, setup.common.standoff, overshoot)
        move = clear_of_platform(setup, target)
        if move is None:
            break
        repeated = yield from touch(setup, move)
        if not repeated.is_hit:
            break
        contact = repeated
    return contact


def _plane_normal(
    contact: Contact, outward: Floats, min_points: int = 6, min_spread: float = 1e-2
) -> Floats:
    """Normal (3,) of the plane through the touched points; `outward` if they lie on a line.

    `min_spread`: least ratio of the points' second to their first principal variance.
    """
    centred = contact.points - contact.points.mean(axis=0)
    if len(centred) < min_points:
        return outward
    spread, axes = np.linalg.eigh(centred.T @ centred)
    if spread[1] < min_spread * spread[2]:
        return outward
    normal = axes[:, 0]
    return np.asarray(normal if normal @ outward > 0.0 else -normal)


class Session:
    """A running procedure, which gives the next move after any sequence of results.

    Results that extend the last ones by one are sent to the running generator; for any other
    results it restarts. So the next move is a function of the results alone.
    """

    def __init__(self, begin: Callable[[], Exploration]) -> None:
        self._begin = begin
        self._running: Exploration | None = None
        self._sent: tuple[MoveResult, ...] = ()

    def after(self, results: tuple[MoveResult, ...]) -> Move | Findings:
        """The next move after these results, or the findings."""
        pairs = zip(results, self._sent, strict=False)
        extends = self._running is not None and len(results) == len(self._sent) + 1
        if extends and all(result is sent for result, sent in pairs):
            step = self._step(results[-1])
        else:
            self._running, self._sent = self._begin(), ()
            step = self._step(None)
            for result in results:
                step = self._step(result)
        self._sent = results
        return step

    def _step(self, result: MoveResult | None) -> Move | Findings:
        assert self._running is not None
        try:
            return next(self._running) if result is None else self._running.send(result)
        except StopIteration as end:
            self._running = None
            findings: Findings = end.value
            return findings
