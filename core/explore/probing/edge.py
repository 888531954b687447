"""Touches at 45 degrees, across the edge between a steep wall and the face that closes it.

They are worth their time where the band that the contour's touches felt ends well below the face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.probing.face import Face
from palpate.core.explore.probing.known import Probed, Probing, Wall
from palpate.core.frames import pad_rotation, pose_of, split_pose

STEEP = 0.6
"""Upward part of a wall's normal below which there is an edge between it and the face."""
UNFELT = 1.0 / 6.0
"""Of the pad's width: a stretch between band and face that is lower needs no touch."""
LEAST_ALIKE = 4
"""Touches after which the edge is believed to be the same all around, if they agree."""
MOST = 8
"""Touches of one edge."""
APART = 1.0
"""Widths of the pad: places nearer to a touched one need no touch."""
TILT = math.radians(45.0)
STANDOFF, BEYOND = 1.0, 0.6
"""Widths of the pad: from how far an edge is approached, and how far past its place."""


class Edge(NamedTuple):
    """Where the edge is expected, and how much of it nobody felt."""

    places: Floats
    """(n, 3), m."""
    headings: Floats
    """Azimuths of the wall's outward normals there, (n,), rad."""
    unfelt: Floats
    """Height between band and face, (n,), m; 0 where there is no edge."""


def expected_edge(face: Face, wall: Wall, touched: Floats, foot: float, top: float) -> Edge:
    """Where the wall, gone on with as it leans, meets the face.

    Parameters
    ----------
    face : Face
        The face.
    wall : Wall
        The contour nearest to it.
    touched : (k, 3) array
        Where the face was touched, m: an edge within a `foot` of that has been felt.
    foot : float
        How far around a touched point the pad feels, m.
    top : float
        Where the object ends, m: a plane through touches of what is none may rise beyond.
    """
    level = np.linalg.norm(wall.normals[:, :2], axis=1)
    steep = wall.normals[:, 2] < STEEP
    outward = wall.normals[:, :2] / np.where(steep, level, 1.0)[:, None]
    lean = np.where(steep, wall.normals[:, 2] / np.where(steep, level, 1.0), 0.0)
    # Along the wall, a height h lies lean * h inwards; the face there is as high as h.
    rise = np.minimum(face.at(wall.points[:, :2]), top) - wall.points[:, 2]
    height = rise / np.maximum(1.0 + lean * (outward @ face.slopes), 0.5)
    places = wall.points[:, :2] - (lean * height)[:, None] * outward
    edge = np.column_stack([places, np.minimum(face.at(places), top)])
    away = np.linalg.norm(edge[:, None] - touched, axis=2).min(axis=1)
    unfelt = np.where(steep & (away > foot), edge[:, 2] - wall.felt_high, 0.0)
    return Edge(edge, np.arctan2(outward[:, 1], outward[:, 0]), np.maximum(unfelt, 0.0))


def next_edge(edge: Edge, made: Sequence[Probed], width: float, allowed: float) -> Probing | float:
    """The next touch across an edge, or the height that stays unfelt, m.

    Parameters
    ----------
    edge : Edge
        What is known of it.
    made : sequence of Probed
        Touches of it.
    width : float
        Of the pad, m.
    allowed : float
        What touches of one edge may differ by, m.
    """
    uncertain = np.flatnonzero(edge.unfelt > UNFELT * width)
    if not len(uncertain):
        return float(edge.unfelt.max(initial=0.0))
    if not made:
        return _across(edge, int(edge.unfelt.argmax()), width)
    aimed = np.stack([one.probing.aim for one in made])
    away = np.linalg.norm(edge.places[uncertain, None] - aimed, axis=2).min(axis=1)
    enough = float(away.max()) < APART * width or len(made) >= MOST
    if enough or (len(made) >= LEAST_ALIKE and _alike(made, allowed)):
        return 0.0 if any(one.touched for one in made) else float(edge.unfelt.max())
    return _across(edge, int(uncertain[away.argmax()]), width)


def _across(edge: Edge, number: int, width: float) -> Probing:
    axes = pad_rotation(float(edge.headings[number]), TILT)
    aim = edge.places[number]
    start = aim - STANDOFF * width * axes[:, 2]
    return Probing(pose_of(start, axes), (STANDOFF + BEYOND) * width, "edge", aim)


def _alike(made: Sequence[Probed], allowed: float) -> bool:
    """Whether all touches met the edge as far from where it was expected."""
    if not all(one.touched for one in made):
        return False
    off = [
        float((one.point - one.probing.aim) @ split_pose(one.probing.pose)[1][:, 2]) for one in made
    ]
    return max(off) - min(off) <= allowed
