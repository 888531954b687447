"""Planar Surface Explorer: a convex polyhedron face by face (Allen; Fung, 1999, 1.4.3.2).

On each face the finger lifts, moves parallel to it and lowers, outwards in two directions and their
opposites, until the pad shows that the face ends. Beyond each end it turns to the face that comes
next. Planes are fitted by total least squares. Where the text stops once a face is measured, here
the planes' intersection is looked at: near each of its corners the face is touched, and a corner
that is not there leads to the face that cuts it off: it closes only where touched.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import point_tree, sample_surface
from palpate.core.poses import axes_along
from palpate.core.procedures.polyhedron import (
    Corners,
    Plane,
    PlaneFit,
    corners_of,
    fit_plane,
    polyhedron_of,
)
from palpate.core.procedures.protocol import (
    STANDOFF,
    UNSUITED,
    UP,
    WORST,
    Contact,
    Exploration,
    Findings,
    FingerMove,
    Met,
    Move,
    TouchSetting,
    approach,
    kept_clear,
    square_on,
    touch,
    touch_from_above,
)
from palpate.core.shapes import Mesh, Polyhedron

LIFT, DROP = 5.0e-3, 2.5e-3  # Above the face, and below it, m: where it is no longer touched
STEP = 0.55  # Of the pad's width, between two touches of a face
MOST_STEPS = 40
SAME, SAME_OFFSET = math.radians(4.0), 1.0e-3  # Planes that are so near to each other are one, m
SHARE = 0.6  # Of a contact, that lies on a face where it belongs to it
BELOW = 10.0e-3  # Below an edge, m, where the next face is sought: beyond any rounded rim
RIM = 10.0e-3  # A curved place so near to two faces is a rounded rim, m
INSET = 9.0e-3  # From a corner's edges, m, where it is looked whether the face is there
SEEN = 4.0e-3  # A place so near to what was touched is known, m
FEWEST = 12  # Taxels that tell a plane
FLAT_DEVIATIONS, FLAT_SHARE = 4.0, 1.0  # Within one touch, of a taxel's noise, and of `sigma`
SHARP = 1.4e-3  # From an edge or a corner to the touch on it, m: else it is rounded or cut
FEW_HOLLOW = 6  # Taxels that touch nothing, between others
SAMPLES = 2000  # Of the faces
LEVEL = 0.05  # Cosine of a direction and a plane that it leads to
ASIDE = 1.0e-3  # Where it was looked already, m
AROUND = 8  # Directions from which faces are sought that nothing leads to


class BoundaryModel(NamedTuple):
    """The boundary representation that was found."""

    vertices: Floats  # World frame, (n, 3), m
    polyhedron: Polyhedron  # With winged edges
    planes: tuple[Plane, ...]  # Of its faces
    touches: tuple[int, ...]  # On each face; 0 of the one on which it stands
    rms: float  # Of all touched points about their planes, m


def planar(setting: TouchSetting) -> Exploration:
    """Explore faces in turn until the polyhedron closes.

    Findings: a `BoundaryModel`, or ``unsuited`` for what is curved, not convex, or off its planes
    by more than three standard deviations.
    """
    survey = PolyhedronSurvey(setting)
    first = yield from touch_from_above(setting)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    survey.waiting.append(first)
    try:
        corners = yield from _all_faces(survey)
        return _findings(survey, corners)
    except UnsuitedError as error:
        return Findings(status="unsuited", reason=str(error))


class UnsuitedError(Exception):
    """The object is no convex polyhedron."""


@dataclass(slots=True, eq=False)
class Face:
    """A face under exploration."""

    fit: PlaneFit
    touches: list[Floats]  # What lies on it, by touch, (n, 3) each, m
    ends: list[tuple[Floats, Floats]] = field(default_factory=list)  # Where it ended, and which way

    @property
    def plane(self) -> Plane:
        """Where it lies."""
        return self.fit.plane


class Doubt(NamedTuple):
    """A place where it is not known what is there."""

    place: Floats  # (3,), m
    outward: Floats  # From where it is approached, (3,)
    far: float  # How far off the approach begins, m
    beyond: float  # How far beyond the place it goes, m
    face: Face | None = None  # The face that should be there
    corner: tuple[Floats, Floats] | None = None  # Whose it is, and the way out of the object there
    edge: bool = False  # Whether it is the middle of an edge, which may be rounded or cut


@dataclass(slots=True, eq=False)
class PolyhedronSurvey:
    """What is known of the polyhedron."""

    setting: TouchSetting
    faces: list[Face] = field(default_factory=list)
    waiting: list[Contact] = field(default_factory=list)  # On faces that may not be known yet
    curved: list[Contact] = field(default_factory=list)  # Smooth and no plane
    met: list[Floats] = field(default_factory=list)  # All touched points, by touch
    refuted: list[Floats] = field(default_factory=list)  # Places where a face should be, and is not
    # Of edges' middles to a touch, m.
    gaps: list[tuple[Floats, float]] = field(default_factory=list)

    @property
    def near(self) -> float:
        """Distance from a plane of what lies on it, m: the pose's error, four times."""
        return max(4.0 * self.setting.sigma, self.flat)

    @property
    def flat(self) -> float:
        """The same within one touch, which its pose's error does not bend, m."""
        return max(FLAT_DEVIATIONS * self.setting.noise, FLAT_SHARE * self.setting.sigma)

    @property
    def planes(self) -> list[Plane]:
        """Of all faces, the platform first."""
        return [Plane(-UP, -self.setting.platform), *(face.plane for face in self.faces)]

    def fitted(self, touches: list[Floats], outward: Floats) -> PlaneFit:
        """The plane through touches of a face."""
        setting = self.setting
        errors = setting.noise, setting.point_error, setting.angle_error
        return fit_plane(touches, outward, *errors)

    def take(self, face: Face, contact: Contact) -> Floats:
        """Keep what of a contact lies on a face; returns these points, (n, 3)."""
        above = face.plane.above(contact.points)
        on = np.abs(above) <= self.near
        if on.sum() < FEWEST:
            return contact.points[:0]
        on &= np.abs(above - np.median(above[on])) <= self.flat
        if on.sum() < FEWEST:
            return contact.points[:0]
        face.touches.append(contact.points[on])
        face.fit = self.fitted(face.touches, face.plane.normal)
        return contact.points[on]

    def face_of(self, contact: Contact) -> Face | None:
        """The known face on which a contact lies for the greater part."""
        for face in self.faces:
            on = np.abs(face.plane.above(contact.points)) <= max(self.near, SAME_OFFSET)
            leans = contact.normal @ face.plane.normal < math.cos(SAME)
            if on.mean() > SHARE and not (contact.kind == "smooth" and leans):
                return face
        return None

    def touched(self, move: FingerMove | None) -> Generator[Move, Met, Contact | None]:
        """What a move meets; None if it meets nothing, or must not be made."""
        move = None if move is None else kept_clear(self.setting, move)
        if move is None:
            return None
        contact = yield from touch(self.setting, move)
        if not contact.met:
            return None
        self.met.append(contact.points)
        if len(contact.hollow) >= FEW_HOLLOW:
            at = ", ".join(f"{1e3 * one:.0f}" for one in contact.hollow.mean(axis=0))
            raise UnsuitedError(f"it is hollow at ({at}) mm, between taxels that touch it")
        return contact


