"""Poses of the object after each time that it was turned over, from contacts and touches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import KnownSurface, Placement, place_object
from palpate.core.geometry import (
    RestingSolid,
    areas_and_normals,
    nearest_points,
    nearest_search,
    sample_surface,
)
from palpate.core.poses import Pose
from palpate.core.rebuild import GeneralSolid
from palpate.core.rebuild.contours import ContactPoints, stack_points
from palpate.nodes.rebuilding.candidates import Placements
from palpate.nodes.rebuilding.received import (
    Goal,
    State,
    closings_in,
    placements_of,
    touches_in,
)
from palpate.nodes.rebuilding.settings import (
    DEFAULT_RECONSTRUCTOR,
    LocatingSettings,
    ReconstructorSettings,
)


def underside_of(solid: GeneralSolid, settings: LocatingSettings) -> Floats:
    """Points (k, 3) sampled on the faces on which a solid stands [m]; none if it is held."""
    mesh = solid.rough_mesh
    corners = mesh.vertices[mesh.faces]
    standing = corners[:, :, 2].max(axis=1) <= (solid.platform or 0.0) + settings.standing_height
    area = float(areas_and_normals(corners[standing])[0].sum())
    if solid.platform is None or not area > 0.0:
        return np.zeros((0, 3))
    count = math.ceil(area / settings.underside_point_area)
    return sample_surface(corners[standing], count, np.random.default_rng(0)).points


def located(state: State, goal: Goal, solid: GeneralSolid, known: Placements) -> Placements:
    """The known placements and later ones, from contacts of the hand, or from touches without."""
    poses, errors, faults, alternatives = map(list[Any], known[:4])
    lost, settings = tuple[str, ...](), state.settings
    for number in range(len(poses) + 1, placements_of(state) + 1):
        closings, asked = closings_in(state, goal, number), state.turns.get(number)
        if asked is None:
            touches = touches_in(state, goal, number)
            closings = touches[:: math.ceil(len(touches) / settings.locating.max_touches) or 1]
        if not closings or state.platform is None:
            break
        contacts, noun = stack_points(closings), "touches" if asked is None else "contacts"
        placement = _place(solid, contacts, asked, state.platform, settings)
        if placement is None:
            lost = (f"its {len(contacts.points)} {noun} fit the solid in no pose",)
            break
        faults += _sentences(placement, asked, noun, settings.locating.max_lean)
        poses.append(placement.pose)
        errors.append(placement.error)
        alternatives.append(placement.alternatives)
    sentences = tuple(dict.fromkeys(faults))
    return Placements(tuple(poses), tuple(errors), sentences, tuple(alternatives), lost)


def _place(
    solid: GeneralSolid,
    contacts: ContactPoints,
    asked: Pose | None,
    platform: float,
    settings: ReconstructorSettings,
) -> Placement | None:
    """The pose in which contacts lie on a solid; None if there is none."""
    # Only objects that are turned over need this import.
    from palpate.core.rebuild.general import protrusions

    assert contacts.normals is not None
    locating = settings.locating
    mesh = solid.mesh(solid.rough_parts)  # with sharp edges, where contacts of hands often lie
    corners = mesh.vertices[mesh.faces]
    places, faces = sample_surface(corners, locating.n_places, np.random.default_rng(0))
    bends = np.where(solid.is_sharp(places), 0.0, solid.bends(places))
    rounding = locating.rounding_error * solid.cell * bends
    errors = np.hypot(solid.expected_errors(places)[0], rounding)
    # Parts that protrude from the convex hull of all contacts may not exist.
    errors = np.hypot(errors, protrusions(solid.contacts.points, places))
    surface = KnownSurface(places, areas_and_normals(corners)[1][faces], errors)
    resting = RestingSolid(mesh.vertices, mesh.faces)
    data = contacts.points, contacts.normals
    axes = None if asked is None else asked.axes
    return place_object(surface, resting, *data, axes, platform, settings.placing)


def _sentences(placement: Placement, asked: Pose | None, noun: str, max_lean: float) -> list[str]:
    """Warnings for the user, a sentence each: a lean above `max_lean` [rad], and alternatives."""
    sentences, lean = [], 0.0
    if asked is not None:
        lean = float(np.arccos(np.clip(placement.pose.axes[2] @ asked.axes[2], -1.0, 1.0)))
    if lean > max_lean:
        sentences.append(f"it leans {math.degrees(lean):.0f} degrees from the requested pose")
    if placement.alternatives:
        sentences.append(
            f"its {noun} fit {len(placement.alternatives) + 1} poses: which is true is unknown"
        )
    return sentences


def contradicted(solid: GeneralSolid) -> tuple[float, tuple[str, ...]]:
    """Largest error [m] of poses that touches since the turn contradict, and a sentence each."""
    errors = solid.contradicted_placements()
    sentences = (
        f"its touches contradict the pose that contacts gave: they lie {1e3 * error:.2g} mm off it"
        for error in errors
    )
    return max(errors, default=0.0), tuple(sentences)


def mistaken_error(
    solid: GeneralSolid,
    placements: Placements,
    settings: LocatingSettings = DEFAULT_RECONSTRUCTOR.locating,
) -> float:
    """Largest root mean square error if an alternative pose of the object is the true one [m].

    The solid is compared with itself after the motion from one pose to the other; the mean square
    of the expected errors of both is subtracted from that of the distances.
    """
    if not any(placements.alternatives):
        return 0.0
    mesh = solid.rough_mesh
    corners = mesh.vertices[mesh.faces]
    places = sample_surface(corners, settings.n_compared_places, np.random.default_rng(0)).points
    search, own = nearest_search(corners), 2.0 * np.square(solid.expected_errors(places)[0]).mean()
    worst = 0.0
    for pose, alternatives in zip(placements.poses, placements.alternatives, strict=True):
        for alternative in alternatives:
            moved = (alternative.inverse() @ pose).to_outer(places)
            off = nearest_points(search, moved).distances
            worst = max(worst, float(np.square(off).mean() - own))
    return math.sqrt(worst)
