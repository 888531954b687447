"""Where to touch an end next, or that it is known well enough: a pure function.

The end is found by one touch along the axis, and by a few more uphill where that met a flank. With
a contour beside it, the face that closes it is touched where it is farthest from all touches so
far, until every untouched stretch is smaller than what a pad touches, or until touches all over the
face lie in one plane and their mean height is accurate enough. Then the edge around it is touched,
where the band that the contour's touches reached ends below the face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import search_places
from palpate.core.explore.probing import ends
from palpate.core.explore.tracing import TOUCH_DEPTH
from palpate.core.geometry import edge_distance, signed_area
from palpate.core.poses import FACING_DOWN, Pose, pad_rotation


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSettings:
    """From where an end is touched, and where it is looked for."""

    clearance: float = 5e-3  # [m] of a touch's start over the highest known point
    max_deviations: float = 3.0  # [standard deviations] by which an end may lie above `height`
    # [height of the object] below the end, down to which a face can close it.
    max_depth: float = 0.5
    max_retreats: int = 4  # of a touch that began inside the object, each by a pad's width
    max_rings: int = 3  # of places around the axis where the end is looked for


@dataclass(frozen=True, slots=True, kw_only=True)
class ClimbSettings:
    """How the highest point is looked for uphill."""

    # [rad] of the normal at the highest touch, below which the pole is under the pad. Touches of a
    # ridge that continues beyond the pad lean only a little more.
    max_summit_lean: float = math.radians(3.0)
    min_distance: float = 0.25  # [widths of the pad] from a touched place to the next one
    max_touches: int = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverSettings:
    """When a face is touched enough, and how it is touched."""

    max_touches: int = 14  # of the face
    n_plane: int = 5  # touches spread over a face that are enough if they lie in one plane
    # [tolerance] share of the whole surface's error that a plane may add: its height is the mean of
    # touches, each with the error of its pose.
    max_error: float = 0.05
    max_radius: float = 0.35  # [widths of the pad] of the largest disc that may stay untouched
    max_round_radius: float = 0.5  # [widths of the pad] the same, of a round end
    min_round_rise: float = 0.5  # mean upward part of the wall's normals, above which it is round
    min_lean: float = math.radians(5.0)  # [rad] of a face; beyond it, touches are along its normal
    max_lean: float = math.radians(45.0)  # [rad] of the pad
    n_deviations: float = 3.0  # [`noise`] by which heights of one face may differ beyond tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbingSettings:
    """How the ends of an object are touched."""

    approach: ApproachSettings = ApproachSettings()
    climb: ClimbSettings = ClimbSettings()
    cover: CoverSettings = CoverSettings()
    face: ends.FaceSettings = field(default_factory=ends.FaceSettings)
    edge: ends.EdgeSettings = field(default_factory=ends.EdgeSettings)


def next_probe(
    end: ends.End, observation: ends.EndObservation, settings: ProbingSettings = ProbingSettings()
) -> ends.ProbeCommand | ends.StopProbing:
    """Where to touch an end next, in the slicing frame, or that it is touched enough.

    Each result of a command is appended to `observation.probes` before the next call. Probing stops
    after 40 touches at the latest. Raises ValueError if the end does not lie beyond the other.
    """
    if (observation.height > observation.other_height) != (end == "upper"):
        raise ValueError(
            f"height of the {end} end must lie beyond the other one's "
            f"{observation.other_height} m, got {observation.height} m"
        )
    if end == "upper":
        return _upper(observation, settings)
    choice = _upper(ends.turned_over(observation), settings)
    return ends.turned_command(choice) if isinstance(choice, ends.ProbeCommand) else choice


def _upper(
    observation: ends.EndObservation, settings: ProbingSettings
) -> ends.ProbeCommand | ends.StopProbing:
    """The next touch of an upper end."""
    if observation.is_standing:
        return ends.StopProbing("it stands on the platform", _height_over_platform(observation))
    retreat = _farther_off(observation, settings.approach)
    if retreat is not None:
        return retreat
    if not observation.hits:
        return _search(observation, settings)
    if observation.contour is None:
        higher = next_uphill(observation.hits, observation.probes, observation.width, settings)
        if higher is None:
            return ends.StopProbing("the end is found", 0.0)
        return probe_along_axis(observation, higher, settings.approach)
    faces = [hit for hit in observation.hits if hit.command.reason != "edge"]
    if not faces:
        return ends.StopProbing("only its edge was touched", 0.0)
    return _with_wall(observation, observation.contour, faces, settings)


def _height_over_platform(observation: ends.EndObservation) -> float:
    """Height between the platform and what was touched over it [m]."""
    if observation.contour is None:
        return 0.0
    return max(float((observation.height - observation.contour.contact_high).max()), 0.0)


def _farther_off(
    observation: ends.EndObservation, settings: ApproachSettings
) -> ends.ProbeCommand | None:
    """The last touch repeated from farther off, if it began inside the object."""
    n_inside = 0
    for probe in reversed(observation.probes):
        if probe.outcome != "inside":
            break
        n_inside += 1
    if not 0 < n_inside <= settings.max_retreats:
        return None
    command = observation.probes[-1].command
    width = observation.width
    return command._replace(pose=command.pose.advanced(-width), reach=command.reach + width)


def _search(
    observation: ends.EndObservation, settings: ProbingSettings
) -> ends.ProbeCommand | ends.StopProbing:
    """The next place at which the end is looked for."""
    approach, cover = settings.approach, settings.cover
    if observation.contour is None:
        places = search_places(observation.radius, observation.width, approach.max_rings)
        if len(observation.probes) < len(places):
            return probe_along_axis(observation, places[len(observation.probes)], approach)
        return ends.StopProbing("nothing was touched", 2.0 * observation.radius)
    if not observation.probes:
        return probe_along_axis(observation, ends.interior_point(observation.contour), approach)
    outline = ends.inner_outline(observation.contour, settings.face)
    touched = np.stack([_place(probe) for probe in observation.probes])
    gap = ends.largest_untouched_disc(outline, touched, observation.width, settings.face)
    is_spent = len(observation.probes) >= cover.max_touches
    if gap.radius <= cover.max_radius * observation.width or is_spent:
        return ends.StopProbing("nothing was touched", float(np.ptp(outline, axis=0).max()))
    return probe_along_axis(observation, gap.place, approach)


def _with_wall(
    observation: ends.EndObservation,
    contour: ends.SideContour,
    touches: list[ends.ProbeResult],
    settings: ProbingSettings,
) -> ends.ProbeCommand | ends.StopProbing:
    """The next touch of an end that is found and has a contour beside it."""
    touch_radius = settings.face.touch_radius * observation.width
    covered = _covered(touches, contour, touch_radius)
    if not covered:
        first = _first_over(observation, contour, touch_radius, settings.approach)
        if first is not None:
            return first
    faces = covered or touches
    face = ends.fit_face(faces, observation.width, settings.face)
    tolerance = observation.tolerance + settings.cover.n_deviations * observation.noise
    is_plane = ends.is_plane(face, faces, contour, tolerance, settings.face)
    next_face = _next_face(observation, contour, face, faces, is_plane, settings)
    if isinstance(next_face, ends.ProbeCommand):
        return next_face
    made = [probe for probe in observation.probes if probe.command.reason == "edge"]
    points = np.stack([touch.point for touch in touches])
    top = max(float(points[:, 2].max()), observation.height) + tolerance
    edge = ends.expected_edge(face, contour, points, touch_radius, top, settings.edge)
    next_edge = ends.next_edge(edge, made, observation.width, tolerance, settings.edge)
    if isinstance(next_edge, ends.ProbeCommand):
        return next_edge
    reason = _reason(observation, is_plane, len(faces), next_face, settings.cover)
    return ends.StopProbing(reason, max(next_face, next_edge))


def _covered(
    touches: list[ends.ProbeResult], contour: ends.SideContour, margin: float
) -> list[ends.ProbeResult]:
    """Touches of the face that the contour lies around: others met a flank beside it."""
    inside = ends.covers(contour, np.stack([touch.point[:2] for touch in touches]), margin)
    return [touch for touch, is_inside in zip(touches, inside, strict=True) if is_inside]


def _first_over(
    observation: ends.EndObservation,
    contour: ends.SideContour,
    touch_radius: float,
    settings: ApproachSettings,
) -> ends.ProbeCommand | None:
    """A touch of the face's middle, unless that was made and met nothing there."""
    place = ends.interior_point(contour)
    tried = [
        probe.command.pose.position[:2]
        for probe in observation.probes
        if probe.command.reason != "edge"
    ]
    if min(np.linalg.norm(place - other) for other in tried) <= touch_radius:
        return None
    return probe_along_axis(observation, place, settings)._replace(reason="face")