def _all_faces(survey: PolyhedronSurvey) -> Generator[Move, Met, Corners]:
    """Explore what waits, and look at the corners, until neither brings anything new."""
    half, tried = 4.0 * survey.setting.reach, [np.full(3, math.inf)]
    while True:
        while survey.waiting:
            yield from _next_face(survey, survey.waiting.pop(0))
        if not survey.faces:
            raise UnsuitedError(f"it has no plane face where it was touched{_bends(survey)}")
        corners = corners_of(survey.planes, half)
        if corners is not None:
            _check_convex(survey)
        doubts = _open_sides(survey)
        if corners is not None:
            doubts = [*_doubts(survey, corners), *_edges(survey, corners)]
        new = [
            one
            for one in doubts
            if np.linalg.norm(one.place - np.array(tried), axis=1).min() > ASIDE
        ]
        if not new:
            break
        tried.append(new[0].place)
        yield from _look(survey, new[0])
    if corners is None:
        raise UnsuitedError(f"its plane faces do not close{_bends(survey)}")
    return corners


def _next_face(survey: PolyhedronSurvey, contact: Contact) -> Generator[Move, Met, None]:
    """Explore the face on which a contact lies, unless it is known or no plane."""
    if survey.face_of(contact) is None:
        contact = yield from square_on(survey.setting, contact)
        survey.met.append(contact.points)
    known = survey.face_of(contact)
    if known is not None:
        survey.take(known, contact)
        return
    fit = None
    if contact.kind == "smooth" and len(contact.points) >= FEWEST:
        fit = survey.fitted([contact.points], contact.normal)
    if fit is None or fit.rms > survey.flat:
        survey.curved.append(contact)
        return
    face = Face(fit, [contact.points])
    survey.faces.append(face)
    level = np.cross(fit.plane.normal, UP)
    if np.linalg.norm(level) < 0.1:
        level = axes_along(fit.plane.normal)[:, 0]
    level /= np.linalg.norm(level)
    steep = np.cross(fit.plane.normal, level)
    for way in (level, -level, steep, -steep):
        end = yield from _to_the_end(survey, face, contact.middle, way)
        face.ends.append((end, way))
        yield from _beyond(survey, face, end, way)
    if len(face.touches) == 1:  # where the pad just fits on, it is a rim, and no face
        survey.faces.remove(face)
        survey.curved.append(contact)


