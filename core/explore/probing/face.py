"""The plane that a few touches of an end let expect, and whether they all lie in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.probing.known import Probed, Wall

FOOT = 0.35
"""Of the pad's width: how far from the touched point a domed pad feels a level face."""
STEEPEST = math.radians(45.0)
"""A normal that leans more says that an edge was touched, not a face."""
ALIKE = math.radians(3.0)
"""Normals of one plane differ by no more: what noise and an edge under the pad make of them."""


class Face(NamedTuple):
    """A plane over the slicing frame, z = height + slopes (x, y)."""

    height: float
    """On the slicing axis, m."""
    slopes: Floats
    """(2,)."""

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2), m."""
        return np.asarray(self.height + places @ self.slopes)

    @property
    def normal(self) -> Floats:
        """Upward unit normal, (3,)."""
        upward = np.array([-self.slopes[0], -self.slopes[1], 1.0])
        return np.asarray(upward / np.linalg.norm(upward))


def fit_face(touches: Sequence[Probed], width: float) -> Face:
    """The plane through touched points that leans as their normals do.

    Parameters
    ----------
    touches : sequence of Probed
        At least one, that touched something.
    width : float
        Of the pad, m: a normal tells of the heights a foot away.
    """
    points = np.stack([one.point for one in touches])
    slopes, sure = _slopes(touches)
    middle = points.mean(axis=0)
    foot = FOOT * width
    rows = np.concatenate(
        [
            np.column_stack([np.ones(len(points)), points[:, :2] - middle[:2]]),
            np.tile(foot * np.eye(3)[1:], (len(slopes), 1)),
        ]
    )
    # A normal that leans too far counts for next to nothing: the rows keep their rank.
    weights = np.concatenate([np.ones(len(points)), np.repeat(np.where(sure, 1.0, FAINT), 2)])
    heights = np.concatenate([points[:, 2] - middle[2], foot * slopes.ravel()])
    found = np.linalg.lstsq(weights[:, None] * rows, weights * heights, rcond=None)[0]
    return Face(float(middle[2] + found[0] - middle[:2] @ found[1:]), found[1:])


FAINT = 1e-3
"""Weight of a normal that is not believed."""


def is_plane(face: Face, touches: Sequence[Probed], wall: Wall, allowed: float) -> bool:
    """Whether all touches lie in a plane, and nothing beside them rises over it.

    Parameters
    ----------
    face : Face
        Fitted to the touches.
    touches : sequence of Probed
        Those.
    wall : Wall
        The contour nearest to the end.
    allowed : float
        Largest distance from the plane, m.
    """
    points = np.stack([one.point for one in touches])
    if float(np.abs(points[:, 2] - face.at(points[:, :2])).max()) > allowed:
        return False
    normals = np.stack([one.normal for one in touches])
    if float((normals @ face.normal).min()) < math.cos(ALIKE):
        return False
    return bool((wall.felt_high - face.at(wall.points[:, :2])).max() <= allowed)


def _slopes(touches: Sequence[Probed]) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Slopes (n, 2) that the normals tell, and whether they are believed; else 0."""
    normals = np.stack([one.normal for one in touches])
    sure = normals[:, 2] >= math.cos(STEEPEST)
    upward = np.where(sure, normals[:, 2], 1.0)
    return np.where(sure[:, None], -normals[:, :2] / upward[:, None], 0.0), sure
