"""Planar Surface Explorer: a convex polyhedron face by face (Allen; Fung, 1999, 1.4.3.2).

On each face the finger lifts, moves parallel to it and lowers, along two directions and their
opposites, until the pad shows that the face ends. Beyond each end it turns to the next face. Planes
are fitted by total least squares. The text stops once a face is measured; here the planes are
intersected, and each face is touched near each of its corners: a missing corner leads to the face
that cuts it off, so that the polyhedron closes only where it was touched.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import point_tree, sample_surface
from palpate.core.poses import axes_along
from palpate.core.procedures.polyhedron import (
    Corners,
    Plane,
    corners_of,
    polyhedron_of,
)
from palpate.core.procedures.polyhedron_survey import (
    DEFAULT_PLANAR,
    Face,
    PlaceCheck,
    PlanarSettings,
    PolyhedronSurvey,
    UnsuitedError,
    millimetres,
)
from palpate.core.procedures.protocol import (
    UP,
    Contact,
    Exploration,
    Findings,
    Move,
    MoveResult,
    TouchSetup,
    approach,
    touch_from_above,
    touch_squarely,
)
from palpate.core.shapes import Mesh, Polyhedron


class BoundaryModel(NamedTuple):
    """A boundary representation."""

    vertices: Floats  # in the world frame, (n, 3) [m]
    polyhedron: Polyhedron  # with winged edges
    planes: tuple[Plane, ...]  # of its faces
    touches: tuple[int, ...]  # on each face; 0 on the face on which it stands
    rms: float  # [m] of all touched points about their planes


def planar(setup: TouchSetup, settings: PlanarSettings = DEFAULT_PLANAR) -> Exploration:
    """Explore faces in turn until the polyhedron closes.

    Findings: a `BoundaryModel`, or ``unsuited`` for an object that is curved, not convex, or off
    its planes by more than three standard deviations.
    """
    survey = PolyhedronSurvey(setup, settings)
    first = yield from touch_from_above(setup)
    if first is None:
        return Findings(status="incomplete", reason="nothing was touched within reach")
    survey.waiting.append(first)
    try:
        corners = yield from _all_faces(survey)
        return _findings(survey, corners)
    except UnsuitedError as error:
        return Findings(status="unsuited", reason=str(error))


def _all_faces(survey: PolyhedronSurvey) -> Generator[Move, MoveResult, Corners]:
    """Explore waiting contacts, and check the corners, until nothing new is touched."""
    half, checked = 4.0 * survey.setup.reach, [np.full(3, math.inf)]
    same_place = survey.settings.walk.same_place
    while True:
        while survey.waiting:
            yield from _next_face(survey, survey.waiting.pop(0))
        if not survey.faces:
            raise UnsuitedError(
                f"it has no plane face where it was touched{_curvature_text(survey)}"
            )
        corners = corners_of(survey.planes, half)
        if corners is not None:
            _check_convex(survey)
        if corners is None:
            checks = _side_checks(survey)
        else:
            checks = [*_untouched_corners(survey, corners), *_edge_checks(survey, corners)]
        check = next((check for check in checks if _is_new(check, checked, same_place)), None)
        if check is None:
            break
        checked.append(check.place)
        yield from _check_place(survey, check)
    if corners is None:
        raise UnsuitedError(f"its plane faces do not close{_curvature_text(survey)}")
    return corners


def _is_new(check: PlaceCheck, checked: list[Floats], same_place: float) -> bool:
    return bool(np.linalg.norm(check.place - np.array(checked), axis=1).min() > same_place)


def _next_face(survey: PolyhedronSurvey, contact: Contact) -> Generator[Move, MoveResult, None]:
    """Explore the face on which a contact lies, unless it is known or not plane."""
    if survey.face_of(contact) is None:
        contact = yield from touch_squarely(survey.setup, contact)
        survey.touched.append(contact.points)
    known = survey.face_of(contact)
    if known is not None:
        survey.take(known, contact)
        return
    fit = None
    if contact.kind == "smooth" and len(contact.points) >= survey.settings.min_taxels:
        fit = survey.fitted([contact.points], contact.normal)
    if fit is None or fit.rms > survey.max_rise:
        survey.curved.append(contact)
        return
    face = Face(fit, [contact.points])
    survey.faces.append(face)
    level = np.cross(fit.plane.normal, UP)
    if np.linalg.norm(level) < 0.1:
        level = axes_along(fit.plane.normal)[:, 0]
    level /= np.linalg.norm(level)
    steep = np.cross(fit.plane.normal, level)
    for direction in (level, -level, steep, -steep):
        end = yield from _end_of_face(survey, face, contact.middle, direction)
        face.ends.append((end, direction))
        yield from _next_over_edge(survey, face, end, direction)
    if len(face.touches) == 1:  # a rim: it has no room for two touches
        survey.faces.remove(face)
        survey.curved.append(contact)


def _end_of_face(
    survey: PolyhedronSurvey, face: Face, start: Floats, direction: Floats
) -> Generator[Move, MoveResult, Floats]:
    """Lift, move parallel, lower: the last place (3,) on the face in one direction [m]."""
    walk, pad, last = survey.settings.walk, survey.setup.pad, start
    half_width = float(np.abs((face.touches[0] - start) @ direction).max())  # of a full contact
    for number in range(1, walk.max_steps):
        place = start + number * walk.step * survey.setup.width * direction
        place = place - face.plane.above(place[None])[0] * face.plane.normal
        move = approach(place, face.plane.normal, walk.lift, walk.drop)
        contact = yield from survey.touch(move)
        if contact is None:
            break
        points = survey.take(face, contact)
        if not len(points):
            break
        last = points[int((points @ direction).argmax())]
        if (last - place) @ direction < half_width - 1.5 * pad.pitch:
            break
    return last


def _next_over_edge(
    survey: PolyhedronSurvey, face: Face, end: Floats, direction: Floats
) -> Generator[Move, MoveResult, None]:
    """Probe for the face behind an edge, level with this one or leaning over the edge."""
    setup, walk = survey.setup, survey.settings.walk
    leaning_depth = walk.leaning_depth * walk.edge_depth
    for lean, depth in ((0.0, walk.edge_depth), (walk.lean, leaning_depth)):
        outward = (direction + lean * face.plane.normal) / math.hypot(1.0, lean)
        place = end - depth * face.plane.normal
        move = approach(place, outward, 3.0 * setup.common.standoff, 0.5 * setup.reach)
        contact = yield from survey.touch(move)
        if contact is not None:
            survey.waiting.append(contact)
            return


def _check_convex(survey: PolyhedronSurvey) -> None:
    """Raise UnsuitedError if a touched point lies outside a face."""
    points, setup = np.concatenate(survey.touched), survey.setup
    max_height = max(setup.common.max_touch_error * setup.sigma, survey.settings.same_offset)
    for number, face in enumerate(survey.faces):
        height = float(face.plane.above(points).max())
        if height > max_height:
            raise UnsuitedError(
                f"it is not convex: a touched point lies {1e3 * height:.2f} mm beyond face {number}"
            )


def _side_checks(survey: PolyhedronSurvey) -> list[PlaceCheck]:
    """Places all around the touched points, where unknown faces must be."""
    middle = np.concatenate([points.mean(axis=0)[None] for points in survey.touched]).mean(axis=0)
    setup, count = survey.setup, survey.settings.walk.n_azimuths
    azimuths = 2.0 * math.pi * np.arange(count) / count
    directions = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(count)])
    standoff = setup.common.standoff
    return [PlaceCheck(middle + standoff * out, out, setup.reach, 0.0) for out in directions]


def _untouched_corners(survey: PolyhedronSurvey, corners: Corners) -> list[PlaceCheck]:
    """Untouched places of faces near their corners."""
    setup, walk, checks = survey.setup, survey.settings.walk, list[PlaceCheck]()
    normals = np.array([plane.normal for plane in survey.planes])
    for number, face in enumerate(survey.faces, start=1):
        ring = corners.places[list(corners.faces[number])]
        points = np.concatenate(face.touches)
        for corner, place in zip(ring, _inset_corners(ring, walk.corner_inset), strict=True):
            if np.linalg.norm(points - place, axis=1).min() <= walk.known_distance:
                continue
            offsets = np.abs(normals @ corner - [plane.offset for plane in survey.planes])
            out = normals[offsets <= survey.max_offset].sum(axis=0)
            out /= np.linalg.norm(out)
            reach = setup.common.standoff, walk.drop
            checks.append(PlaceCheck(place, face.plane.normal, *reach, face, (corner, out)))
    return checks


def _edge_checks(survey: PolyhedronSurvey, corners: Corners) -> list[PlaceCheck]:
    """Corners and middles of edges, except on the platform: there a rounded or cut edge shows."""
    faces = [set(face) for face in corners.faces]
    places: list[tuple[Floats, tuple[int, ...]]] = []  # with the faces that meet there
    for pair in combinations(range(1, len(faces)), 2):
        ends = sorted(faces[pair[0]] & faces[pair[1]])
        if len(ends) == 2:
            places.append((corners.places[ends].mean(axis=0), pair))
    for number, place in enumerate(corners.places):
        meeting = tuple(k for k, face in enumerate(faces) if number in face)
        if meeting and meeting[0] > 0:
            places.append((place, meeting))
    outward = [np.sum([survey.planes[k].normal for k in meeting], axis=0) for _, meeting in places]
    standoff = survey.setup.common.standoff
    return [
        PlaceCheck(place, out / np.linalg.norm(out), standoff, 2.0 * standoff, is_edge=True)
        for (place, _), out in zip(places, outward, strict=True)
    ]


def _inset_corners(ring: Floats, inset: float) -> Floats:
    """For each corner of a face a place (n, 3) on the face at distance `inset` from its edges [m].

    On a face that is too narrow for that, halfway from the corner to the middle.
    """
    after, before = np.roll(ring, -1, axis=0) - ring, np.roll(ring, 1, axis=0) - ring
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    sine = np.maximum(np.linalg.norm(np.cross(after, before), axis=1, keepdims=True), 0.1)
    shift = inset * (after + before) / sine
    to_middle = 0.5 * (ring.mean(axis=0) - ring)
    too_long = np.linalg.norm(shift, axis=1) > np.linalg.norm(to_middle, axis=1)
    return np.asarray(ring + np.where(too_long[:, None], to_middle, shift))


def _check_place(survey: PolyhedronSurvey, check: PlaceCheck) -> Generator[Move, MoveResult, None]:
    """Touch a place; where its face is missing, touch the face that cuts off its corner."""
    move = approach(check.place, check.outward, check.standoff, check.overshoot)
    contact = yield from survey.touch(move)
    if check.is_edge:
        if contact is not None:
            gap = -float(((contact.points - check.place) @ check.outward).max())
            survey.gaps.append((check.place, gap))
            survey.waiting += [contact] if gap > survey.settings.max_rim_gap else []
        return
    if contact is not None and (check.face is None or not len(survey.take(check.face, contact))):
        survey.waiting.append(contact)
        survey.refuted.append(check.place)
    if contact is None and check.corner is not None:
        corner, out = check.corner
        standoff = survey.setup.common.standoff
        contact = yield from survey.touch(approach(corner, out, standoff, 3.0 * standoff))
        if contact is not None:
            survey.waiting.append(contact)
            survey.refuted.append(check.place)


def _findings(survey: PolyhedronSurvey, corners: Corners) -> Findings:
    """The polyhedron, unless the touches refute it."""
    checks = _untouched_corners(survey, corners)
    _check_curved(survey)
    rms = _checked_rms(survey)
    _check_faces(survey, checks)
    try:
        polyhedron, numbers = polyhedron_of(corners)
    except ValueError as error:
        raise UnsuitedError(f"its faces do not close: {error}") from None
    touches, planes = (0, *(len(face.touches) for face in survey.faces)), survey.planes
    of_faces = tuple(planes[k] for k in numbers), tuple(touches[k] for k in numbers)
    model = BoundaryModel(corners.places, polyhedron, *of_faces, rms)
    mesh = polyhedron.mesh(0)
    rim_gap, farthest = _rim_gap(survey, corners), _farthest_untouched(survey, mesh)
    figures = {
        "faces": float(len(numbers)),
        "edges": float(len(polyhedron.edges.ends)),
        "vertices": float(polyhedron.edges.vertices),
        "volume_m3": polyhedron.volume,
        "residual_rms_m": rms,
        "normal_error_deg": math.degrees(max(face.fit.normal_error for face in survey.faces)),
        "untouched_corners": float(len(checks)),
        "rim_gap_m": rim_gap,
        "farthest_untouched_m": farthest,
    }
    reason = f"the polyhedron closes with {len(numbers)} faces"
    if rim_gap > survey.settings.max_rim_gap:
        reason += f", some of whose edges are cut or rounded by {1e3 * rim_gap:.1f} mm"
    reason += f"; no place of them is over {1e3 * farthest:.0f} mm from a touch"
    if checks:
        reason += f", but near {len(checks)} of their corners the finger has no room"
        return Findings(status="incomplete", reason=reason, figures=figures)
    return Findings(status="done", reason=reason, shape=model, mesh=mesh, figures=figures)


def _rim_gap(survey: PolyhedronSurvey, corners: Corners) -> float:
    """Largest distance of an edge or a corner from the touch on it [m]; 0 if there is none."""
    places = np.array([check.place for check in _edge_checks(survey, corners)]).reshape(-1, 3)
    nearest = (np.linalg.norm(places - place, axis=1).min() for place, _ in survey.gaps)
    gaps = zip(survey.gaps, nearest, strict=True)
    same_place = survey.settings.walk.same_place
    return max((gap for (_, gap), distance in gaps if distance < same_place), default=0.0)


def _farthest_untouched(survey: PolyhedronSurvey, mesh: Mesh) -> float:
    """Largest distance of a place on the faces, except the platform's, from all touches [m]."""
    settings, corners = survey.settings, mesh.vertices[mesh.faces]
    samples = sample_surface(corners, settings.n_samples, np.random.default_rng(0)).points
    above = samples[samples[:, 2] > survey.setup.platform + settings.same_offset]
    return float(np.max(point_tree(np.concatenate(survey.touched)).query(above)[0]))