def _to_the_end(
    survey: PolyhedronSurvey, face: Face, start: Floats, way: Floats
) -> Generator[Move, Met, Floats]:
    """Lift, move parallel, lower: the last place (3,) on the face in one direction, m."""
    pad, last = survey.setting.pad, start
    usual = float(np.abs((face.touches[0] - start) @ way).max())  # Reach of a contact on a face
    for number in range(1, MOST_STEPS):
        place = start + number * STEP * survey.setting.width * way
        place = place - face.plane.above(place[None])[0] * face.plane.normal
        contact = yield from survey.touched(approach(place, face.plane.normal, LIFT, DROP))
        if contact is None:
            break
        on = survey.take(face, contact)
        if not len(on):
            break
        last = on[int((on @ way).argmax())]
        if (last - place) @ way < usual - 1.5 * pad.pitch:
            break
    return last


def _beyond(
    survey: PolyhedronSurvey, face: Face, end: Floats, way: Floats
) -> Generator[Move, Met, None]:
    """Look for the face that comes after an edge, from beside it or from above."""
    for lean, below in ((0.0, BELOW), (0.6, 0.3 * BELOW)):
        outward = (way + lean * face.plane.normal) / math.hypot(1.0, lean)
        place = end - below * face.plane.normal
        move = approach(place, outward, 3.0 * STANDOFF, 0.5 * survey.setting.reach)
        contact = yield from survey.touched(move)
        if contact is not None:
            survey.waiting.append(contact)
            return


def _check_convex(survey: PolyhedronSurvey) -> None:
    """Refuse faces that cut off what was touched."""
    points = np.concatenate(survey.met)
    for number, face in enumerate(survey.faces):
        out = float(face.plane.above(points).max())
        if out > max(WORST * survey.setting.sigma, SAME_OFFSET):
            raise UnsuitedError(
                f"it is not convex: a touched point lies {1e3 * out:.2f} mm beyond face {number}"
            )


def _open_sides(survey: PolyhedronSurvey) -> list[Doubt]:
    """Where faces must be that nothing leads to: all around the middle of what was touched."""
    middle = np.concatenate([one.mean(axis=0)[None] for one in survey.met]).mean(axis=0)
    azimuths = 2.0 * math.pi * np.arange(AROUND) / AROUND
    ways = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(AROUND)])
    return [Doubt(middle + STANDOFF * one, one, survey.setting.reach, 0.0) for one in ways]


