"""What is known of one end of an object, touches of it, and the face that closes it.

All is in the slicing frame. The rule treats upper ends only: `turned_over` makes one of a lower
end. A face has a plane, an edge, and places where it was not touched. Touches at 45 degrees, across
the edge between a steep wall and the face, are worth their time where the band that the contour's
touches reached ends well below the face.
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
# What a touch is for: to find the end, to touch the face that closes it, or the face's edge.
ProbeReason = Literal["search", "face", "edge"]
TURNED_OVER = Pose(np.zeros(3), FACING_DOWN)  # the slicing frame, half a turn about its x axis
MIN_POINTS = 3  # of a contour


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceSettings:
    """How a plane is fitted to touches of a face, and where the face is untouched."""

    touch_radius: float = 0.35  # [widths of the pad] of a domed pad's contact with a face
    max_lean: float = math.radians(45.0)  # [rad] of a face's normal; beyond it, it is an edge's
    lean_weight: float = 1e-3  # of an edge's normal in the fit; not 0, so that the rank is full
    # [rad] of normals from that of one plane; noise and an edge under the pad turn them by less.
    max_angle: float = math.radians(3.0)
    n_cells: int = 8  # per pad's width, of the grid of places
    max_cells: int = 64  # across the end, of the grid of places
    max_points: int = 96  # of an outline: more only cost time
    min_level_normal: float = 0.05  # smallest level part of a wall's normal in a division


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeSettings:
    """Where and how often the edge of a face is touched."""

    max_rise: float = 0.6  # upward part of a wall's normal; beyond it, the wall has no edge
    min_approach: float = 0.5  # [1] smallest rate per height at which wall and face come together
    min_untouched: float = 1.0 / 6.0  # [widths of the pad] between band and face, to touch the edge
    min_touches: int = 4  # of the edge, which end it if they agree
    max_touches: int = 8  # of the edge
    spacing: float = 1.0  # [widths of the pad] between touched places, at least
    tilt: float = math.radians(45.0)  # [rad] of the pad
    standoff: float = 1.0  # [widths of the pad] before the edge's place
    reach: float = 0.6  # [widths of the pad] past the edge's place


class SideContour(NamedTuple):
    """The usable contour that is nearest to the end."""

    points: Floats  # (n, 3) [m] in order
    normals: Floats  # (n, 3) outward unit normals
    contact_low: Floats  # (n,) [m] lowest height touched below each point without a break
    contact_high: Floats  # (n,) [m] highest height touched above it


class ProbeCommand(NamedTuple):
    """A touch to make."""

    pose: Pose  # from which the pad moves along its z axis
    reach: float  # [m] longest distance that it moves
    reason: ProbeReason
    target: Floats  # (3,) [m] where the surface is expected


class StopProbing(NamedTuple):
    """No further touch of the end is worth its time."""

    reason: str  # in a few words
    untouched: float  # [m] width of the end's largest untouched stretch; 0 if unknown


class ProbeResult(NamedTuple):
    """A touch that was made."""

    command: ProbeCommand
    outcome: TouchOutcome
    point: Floats  # (3,) [m] deepest point touched; only of a hit
    normal: Floats  # (3,) outward normal at the middle of the contact

    @property
    def touched(self) -> bool:
        """Whether it shows where the surface is."""
        return self.outcome in HITS


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EndObservation:
    """All that the next touch of one end may depend on."""

    height: float  # [m] where the end is expected along the slicing axis
    deviation: float  # [m] standard deviation of `height`
    other_height: float  # [m] of the object's other end
    radius: float  # [m] largest expected distance of the surface from the slicing axis
    width: float  # [m] of the pad
    tolerance: float  # [m] by which two heights may differ and count as equal
    noise: float = 0.0  # [m] standard deviation of a touch's place
    is_standing: bool = False  # on the platform: no touch comes from beyond this end
    contour: SideContour | None = None  # nearest to the end; None while there is none
    probes: tuple[ProbeResult, ...] = ()  # of this end so far, in their order

    def __post_init__(self) -> None:
        for name in ("radius", "width", "tolerance"):
            positive(name, getattr(self, name), "m")
        for name in ("deviation", "noise"):
            not_negative(name, getattr(self, name), "m")
        is_finite = math.isfinite(self.height) and math.isfinite(self.other_height)
        if not is_finite or self.height == self.other_height:
            raise ValueError(
                f"height must be finite and differ from that of the other end, "
                f"{self.other_height} m, got {self.height} m"
            )
        if self.contour is not None:
            count = len(finite_array("contour.points", self.contour.points, (None, 3)))
            if count < MIN_POINTS:
                raise ValueError(f"contour.points must be at least {MIN_POINTS}, got {count}")
            finite_array("contour.normals", self.contour.normals, (count, 3))
            for name in ("contact_low", "contact_high"):
                finite_array(f"contour.{name}", getattr(self.contour, name), (count,))

    @property
    def hits(self) -> tuple[ProbeResult, ...]:
        """Touches that show where the surface is."""
        return tuple(probe for probe in self.probes if probe.touched)


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
        other_height=-observation.other_height,
        contour=contour,
        probes=tuple(
            probe._replace(
                command=turned_command(probe.command),
                point=probe.point @ FACING_DOWN,
                normal=probe.normal @ FACING_DOWN,
            )
            for probe in observation.probes
        ),
    )


def turned_command(command: ProbeCommand) -> ProbeCommand:
    """A touch of one end as one of the other."""
    return command._replace(pose=TURNED_OVER @ command.pose, target=command.target @ FACING_DOWN)


class EndFace(NamedTuple):
    """A plane over the slicing frame, z = height + slopes (x, y)."""

    height: float  # [m] on the slicing axis
    slopes: Floats  # (2,)

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2) [m]."""
        return np.asarray(self.height + places @ self.slopes)

    @property
    def normal(self) -> Floats:
        """Upward unit normal (3,)."""
        upward = np.array([-self.slopes[0], -self.slopes[1], 1.0])
        return np.asarray(upward / np.linalg.norm(upward))