def _checked_rms(survey: PolyhedronSurvey) -> float:
    """Root mean square distance of all touched points from their planes [m].

    Raises UnsuitedError if it, or the distance of one touch, is too large.
    """
    common, sigma = survey.setup.common, survey.setup.sigma
    counts = np.array([sum(map(len, face.touches)) for face in survey.faces])
    squares = np.array([face.fit.rms**2 for face in survey.faces])
    rms = math.sqrt(float(counts @ squares) / float(counts.sum()))
    worst = max(face.fit.worst for face in survey.faces)
    if rms > common.max_rms * sigma or worst > common.max_touch_error * sigma:
        raise UnsuitedError(
            f"its faces are not plane: {1e3 * rms:.3f} mm rms, {1e3 * worst:.3f} mm the worst touch"
            f", where one standard deviation is {1e3 * sigma:.3f} mm"
        )
    return rms


def _check_curved(survey: PolyhedronSurvey) -> None:
    """Raise UnsuitedError if a curved contact is on no rim between two faces."""
    for contact in survey.curved:
        depths = sorted(-plane.above(contact.middle[None])[0] for plane in survey.planes)
        if depths[1] > survey.settings.rim_depth:
            raise UnsuitedError(f"it is curved beside its edges{_curvature_text(survey)}")


