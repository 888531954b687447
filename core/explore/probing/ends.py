"""What is known of one end, what the rule answers, and the face that closes the end.

All in the slicing frame. The rule itself thinks of upper ends alone: `turned_over` makes one of a
lower end. A face has a plane, an edge, and places where it was not touched. Touches at 45 degrees,
across the edge between a steep wall and the face, are worth their time where the band that the
contour's touches reached ends well below the face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, finite_array, not_negative, positive
from palpate.core.geometry import area_centroid, edge_distance, inscribed_circle, winding_number
from palpate.core.poses import FACING_DOWN, Pose, pad_rotation
from palpate.core.touch import HITS, TouchOutcome

End = Literal["upper", "lower"]
# What a touch is for: to find the end, to touch the face that closes it, or that one's edge.
ProbeReason = Literal["search", "face", "edge"]
OVER = Pose(np.zeros(3), FACING_DOWN)  # The slicing frame, half a turn about its x axis
LEAST_POINTS = 3
NOISES = 3.0  # Standard deviations by which touches may differ
FOOT = 0.35  # Of the pad's width: how far from its deepest point a domed pad touches a level face
STEEPEST = math.radians(45.0)  # A normal that leans more says that an edge was touched, not a face
# Normals of one plane differ by no more: what noise and an edge under the pad make of them.
ALIKE = math.radians(3.0)
FAINT = 1e-3  # Weight of a normal that is not believed
STEEP = 0.6  # Upward part of a wall's normal below which there is an edge between it and the face
UNTOUCHED = 1.0 / 6.0  # Of the pad's width: a lower stretch between band and face needs no touch
LEAST_ALIKE = 4  # Touches after which the edge is believed to be the same all around, if they agree
MOST_EDGE = 8  # Touches of one edge
APART = 1.0  # Widths of the pad: places nearer to a touched one need no touch
TILT = math.radians(45.0)
# Widths of the pad: from how far an edge is approached, and how far past its place.
STANDOFF, BEYOND = 1.0, 0.6
CELLS = 8  # Places to a pad's width, between which one is looked for
MOST_CELLS = 64  # The same across the end
OUTLINE = 96  # Points of an outline, at most: more say no more, and each costs
LEAST_LEVEL = 0.05  # Level part of a normal below which nobody can say which way is inwards


class SideContour(NamedTuple):
    """The usable contour nearest to the end."""

    points: Floats  # (n, 3), m, in order
    normals: Floats  # Outward unit normals, (n, 3)
    contact_low: Floats  # Lowest height touched below each point without a break, (n,), m
    contact_high: Floats  # Highest height touched above it


class ProbeCommand(NamedTuple):
    """A touch to make."""

    pose: Pose  # From which the pad moves along its z axis
    reach: float  # Longest way, m
    reason: ProbeReason  # What it is for
    target: Floats  # Where the surface is expected, (3,), m


class StopProbing(NamedTuple):
    """No touch is worth its time."""

    reason: str  # Why, in a few words
    untouched: float  # Width of the largest stretch of it that nobody touched, m; 0 if unknown


class ProbeResult(NamedTuple):
    """A touch that was made, and what came of it."""

    probing: ProbeCommand  # What was asked for
    outcome: TouchOutcome  # How it ended
    point: Floats  # Deepest point touched, (3,), m; of no meaning unless something was touched
    normal: Floats  # Outward normal at the middle of the contact, (3,)

    @property
    def touched(self) -> bool:
        """Whether it tells where the surface is."""
        return self.outcome in HITS


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EndObservation:
    """All that the next touch of one end may depend on; lengths in m."""

    height: float  # Where the end is expected along the slicing axis
    deviation: float  # Standard deviation of that
    other: float  # Where the object's other end is
    radius: float  # Largest distance of the surface from the slicing axis that is expected
    width: float  # Of the pad
    tolerance: float  # What two heights may differ by and still be as good as one
    noise: float = 0.0  # Standard deviation of a touch's place
    standing: bool = False  # Whether the object stands on this end: no touch comes from beyond
    contour: SideContour | None = None  # The contour nearest to it; None while there is none
    probes: tuple[ProbeResult, ...] = ()  # Touches made of this end, in their order

    def __post_init__(self) -> None:
        for name in ("radius", "width", "tolerance"):
            positive(name, getattr(self, name), "m")
        for name in ("deviation", "noise"):
            not_negative(name, getattr(self, name), "m")
        finite = math.isfinite(self.height) and math.isfinite(self.other)
        if not finite or self.height == self.other:
            raise ValueError(
                f"height must be finite and differ from that of the other end {self.other} m, "
                f"got {self.height} m"
            )
        if self.contour is not None:
            count = len(finite_array("contour.points", self.contour.points, (None, 3)))
            if count < LEAST_POINTS:
                raise ValueError(f"contour.points must be at least {LEAST_POINTS}, got {count}")
            finite_array("contour.normals", self.contour.normals, (count, 3))
            for name in ("contact_low", "contact_high"):
                finite_array(f"contour.{name}", getattr(self.contour, name), (count,))

    @property
    def hits(self) -> tuple[ProbeResult, ...]:
        """Touches that tell where the surface is."""
        return tuple(one for one in self.probes if one.touched)

    @property
    def allowed(self) -> float:
        """What two touched heights may differ by if the surface has but one."""
        return self.tolerance + NOISES * self.noise


def turned_over(observation: EndObservation) -> EndObservation:
    """What is known of a lower end, as if it were an upper one."""
    contour = observation.contour
    if contour is not None:
        contour = SideContour(
            contour.points @ FACING_DOWN,
            contour.normals @ FACING_DOWN,
            -contour.contact_high,
            -contour.contact_low,
        )
    return replace(
        observation,
        height=-observation.height,
        other=-observation.other,
        contour=contour,
        probes=tuple(
            one._replace(
                probing=turned_command(one.probing),
                point=one.point @ FACING_DOWN,
                normal=one.normal @ FACING_DOWN,
            )
            for one in observation.probes
        ),
    )


def turned_command(probing: ProbeCommand) -> ProbeCommand:
    """A touch of the one end as one of the other."""
    return probing._replace(pose=OVER @ probing.pose, target=probing.target @ FACING_DOWN)


class EndFace(NamedTuple):
    """A plane over the slicing frame, z = height + slopes (x, y)."""

    height: float  # On the slicing axis, m
    slopes: Floats  # (2,)

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2), m."""
        return np.asarray(self.height + places @ self.slopes)

    @property
    def normal(self) -> Floats:
        """Upward unit normal, (3,)."""
        upward = np.array([-self.slopes[0], -self.slopes[1], 1.0])
        return np.asarray(upward / np.linalg.norm(upward))


