"""Where to touch an end next, or that it is known well enough: a pure function.

The end is found by one touch along the axis, and by a few more uphill where that met a flank. With
a contour beside it, the face that closes it is touched where it is farthest from everything touched
so far, until no more is left than a pad would see beside it, or until touches all over it lie in
one plane, whose height they tell surely enough. Then the edge around it, where the band that the
contour's touches reached ends below the face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import search_places
from palpate.core.explore.probing import ends
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.geometry import edge_distance, signed_area
from palpate.core.poses import FACING_DOWN, Pose, pad_rotation

MOST_BACK = 4  # Times that a touch which began inside the object is begun a pad's width farther off
MOST_FACE = 14  # Touches of one face
PLANE = 5  # Touches all over a face that are enough if they lie in one plane
# Of the tolerance: what a plane may add to the error of the whole surface, for the mean of its
# touches errs as their poses do.
SURE = 0.05
# Of the pad's width: radius of a disc in which nothing need be touched; and where the wall leans
# over the end, so that a smooth surface goes on from it.
SMALL, SMALL_ROUND = 0.35, 0.5
ROUND = 0.5  # Upward part of the wall's normals, on average, from which on it does
LEAN = math.radians(5.0)  # A face that leans less is touched along the slicing axis
MOST_LEAN = math.radians(45.0)
CLEARANCE = 5e-3  # Start of a touch over the highest point known, m
DEVIATIONS = 3.0  # Standard deviations by which an end may be higher than expected
MOST_RINGS = 3  # Rings of places around the axis at which an object is looked for
DEEP = 0.5  # Of the object's height: how far down a face is looked for: deeper nothing closes it
# Where the surface leans less, a pole is under the pad: of a ridge that goes on beyond the pad,
# what touches leans little more.
SUMMIT_LEAN = math.radians(3.0)
SAME_PLACE = 0.25  # Of the pad's width: a place nearer to a touched one is not touched again
MOST_CLIMBS = 8  # Touches after which nobody climbs on


def next_probe(
    end: ends.End, observation: ends.EndObservation
) -> ends.ProbeCommand | ends.StopProbing:
    """Where to touch an end next.

    To be called again with the answered touch among `observation.probes`. In the slicing frame. It
    ends after 40 touches at the latest. Raises ValueError if the end does not lie beyond the other.
    """
    if (observation.height > observation.other) != (end == "upper"):
        raise ValueError(
            f"height of the {end} end must lie beyond the other one's {observation.other} m, "
            f"got {observation.height} m"
        )
    if end == "upper":
        return _upper(observation)
    found = _upper(ends.turned_over(observation))
    return ends.turned_command(found) if isinstance(found, ends.ProbeCommand) else found


def _upper(observation: ends.EndObservation) -> ends.ProbeCommand | ends.StopProbing:
    if observation.standing:
        return ends.StopProbing("it stands on the platform", _below(observation))
    again = _farther(observation)
    if again is not None:
        return again
    if not observation.hits:
        return _search(observation)
    if observation.contour is None:
        higher = next_uphill(observation.hits, observation.probes, observation.width)
        if higher is None:
            return ends.StopProbing("the end is found", 0.0)
        return probe_along_axis(observation, higher)
    faces = [one for one in observation.hits if one.probing.reason != "edge"]
    if not faces:
        return ends.StopProbing("only its edge was touched", 0.0)
    return _with_wall(observation, observation.contour, faces)


def _below(observation: ends.EndObservation) -> float:
    """Height between the platform and what was touched over it, m."""
    if observation.contour is None:
        return 0.0
    return max(float((observation.height - observation.contour.contact_high).max()), 0.0)


def _farther(observation: ends.EndObservation) -> ends.ProbeCommand | None:
    """The last touch from farther off, if it began inside the object."""
    back = 0
    for one in reversed(observation.probes):
        if one.outcome != "inside":
            break
        back += 1
    if not 0 < back <= MOST_BACK:
        return None
    probing = observation.probes[-1].probing
    width = observation.width
    return probing._replace(pose=probing.pose.advanced(-width), reach=probing.reach + width)


def _search(observation: ends.EndObservation) -> ends.ProbeCommand | ends.StopProbing:
    """The next place at which the end is looked for."""
    if observation.contour is None:
        places = search_places(observation.radius, observation.width, MOST_RINGS)
        if len(observation.probes) < len(places):
            return probe_along_axis(observation, places[len(observation.probes)])
        return ends.StopProbing("nothing was touched", 2.0 * observation.radius)
    if not observation.probes:
        return probe_along_axis(observation, ends.interior_point(observation.contour))
    outline = ends.inner_outline(observation.contour)
    touched = np.stack([_place(one) for one in observation.probes])
    gap = ends.largest_untouched_disc(outline, touched, observation.width)
    if gap.radius <= SMALL * observation.width or len(observation.probes) >= MOST_FACE:
        return ends.StopProbing("nothing was touched", float(np.ptp(outline, axis=0).max()))
    return probe_along_axis(observation, gap.place)


def _with_wall(
    observation: ends.EndObservation, contour: ends.SideContour, faces: list[ends.ProbeResult]
) -> ends.ProbeCommand | ends.StopProbing:
    """The next touch of an end that is found and has a contour beside it."""
    over = _over(faces, contour, observation.width)
    if not over:
        first = _first_over(observation, contour)
        if first is not None:
            return first
    told = over or faces
    face = ends.fit_face(told, observation.width)
    plane = ends.is_plane(face, told, contour, observation.allowed)
    wanted = _next_face(observation, contour, face, told, plane)
    if isinstance(wanted, ends.ProbeCommand):
        return wanted
    edges = [one for one in observation.probes if one.probing.reason == "edge"]
    touched = np.stack([one.point for one in faces])
    top = max(float(touched[:, 2].max()), observation.height) + observation.allowed
    edge = ends.expected_edge(face, contour, touched, ends.FOOT * observation.width, top)
    rest = ends.next_edge(edge, edges, observation.width, observation.allowed)
    if isinstance(rest, ends.ProbeCommand):
        return rest
    return ends.StopProbing(_reason(observation, plane, len(told), wanted), max(wanted, rest))


def _over(
    faces: list[ends.ProbeResult], contour: ends.SideContour, width: float
) -> list[ends.ProbeResult]:
    """Touches of the face that the contour lies around: others met a flank beside it."""
    inside = ends.covers(contour, np.stack([one.point[:2] for one in faces]), ends.FOOT * width)
    return [one for one, is_in in zip(faces, inside, strict=True) if is_in]


def _first_over(
    observation: ends.EndObservation, contour: ends.SideContour
) -> ends.ProbeCommand | None:
    """A touch of the face's middle, unless that was made and met nothing there."""
    place = ends.interior_point(contour)
    made = [
        one.probing.pose.position[:2] for one in observation.probes if one.probing.reason != "edge"
    ]
    if min(np.linalg.norm(place - one) for one in made) <= ends.FOOT * observation.width:
        return None
    return probe_along_axis(observation, place)._replace(reason="face")