def _next_face(
    observation: ends.EndObservation,
    contour: ends.SideContour,
    face: ends.EndFace,
    faces: list[ends.ProbeResult],
    is_plane: bool,
    settings: ProbingSettings,
) -> ends.ProbeCommand | float:
    """The next touch of the face, or the width that stays untouched [m]."""
    width, cover = observation.width, settings.cover
    made = [probe for probe in observation.probes if probe.command.reason != "edge"]
    touched = np.stack([_place(probe) for probe in made])
    outline = ends.inner_outline(contour, settings.face)
    gap = ends.largest_untouched_disc(outline, touched, width, settings.face)
    untouched = max(2.0 * gap.radius, 0.0)
    is_round = float(contour.normals[:, 2].mean()) > cover.min_round_rise
    if len(made) >= cover.max_touches:
        return untouched
    touch_radius = settings.face.touch_radius * width
    summit = next_uphill(faces, made, width, settings) if is_round or not is_plane else None
    if summit is not None and ends.covers(contour, summit[None], touch_radius)[0]:
        return probe_along_axis(observation, summit, settings.approach)._replace(reason="face")
    is_small = gap.radius <= (cover.max_round_radius if is_round else cover.max_radius) * width
    has_plane = is_plane and len(faces) >= cover.n_plane
    is_covered = is_small or (has_plane and not is_round)
    middle = ends.interior_point(contour)
    # The mean of more touches has a smaller error, on a flat face on which a whole pad lies.
    is_wide = float(edge_distance(outline, middle[None])[0]) > touch_radius
    is_flat = has_plane or (is_plane and not is_round)
    needs_mean = is_flat and is_wide
    if is_covered and (
        not needs_mean or len(faces) >= _touches_for_mean(observation, outline, cover)
    ):
        return untouched
    return _onto(observation, face, middle if is_small else gap.place, settings)


