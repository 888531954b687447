"""How the object lay after each time that it was turned over, as contacts and touches tell."""

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
from palpate.nodes.rebuilding.received import Goal, State, closings_in

PLACES = 12_000  # Of the solid's surface, onto which contacts are brought
STANDING = 0.2e-3  # Of a face over the platform that belongs to the underside, m
UNDERSIDE_AREA = 12.0e-6  # For which one place of the underside stands, m^2
MISTAKEN_PLACES = 2_000  # At which the solid is held against itself, turned
OTHERWISE = math.radians(10.0)  # Between the side asked for and the one it lies on: it is told


def underside_of(solid: GeneralSolid) -> Floats:
    """Places (k, 3) evenly over what a solid stands on; none if it is held."""
    mesh = solid.rough_mesh
    corners = mesh.vertices[mesh.faces]
    standing = corners[:, :, 2].max(axis=1) <= (solid.platform or 0.0) + STANDING
    area = float(areas_and_normals(corners[standing])[0].sum())
    if solid.platform is None or not area > 0.0:
        return np.zeros((0, 3))
    count = math.ceil(area / UNDERSIDE_AREA)
    return sample_surface(corners[standing], count, np.random.default_rng(0)).points


def located(state: State, goal: Goal, solid: GeneralSolid, known: Placements) -> Placements:
    """The placements with those since, of which the hand has told, as far as it tells."""
    poses, errors, faults, others = map(list[Any], known[:4])
    lost = tuple[str, ...]()
    for number in range(len(poses) + 1, max(state.turns) + 1):
        closings = closings_in(state, goal, number)
        if not closings or state.platform is None:
            break
        contacts, asked = stack_points(closings), state.turns[number]
        found = _place(solid, contacts, asked, state.platform)
        if found is None:
            lost = (f"its {len(contacts.points)} contacts of the hand fit the solid nowhere",)
            break
        faults += _told(found, asked)
        poses.append(found.pose)
        errors.append(found.error)
        others.append(found.alternatives)
    told = tuple(dict.fromkeys(faults))
    return Placements(tuple(poses), tuple(errors), told, tuple(others), lost)


def _place(
    solid: GeneralSolid, contacts: ContactPoints, asked: Pose, platform: float
) -> Placement | None:
    assert contacts.normals is not None
    mesh = solid.rough_mesh
    corners = mesh.vertices[mesh.faces]
    places, faces = sample_surface(corners, PLACES, np.random.default_rng(0))
    errors = solid.expected_errors(places)[0]
    surface = KnownSurface(places, areas_and_normals(corners)[1][faces], errors)
    resting = RestingSolid(mesh.vertices, mesh.faces)
    met = contacts.points, contacts.normals
    return place_object(surface, resting, *met, asked.axes, platform)


def _told(found: Placement, asked: Pose) -> list[str]:
    """What a person should know of a placement, a sentence each."""
    told = []
    lean = float(np.arccos(np.clip(found.pose.axes[2] @ asked.axes[2], -1.0, 1.0)))
    if lean > OTHERWISE:
        told.append(f"it lies {math.degrees(lean):.0f} degrees otherwise than asked")
    if found.alternatives:
        told.append(f"its contacts fit {len(found.alternatives) + 1} ways to lie: it looks alike")
    return told


def mistaken_error(solid: GeneralSolid, placements: Placements) -> float:
    """Root mean square error if it lay in another way that fits as well, the worst of them [m].

    An object that looks alike from there is the same then, but for what was touched since: by how
    much it differs from itself, over what both may be off by themselves.
    """
    if not any(placements.alternatives):
        return 0.0
    mesh = solid.rough_mesh
    corners = mesh.vertices[mesh.faces]
    places = sample_surface(corners, MISTAKEN_PLACES, np.random.default_rng(0)).points
    search, own = nearest_search(corners), 2.0 * np.square(solid.expected_errors(places)[0]).mean()
    worst = 0.0
    for pose, others in zip(placements.poses, placements.alternatives, strict=True):
        for other in others:
            moved = (other.inverse() @ pose).to_outer(places)
            off = nearest_points(search, moved).distances
            worst = max(worst, float(np.square(off).mean() - own))
    return math.sqrt(worst)