def fit_face(
    touches: Sequence[ProbeResult], width: float, settings: FaceSettings = FaceSettings()
) -> EndFace:
    """The plane that fits touched points and their normals; `width`: of the pad [m]."""
    points = np.stack([touch.point for touch in touches])
    slopes, is_face = _slopes(touches, settings.max_lean)
    middle = points.mean(axis=0)
    touch_radius = settings.touch_radius * width
    rows = np.concatenate(
        [
            np.column_stack([np.ones(len(points)), points[:, :2] - middle[:2]]),
            np.tile(touch_radius * np.eye(3)[1:], (len(slopes), 1)),
        ]
    )
    normal_weights = np.repeat(np.where(is_face, 1.0, settings.lean_weight), 2)
    weights = np.concatenate([np.ones(len(points)), normal_weights])
    heights = np.concatenate([points[:, 2] - middle[2], touch_radius * slopes.ravel()])
    fit = np.linalg.lstsq(weights[:, None] * rows, weights * heights, rcond=None)[0]
    return EndFace(float(middle[2] + fit[0] - middle[:2] @ fit[1:]), fit[1:])


def _slopes(touches: Sequence[ProbeResult], max_lean: float) -> tuple[Floats, Bools]:
    """Slopes (n, 2) from the normals, 0 where these are an edge's; mask (n,) of the others."""
    normals = np.stack([touch.normal for touch in touches])
    is_face: Bools = normals[:, 2] >= math.cos(max_lean)
    upward = np.where(is_face, normals[:, 2], 1.0)
    return np.where(is_face[:, None], -normals[:, :2] / upward[:, None], 0.0), is_face


def is_plane(
    face: EndFace,
    touches: Sequence[ProbeResult],
    contour: SideContour,
    tolerance: float,
    settings: FaceSettings = FaceSettings(),
) -> bool:
    """Whether touches lie in a plane, to a tolerance [m], and nothing beside them rises over it."""
    points = np.stack([touch.point for touch in touches])
    if float(np.abs(points[:, 2] - face.at(points[:, :2])).max()) > tolerance:
        return False
    normals = np.stack([touch.normal for touch in touches])
    if float((normals @ face.normal).min()) < math.cos(settings.max_angle):
        return False
    return bool((contour.contact_high - face.at(contour.points[:, :2])).max() <= tolerance)


class FaceEdge(NamedTuple):
    """Where the edge is expected, and how much of it is untouched."""

    places: Floats  # (n, 3) [m]
    headings: Floats  # (n,) [rad] azimuths of the wall's outward normals
    untouched: Floats  # (n,) [m] height between band and face; 0 where there is no edge


def expected_edge(
    face: EndFace,
    contour: SideContour,
    touched: Floats,
    foot: float,
    top: float,
    settings: EdgeSettings = EdgeSettings(),
) -> FaceEdge:
    """Where the wall, continued with its lean, meets the face.

    `touched` (k, 3): where the face was touched [m]. `foot`: radius of a touch [m]; an edge nearer
    to a touched point is known. `top`: upper end of the object [m]; a plane fitted to touches of
    something else may rise above it.
    """
    level = np.linalg.norm(contour.normals[:, :2], axis=1)
    steep = contour.normals[:, 2] < settings.max_rise
    outward = contour.normals[:, :2] / np.where(steep, level, 1.0)[:, None]
    lean = np.where(steep, contour.normals[:, 2] / np.where(steep, level, 1.0), 0.0)
    # The wall at height h above the contour lies lean * h inwards; it ends where the face is at h.
    rise = np.minimum(face.at(contour.points[:, :2]), top) - contour.points[:, 2]
    height = rise / np.maximum(1.0 + lean * (outward @ face.slopes), settings.min_approach)
    places = contour.points[:, :2] - (lean * height)[:, None] * outward
    edge = np.column_stack([places, np.minimum(face.at(places), top)])
    distances = np.linalg.norm(edge[:, None] - touched, axis=2).min(axis=1)
    untouched = np.where(steep & (distances > foot), edge[:, 2] - contour.contact_high, 0.0)
    return FaceEdge(edge, np.arctan2(outward[:, 1], outward[:, 0]), np.maximum(untouched, 0.0))


