"""Where to touch an end next, or that it is known well enough: a pure function.

The end is found by one touch along the axis, and by a few more uphill where that met a flank.
With a contour beside it, the face that closes it is touched where it is farthest from
everything touched so far, until no more is left than a pad would see beside it, or until
touches all over it lie in one plane, whose height they tell surely enough. Then the edge around
it, where the band that the contour's touches reached ends below the face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.probing.end_observation import (
    End,
    EndObservation,
    ProbeCommand,
    ProbeResult,
    SideContour,
    StopProbing,
    turned_command,
    turned_over,
)
from palpate.core.explore.probing.faces import (
    FOOT,
    EndFace,
    covers,
    expected_edge,
    fit_face,
    inner_outline,
    interior_point,
    is_plane,
    largest_untouched_disc,
    next_edge,
)
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.geometry import edge_distance, signed_area
from palpate.core.poses import FACING_DOWN, pad_rotation, pose_of, split_pose

MOST_BACK = 4  # Times that a touch which began inside the object is begun a pad's width farther off
MOST_FACE = 14  # Touches of one face
PLANE = 5  # Touches all over a face that are enough if they lie in one plane
# Of the tolerance: what a plane may add to the error of the whole surface, for the mean of its
# touches errs as their poses do.
SURE = 0.05
# Of the pad's width: radius of a disc in which nothing need be felt; and where the wall leans over
# the end, so that a smooth surface goes on from it.
SMALL, SMALL_ROUND = 0.35, 0.5
ROUND = 0.5  # Upward part of the wall's normals, on average, from which on it does
LEAN = math.radians(5.0)  # A face that leans less is touched along the slicing axis
MOST_LEAN = math.radians(45.0)
CLEARANCE = 5e-3  # Start of a touch over the highest point known, m
DEVIATIONS = 3.0  # Standard deviations by which an end may be higher than expected
MOST_RINGS = 3  # Rings of places around the axis at which an object is looked for
# Of the object's height: how far down a face is looked for. Farther inside nothing closes it.
DEEP = 0.5
# Where the surface leans less, a pole is under the pad: of a ridge that goes on beyond the pad,
# what touches leans little more.
SUMMIT_LEAN = math.radians(3.0)
# Of the pad's width: a place is not touched again that lies nearer to a touched one.
SAME_PLACE = 0.25
MOST_CLIMBS = 8  # Touches after which nobody climbs on


def next_probe(end: End, known: EndObservation) -> ProbeCommand | StopProbing:
    """Where to touch an end next.

    Parameters
    ----------
    end : {"upper", "lower"}
        Which end of the slicing axis.
    known : EndKnown
        What is known of it; call again with the answered touch among `known.probes`.

    Returns
    -------
    Probing or Done
        In the slicing frame. It ends after 40 touches at the latest.

    Raises
    ------
    ValueError
        If the end does not lie beyond the other one.
    """
    if (known.height > known.other) != (end == "upper"):
        raise ValueError(
            f"height of the {end} end must lie beyond the other one's {known.other} m, "
            f"got {known.height} m"
        )
    if end == "upper":
        return _upper(known)
    found = _upper(turned_over(known))
    return turned_command(found) if isinstance(found, ProbeCommand) else found


def _upper(known: EndObservation) -> ProbeCommand | StopProbing:
    if known.standing:
        return StopProbing("it stands on the platform", _below(known))
    again = _farther(known)
    if again is not None:
        return again
    if not known.found:
        return _search(known)
    if known.wall is None:
        higher = next_uphill(known.found, known.probes, known.width)
        return (
            StopProbing("the end is found", 0.0)
            if higher is None
            else probe_along_axis(known, higher)
        )
    faces = [one for one in known.found if one.probing.why != "edge"]
    if not faces:
        return StopProbing("only its edge was touched", 0.0)
    return _with_wall(known, known.wall, faces)


def _below(known: EndObservation) -> float:
    """Height between the platform and what was felt over it, m."""
    if known.wall is None:
        return 0.0
    return max(float((known.height - known.wall.contact_high).max()), 0.0)


def _farther(known: EndObservation) -> ProbeCommand | None:
    """The last touch from farther off, if it began inside the object."""
    back = 0
    for one in reversed(known.probes):
        if one.outcome != "inside":
            break
        back += 1
    if not 0 < back <= MOST_BACK:
        return None
    probing = known.probes[-1].probing
    position, axes = split_pose(probing.pose)
    pose = pose_of(position - known.width * axes[:, 2], axes)
    return probing._replace(pose=pose, reach=probing.reach + known.width)


def _search(known: EndObservation) -> ProbeCommand | StopProbing:
    """The next place at which the end is looked for."""
    if known.wall is None:
        places = end_search_places(known.radius, known.width)
        if len(known.probes) < len(places):
            return probe_along_axis(known, places[len(known.probes)])
        return StopProbing("nothing was felt", 2.0 * known.radius)
    if not known.probes:
        return probe_along_axis(known, interior_point(known.wall))
    outline = inner_outline(known.wall)
    gap = largest_untouched_disc(
        outline, np.stack([_place(one) for one in known.probes]), known.width
    )
    if gap.radius <= SMALL * known.width or len(known.probes) >= MOST_FACE:
        return StopProbing("nothing was felt", float(np.ptp(outline, axis=0).max()))
    return probe_along_axis(known, gap.place)


def end_search_places(radius: float, width: float) -> list[Floats]:
    """Places (2,) at which an end is looked for: the axis, then rings around it, m.

    Neighbouring ones are a pad's width apart, so that nothing wider is missed.
    """
    places = [np.zeros(2)]
    for ring in range(1, min(int(radius / width), MOST_RINGS) + 1):
        for azimuth in 2.0 * math.pi * np.arange(6 * ring) / (6 * ring):
            places.append(ring * width * np.array([math.cos(azimuth), math.sin(azimuth)]))
    return places


def _with_wall(
    known: EndObservation, wall: SideContour, faces: list[ProbeResult]
) -> ProbeCommand | StopProbing:
    """The next touch of an end that is found and has a contour beside it."""
    over = _over(faces, wall, known.width)
    if not over:
        first = _first_over(known, wall)
        if first is not None:
            return first
    told = over or faces
    face = fit_face(told, known.width)
    plane = is_plane(face, told, wall, known.allowed)
    wanted = _next_face(known, wall, face, told, plane)
    if isinstance(wanted, ProbeCommand):
        return wanted
    edges = [one for one in known.probes if one.probing.why == "edge"]
    touched = np.stack([one.point for one in faces])
    top = max(float(touched[:, 2].max()), known.height) + known.allowed
    edge = expected_edge(face, wall, touched, FOOT * known.width, top)
    rest = next_edge(edge, edges, known.width, known.allowed)
    if isinstance(rest, ProbeCommand):
        return rest
    return StopProbing(_reason(known, plane, len(told), wanted), max(wanted, rest))


def _over(faces: list[ProbeResult], wall: SideContour, width: float) -> list[ProbeResult]:
    """Touches of the face that the contour lies around: others met a flank beside it."""
    places = np.stack([one.point[:2] for one in faces])
    inside = covers(wall, places, FOOT * width)
    return [one for one, is_in in zip(faces, inside, strict=True) if is_in]


def _first_over(known: EndObservation, wall: SideContour) -> ProbeCommand | None:
    """A touch of the face's middle, unless that was made and met nothing there."""
    place = interior_point(wall)
    made = [one.probing.pose[:2] for one in known.probes if one.probing.why != "edge"]
    if min(np.linalg.norm(place - one) for one in made) <= FOOT * known.width:
        return None
    return probe_along_axis(known, place)._replace(why="face")