def _next_face(
    observation: ends.EndObservation,
    contour: ends.SideContour,
    face: ends.EndFace,
    faces: list[ends.ProbeResult],
    plane: bool,
) -> ends.ProbeCommand | float:
    """The next touch of the face, or the width that stays untouched, m."""
    made = [one for one in observation.probes if one.probing.reason != "edge"]
    touched = np.stack([_place(one) for one in made])
    gap = ends.largest_untouched_disc(ends.inner_outline(contour), touched, observation.width)
    untouched = max(2.0 * gap.radius, 0.0)
    leans = float(contour.normals[:, 2].mean()) > ROUND
    if len(made) >= MOST_FACE:
        return untouched
    summit = next_uphill(faces, made, observation.width) if leans or not plane else None
    if summit is not None and ends.covers(contour, summit[None], ends.FOOT * observation.width)[0]:
        return probe_along_axis(observation, summit)._replace(reason="face")
    small = gap.radius <= (SMALL_ROUND if leans else SMALL) * observation.width
    enough = len(faces) >= PLANE
    covered = small or (plane and not leans and enough)
    # The mean of more touches tells the height of a flat face on which a whole pad lies.
    middle = ends.interior_point(contour)
    wide = (
        float(edge_distance(ends.inner_outline(contour), middle[None])[0])
        > ends.FOOT * observation.width
    )
    flat = plane and (enough or not leans)
    sure = not (flat and wide) or len(faces) >= _asked_by_noise(observation, contour)
    if covered and sure:
        return untouched
    return _onto(observation, face, middle if small else gap.place)


