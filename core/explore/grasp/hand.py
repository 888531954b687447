"""A hand that closes: from where, and what its fingers touch.

It closes next where it expects to touch farthest from all contacts so far. The hand's own frame:
its z axis points away from the palm, into what is grasped; the fingers close towards the origin in
the plane across it, evenly spread, and the palm comes from behind. The expected object is an
ellipsoid about the contacts that stands on the platform. Before there are any contacts, the hand
looks over the platform from above until it closes on something.
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

MAX_FINGERS = 20
MIN_DESCENT = 1e-9  # [1] slope below which a finger does not go down


@dataclass(frozen=True, slots=True, kw_only=True)
class HandSettings:
    """From where a hand closes, and what it expects to touch."""

    search_heights: tuple[float, ...] = (0.04, 0.012)  # [m] over the platform, before any contact
    # With fewer contacts the object has not been touched from all sides: a point is added behind
    # each contact, at this thickness.
    min_contacts: int = 12
    thickness: float = 0.04  # [m]
    min_axis_ratio: float = 0.15  # of the expected ellipsoid's shortest to its longest semi-axis
    leans: tuple[float, ...] = (0.0, math.radians(40.0), math.radians(75.0))  # [rad] of the hand
    n_azimuths: int = 8  # from which a leaning hand comes
    # [expected semi-axes, the shortest first] of the hand's middle from the ellipsoid's.
    shifts: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.75),
        (0.0, 0.0, -0.75),
        (0.0, 0.0, 0.4),
        (0.0, 0.0, -0.4),
        (0.0, 0.5, 0.0),
        (0.0, -0.5, 0.0),
    )
    margin: float = 0.02  # [m] before the expected surface, up to which fingers are brought in


def search_pose(
    places: list[Floats], number: int, platform: float, settings: HandSettings = HandSettings()
) -> Pose | None:
    """Pose number `number` of a hand that looks for the object from above; None after the last.

    `places` (2,): where to look [m]. `platform`: height of the platform [m].
    """
    place, height = divmod(number, len(settings.search_heights))
    if place >= len(places):
        return None
    x, y = places[place].tolist()
    return Pose(np.array([x, y, platform + settings.search_heights[height]]), _turn(0.0, 0.0, 0.0))


def next_pose(
    hand: Hand,
    points: Floats,
    normals: Floats,
    platform: float,
    settings: HandSettings = HandSettings(),
) -> Pose:
    """Pose from which a hand is expected to touch where nothing was touched yet.

    `points`, `normals` (n, 3): contacts so far, at least one [m], and outward unit normals.
    `platform`: its height [m]. Farthest-point sampling: of a fixed set of poses the one is taken
    whose expected contacts have the largest sum of distances from the nearest contact, be it one
    of the past or of another finger.
    """
    middle, axes, size = expected_ellipsoid(points, normals, platform, settings)
    middles = middle + (np.array(settings.shifts) * size) @ axes.T
    middles[:, 2] = np.maximum(middles[:, 2], platform + hand.fingertip)
    turns = _turns(hand.fingers, settings.leans, settings.n_azimuths)
    hands = np.repeat(middles, len(turns), axis=0), np.tile(turns, (len(middles), 1, 1))
    touched, places = _expected_contacts(finger_paths(hand, *hands, platform), middle, axes, size)
    gain = _distances(places, points)
    for i in range(1, places.shape[1]):  # a finger beside another one adds little
        beside = np.linalg.norm(places[:, :i] - places[:, i : i + 1], axis=2)
        beside[~touched[:, :i]] = math.inf
        gain[:, i] = np.minimum(gain[:, i], beside.min(axis=1))
    best = int(np.where(touched, gain, 0.0).sum(axis=1).argmax())
    return Pose(hands[0][best], hands[1][best])


def brought_near(
    hand: Hand,
    pose: Pose,
    points: Floats,
    normals: Floats,
    platform: float,
    settings: HandSettings = HandSettings(),
) -> Hand:
    """The hand whose fingers are brought near the expected surface before they close.

    Arguments as of `next_pose`. A finger that then is inside does not close, and counts as blocked.
    """
    if len(points) < settings.min_contacts:
        return hand
    expected = expected_ellipsoid(points, normals, platform, settings)
    place, axes = pose
    paths = finger_paths(hand, place[None], axes[None], platform)
    touched, places = _expected_contacts(paths, *expected)
    distances = np.linalg.norm(places - paths.starts, axis=2)
    # A finger that is expected to pass the ellipsoid stays outside its longest semi-axis.
    passing = hand.opening - np.linalg.norm(place - expected[0]) - expected[2].max()
    near = np.maximum(np.where(touched, distances, passing)[0] - settings.margin, 0.0)
    return replace(hand, advanced=tuple(near.tolist()))


def expected_ellipsoid(
    points: Floats, normals: Floats, platform: float, settings: HandSettings = HandSettings()
) -> tuple[Floats, Floats, Floats]:
    """Middle (3,), axes (3, 3) and semi-axes (3,) of an ellipsoid about contacts [m].

    It stands on the platform. Arguments as of `next_pose`.
    """
    if len(points) < settings.min_contacts:
        points = np.concatenate([points, points - settings.thickness * normals])
    foot = points[points[:, 2].argmin()].copy()
    foot[2] = platform
    points = np.maximum(np.concatenate([points, foot[None]]), [-math.inf, -math.inf, platform])
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    along = points @ axes
    low, high = along.min(axis=0), along.max(axis=0)
    size = 0.5 * (high - low)
    middle = axes @ (0.5 * (low + high))
    return middle, axes, np.maximum(size, settings.min_axis_ratio * size.max())


@cache
def _turns(fingers: int, leans: tuple[float, ...], n_azimuths: int) -> Floats:
    """Rotations (n, 3, 3) of a hand that points down or leans, each with two spins."""
    turns = []
    for lean in leans:
        for azimuth in 2.0 * math.pi * np.arange(n_azimuths if lean else 1) / n_azimuths:
            for spin in (0.0, math.pi / fingers):
                turns.append(_turn(lean, float(azimuth), spin))
    return np.stack(turns)


def _turn(lean: float, azimuth: float, spin: float) -> Floats:
    """Rotation (3, 3) whose z axis comes from an azimuth and leans from straight down [rad]."""
    c, s = math.cos(lean), math.sin(lean)
    leaning = np.array([[c, 0.0, -s], [0.0, -1.0, 0.0], [-s, 0.0, -c]])
    result: Floats = _about_z(azimuth) @ leaning @ _about_z(spin)
    return result


def _about_z(angle: float) -> Floats:
    """Rotation (3, 3) about z [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _expected_contacts(
    paths: FingerPaths, middle: Floats, axes: Floats, size: Floats
) -> tuple[Bools, Floats]:
    """Which fingertips (h, f) meet the ellipsoid within reach, and where, (h, f, 3)."""
    start, step = (paths.starts - middle) @ axes / size, paths.along @ axes / size
    pairs = (step, step), (start, step), (start, start)
    a, b, c = (np.einsum("hfi,hfi->hf", *pair) for pair in pairs)
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
    """A hand: its fingers, and how wide it opens.

    Raises ValueError unless it has 1 to 20 fingers, and the opening and the reach are positive.
    """

    fingers: int = 5  # besides the palm
    opening: float = 0.12  # [m] from the middle of the open hand to fingertips and palm
    reach: float = 0.12  # [m] longest distance that a fingertip moves
    # [m] by which each fingertip, the palm last, is brought in before it closes; empty: none is.
    advanced: tuple[float, ...] = ()
    fingertip: float = 8e-3  # [m] half a fingertip's width: its distance from the platform
    depth: float = 1.0e-3  # [m] compression at which a finger stops

    def __post_init__(self) -> None:
        if not 1 <= self.fingers <= MAX_FINGERS:
            raise ValueError(f"fingers must be from 1 to {MAX_FINGERS}, got {self.fingers}")
        positive("opening", self.opening, "m")
        positive("reach", self.reach, "m")
        if (count := len(self.advanced)) not in (0, self.fingers + 1):
            raise ValueError(f"advanced must have {self.fingers + 1} lengths or none, got {count}")
        for length in self.advanced:
            if not 0.0 <= length < self.reach:
                raise ValueError(f"advanced must be below the reach {self.reach} m, got {length} m")


class FingerPaths(NamedTuple):
    """Straight paths of the fingertips of hands."""

    starts: Floats  # (hands, fingers + 1, 3) [m] the palm is last
    along: Floats  # (hands, fingers + 1, 3) unit directions
    # (hands, fingers + 1) [m] how far they may go; 0 where the platform is in the way, and the
    # finger stays open.
    reach: Floats


def search_places(reach: float, spacing: float, max_rings: int | None = None) -> list[Floats]:
    """Places (2,) at which to look for the object [m]: the axis, then rings around it.

    Neighbouring places are at most `spacing` [m] apart, so that nothing wider is missed within
    `reach` [m].
    """
    places = [np.zeros(2)]
    n_rings = int(reach / spacing)
    for ring in range(1, (n_rings if max_rings is None else min(n_rings, max_rings)) + 1):
        azimuths = 2 * math.pi * np.arange(6 * ring) / (6 * ring)
        radius = ring * spacing
        places += [radius * np.array([math.cos(a), math.sin(a)]) for a in azimuths]
    return places


class Grasp(NamedTuple):
    """What a closing hand touched."""

    points: Floats  # (n, 3) [m] contacts
    normals: Floats  # (n, 3) outward unit normals
    fingers: tuple[int, ...]  # which finger made each contact, from 0; the palm is the last
    missed: int  # fingers that closed on nothing, or whose touch showed no surface
    blocked: int  # fingers that did not move: the platform or the object was in the way
    advance: float  # [m] longest distance that a fingertip moved


class Closing(NamedTuple):
    """When a hand closes, and how often it has done so before."""

    number: int  # of the hand's closings, from 0; chooses the random draws
    begun: float  # [s] robot time at which it begins to close
    previous: float  # [s] robot time at which it had opened before


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

    `fingers`, `remembered`: fingertips with the scene's effects, the palm last, and the state of
    each. `hand`, `pose`, `platform`: the open hand, where it is, and the platform's height [m].
    Returns the grasp, and the fingertips' next states.
    """
    poses, reaches = fingertip_starts(hand, pose, platform)
    touches = [
        SimulatedTouch(
            shape=shape,
            number=closing.number,
            believed=start,
            actual=start,
            reach=reach,
            depth=hand.depth,
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
    return _grasp_of(fingers, touches), tuple(following)


def fingertip_starts(hand: Hand, pose: Pose, platform: float) -> tuple[list[Pose], Floats]:
    """Start poses and reaches (n,) [m] of an open hand's fingertips, the palm last."""
    place, axes = pose
    paths = finger_paths(hand, place[None], axes[None], platform)
    turns = _in_hand(hand.fingers)[1]
    poses = [Pose(at, axes @ turn) for at, turn in zip(paths.starts[0], turns, strict=True)]
    return poses, paths.reach[0]


def finger_paths(hand: Hand, places: Floats, axes: Floats, platform: float) -> FingerPaths:
    """Paths of the fingertips of open hands at places (n, 3) [m] with axes (n, 3, 3)."""
    tips, turns = _in_hand(hand.fingers)
    advanced = np.array(hand.advanced or [0.0] * len(tips))
    tips = (hand.opening - advanced)[:, None] * tips
    starts = places[:, None] + np.einsum("hij,fj->hfi", axes, tips)
    along = np.einsum("hij,fj->hfi", axes, turns[:, :, 2])
    down = along[:, :, 2]
    tilted_width = hand.fingertip * np.sqrt(np.maximum(1.0 - down**2, 0.0))
    height = starts[:, :, 2] - platform - tilted_width
    reach = np.where(down < -MIN_DESCENT, height / np.maximum(-down, MIN_DESCENT), math.inf)
    reach = np.where(height > 0.0, np.clip(reach, 0.0, hand.reach - advanced), 0.0)
    return FingerPaths(starts, along, reach)


@cache
def _in_hand(fingers: int) -> tuple[Floats, Floats]:
    """Fingertips, the palm last, in the hand: places (n, 3) over the opening, and rotations."""
    azimuths = 2.0 * math.pi * np.arange(fingers) / fingers
    places = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(fingers)])
    turns = [pad_rotation(azimuth, 0.0) for azimuth in azimuths.tolist()]
    return np.vstack([places, [[0.0, 0.0, -1.0]]]), np.stack([*turns, np.eye(3)])


