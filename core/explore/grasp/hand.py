"""A hand that closes: from where, and what its fingers touch.

It closes next where it expects to touch farthest from all contacts so far. The hand's own frame:
its z axis points away from the palm, into what is grasped; the fingers close towards the origin in
the plane across it, evenly spread, and the palm comes from behind. What is expected is an ellipsoid
about the contacts, on the platform. Before there are any, the hand goes over the platform from
above until it closes on something.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, positive
from palpate.core.poses import Pose, pad_rotation
from palpate.core.shapes import Shape
from palpate.core.touch import (
    DEFAULT_CONTACT,
    Pad,
    Pipeline,
    SimulatedTouch,
    StageStates,
    clean,
    fit_patch,
)

SEARCH_HEIGHTS = (0.04, 0.012)  # Over the platform, m: where the hand closes while nothing is found
THICKNESS = 0.04  # Of what is touched, while it has not been touched from all sides, m
FEW = 12  # Contacts below which it has not
SLENDEREST = 0.15  # No expected semi-axis is shorter than this share of the longest
LEANS = (0.0, math.radians(40.0), math.radians(75.0))  # Of the hand's axis from the vertical
AROUND = 8  # Directions from which a leaning hand comes
# Where the hand closes, in expected semi-axes, the shortest first.
SHIFTS = np.array(
    [[0, 0, 0], [0, 0, 0.75], [0, 0, -0.75], [0, 0, 0.4], [0, 0, -0.4], [0, 0.5, 0], [0, -0.5, 0]]
)
MOST_FINGERS = 20
FINGERTIP = 8e-3  # Half a fingertip's width, m: a finger stays this far above the platform
LEVEL = 1e-9  # Slope below which a finger does not go down
MARGIN = 0.02  # Distance from what is expected at which fingers begin to close slowly, m
GRASP_DEPTH = 1.0e-3  # Compression at which a finger stops, m
ACROSS: Floats = np.array([0.0, 1.0, 0.0])
ACROSS.setflags(write=False)


def search_pose(places: list[Floats], number: int, platform: float) -> Pose | None:
    """Pose of a hand that looks for the object from above; None when it looked everywhere.

    `places` (2,): where to look, m. `platform`: height of the platform, m.
    """
    place, height = divmod(number, len(SEARCH_HEIGHTS))
    if place >= len(places):
        return None
    x, y = places[place].tolist()
    return Pose(np.array([x, y, platform + SEARCH_HEIGHTS[height]]), _turns(5)[0])


def next_pose(hand: Hand, points: Floats, normals: Floats, platform: float) -> Pose:
    """Pose from which a hand is expected to touch where nothing was touched yet.

    `points`, `normals` (n, 3): contacts so far, at least one, m, and outward unit normals.
    `platform`: its height, m. Farthest-point sampling: of a fixed set of poses the one is taken
    whose expected contacts are together farthest from those that there are, and from each other.
    """
    middle, axes, size = expected_ellipsoid(points, normals, platform)
    middles = middle + (SHIFTS * size) @ axes.T
    middles[:, 2] = np.maximum(middles[:, 2], platform + FINGERTIP)
    turns = _turns(hand.fingers)
    hands = np.repeat(middles, len(turns), axis=0), np.tile(turns, (len(middles), 1, 1))
    touched, places = _expected_contacts(finger_paths(hand, *hands, platform), middle, axes, size)
    gain = _distances(places, points)
    for i in range(1, places.shape[1]):  # a finger beside another one tells little
        beside = np.linalg.norm(places[:, :i] - places[:, i : i + 1], axis=2)
        beside[~touched[:, :i]] = math.inf
        gain[:, i] = np.minimum(gain[:, i], beside.min(axis=1))
    best = int(np.where(touched, gain, 0.0).sum(axis=1).argmax())
    return Pose(hands[0][best], hands[1][best])


def brought_near(hand: Hand, pose: Pose, points: Floats, normals: Floats, platform: float) -> Hand:
    """The hand whose fingers are brought near what is expected before they close.

    Arguments as of `next_pose`. A finger that then is inside does not close, and counts as blocked.
    """
    if len(points) < FEW:
        return hand
    expected = expected_ellipsoid(points, normals, platform)
    place, axes = pose
    paths = finger_paths(hand, place[None], axes[None], platform)
    touched, places = _expected_contacts(paths, *expected)
    ways = np.linalg.norm(places - paths.starts, axis=2)
    # A finger that is expected to pass it stays as far away as that reaches.
    passing = hand.opening - np.linalg.norm(place - expected[0]) - expected[2].max()
    near = np.maximum(np.where(touched, ways, passing)[0] - MARGIN, 0.0)
    return replace(hand, advanced=tuple(near.tolist()))


def expected_ellipsoid(
    points: Floats, normals: Floats, platform: float
) -> tuple[Floats, Floats, Floats]:
    """Middle (3,), axes (3, 3) and semi-axes (3,) of the ellipsoid that contacts let expect, m."""
    if len(points) < FEW:  # as thick as it may well be behind each contact
        points = np.concatenate([points, points - THICKNESS * normals])
    foot = points[points[:, 2].argmin()].copy()
    foot[2] = platform
    points = np.maximum(np.concatenate([points, foot[None]]), [-math.inf, -math.inf, platform])
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    along = points @ axes
    low, high = along.min(axis=0), along.max(axis=0)
    size = 0.5 * (high - low)
    return axes @ (0.5 * (low + high)), axes, np.maximum(size, SLENDEREST * size.max())


@cache
def _turns(fingers: int) -> Floats:
    """Rotations (n, 3, 3) of a hand that points down or leans, each spun two ways."""
    turns = []
    for lean in LEANS:
        for azimuth in 2.0 * math.pi * np.arange(AROUND if lean else 1) / AROUND:
            for spin in (0.0, math.pi / fingers):
                turns.append(_turn(lean, float(azimuth), spin))
    return np.stack(turns)


def _turn(lean: float, azimuth: float, spin: float) -> Floats:
    """Rotation whose z axis comes from an azimuth, leaning from straight down."""
    c, s = math.cos(lean), math.sin(lean)
    leaning = np.array([[c, 0.0, -s], [0.0, -1.0, 0.0], [-s, 0.0, -c]])
    result: Floats = _about_z(azimuth) @ leaning @ _about_z(spin)
    return result


def _about_z(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _expected_contacts(
    paths: FingerPaths, middle: Floats, axes: Floats, size: Floats
) -> tuple[Bools, Floats]:
    """Which fingertips (h, f) meet the ellipsoid within reach, and where, (h, f, 3)."""
    start, way = (paths.starts - middle) @ axes / size, paths.along @ axes / size
    a, b, c = (np.einsum("hfi,hfi->hf", *two) for two in ((way, way), (start, way), (start, start)))
    root = b * b - a * (c - 1.0)
    distance = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    meets = (root > 0.0) & (distance > 0.0) & (distance < paths.reach)
    return meets, paths.starts + distance[..., None] * paths.along


def _distances(places: Floats, points: Floats) -> Floats:
    """Distance (c, f) of places (c, f, 3) from the nearest of points (n, 3)."""
    nearest = np.full(places.shape[:2], math.inf)
    for point in points:
        nearest = np.minimum(nearest, np.linalg.norm(places - point, axis=2))
    return nearest


@dataclass(frozen=True, slots=True, kw_only=True)
class Hand:
    """How many fingers a hand has, and how wide it opens.

    Raises ValueError unless it has 1 to 20 fingers, and the opening and the reach are positive.
    """

    fingers: int = 5  # Beside the palm
    opening: float = 0.12  # Distance of fingertips and palm from the middle of the open hand, m
    reach: float = 0.12  # Longest way of a fingertip, m
    # How far each fingertip, the palm last, is brought in before it closes, m; not at all if none.
    advanced: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.fingers <= MOST_FINGERS:
            raise ValueError(f"fingers must be from 1 to {MOST_FINGERS}, got {self.fingers}")
        positive("opening", self.opening, "m")
        positive("reach", self.reach, "m")
        if (count := len(self.advanced)) not in (0, self.fingers + 1):
            raise ValueError(f"advanced must have {self.fingers + 1} lengths or none, got {count}")
        for length in self.advanced:
            if not 0.0 <= length < self.reach:
                raise ValueError(f"advanced must be below the reach {self.reach} m, got {length} m")


class FingerPaths(NamedTuple):
    """Ways of the fingertips of hands, and how far they may go."""

    starts: Floats  # (hands, fingers + 1, 3), m; the palm is last
    along: Floats  # Unit directions, (hands, fingers + 1, 3)
    # (hands, fingers + 1), m: 0 where the platform is in the way, and the finger stays open.
    reach: Floats


def search_places(reach: float, spacing: float, most_rings: int | None = None) -> list[Floats]:
    """Places (2,) at which to look for the object, m: the axis, then rings around it.

    Neighbouring places are at most so far apart that nothing wider is missed within reach.
    """
    places = [np.zeros(2)]
    rings = int(reach / spacing)
    for ring in range(1, (rings if most_rings is None else min(rings, most_rings)) + 1):
        azimuths = 2 * math.pi * np.arange(6 * ring) / (6 * ring)
        away = ring * spacing
        places += [away * np.array([math.cos(a), math.sin(a)]) for a in azimuths]
    return places


class Grasp(NamedTuple):
    """What a closing hand touched."""

    points: Floats  # Contacts (n, 3), m
    normals: Floats  # Outward unit normals, (n, 3)
    fingers: tuple[int, ...]  # Which finger made each contact, from 0; the palm is the last
    missed: int  # Fingers that closed on nothing, or that could not say what they touched
    blocked: int  # Fingers that did not move, as the platform or the object was in their way
    advance: float  # Longest way that a fingertip went, m


class Closing(NamedTuple):
    """When a hand closes, and how often it has done so before."""

    number: int  # Counts the hand's closings from 0; chooses the random draws
    begun: float  # Robot time at which it begins to close, s
    previous: float  # Robot time at which it had opened before, s


def close_hand(
    shape: Shape,
    fingers: Sequence[Pipeline],
    remembered: Sequence[StageStates],
    hand: Hand,
    pose: Pose,
    platform: float,
    closing: Closing,
) -> tuple[Grasp, tuple[StageStates, ...]]:
    """Close every finger until it touches.

    `fingers`, `remembered`: fingertips with the scene's effects, the palm last, and what each
    remembers. `hand`, `pose`, `platform`: how wide it opens, where it is, and the platform's
    height, m. Returns the grasp, and what the fingertips remember next.
    """
    poses, reaches = fingertip_starts(hand, pose, platform)
    touches = [
        SimulatedTouch(
            shape=shape,
            number=closing.number,
            believed=start,
            actual=start,
            reach=reach,
            depth=GRASP_DEPTH,
            begun=closing.begun,
            previous=closing.previous,
        )
        if reach > 0.0
        else None
        for start, reach in zip(poses, reaches.tolist(), strict=True)
    ]
    following = [
        states if touch is None else pipeline.simulate(touch, states)
        for pipeline, states, touch in zip(fingers, remembered, touches, strict=True)
    ]
    return _together(fingers, touches), tuple(following)


def fingertip_starts(hand: Hand, pose: Pose, platform: float) -> tuple[list[Pose], Floats]:
    """Start poses, and ways (n,) [m], of an open hand's fingertips, the palm last."""
    place, axes = pose
    paths = finger_paths(hand, place[None], axes[None], platform)
    turns = _in_hand(hand.fingers)[1]
    poses = [Pose(at, axes @ turn) for at, turn in zip(paths.starts[0], turns, strict=True)]
    return poses, paths.reach[0]