def _place(probe: ends.ProbeResult) -> Floats:
    """Where a touch met the face (2,) [m]; on the pad's path if it met nothing."""
    return probe.point[:2] if probe.touched else probe.command.pose.position[:2]


def next_uphill(
    touches: Sequence[ends.ProbeResult],
    made: Sequence[ends.ProbeResult],
    width: float,
    settings: ProbingSettings = ProbingSettings(),
) -> Floats | None:
    """The next place (2,) on the way up [m]; None at the top.

    `touches`: hits. `made`: all touches. `width`: of the pad [m].
    """
    climb = settings.climb
    highest = max(touches, key=lambda touch: float(touch.point[2]))
    level = float(np.linalg.norm(highest.normal[:2]))
    if not level > math.sin(climb.max_summit_lean) or len(made) >= climb.max_touches:
        return None
    place = highest.point[:2] - settings.face.touch_radius * width / level * highest.normal[:2]
    tried = [touch.command.pose.position[:2] for touch in made]
    tried += [touch.point[:2] for touch in made if touch.touched]
    distances = np.linalg.norm(np.stack(tried) - place, axis=1)
    return place if distances.min() > climb.min_distance * width else None


def probe_along_axis(
    observation: ends.EndObservation, place: Floats, settings: ApproachSettings = ApproachSettings()
) -> ends.ProbeCommand:
    """A touch over a place (2,) [m] along the slicing axis, from above everything known."""
    start = highest_expected(observation, settings) + settings.clearance + TOUCH_DEPTH
    extent = observation.height - observation.other_height
    lowest = observation.height - settings.max_depth * extent
    pose = Pose(np.array([*place, start]), FACING_DOWN)
    return ends.ProbeCommand(pose, start - lowest, "search", np.array([*place, observation.height]))


def _touches_for_mean(
    observation: ends.EndObservation, outline: Floats, settings: CoverSettings
) -> float:
    """Touches needed for the mean height of a plane: in proportion to its share of the area."""
    area = abs(signed_area(outline))
    perimeter = float(np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum())
    surface = 2.0 * area + perimeter * (observation.height - observation.other_height)
    max_error = settings.max_error * observation.tolerance
    return area / surface * (observation.noise / max_error) ** 2


def _onto(
    observation: ends.EndObservation, face: ends.EndFace, place: Floats, settings: ProbingSettings
) -> ends.ProbeCommand:
    """A touch of a place (2,) of the face, along the axis or, where it leans, its normal."""
    approach, cover = settings.approach, settings.cover
    normal = face.normal
    lean = math.acos(min(float(normal[2]), 1.0))
    target = np.array([*place, face.at(place[None])[0]])
    axes = FACING_DOWN
    if lean > cover.min_lean:
        tilt = 0.5 * math.pi - min(lean, cover.max_lean)
        axes = pad_rotation(math.atan2(normal[1], normal[0]), tilt)
    height = max(highest_expected(observation, approach) - float(target[2]), 0.0)
    standoff = height + approach.clearance
    start = target - standoff * axes[:, 2]
    extent = observation.height - observation.other_height
    return ends.ProbeCommand(
        Pose(start, axes), standoff + approach.max_depth * extent, "face", target
    )


def highest_expected(
    observation: ends.EndObservation, settings: ApproachSettings = ApproachSettings()
) -> float:
    """The highest known point, or where the end may be while it is not found [m]."""
    heights = [float(hit.point[2]) for hit in observation.hits]
    if observation.contour is not None:
        heights.append(float(observation.contour.contact_high.max()))
    if not observation.hits:
        heights.append(observation.height + settings.max_deviations * observation.deviation)
    return max(heights)


def _reason(
    observation: ends.EndObservation,
    is_plane: bool,
    count: int,
    untouched: float,
    settings: CoverSettings,
) -> str:
    """Why a face needs no further touch."""
    has_plane = is_plane and count >= settings.n_plane
    if untouched > 2.0 * settings.max_round_radius * observation.width and not has_plane:
        return f"{count} touches have not reached all of it"
    if has_plane:
        return f"{count} touches lie in one plane"
    return "nothing larger than a pad is untouched"
