"""Where to touch an end next, or that it is felt well enough: a pure function of what is known.

The end is found by one touch along the axis, and by a few more uphill where that met a flank. With
a contour beside it, the face that closes it is felt where it is farthest from everything felt so
far, until no more is left than a pad would see beside it, or until touches all over it lie in one
plane, whose height they tell surely enough. Then the edge around it, where the band that the
contour felt ends below the face.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.probing.edge import expected_edge, next_edge
from palpate.core.explore.probing.face import FOOT, Face, fit_face, is_plane
from palpate.core.explore.probing.known import (
    Done,
    End,
    EndKnown,
    Probed,
    Probing,
    Wall,
    turned_over,
    turned_probing,
)
from palpate.core.explore.probing.places import covers, heart, inner_outline, largest_gap
from palpate.core.explore.probing.search import (
    CLEARANCE,
    DEEP,
    along_axis,
    highest_known,
    search_places,
)
from palpate.core.explore.probing.summit import uphill
from palpate.core.frames import DOWN, pad_rotation, pose_of, split_pose
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.signed_area import signed_area

MOST_BACK = 4
"""Times that a touch which began inside the object is begun a pad's width farther off."""
MOST_FACE = 14
"""Touches of one face."""
PLANE = 5
"""Touches all over a face that are enough if they lie in one plane."""
SURE = 0.05
"""Of the tolerance: what a plane may add to the error of the whole surface, for the mean of its
touches errs as their poses do."""
SMALL, SMALL_ROUND = 0.35, 0.5
"""Of the pad's width: radius of a disc in which nothing need be felt; and where the wall leans over
the end, so that a smooth surface goes on from it."""
ROUND = 0.5
"""Upward part of the wall's normals, on average, from which on it does."""
LEAN = math.radians(5.0)
"""A face that leans less is touched along the slicing axis."""
MOST_LEAN = math.radians(45.0)


def next_probe(end: End, known: EndKnown) -> Probing | Done:
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
    return turned_probing(found) if isinstance(found, Probing) else found


def _upper(known: EndKnown) -> Probing | Done:
    if known.standing:
        return Done("it stands on the platform", _below(known))
    again = _farther(known)
    if again is not None:
        return again
    if not known.found:
        return _search(known)
    if known.wall is None:
        higher = uphill(known.found, known.probes, known.width)
        return Done("the end is found", 0.0) if higher is None else along_axis(known, higher)
    faces = [one for one in known.found if one.probing.why != "edge"]
    if not faces:
        return Done("only its edge was touched", 0.0)
    return _with_wall(known, known.wall, faces)


def _with_wall(known: EndKnown, wall: Wall, faces: list[Probed]) -> Probing | Done:
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
    if isinstance(wanted, Probing):
        return wanted
    edges = [one for one in known.probes if one.probing.why == "edge"]
    touched = np.stack([one.point for one in faces])
    top = max(float(touched[:, 2].max()), known.height) + known.allowed
    edge = expected_edge(face, wall, touched, FOOT * known.width, top)
    rest = next_edge(edge, edges, known.width, known.allowed)
    if isinstance(rest, Probing):
        return rest
    return Done(_reason(known, plane, len(told), wanted), max(wanted, rest))


def _over(faces: list[Probed], wall: Wall, width: float) -> list[Probed]:
    """Touches of the face that the contour lies around: others met a flank beside it."""
    places = np.stack([one.point[:2] for one in faces])
    inside = covers(wall, places, FOOT * width)
    return [one for one, is_in in zip(faces, inside, strict=True) if is_in]


def _first_over(known: EndKnown, wall: Wall) -> Probing | None:
    """A touch of the face's middle, unless that was made and met nothing there."""
    place = heart(wall)
    made = [one.probing.pose[:2] for one in known.probes if one.probing.why != "edge"]
    if min(np.linalg.norm(place - one) for one in made) <= FOOT * known.width:
        return None
    return along_axis(known, place)._replace(why="face")


