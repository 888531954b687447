"""Where a pad cannot come: creases that hold it off, and pits, below which there may be a hole."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import axes_across, point_tree
from palpate.core.touch import Pad


@dataclass(frozen=True, slots=True)
class HollowSettings:
    """Where a pad is held off, and which of these places may be the mouth of a hole.

    The limits of a pit separate a bore of 8 mm below a countersink of 20 mm, where the surface is
    concave with radii of 7 to 14 mm, from all creases of 13 scanned objects, whose smallest radius
    in the flatter direction is 26 mm.
    """

    tilts: tuple[float, ...] = (0.0, 25.0, 45.0, 65.0)  # [deg] of an approach from the normal
    n_azimuths: int = 8  # of each tilt but 0
    n_neighbours: int = 64  # nearest places of the surface that can hold the pad off a place
    min_gap: float = 1.0e-3  # [m] between pad and place, from which on the place is in a crease
    min_pit_distance: float = 2.5e-3  # [m] from every touch, from which on a crease may be a pit
    max_pit_radius: float = 20.0e-3  # [m] radius of curvature of a pit in its flattest direction
    n_opening_aims: int = 2  # touches aimed at an opening, after which no more are


RIDGE = 1e-15  # [m^2] added to a sum of squares: with fewer than two neighbours it is singular


def pad_width(pad: Pad) -> float:
    """Width of the pad along its longer side [m]."""
    return pad.pitch * max(pad.rows, pad.cols)


def pad_gaps(
    pad: Pad,
    points: Floats,
    places: Floats,
    normals: Floats,
    enough: float = 0.0,
    settings: HollowSettings = HollowSettings(),
) -> Floats:
    """Gap (k,) [m] that the surface beside each place leaves under a pad, in its best lean.

    `points` (n, 3): of the surface [m]. `places`, `normals` (k, 3): places on it, outward.
    No further lean is tried once the gap is at most `enough` [m].
    """
    half = 0.5 * pad_width(pad)
    count = min(settings.n_neighbours, len(points))
    corner = math.sqrt(2.0) * half
    beside = np.asarray(point_tree(points).query(places, count, distance_upper_bound=corner)[1])
    known = np.concatenate([points, np.full((1, 3), np.inf)])
    away = np.where(beside[..., None] < len(points), known[beside] - places[:, None], 0.0)
    leaning = approach_directions(np.array([0.0, 0.0, 1.0]), settings)
    steepest = math.radians(settings.tilts[-1])
    local = np.array([direction for tilt, direction in leaning if tilt < steepest])
    frames = np.concatenate([axes_across(normals), normals[:, None]], axis=1)
    squares = np.einsum("kni,kni->kn", away, away)
    gaps, left = np.full(len(places), np.inf), np.arange(len(places))
    for direction in local:
        over = np.matmul(away[left], (direction @ frames[left])[..., None])[..., 0]
        aside = squares[left] - over**2
        held = np.where(aside < half**2, over - 0.5 * pad.dome * aside, 0.0)
        gaps[left] = np.minimum(gaps[left], held.max(axis=1))
        left = left[gaps[left] > enough]
    return gaps


def approach_directions(
    normal: Floats, settings: HollowSettings = HollowSettings()
) -> Iterator[tuple[float, Floats]]:
    """Tilt [rad] from the normal, and unit direction (3,) from which a place is approached."""
    yield 0.0, normal
    first, second = axes_across(normal)
    for tilt in np.radians(settings.tilts[1:]).tolist():
        for turn in 2.0 * np.pi * np.arange(settings.n_azimuths) / settings.n_azimuths:
            level = math.cos(turn) * first + math.sin(turn) * second
            yield tilt, math.cos(tilt) * normal + math.sin(tilt) * level


def least_concavity(
    points: Floats,
    normals: Floats,
    places: Floats,
    outward: Floats,
    reach: float,
    settings: HollowSettings = HollowSettings(),
) -> Floats:
    """Curvatures (k,) [1/m] about places, in the direction in which each is least concave.

    Positive if it is concave all around. `points`, `normals` (n, 3): of the surface [m], outward;
    `places`, `outward` (k, 3): of the places. Normals within `reach` [m] are fitted as a linear
    function of the place in the tangent plane, whose symmetric part is the curvature.
    """
    count = min(settings.n_neighbours, len(points))
    near = np.asarray(point_tree(points).query(places, count, distance_upper_bound=reach)[1])
    is_near = (near < len(points))[..., None]
    near = np.minimum(near, len(points) - 1)
    tangents = axes_across(outward).transpose(0, 2, 1)
    away = np.where(is_near, (points[near] - places[:, None]) @ tangents, 0.0)
    leaning = np.where(is_near, normals[near] @ tangents, 0.0)
    squares = np.einsum("kni,knj->kij", away, away) + RIDGE * np.eye(2)
    growth = np.linalg.solve(squares, np.einsum("kni,knj->kij", away, leaning))
    bent = np.linalg.eigvalsh(0.5 * (growth + growth.transpose(0, 2, 1)))
    return np.asarray(-bent[:, 1])