def _place(one: ends.ProbeResult) -> Floats:
    """Where a touch of the face was, (2,), m; under the pad's way if it met nothing."""
    return one.point[:2] if one.touched else one.probing.pose.position[:2]


def next_uphill(
    touches: Sequence[ends.ProbeResult], made: Sequence[ends.ProbeResult], width: float
) -> Floats | None:
    """The next place (2,) on the way up, m; None at the top."""
    highest = max(touches, key=lambda one: float(one.point[2]))
    level = float(np.linalg.norm(highest.normal[:2]))
    if not level > math.sin(SUMMIT_LEAN) or len(made) >= MOST_CLIMBS:
        return None
    place = highest.point[:2] - ends.FOOT * width / level * highest.normal[:2]
    tried = [one.probing.pose.position[:2] for one in made]
    tried += [one.point[:2] for one in made if one.touched]
    away = np.linalg.norm(np.stack(tried) - place, axis=1)
    return place if away.min() > SAME_PLACE * width else None


def probe_along_axis(observation: ends.EndObservation, place: Floats) -> ends.ProbeCommand:
    """A touch over a place (2,), along the slicing axis, that nothing known is in the way of."""
    start = highest_expected(observation) + CLEARANCE + TOUCH_DEPTH
    lowest = observation.height - DEEP * (observation.height - observation.other)
    pose = Pose(np.array([*place, start]), FACING_DOWN)
    return ends.ProbeCommand(pose, start - lowest, "search", np.array([*place, observation.height]))


def _asked_by_noise(observation: ends.EndObservation, contour: ends.SideContour) -> float:
    """Touches that tell the height of a plane: the more, the more of the surface it is."""
    outline = ends.inner_outline(contour)
    area = abs(signed_area(outline))
    around = float(np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum())
    whole = 2.0 * area + around * (observation.height - observation.other)
    return area / whole * (observation.noise / (SURE * observation.tolerance)) ** 2


def _onto(observation: ends.EndObservation, face: ends.EndFace, place: Floats) -> ends.ProbeCommand:
    """A touch of a place (2,) of the face, along the axis or, where it leans, its normal."""
    normal = face.normal
    lean = math.acos(min(float(normal[2]), 1.0))
    target = np.array([*place, face.at(place[None])[0]])
    axes = FACING_DOWN
    if lean > LEAN:
        tilt = 0.5 * math.pi - min(lean, MOST_LEAN)
        axes = pad_rotation(math.atan2(normal[1], normal[0]), tilt)
    standoff = max(highest_expected(observation) - float(target[2]), 0.0) + CLEARANCE
    start = target - standoff * axes[:, 2]
    reach = standoff + DEEP * (observation.height - observation.other)
    return ends.ProbeCommand(Pose(start, axes), reach, "face", target)


def highest_expected(observation: ends.EndObservation) -> float:
    """The highest that anything is known to be, or may be while the end is not found, m."""
    heights = [float(one.point[2]) for one in observation.hits]
    if observation.contour is not None:
        heights.append(float(observation.contour.contact_high.max()))
    if not observation.hits:
        heights.append(observation.height + DEVIATIONS * observation.deviation)
    return max(heights)


def _reason(observation: ends.EndObservation, plane: bool, count: int, untouched: float) -> str:
    if untouched > 2.0 * SMALL_ROUND * observation.width and not (plane and count >= PLANE):
        return f"{count} touches have not reached all of it"
    if plane and count >= PLANE:
        return f"{count} touches lie in one plane"
    return "nothing larger than a pad is untouched"