def finger_paths(hand: Hand, places: Floats, axes: Floats, platform: float) -> FingerPaths:
    """Ways of the fingertips of open hands."""
    tips, turns = _in_hand(hand.fingers)
    advanced = np.array(hand.advanced or [0.0] * len(tips))
    tips = (hand.opening - advanced)[:, None] * tips
    starts = places[:, None] + np.einsum("hij,fj->hfi", axes, tips)
    along = np.einsum("hij,fj->hfi", axes, turns[:, :, 2])
    down = along[:, :, 2]
    room = starts[:, :, 2] - platform - FINGERTIP * np.sqrt(np.maximum(1.0 - down**2, 0.0))
    reach = np.where(down < -LEVEL, room / np.maximum(-down, LEVEL), math.inf)
    ways = np.where(room > 0.0, np.clip(reach, 0.0, hand.reach - advanced), 0.0)
    return FingerPaths(starts, along, ways)


@cache
def _in_hand(fingers: int) -> tuple[Floats, Floats]:
    """Fingertips, the palm last, in the hand: places (n, 3) over the opening, and turns."""
    around = 2.0 * math.pi * np.arange(fingers) / fingers
    places = np.column_stack([np.cos(around), np.sin(around), np.zeros(fingers)])
    turns = [pad_rotation(turn, 0.0) for turn in around.tolist()]
    return np.vstack([places, [[0.0, 0.0, -1.0]]]), np.stack([*turns, np.eye(3)])


