"""Where a pad cannot come: creases that hold it off, and pits, below which there may be a hole."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import point_tree
from palpate.core.touch import Pad

TILTS = np.radians([0.0, 25.0, 45.0, 65.0])  # Of the approach from the normal
AROUND = 8  # Directions of each tilt
BESIDES = 64  # Places about a place that may hold a pad off
SQUARE = 1e-15  # m^2: where fewer than two places lie about one, its surface counts as plane


def pad_width(pad: Pad) -> float:
    """Of its longer side, m."""
    return pad.pitch * max(pad.rows, pad.cols)


def pad_gaps(
    pad: Pad, points: Floats, places: Floats, normals: Floats, enough: float = 0.0
) -> Floats:
    """How far off what is beside them holds a pad from places, (k,), m, if it leans as it may.

    `points` (n, 3): of the surface, m. `places`, `normals` (k, 3): of some, and out of it. No
    further lean is tried where the pad comes as near as `enough`, m.
    """
    half = 0.5 * pad_width(pad)
    count = min(BESIDES, len(points))
    corner = math.sqrt(2.0) * half
    beside = np.asarray(point_tree(points).query(places, count, distance_upper_bound=corner)[1])
    known = np.concatenate([points, np.full((1, 3), np.inf)])
    away = np.where(beside[..., None] < len(points), known[beside] - places[:, None], 0.0)
    leaning = approach_directions(np.array([0.0, 0.0, 1.0]))
    local = np.array([direction for tilt, direction in leaning if tilt < TILTS[-1]])
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.maximum(np.linalg.norm(first, axis=1), np.finfo(float).tiny)[:, None]
    frames = np.stack([first, np.cross(normals, first), normals], axis=1)
    squares = np.einsum("kni,kni->kn", away, away)
    gaps, left = np.full(len(places), np.inf), np.arange(len(places))
    for direction in local:
        over = np.matmul(away[left], (direction @ frames[left])[..., None])[..., 0]
        aside = squares[left] - over**2
        held = np.where(aside < half**2, over - 0.5 * pad.dome * aside, 0.0)
        gaps[left] = np.minimum(gaps[left], held.max(axis=1))
        left = left[gaps[left] > enough]
    return gaps


def approach_directions(normal: Floats) -> Iterator[tuple[float, Floats]]:
    """Unit directions (3,) out of which a place may be approached, with their tilt, rad."""
    yield 0.0, normal
    aside = np.eye(3)[int(np.abs(normal).argmin())]
    first = np.cross(normal, aside)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    for tilt in TILTS[1:].tolist():
        for turn in 2.0 * np.pi * np.arange(AROUND) / AROUND:
            level = math.cos(turn) * first + math.sin(turn) * second
            yield tilt, math.cos(tilt) * normal + math.sin(tilt) * level


def least_concavity(
    points: Floats, normals: Floats, places: Floats, outward: Floats, reach: float
) -> Floats:
    """Curvatures (k,), 1/m, in the direction in which a surface is least concave about places.

    Positive if it is concave all around. `points`, `normals` (n, 3): of the surface, m, and out of
    it; `places`, `outward` (k, 3): some of them. Normals within `reach` [m] are fitted as a linear
    function of the place in the tangent plane, whose symmetric part is the curvature.
    """
    count = min(BESIDES, len(points))
    found = point_tree(points).query(places, count, distance_upper_bound=reach)[1]
    near = np.asarray(found)
    is_near = (near < len(points))[..., None]
    near = np.minimum(near, len(points) - 1)
    first = np.cross(outward, np.eye(3)[np.abs(outward).argmin(axis=1)])
    first /= np.maximum(np.linalg.norm(first, axis=1), np.finfo(float).tiny)[:, None]
    tangents = np.stack([first, np.cross(outward, first)], axis=2)
    away = np.where(is_near, (points[near] - places[:, None]) @ tangents, 0.0)
    leaning = np.where(is_near, normals[near] @ tangents, 0.0)
    squares = np.einsum("kni,knj->kij", away, away) + SQUARE * np.eye(2)
    growth = np.linalg.solve(squares, np.einsum("kni,knj->kij", away, leaning))
    bent = np.linalg.eigvalsh(0.5 * (growth + growth.transpose(0, 2, 1)))
    return np.asarray(-bent[:, 1])
