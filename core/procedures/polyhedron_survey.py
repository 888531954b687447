"""State of the exploration of a convex polyhedron: its faces, and places to check."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.procedures.polyhedron import Plane, PlaneFit, fit_plane
from palpate.core.procedures.protocol import (
    UP,
    Contact,
    FingerMove,
    Move,
    MoveResult,
    TouchSetup,
    clear_of_platform,
    touch,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceWalkSettings:
    """How a finger walks over the faces of a polyhedron, and looks for the next one."""

    lift: float = 5.0e-3  # [m] above the face, where a step begins
    drop: float = 2.5e-3  # [m] below the face, where a step ends without contact
    step: float = 0.55  # fraction of the pad's width, between two touches of a face
    max_steps: int = 40  # in one direction over a face
    edge_depth: float = 10.0e-3  # [m] below a face, where the face behind its edge is probed
    leaning_depth: float = 0.3  # fraction of `edge_depth`, for the second probe, which leans
    lean: float = 0.6  # tangent of the second probe's angle to the first
    corner_inset: float = 9.0e-3  # [m] from a corner's edges, where its face is checked
    known_distance: float = 4.0e-3  # [m] from a touched point, up to which a place is known
    same_place: float = 1.0e-3  # [m] between places, below which only the first is checked
    min_approach: float = 0.05  # cosine of a direction and the normal of a plane that is ahead
    n_azimuths: int = 8  # directions from which open sides are probed


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanarSettings:
    """How contacts are assigned to faces, and when the object is refused."""

    walk: FaceWalkSettings = FaceWalkSettings()
    min_taxels: int = 12  # that determine a plane
    min_share: float = 0.6  # of a contact's points that lie on the face it belongs to
    same_angle: float = math.radians(4.0)  # [rad] between a smooth contact and its face
    same_offset: float = 1.0e-3  # [m] of a contact from its face
    plane_sigmas: float = 4.0  # [standard deviations of a point] about the plane of a face
    touch_sigmas: float = 4.0  # [standard deviations of a taxel] within one touch of a plane
    max_touch_rise: float = 1.0  # [standard deviations of a point] the same; the larger counts
    rim_depth: float = 10.0e-3  # [m] below two faces, where a curved contact is a rounded rim
    max_rim_gap: float = 1.4e-3  # [m] from an edge or corner to the touch on it, if it is sharp
    min_hollow: int = 6  # untouched taxels between touched ones that show a hole
    n_samples: int = 2000  # of the faces, for the largest distance from a touch


DEFAULT_PLANAR = PlanarSettings()


class UnsuitedError(Exception):
    """The object is not a convex polyhedron."""


@dataclass(slots=True, eq=False)
class Face:
    """A face under exploration."""

    fit: PlaneFit
    touches: list[Floats]  # points of each touch on the face, (n, 3) [m]
    # Last place on the face in each direction, (3,) [m], and the direction, (3,).
    ends: list[tuple[Floats, Floats]] = field(default_factory=list)

    @property
    def plane(self) -> Plane:
        """The plane of the face."""
        return self.fit.plane


class PlaceCheck(NamedTuple):
    """A place that is to be touched, since its surface is not known."""

    place: Floats  # (3,) [m]
    outward: Floats  # unit vector from the place to the start of the approach, (3,)
    standoff: float  # [m] from the place, where the approach begins
    overshoot: float  # [m] behind the place, where the approach ends
    face: Face | None = None  # the face expected there
    corner: tuple[Floats, Floats] | None = None  # its corner, and the outward direction there
    is_edge: bool = False  # whether it is a corner or the middle of an edge: maybe rounded or cut


@dataclass(slots=True, eq=False)
class PolyhedronSurvey:
    """All that was touched of the polyhedron."""

    setup: TouchSetup
    settings: PlanarSettings = DEFAULT_PLANAR
    faces: list[Face] = field(default_factory=list)
    waiting: list[Contact] = field(default_factory=list)  # on faces that may be new
    curved: list[Contact] = field(default_factory=list)  # on no plane
    touched: list[Floats] = field(default_factory=list)  # all touched points, by touch
    refuted: list[Floats] = field(default_factory=list)  # places without the face expected there
    # Corners and middles of edges, (3,), and the distance of each from the touch on it [m].
    gaps: list[tuple[Floats, float]] = field(default_factory=list)

    @property
    def max_offset(self) -> float:
        """Largest distance of a face's points from its plane [m]."""
        return self.settings.plane_sigmas * self.setup.sigma

    @property
    def max_rise(self) -> float:
        """Largest distance from a plane within one touch, whose points share a pose error [m]."""
        settings, setup = self.settings, self.setup
        return max(settings.touch_sigmas * setup.noise, settings.max_touch_rise * setup.sigma)

    @property
    def planes(self) -> list[Plane]:
        """Planes of the platform and of all faces."""
        return [Plane(-UP, -self.setup.platform), *(face.plane for face in self.faces)]

    def fitted(self, touches: list[Floats], outward: Floats) -> PlaneFit:
        """The plane through touches of a face."""
        setup = self.setup
        errors = setup.noise, setup.point_error, setup.angle_error
        return fit_plane(touches, outward, *errors)

    def take(self, face: Face, contact: Contact) -> Floats:
        """Add the points of a contact that lie on a face to it; returns them, (n, 3)."""
        above = face.plane.above(contact.points)
        on = np.abs(above) <= self.max_offset
        if on.sum() < self.settings.min_taxels:
            return contact.points[:0]
        on &= np.abs(above - np.median(above[on])) <= self.max_rise
        if on.sum() < self.settings.min_taxels:
            return contact.points[:0]
        face.touches.append(contact.points[on])
        face.fit = self.fitted(face.touches, face.plane.normal)
        return contact.points[on]

    def face_of(self, contact: Contact) -> Face | None:
        """The known face on which most of a contact lies."""
        settings = self.settings
        max_offset = max(self.max_offset, settings.same_offset)
        for face in self.faces:
            on = np.abs(face.plane.above(contact.points)) <= max_offset
            leans = contact.normal @ face.plane.normal < math.cos(settings.same_angle)
            if on.mean() > settings.min_share and not (contact.kind == "smooth" and leans):
                return face
        return None

    def touch(self, move: FingerMove) -> Generator[Move, MoveResult, Contact | None]:
        """The contact of a move; None if it touches nothing, or would touch the platform."""
        clear = clear_of_platform(self.setup, move)
        if clear is None:
            return None
        contact = yield from touch(self.setup, clear)
        if not contact.is_hit:
            return None
        self.touched.append(contact.points)
        if len(contact.hollow) >= self.settings.min_hollow:
            place = millimetres(contact.hollow.mean(axis=0))
            raise UnsuitedError(f"it is hollow at {place}, between taxels that touch it")
        return contact


def millimetres(place: Floats) -> str:
    """Coordinates of a place (3,) as text [mm]."""
    return f"({', '.join(f'{1e3 * coordinate:.0f}' for coordinate in place)}) mm"