def _grasp_of(fingers: Sequence[Pipeline], touches: Sequence[SimulatedTouch | None]) -> Grasp:
    """What fingertips have touched; None for a finger that did not move."""
    contacts, which, missed, blocked, advance = [], [], 0, 0, 0.0
    for i, (pipeline, touch) in enumerate(zip(fingers, touches, strict=True)):
        if touch is None or touch.outcome == "inside":
            blocked += 1
            continue
        advance = max(advance, touch.advance)
        contact = None
        if touch.outcome != "miss":
            contact = contact_of(pipeline.finger.pad, touch.believed, touch.reading, pipeline.noise)
        if contact is None:
            missed += 1
            continue
        contacts.append(contact)
        which.append(i)
    points = np.array([point for point, _ in contacts]).reshape(-1, 3)
    normals = np.array([normal for _, normal in contacts]).reshape(-1, 3)
    return Grasp(points, normals, tuple(which), missed, blocked, advance)


def contact_of(
    pad: Pad, pose: Pose, compression: Floats, noise: float
) -> tuple[Floats, Floats] | None:
    """The deepest point (3,) [m] and the surface's unit normal (3,); None if nothing is touched.

    `compression` (rows, cols), `noise`: of the taxels, and its standard deviation [m]. The result
    is in the frame of `pose`.
    """
    cleaned = clean(pad, compression, noise, DEFAULT_CONTACT.min_compression, "auto")
    if not cleaned.touched.any():
        return None
    surface = pad.surface(cleaned.compression, cleaned.touched)
    across = np.array([0.0, 1.0, 0.0])
    patch = fit_patch(pad, surface, cleaned.touched, across, noise)
    position, axes = pose
    if patch.jet is not None and patch.kind == "smooth":
        return axes @ patch.place + position, axes @ patch.normal
    taxel = int(np.where(cleaned.touched, cleaned.compression, -1.0).argmax())
    return axes @ pad.surface_point(surface, taxel) + position, axes @ patch.normal