def _next_face(
    known: EndObservation, wall: SideContour, face: EndFace, faces: list[ProbeResult], plane: bool
) -> ProbeCommand | float:
    """The next touch of the face, or the width that stays unfelt, m."""
    made = [one for one in known.probes if one.probing.why != "edge"]
    gap = largest_untouched_disc(
        inner_outline(wall), np.stack([_place(one) for one in made]), known.width
    )
    unfelt = max(2.0 * gap.radius, 0.0)
    leans = float(wall.normals[:, 2].mean()) > ROUND
    if len(made) >= MOST_FACE:
        return unfelt
    summit = next_uphill(faces, made, known.width) if leans or not plane else None
    if summit is not None and covers(wall, summit[None], FOOT * known.width)[0]:
        return probe_along_axis(known, summit)._replace(why="face")
    small = gap.radius <= (SMALL_ROUND if leans else SMALL) * known.width
    enough = len(faces) >= PLANE
    felt = small or (plane and not leans and enough)
    # The mean of more touches tells the height of a flat face on which a whole pad lies.
    middle = interior_point(wall)
    wide = float(edge_distance(inner_outline(wall), middle[None])[0]) > FOOT * known.width
    flat = plane and (enough or not leans)
    sure = not (flat and wide) or len(faces) >= _asked_by_noise(known, wall)
    if felt and sure:
        return unfelt
    return _onto(known, face, middle if small else gap.place)