def _doubts(survey: PolyhedronSurvey, corners: Corners) -> list[Doubt]:
    """Places near corners of faces that nothing has touched."""
    found = []
    normals = np.array([plane.normal for plane in survey.planes])
    for number, face in enumerate(survey.faces, start=1):
        ring = corners.places[list(corners.faces[number])]
        seen = np.concatenate(face.touches)
        for corner, place in zip(ring, _inside(ring, face.plane.normal), strict=True):
            if np.linalg.norm(seen - place, axis=1).min() <= SEEN:
                continue
            meeting = np.abs(normals @ corner - [plane.offset for plane in survey.planes])
            out = normals[meeting <= survey.near].sum(axis=0)
            out /= np.linalg.norm(out)
            found.append(Doubt(place, face.plane.normal, STANDOFF, DROP, face, (corner, out)))
    return found


def _edges(survey: PolyhedronSurvey, corners: Corners) -> list[Doubt]:
    """The middles of edges, the platform's aside: there shows what rounds an edge or cuts it."""
    faces = [set(one) for one in corners.faces]
    places: list[tuple[Floats, tuple[int, ...]]] = []  # And the faces that meet there
    for pair in combinations(range(1, len(faces)), 2):
        ends = sorted(faces[pair[0]] & faces[pair[1]])
        if len(ends) == 2:
            places.append((corners.places[ends].mean(axis=0), pair))
    for number, place in enumerate(corners.places):
        meeting = tuple(k for k, face in enumerate(faces) if number in face)
        if meeting and meeting[0] > 0:
            places.append((place, meeting))
    outward = [np.sum([survey.planes[k].normal for k in meeting], axis=0) for _, meeting in places]
    return [
        Doubt(place, out / np.linalg.norm(out), STANDOFF, 2.0 * STANDOFF, edge=True)
        for (place, _), out in zip(places, outward, strict=True)
    ]


def _inside(ring: Floats, normal: Floats) -> Floats:
    """For each corner of a face a place (n, 3) inside of it, as far from its edges as asked, m.

    In a face that is too narrow for that, half of the way to the middle.
    """
    after, before = np.roll(ring, -1, axis=0) - ring, np.roll(ring, 1, axis=0) - ring
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    sine = np.maximum(np.linalg.norm(np.cross(after, before), axis=1, keepdims=True), 0.1)
    way = INSET * (after + before) / sine
    to_middle = 0.5 * (ring.mean(axis=0) - ring)
    long = np.linalg.norm(way, axis=1) > np.linalg.norm(to_middle, axis=1)
    return np.asarray(ring + np.where(long[:, None], to_middle, way))


def _look(survey: PolyhedronSurvey, doubt: Doubt) -> Generator[Move, Met, None]:
    """Touch a doubtful place; where the face is not there, touch what cuts off its corner."""
    move = approach(doubt.place, doubt.outward, doubt.far, doubt.beyond)
    contact = yield from survey.touched(move)
    if doubt.edge:
        if contact is not None:
            gap = -float(((contact.points - doubt.place) @ doubt.outward).max())
            survey.gaps.append((doubt.place, gap))
            survey.waiting += [contact] if gap > SHARP else []
        return
    if contact is not None and (doubt.face is None or not len(survey.take(doubt.face, contact))):
        survey.waiting.append(contact)
        survey.refuted.append(doubt.place)
    if contact is None and doubt.corner is not None:
        corner, out = doubt.corner
        contact = yield from survey.touched(approach(corner, out, STANDOFF, 3.0 * STANDOFF))
        if contact is not None:
            survey.waiting.append(contact)
            survey.refuted.append(doubt.place)