def fit_face(touches: Sequence[ProbeResult], width: float) -> EndFace:
    """The plane through touched points that leans as their normals do, for a pad's `width`, m."""
    points = np.stack([one.point for one in touches])
    slopes, sure = _slopes(touches)
    middle = points.mean(axis=0)
    foot = FOOT * width
    rows = np.concatenate(
        [
            np.column_stack([np.ones(len(points)), points[:, :2] - middle[:2]]),
            np.tile(foot * np.eye(3)[1:], (len(slopes), 1)),
        ]
    )
    # A normal that leans too far counts for next to nothing: the rows keep their rank.
    weights = np.concatenate([np.ones(len(points)), np.repeat(np.where(sure, 1.0, FAINT), 2)])
    heights = np.concatenate([points[:, 2] - middle[2], foot * slopes.ravel()])
    found = np.linalg.lstsq(weights[:, None] * rows, weights * heights, rcond=None)[0]
    return EndFace(float(middle[2] + found[0] - middle[:2] @ found[1:]), found[1:])


def _slopes(
    touches: Sequence[ProbeResult],
) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Slopes (n, 2) that the normals tell, and whether they are believed; else 0."""
    normals = np.stack([one.normal for one in touches])
    sure = normals[:, 2] >= math.cos(STEEPEST)
    upward = np.where(sure, normals[:, 2], 1.0)
    return np.where(sure[:, None], -normals[:, :2] / upward[:, None], 0.0), sure


def is_plane(
    face: EndFace, touches: Sequence[ProbeResult], contour: SideContour, allowed: float
) -> bool:
    """Whether touches lie in a plane, to `allowed`, m, and nothing beside them rises over it."""
    points = np.stack([one.point for one in touches])
    if float(np.abs(points[:, 2] - face.at(points[:, :2])).max()) > allowed:
        return False
    normals = np.stack([one.normal for one in touches])
    if float((normals @ face.normal).min()) < math.cos(ALIKE):
        return False
    return bool((contour.contact_high - face.at(contour.points[:, :2])).max() <= allowed)


class FaceEdge(NamedTuple):
    """Where the edge is expected, and how much of it nobody touched."""

    places: Floats  # (n, 3), m
    headings: Floats  # Azimuths of the wall's outward normals there, (n,), rad
    untouched: Floats  # Height between band and face, (n,), m; 0 where there is no edge


def expected_edge(
    face: EndFace, contour: SideContour, touched: Floats, foot: float, top: float
) -> FaceEdge:
    """Where the wall, gone on with as it leans, meets the face.

    `touched` (k, 3): where the face was touched, m: an edge within a `foot` of that is known.
    `foot`: how far around a touched point the pad touches, m. `top`: where the object ends, m: a
    plane through touches of what is none may rise beyond.
    """
    level = np.linalg.norm(contour.normals[:, :2], axis=1)
    steep = contour.normals[:, 2] < STEEP
    outward = contour.normals[:, :2] / np.where(steep, level, 1.0)[:, None]
    lean = np.where(steep, contour.normals[:, 2] / np.where(steep, level, 1.0), 0.0)
    # Along the wall, a height h lies lean * h inwards; the face there is as high as h.
    rise = np.minimum(face.at(contour.points[:, :2]), top) - contour.points[:, 2]
    height = rise / np.maximum(1.0 + lean * (outward @ face.slopes), 0.5)
    places = contour.points[:, :2] - (lean * height)[:, None] * outward
    edge = np.column_stack([places, np.minimum(face.at(places), top)])
    away = np.linalg.norm(edge[:, None] - touched, axis=2).min(axis=1)
    untouched = np.where(steep & (away > foot), edge[:, 2] - contour.contact_high, 0.0)
    return FaceEdge(edge, np.arctan2(outward[:, 1], outward[:, 0]), np.maximum(untouched, 0.0))


def next_edge(
    edge: FaceEdge, made: Sequence[ProbeResult], width: float, allowed: float
) -> ProbeCommand | float:
    """The next touch across an edge, or the height that stays untouched, m.

    `width`: of the pad, m. `allowed`: what touches of one edge may differ by, m.
    """
    uncertain = np.flatnonzero(edge.untouched > UNTOUCHED * width)
    if not len(uncertain):
        return float(edge.untouched.max(initial=0.0))
    if not made:
        return _across(edge, int(edge.untouched.argmax()), width)
    aimed = np.stack([one.probing.target for one in made])
    away = np.linalg.norm(edge.places[uncertain, None] - aimed, axis=2).min(axis=1)
    enough = float(away.max()) < APART * width or len(made) >= MOST_EDGE
    if enough or (len(made) >= LEAST_ALIKE and _alike(made, allowed)):
        return 0.0 if any(one.touched for one in made) else float(edge.untouched.max())
    return _across(edge, int(uncertain[away.argmax()]), width)


def _across(edge: FaceEdge, number: int, width: float) -> ProbeCommand:
    axes = pad_rotation(float(edge.headings[number]), TILT)
    target = edge.places[number]
    start = target - STANDOFF * width * axes[:, 2]
    return ProbeCommand(Pose(start, axes), (STANDOFF + BEYOND) * width, "edge", target)


def _alike(made: Sequence[ProbeResult], allowed: float) -> bool:
    """Whether all touches met the edge as far from where it was expected."""
    if not all(one.touched for one in made):
        return False
    off = [float((one.point - one.probing.target) @ one.probing.pose.axes[:, 2]) for one in made]
    return max(off) - min(off) <= allowed


class UntouchedDisc(NamedTuple):
    """The largest disc in which nothing was touched."""

    place: Floats  # Its middle, (2,), m
    radius: float  # m; 0 or less where everything was touched


def inner_outline(contour: SideContour) -> Floats:
    """Where the band that the contour's touches touched ends on the face, (n, 2), m.

    Beyond a leaning wall by as much as the band climbs along it.
    """
    level = np.maximum(np.linalg.norm(contour.normals[:, :2], axis=1), LEAST_LEVEL)
    climbed = np.maximum(contour.contact_high - contour.points[:, 2], 0.0)
    inwards = climbed * np.maximum(contour.normals[:, 2], 0.0) / level
    outline = contour.points[:, :2] - (inwards / level)[:, None] * contour.normals[:, :2]
    return np.asarray(outline[:: max(len(outline) // OUTLINE, 1)])


def interior_point(contour: SideContour) -> Floats:
    """A place (2,) well inside a contour: its centroid, or where the widest disc fits, m."""
    outline = contour.points[:, :2]
    middle = area_centroid(outline)
    if winding_number(outline, middle[None])[0] != 0:
        return middle
    return inscribed_circle(outline).middle


def covers(contour: SideContour, places: Floats, beside: float) -> Bools:
    """Which places (n, 2) lie inside a contour, or beside it by no more than so much, m."""
    outline = contour.points[:, :2]
    inside = winding_number(outline, places) != 0
    return np.asarray(inside | (edge_distance(outline, places) <= beside), np.bool_)


def largest_untouched_disc(outline: Floats, tried: Floats, width: float) -> UntouchedDisc:
    """The largest disc inside an outline that no touch has reached.

    `outline` (n, 2): of the unknown, m. `tried` (k, 2): at least one touch. `width`: the pad's.
    """
    places, inwards = _places_inside(outline.tobytes(), width)
    if not len(places):
        return UntouchedDisc(tried[-1], 0.0)
    away = np.linalg.norm(places[:, None] - tried, axis=2).min(axis=1) - FOOT * width
    clear = np.minimum(inwards, away)
    widest = int(clear.argmax())
    return UntouchedDisc(places[widest], float(clear[widest]))


@lru_cache(maxsize=8)  # the same outline is asked for after each touch
def _places_inside(points: bytes, width: float) -> tuple[Floats, Floats]:
    """A grid of places (m, 2) within an outline, and how far from it they are, (m,), m."""
    outline = np.frombuffer(points).reshape(-1, 2)
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = max(width / CELLS, float((high - low).max()) / MOST_CELLS)
    axes = [np.arange(lo, hi + step, step) for lo, hi in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[winding_number(outline, places) != 0]
    return places, edge_distance(outline, places)
