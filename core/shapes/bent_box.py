"""The part of a ray that lies in a bent box: a sector of a ring, of some thickness."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import LEAST_CURVATURE
from palpate.core.shapes.clip import ROOM, through_box
from palpate.core.shapes.first_root import Gap

LEAST = 1e-200
"""Stands for a vanishing divisor, so that no quotient is 0 / 0 or overflows."""


class Clipped(NamedTuple):
    """Where rays may meet what is in a bent box."""

    starts: Floats
    """Where they enter, at least 0, (n,), m; after the end for a ray that misses."""
    ends: Floats
    """Where they leave for good, (n,), m."""
    gaps: tuple[Gap, ...]
    """Where they are outside in between; no two of a ray meet."""


def through_bent_box(origins: Floats, direction: Floats, half: Floats, curvature: float) -> Clipped:
    """Where parallel rays enter and leave a box that was bent with its axis.

    Parameters
    ----------
    origins : (3, n) array
        Where the rays start, by coordinate: towards the centre of curvature, square to the
        bend's plane, up, m.
    direction : (3,) array
        Their unit direction.
    half : (3,) array
        Half the edges of the box before it was bent, m.
    curvature : float
        1/m; smaller than 1 over the first half edge and than pi over the last.
    """
    if abs(curvature) < LEAST_CURVATURE:
        return Clipped(*through_box(origins, direction, half), ())
    inwards, aside, height = half * (1.0 + ROOM)
    starts, ends = _part_between(origins[1], direction[1], aside)
    begin, end = _part_in_circle(origins, direction, curvature, inwards)
    starts, ends = np.maximum(np.maximum(starts, begin), 0.0), np.minimum(ends, end)
    hole = _part_in_circle(origins, direction, curvature, -inwards)
    if abs(curvature) * height < 0.5 * math.pi:
        begin, end = _part_between_ends(origins, direction, curvature, height, 1.0)
        return Clipped(np.maximum(starts, begin), np.minimum(ends, end), (hole,))
    # More than half a circle: what is left out between the ends is the wedge.
    wedge = _part_between_ends(origins, direction, curvature, height, -1.0)
    return Clipped(starts, ends, _joined(hole, wedge))


def _joined(first: Gap, second: Gap) -> tuple[Gap, Gap]:
    """Two gaps; those that meet are both the whole of them."""
    meet = (first[0] <= second[1]) & (second[0] <= first[1])
    begin, end = np.minimum(first[0], second[0]), np.maximum(first[1], second[1])
    return (
        (np.where(meet, begin, first[0]), np.where(meet, end, first[1])),
        (np.where(meet, begin, second[0]), np.where(meet, end, second[1])),
    )


def _part_between(origin: Floats, slope: float, half: float) -> Gap:
    """Where rays are within `half` on both sides of a plane."""
    first = _part_above(origin + half, slope)
    second = _part_above(half - origin, -slope)
    return _common(first, second)


def _part_between_ends(
    origins: Floats, direction: Floats, curvature: float, height: float, sign: float
) -> Gap:
    """Where rays are on the body's side of both its end planes; of neither if `sign` is -1.

    The planes meet in the axis of the bend, and are level for no bend.
    """
    angle = curvature * height
    lever, tilt = height * math.sin(angle) / angle, math.cos(angle)
    level, slope = (1.0 - curvature * origins[0]) * lever, -curvature * direction[0] * lever
    rise, climb = origins[2] * tilt, direction[2] * tilt
    below = _part_above(sign * (level - rise), sign * (slope - climb))
    above = _part_above(sign * (level + rise), sign * (slope + climb))
    return _common(below, above)


def _part_above(value: Floats, slope: float) -> Gap:
    """Where value + slope t is not negative."""
    never, ever = np.full(len(value), np.inf), np.full(len(value), -np.inf)
    if slope > LEAST:
        return -value / slope, never
    if slope < -LEAST:
        return ever, -value / slope
    return np.where(value >= 0.0, ever, never), np.where(value >= 0.0, never, ever)


def _common(first: Gap, second: Gap) -> Gap:
    begin, end = np.maximum(first[0], second[0]), np.minimum(first[1], second[1])
    empty = begin >= end
    return np.where(empty, np.inf, begin), np.where(empty, -np.inf, end)


def _part_in_circle(origins: Floats, direction: Floats, curvature: float, outwards: float) -> Gap:
    """Where rays are in the cylinder about the bend's axis, `outwards` from its bent axis.

    In the square of the distance divided by the curvature, so that a circle may be a line.
    """
    k, sign = abs(curvature), math.copysign(1.0, curvature)
    across, _, up = direction
    x, _, z = origins
    a = max(k * (across * across + up * up), LEAST)
    b = k * (x * across + z * up) - sign * across
    c = k * (x * x + z * z) - sign * 2.0 * x - outwards * (2.0 + k * outwards)
    inner = b * b - a * c
    root = b + np.copysign(np.sqrt(np.maximum(inner, 0.0)), b)
    root = np.where(root == 0.0, LEAST, root)
    with np.errstate(over="ignore"):
        first, second = -root / a, -c / root
    met = inner > 0.0
    begin = np.where(met, np.minimum(first, second), np.inf)
    return begin, np.where(met, np.maximum(first, second), -np.inf)