def _findings(survey: PolyhedronSurvey, corners: Corners) -> Findings:
    """The polyhedron, unless what was touched refutes it."""
    doubts = _doubts(survey, corners)
    rms = _checked_rms(survey, doubts)
    try:
        polyhedron, numbers = polyhedron_of(corners)
    except ValueError as error:
        raise UnsuitedError(f"its faces do not close: {error}") from None
    touches, planes = (0, *(len(face.touches) for face in survey.faces)), survey.planes
    of_faces = tuple(planes[one] for one in numbers), tuple(touches[one] for one in numbers)
    model = BoundaryModel(corners.places, polyhedron, *of_faces, rms)
    figures = {
        "faces": float(len(numbers)),
        "edges": float(len(polyhedron.edges.ends)),
        "vertices": float(polyhedron.edges.vertices),
        "volume_m3": polyhedron.volume,
        "residual_rms_m": rms,
        "normal_error_deg": math.degrees(max(face.fit.normal_error for face in survey.faces)),
        "untouched_corners": float(len(doubts)),
    }
    told = f"the polyhedron closes with {len(numbers)} faces"
    edges = np.array([one.place for one in _edges(survey, corners)]).reshape(-1, 3)
    gaps = [
        gap for place, gap in survey.gaps if np.linalg.norm(edges - place, axis=1).min() < ASIDE
    ]
    figures["rim_gap_m"] = max(gaps, default=0.0)
    figures["farthest_untouched_m"] = _farthest_untouched(survey, polyhedron.mesh(0))
    if figures["rim_gap_m"] > SHARP:
        told += f", some of whose edges are cut or rounded by {1e3 * figures['rim_gap_m']:.1f} mm"
    told += (
        f"; no place of them is over {1e3 * figures['farthest_untouched_m']:.0f} mm from a touch"
    )
    if doubts:
        why = f"{told}, but near {len(doubts)} of their corners the finger finds no room"
        return Findings(status="incomplete", reason=why, figures=figures)
    mesh = polyhedron.mesh(0)
    return Findings(status="done", reason=told, shape=model, mesh=mesh, figures=figures)


def _farthest_untouched(survey: PolyhedronSurvey, mesh: Mesh) -> float:
    """How far a place of the faces may be from every touch, the platform's aside, m."""
    corners = mesh.vertices[mesh.faces]
    samples = sample_surface(corners, SAMPLES, np.random.default_rng(0)).points
    above = samples[samples[:, 2] > survey.setting.platform + SAME_OFFSET]
    return float(np.max(point_tree(np.concatenate(survey.met)).query(above)[0]))


def _checked_rms(survey: PolyhedronSurvey, doubts: list[Doubt]) -> float:
    """Root mean square distance of all touched points from their planes, m.

    Raises UnsuitedError if it is too large, something but a rim is curved, or a face is missing.
    """
    sigma = survey.setting.sigma
    for contact in survey.curved:
        depths = sorted(-plane.above(contact.middle[None])[0] for plane in survey.planes)
        if depths[1] > RIM:
            raise UnsuitedError(f"it is curved beside its edges{_bends(survey)}")
    counts = np.array([sum(map(len, face.touches)) for face in survey.faces])
    squares = np.array([face.fit.rms**2 for face in survey.faces])
    rms = math.sqrt(float(counts @ squares) / float(counts.sum()))
    worst = max(face.fit.worst for face in survey.faces)
    if rms > UNSUITED * sigma or worst > WORST * sigma:
        raise UnsuitedError(
            f"its faces are not plane: {1e3 * rms:.3f} mm rms, {1e3 * worst:.3f} mm the worst touch"
            f", where one standard deviation is {1e3 * sigma:.3f} mm"
        )
    for face in survey.faces:
        for end, way in face.ends:
            left = _way_left(survey, face, end, way)
            if left > survey.setting.width:
                at = ", ".join(f"{1e3 * x:.0f}" for x in end)
                raise UnsuitedError(
                    f"a face stops at ({at}) mm, {1e3 * left:.0f} mm before its edge"
                )
    for doubt in doubts:
        if any(np.linalg.norm(doubt.place - one) <= ASIDE for one in survey.refuted):
            at = ", ".join(f"{1e3 * x:.0f}" for x in doubt.place)
            raise UnsuitedError(f"at ({at}) mm its planes promise a face that is not there")
    return rms


def _way_left(survey: PolyhedronSurvey, face: Face, end: Floats, way: Floats) -> float:
    """How far it is from a place of a face to its edge in one direction, m."""
    others = [one for one in survey.planes if one is not face.plane and one.normal @ way > LEVEL]
    return min(float((one.offset - one.normal @ end) / (one.normal @ way)) for one in others)


def _bends(survey: PolyhedronSurvey) -> str:
    """How curved it is where it is no plane, in words; nothing where all is plane."""
    bends = [max(map(abs, one.curvatures)) for one in survey.curved if one.kind == "smooth"]
    bends = [one for one in bends if one > 0.0]
    if not bends:
        return ""
    return f": it is curved, with a radius of {1e3 / float(np.median(bends)):.0f} mm"