def _place(one: ProbeResult) -> Floats:
    """Where a touch of the face was, (2,), m; under the pad's way if it met nothing."""
    return one.point[:2] if one.touched else one.probing.pose[:2]


def next_uphill(
    touches: Sequence[ProbeResult], made: Sequence[ProbeResult], width: float
) -> Floats | None:
    """The next place (2,) on the way up, m; None at the top.

    Parameters
    ----------
    touches : sequence of Probed
        At least one, that touched something: the highest of them tells where the way up goes.
    made : sequence of Probed
        All touches, those that met nothing, too: no place is tried twice.
    width : float
        Of the pad, m: a step goes as far as it feels.
    """
    highest = max(touches, key=lambda one: float(one.point[2]))
    level = float(np.linalg.norm(highest.normal[:2]))
    if not level > math.sin(SUMMIT_LEAN) or len(made) >= MOST_CLIMBS:
        return None
    place = highest.point[:2] - FOOT * width / level * highest.normal[:2]
    tried = [one.probing.pose[:2] for one in made]
    tried += [one.point[:2] for one in made if one.touched]
    away = np.linalg.norm(np.stack(tried) - place, axis=1)
    return place if away.min() > SAME_PLACE * width else None


def probe_along_axis(known: EndObservation, place: Floats) -> ProbeCommand:
    """A touch over a place (2,), along the slicing axis, that nothing known is in the way of."""
    start = highest_expected(known) + CLEARANCE + TOUCH_DEPTH
    lowest = known.height - DEEP * (known.height - known.other)
    pose = pose_of(np.array([place[0], place[1], start]), FACING_DOWN)
    return ProbeCommand(
        pose, start - lowest, "search", np.array([place[0], place[1], known.height])
    )


def _asked_by_noise(known: EndObservation, wall: SideContour) -> float:
    """Touches that tell the height of a plane: the more, the more of the surface it is."""
    outline = inner_outline(wall)
    area = abs(signed_area(outline))
    around = float(np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum())
    whole = 2.0 * area + around * (known.height - known.other)
    return area / whole * (known.noise / (SURE * known.tolerance)) ** 2


def _onto(known: EndObservation, face: EndFace, place: Floats) -> ProbeCommand:
    """A touch of a place (2,) of the face, along the axis or, where it leans, its normal."""
    normal = face.normal
    lean = math.acos(min(float(normal[2]), 1.0))
    target = np.array([*place, face.at(place[None])[0]])
    axes = FACING_DOWN
    if lean > LEAN:
        tilt = 0.5 * math.pi - min(lean, MOST_LEAN)
        axes = pad_rotation(math.atan2(normal[1], normal[0]), tilt)
    standoff = max(highest_expected(known) - float(target[2]), 0.0) + CLEARANCE
    start = target - standoff * axes[:, 2]
    reach = standoff + DEEP * (known.height - known.other)
    return ProbeCommand(pose_of(start, axes), reach, "face", target)


def highest_expected(known: EndObservation) -> float:
    """The highest that anything is known to be, or may be while the end is not found, m."""
    felt = [float(one.point[2]) for one in known.found]
    if known.wall is not None:
        felt.append(float(known.wall.contact_high.max()))
    if not known.found:
        felt.append(known.height + DEVIATIONS * known.deviation)
    return max(felt)


def _reason(known: EndObservation, plane: bool, count: int, unfelt: float) -> str:
    if unfelt > 2.0 * SMALL_ROUND * known.width and not (plane and count >= PLANE):
        return f"{count} touches have not felt all of it"
    if plane and count >= PLANE:
        return f"{count} touches lie in one plane"
    return "nothing larger than a pad is unfelt"
