"""Slicing axes from normals alone: of revolution, of straight sides, of a touched end face.

Every normal of a surface of revolution meets its axis; those of a screw surface have one pitch.
Both are linear in the axis's Pluecker coordinates, so that neither the profile nor where along it
the contacts lie matters: Pottmann and Randrup, *Rotational and helical surface approximation for
reverse engineering*, 1998. Most normals of a box or a column are square to its axis, wherever its
contacts lie; those of its two ends are not, and count for nothing. One touch of an end does not
know whether it met a face: where the surface is level, sections are best taken level; and where all
sides run straight along its normal, it is the face that closes them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, scaled_mad

# A surface that leans less lies level: the object stands on a platform and ends level, however its
# middles lean.
LEVEL = math.radians(3.0)
# The sides run straight along the face's normal if their own axis differs by no more.
SQUARE = math.radians(3.0)
SAME = math.radians(1.0)  # An axis that differs by less is no other
# Normals that are square to the axis but for less are those of the sides; closer each time.
NEAR = tuple(math.radians(one) for one in (20.0, 10.0, 5.0, 2.5, 1.5))
# Contacts of straight sides, at least; and their share of those that face sideways at all: of a
# round surface far fewer do.
FEWEST, LEAST_STRAIGHT = 10, 0.4
# Share of the sides' normals, at least, in the direction that has fewest: else the axis may turn
# about the only direction in which they point.
ROUND_ABOUT = 0.05
# Of reweighting, and of these with the axis's direction held, until it has found its place.
SWEEPS, PLACING = 25, 6
# Normals that miss the axis by more than this many standard deviations count for nothing: those at
# edges, which are measured as something between their faces.
CUT = 3.0
ROUND = 0.015  # Of the size: normals that miss an axis by more than this do not belong to it
QUIET = 5e-4  # Of the size: no standard deviation is taken for smaller
RIDGE = 1e-6  # Of the mean: the axis of a cylinder may slide along itself
PARAMETERS = 5
LEAST = 6  # Contacts: an axis has four parameters, and a screw a fifth


def end_face_axis(axis: Floats, face: Floats, normals: Floats) -> Floats | None:
    """A better axis than the one along which an end was touched; None if that does.

    `axis` (3,): the slicing axis so far, a unit vector that points to the end. `face` (3,): outward
    unit normal where the end was touched. `normals` (n, 3): outward unit normals of all contacts.
    """
    vertical = np.array([0.0, 0.0, 1.0])
    if _apart(face, axis) < SAME:
        return None
    if _apart(face, vertical) < LEVEL:
        return None if np.array_equal(axis, vertical) else vertical
    straight = extrusion_axis(normals, face)
    if straight is None or _apart(straight, face) > SQUARE:
        return None
    return face


def _apart(one: Floats, other: Floats) -> float:
    """Angle between unit vectors, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))


def extrusion_axis(normals: Floats, axis: Floats) -> Floats | None:
    """The axis near another one to which the sides' normals are square; None if they are not.

    `normals` (n, 3): of the contacts. `axis` (3,): about where it lies. Both are unit vectors.
    """
    facing = int((np.abs(normals @ axis) < math.sin(NEAR[0])).sum())
    for near in NEAR:
        sides = normals[np.abs(normals @ axis) < math.sin(near)]
        if len(sides) < max(FEWEST, LEAST_STRAIGHT * facing):
            return None
        spread, directions = np.linalg.eigh(sides.T @ sides / len(sides))
        found = directions[:, 0]
        axis = found if found @ axis > 0.0 else -found
    return np.asarray(axis) if spread[1] >= ROUND_ABOUT else None


class RevolutionAxis(NamedTuple):
    """An axis that normals meet."""

    axis: Floats  # Unit vector (3,); its sign means nothing
    point: Floats  # On the axis, nearest to the middle of the contacts, (3,), m
    error: float  # Standard deviation of the axis's angle, rad; at most pi
    rms: float  # Spread of the distances of normals from the axis, as a share of the contacts' size
    share: float  # Share of the contacts whose normals meet it within `ROUND`
    # How fast normals leave another axis through the same point, as a share of the size for each
    # radian of its turn: 0 for a ball.
    lift: float


def revolution_axis(points: Floats, normals: Floats, axes: Floats) -> RevolutionAxis:
    """The axis that most normals meet best.

    `points`, `normals` (n, 3): at least 6, m, and unit vectors. `axes` (k, 3): to start with,
    beside three that the normals suggest. Raises ValueError if there are fewer contacts.
    """
    if len(points) < LEAST:
        raise ValueError(f"points must be at least {LEAST}, got {len(points)}")
    middle = points.mean(axis=0)
    centred = points - middle
    size = math.sqrt(float((centred**2).sum(axis=1).mean())) or 1.0
    lines = np.hstack([np.cross(centred / size, normals), normals])
    starts = [*_axes(lines, np.ones(len(lines)))[1].T, *axes]
    weights, scale, _ = min((_settle(lines, start) for start in starts), key=lambda one: one[2])
    spread, turned, slides = _axes(lines, weights)
    axis = turned[:, 0]
    beside = -slides @ axis
    missed = lines @ np.concatenate([axis, beside])
    total = float(weights.sum())
    variance = scale**2 * total / max(total - PARAMETERS, 1.0)
    lift = max(float(spread[1] - max(spread[0], 0.0)), 0.0)
    error = math.sqrt(variance / total / lift) if lift > 0.0 else math.pi
    return RevolutionAxis(
        axis,
        middle + size * np.cross(axis, beside),
        min(error, math.pi),
        scale,
        float((np.abs(missed) < ROUND).mean()),
        math.sqrt(lift),
    )


def _settle(lines: Floats, axis: Floats) -> tuple[Floats, float, float]:
    """Weights (n,) of the normals that meet an axis near this one, their spread, and its cost."""
    weights, scale, missed = np.ones(len(lines)), math.inf, np.zeros(len(lines))
    for sweep in range(SWEEPS):
        _, turned, slides = _axes(lines, weights)
        if sweep >= PLACING:
            axis = turned[:, 0]
        missed = lines @ np.concatenate([axis, -slides @ axis])
        scale = max(scaled_mad(missed), QUIET)
        off = np.minimum(np.abs(missed) / (CUT * scale), 1.0)
        weights = (1.0 - off * off) ** 2
    # Not the least spread: half of the contacts may agree on an axis that the others refute.
    cost = float(np.minimum(np.abs(missed) / ROUND, 1.0).mean())
    return weights, scale, cost


def _axes(lines: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean square misses (3,) ascending, their axes as columns, and how the moment follows, (3, 3).

    The best moment of an axis a is -slides @ a; it leaves a problem in a alone.
    """
    square = (lines * weights[:, None]).T @ lines / float(weights.sum())
    mixed, own = square[3:, :3], square[3:, 3:] + RIDGE * np.trace(square) / 6.0 * np.eye(3)
    slides = np.linalg.solve(own, mixed)
    spread, axes = np.linalg.eigh(square[:3, :3] - mixed.T @ slides)
    return spread, axes, slides