def _check_faces(survey: PolyhedronSurvey, checks: list[PlaceCheck]) -> None:
    """Raise UnsuitedError if a face ends before its edge, or is missing at a place."""
    for face in survey.faces:
        for end, direction in face.ends:
            distance = _distance_to_edge(survey, face, end, direction)
            if distance > survey.setup.width:
                place, gap = millimetres(end), 1e3 * distance
                raise UnsuitedError(f"a face stops at {place}, {gap:.0f} mm before its edge")
    same_place = survey.settings.walk.same_place
    for check in checks:
        if any(np.linalg.norm(check.place - place) <= same_place for place in survey.refuted):
            place = millimetres(check.place)
            raise UnsuitedError(f"at {place} its planes predict a face that is not there")


def _distance_to_edge(
    survey: PolyhedronSurvey, face: Face, end: Floats, direction: Floats
) -> float:
    """Distance from a place of a face to its edge in one direction [m]."""
    least = survey.settings.walk.min_approach
    planes = (plane for plane in survey.planes if plane is not face.plane)
    return min(
        float((plane.offset - plane.normal @ end) / (plane.normal @ direction))
        for plane in planes
        if plane.normal @ direction > least
    )


def _curvature_text(survey: PolyhedronSurvey) -> str:
    """The radius of the curved contacts, in words; empty if there is none."""
    smooth = [contact for contact in survey.curved if contact.kind == "smooth"]
    curvatures = [max(map(abs, contact.curvatures)) for contact in smooth]
    curvatures = [curvature for curvature in curvatures if curvature > 0.0]
    if not curvatures:
        return ""
    return f": it is curved, with a radius of {1e3 / float(np.median(curvatures)):.0f} mm"
