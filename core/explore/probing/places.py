"""The place of an end that is farthest from everything felt so far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.probing.face import FOOT
from palpate.core.explore.probing.known import Wall
from palpate.core.plane.area_centroid import area_centroid
from palpate.core.plane.edge_distance import edge_distance
from palpate.core.plane.inscribed_circle import inscribed_circle
from palpate.core.plane.winding import winding_number

CELLS = 8
"""Places to a pad's width, between which one is looked for."""
MOST_CELLS = 64
"""The same across the end."""
OUTLINE = 96
"""Points of an outline, at most: more say no more, and each costs."""
LEAST_LEVEL = 0.05
"""Level part of a normal below which nobody can say which way is inwards."""


class Gap(NamedTuple):
    """The largest disc in which nothing was felt."""

    place: Floats
    """Its middle, (2,), m."""
    radius: float
    """m; 0 or less where everything was felt."""


def inner_outline(wall: Wall) -> Floats:
    """Where the band that the contour's touches felt ends on the face, (n, 2), m.

    Beyond a leaning wall by as much as the band climbs along it.
    """
    level = np.maximum(np.linalg.norm(wall.normals[:, :2], axis=1), LEAST_LEVEL)
    climbed = np.maximum(wall.felt_high - wall.points[:, 2], 0.0)
    inwards = climbed * np.maximum(wall.normals[:, 2], 0.0) / level
    outline = wall.points[:, :2] - (inwards / level)[:, None] * wall.normals[:, :2]
    return np.asarray(outline[:: max(len(outline) // OUTLINE, 1)])


def heart(wall: Wall) -> Floats:
    """A place (2,) well inside a contour: its centroid, or where the widest disc fits, m."""
    outline = wall.points[:, :2]
    middle = area_centroid(outline)
    if winding_number(outline, middle[None])[0] != 0:
        return middle
    return inscribed_circle(outline).middle


def covers(wall: Wall, places: Floats, beside: float) -> Bools:
    """Which places (n, 2) lie inside a contour, or beside it by no more than so much, m."""
    outline = wall.points[:, :2]
    inside = winding_number(outline, places) != 0
    return np.asarray(inside | (edge_distance(outline, places) <= beside), np.bool_)


def largest_gap(outline: Floats, tried: Floats, width: float) -> Gap:
    """The largest disc inside an outline that no touch has reached.

    Parameters
    ----------
    outline : (n, 2) array
        Inside which something is unknown, m.
    tried : (k, 2) array
        Where the touches were, at least one.
    width : float
        Of the pad, m.
    """
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = max(width / CELLS, float((high - low).max()) / MOST_CELLS)
    axes = [np.arange(lo, hi + step, step) for lo, hi in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[winding_number(outline, places) != 0]
    if not len(places):
        return Gap(tried[-1], 0.0)
    away = np.linalg.norm(places[:, None] - tried, axis=2).min(axis=1) - FOOT * width
    clear = np.minimum(edge_distance(outline, places), away)
    widest = int(clear.argmax())
    return Gap(places[widest], float(clear[widest]))