def next_edge(
    edge: FaceEdge,
    made: Sequence[ProbeResult],
    width: float,
    tolerance: float,
    settings: EdgeSettings = EdgeSettings(),
) -> ProbeCommand | float:
    """The next touch across an edge, or the height that stays untouched [m].

    `made`: touches of the edge. `width`: of the pad [m]. `tolerance`: by which touches of one edge
    may differ [m].
    """
    uncertain = np.flatnonzero(edge.untouched > settings.min_untouched * width)
    if not len(uncertain):
        return float(edge.untouched.max(initial=0.0))
    if not made:
        return _across(edge, int(edge.untouched.argmax()), width, settings)
    targets = np.stack([touch.command.target for touch in made])
    distances = np.linalg.norm(edge.places[uncertain, None] - targets, axis=2).min(axis=1)
    is_spent = len(made) >= settings.max_touches
    is_covered = float(distances.max()) < settings.spacing * width
    if is_spent or is_covered or (len(made) >= settings.min_touches and _agree(made, tolerance)):
        return 0.0 if any(touch.touched for touch in made) else float(edge.untouched.max())
    return _across(edge, int(uncertain[distances.argmax()]), width, settings)


def _across(edge: FaceEdge, number: int, width: float, settings: EdgeSettings) -> ProbeCommand:
    """A touch across the edge at one of its places."""
    axes = pad_rotation(float(edge.headings[number]), settings.tilt)
    target = edge.places[number]
    start = target - settings.standoff * width * axes[:, 2]
    reach = (settings.standoff + settings.reach) * width
    return ProbeCommand(Pose(start, axes), reach, "edge", target)


def _agree(made: Sequence[ProbeResult], tolerance: float) -> bool:
    """Whether all touches met the edge at equal offsets from its targets, to a tolerance [m]."""
    if not all(touch.touched for touch in made):
        return False
    offsets = [
        float((touch.point - touch.command.target) @ touch.command.pose.axes[:, 2])
        for touch in made
    ]
    return max(offsets) - min(offsets) <= tolerance


class UntouchedDisc(NamedTuple):
    """The largest disc in which nothing was touched."""

    place: Floats  # (2,) [m] its middle
    radius: float  # [m] 0 or less where everything was touched


def inner_outline(contour: SideContour, settings: FaceSettings = FaceSettings()) -> Floats:
    """Where the band that the contour's touches touched ends on the face, (n, 2) [m].

    It lies inside the contour at a leaning wall, by as much as the band climbs along the wall.
    """
    level = np.maximum(np.linalg.norm(contour.normals[:, :2], axis=1), settings.min_level_normal)
    climbed = np.maximum(contour.contact_high - contour.points[:, 2], 0.0)
    inwards = climbed * np.maximum(contour.normals[:, 2], 0.0) / level
    outline = contour.points[:, :2] - (inwards / level)[:, None] * contour.normals[:, :2]
    return np.asarray(outline[:: max(len(outline) // settings.max_points, 1)])


def interior_point(contour: SideContour) -> Floats:
    """A place (2,) well inside a contour: its centroid, or where the widest disc fits [m]."""
    outline = contour.points[:, :2]
    middle = area_centroid(outline)
    if winding_number(outline, middle[None])[0] != 0:
        return middle
    return inscribed_circle(outline).middle


def covers(contour: SideContour, places: Floats, margin: float) -> Bools:
    """Which places (n, 2) lie inside a contour, or beside it by no more than a margin [m]."""
    outline = contour.points[:, :2]
    inside = winding_number(outline, places) != 0
    return np.asarray(inside | (edge_distance(outline, places) <= margin), np.bool_)


def largest_untouched_disc(
    outline: Floats, tried: Floats, width: float, settings: FaceSettings = FaceSettings()
) -> UntouchedDisc:
    """The largest disc inside an outline that no touch has reached.

    `outline` (n, 2): of the face [m]. `tried` (k, 2): places of at least one touch [m]. `width`: of
    the pad [m].
    """
    places, inwards = _places_inside(outline.tobytes(), width, settings)
    if not len(places):
        return UntouchedDisc(tried[-1], 0.0)
    distances = np.linalg.norm(places[:, None] - tried, axis=2).min(axis=1)
    radii = np.minimum(inwards, distances - settings.touch_radius * width)
    widest = int(radii.argmax())
    return UntouchedDisc(places[widest], float(radii[widest]))


@lru_cache(maxsize=8)  # the same outline is asked for after each touch
def _places_inside(points: bytes, width: float, settings: FaceSettings) -> tuple[Floats, Floats]:
    """A grid of places (m, 2) inside an outline, and how far from it they are, (m,) [m]."""
    outline = np.frombuffer(points).reshape(-1, 2)
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = max(width / settings.n_cells, float((high - low).max()) / settings.max_cells)
    axes = [np.arange(lo, hi + step, step) for lo, hi in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[winding_number(outline, places) != 0]
    return places, edge_distance(outline, places)