def _together(fingers: Sequence[Pipeline], touches: Sequence[SimulatedTouch | None]) -> Grasp:
    contacts, which, missed, blocked, advance = [], [], 0, 0, 0.0
    for i, (pipeline, touch) in enumerate(zip(fingers, touches, strict=True)):
        if touch is None or touch.outcome == "inside":
            blocked += 1
            continue
        advance = max(advance, touch.advance)
        found = None
        if touch.outcome != "miss":
            found = contact_of(pipeline.finger.pad, touch.believed, touch.reading, pipeline.noise)
        if found is None:
            missed += 1
            continue
        contacts.append(found)
        which.append(i)
    points = np.array([point for point, _ in contacts]).reshape(-1, 3)
    normals = np.array([normal for _, normal in contacts]).reshape(-1, 3)
    return Grasp(points, normals, tuple(which), missed, blocked, advance)


def contact_of(
    pad: Pad, pose: Pose, compression: Floats, noise: float
) -> tuple[Floats, Floats] | None:
    """What a pressed fingertip tells of the surface, in the frame in which its pose is given.

    The deepest point, with the normal of the surface about it; None if nothing is touched.
    """
    cleaned = clean(pad, compression, noise, DEFAULT_CONTACT.min_compression, "auto")
    if not cleaned.touched.any():
        return None
    surface = pad.surface(cleaned.compression, cleaned.touched)
    patch = fit_patch(pad, surface, cleaned.touched, ACROSS, noise)
    position, axes = pose
    if patch.jet is not None and patch.kind == "smooth":
        return axes @ patch.place + position, axes @ patch.normal
    taxel = int(np.where(cleaned.touched, cleaned.compression, -1.0).argmax())
    return axes @ pad.surface_point(surface, taxel) + position, axes @ patch.normal