def _next_face(
    known: EndKnown, wall: Wall, face: Face, faces: list[Probed], plane: bool
) -> Probing | float:
    """The next touch of the face, or the width that stays unfelt, m."""
    made = [one for one in known.probes if one.probing.why != "edge"]
    gap = largest_gap(inner_outline(wall), np.stack([_place(one) for one in made]), known.width)
    unfelt = max(2.0 * gap.radius, 0.0)
    leans = float(wall.normals[:, 2].mean()) > ROUND
    if len(made) >= MOST_FACE:
        return unfelt
    summit = uphill(faces, made, known.width) if leans or not plane else None
    if summit is not None and covers(wall, summit[None], FOOT * known.width)[0]:
        return along_axis(known, summit)._replace(why="face")
    small = gap.radius <= (SMALL_ROUND if leans else SMALL) * known.width
    enough = len(faces) >= PLANE
    felt = small or (plane and not leans and enough)
    # The mean of more touches tells the height of a flat face on which a whole pad lies.
    middle = heart(wall)
    wide = float(edge_distance(inner_outline(wall), middle[None])[0]) > FOOT * known.width
    flat = plane and (enough or not leans)
    sure = not (flat and wide) or len(faces) >= _asked_by_noise(known, wall)
    if felt and sure:
        return unfelt
    return _onto(known, face, middle if small else gap.place)


def _asked_by_noise(known: EndKnown, wall: Wall) -> float:
    """Touches that tell the height of a plane: the more, the more of the surface it is."""
    outline = inner_outline(wall)
    area = abs(signed_area(outline))
    around = float(np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum())
    whole = 2.0 * area + around * (known.height - known.other)
    return area / whole * (known.noise / (SURE * known.tolerance)) ** 2


def _search(known: EndKnown) -> Probing | Done:
    """The next place at which the end is looked for."""
    if known.wall is None:
        places = search_places(known.radius, known.width)
        if len(known.probes) < len(places):
            return along_axis(known, places[len(known.probes)])
        return Done("nothing was felt", 2.0 * known.radius)
    if not known.probes:
        return along_axis(known, heart(known.wall))
    outline = inner_outline(known.wall)
    gap = largest_gap(outline, np.stack([_place(one) for one in known.probes]), known.width)
    if gap.radius <= SMALL * known.width or len(known.probes) >= MOST_FACE:
        return Done("nothing was felt", float(np.ptp(outline, axis=0).max()))
    return along_axis(known, gap.place)


def _farther(known: EndKnown) -> Probing | None:
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


def _onto(known: EndKnown, face: Face, place: Floats) -> Probing:
    """A touch of a place (2,) of the face, along the axis or, where it leans, its normal."""
    normal = face.normal
    lean = math.acos(min(float(normal[2]), 1.0))
    target = np.array([*place, face.at(place[None])[0]])
    axes = DOWN
    if lean > LEAN:
        tilt = 0.5 * math.pi - min(lean, MOST_LEAN)
        axes = pad_rotation(math.atan2(normal[1], normal[0]), tilt)
    standoff = max(highest_known(known) - float(target[2]), 0.0) + CLEARANCE
    start = target - standoff * axes[:, 2]
    reach = standoff + DEEP * (known.height - known.other)
    return Probing(pose_of(start, axes), reach, "face", target)


def _place(one: Probed) -> Floats:
    """Where a touch of the face was, (2,), m; under the pad's way if it met nothing."""
    return one.point[:2] if one.touched else one.probing.pose[:2]


def _below(known: EndKnown) -> float:
    """Height between the platform and what was felt over it, m."""
    if known.wall is None:
        return 0.0
    return max(float((known.height - known.wall.felt_high).max()), 0.0)


def _reason(known: EndKnown, plane: bool, count: int, unfelt: float) -> str:
    if unfelt > 2.0 * SMALL_ROUND * known.width and not (plane and count >= PLANE):
        return f"{count} touches have not felt all of it"
    if plane and count >= PLANE:
        return f"{count} touches lie in one plane"
    return "nothing larger than a pad is unfelt"
