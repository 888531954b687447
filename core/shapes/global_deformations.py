"""Linear tapering along z, bending of the z axis to an arc, and rays clipped to a bent box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.ray_casting import ROOM, RayGap, clip_to_box

LEAST_CURVATURE = 1e-200  # A bend below it, 1/m, moves nothing by a rounding, but could underflow
LEAST = 1e-200  # Stands for a vanishing divisor, so that no quotient is 0 / 0 or overflows


@dataclass(frozen=True, slots=True)
class Taper:
    """Widens x and y in proportion to the height: Fung, 1999, (2.7).

    Beyond the ends of what is tapered the widths are those of the ends, so that all of space is
    mapped one to one. `along_x` and `along_y`: widening at the top, and narrowing at the bottom, as
    a share of the width; between -1 and 1, so that no section collapses. `half_height`: half the
    height of what is tapered, m. Raises ValueError if a share is not between -1 and 1.
    """

    along_x: float
    along_y: float
    half_height: float

    def __post_init__(self) -> None:
        if not (abs(self.along_x) < 1.0 and abs(self.along_y) < 1.0):
            raise ValueError(
                f"taper must lie between -1 and 1, got [{self.along_x}, {self.along_y}]"
            )

    def __call__(self, points: Floats) -> Floats:
        """Points (n, 3), tapered."""
        return points * self._widths(points[:, 2])

    def inverse(self, points: Floats) -> Floats:
        """Where tapered points (n, 3) were before."""
        return points / self._widths(points[:, 2])

    def _widths(self, height: Floats) -> Floats:
        share = np.clip(height / self.half_height, -1.0, 1.0)
        return np.column_stack(
            [1.0 + self.along_x * share, 1.0 + self.along_y * share, np.ones_like(share)]
        )


class Unbent(NamedTuple):
    """Places in the plane of a bend, straightened."""

    inwards: Floats  # Towards the centre of curvature, if it is not negative, m
    along: Floats  # Height, m
    stretch: Floats  # Length of the fibre through the place, as a share of the axis's
    cosine: Floats  # Of the angle through which the bend has turned the place
    sine: Floats  # Of the same angle, from upwards to inwards


@dataclass(frozen=True, slots=True)
class Bend:
    """Bends the z axis to a circle whose centre is level with the origin: Fung, 1999, (2.8).

    The axis keeps its length, sections across it stay plane and square to it. `curvature`: of the
    bent axis, 1/m; 0 bends nothing. `direction`: azimuth towards which both ends move, rad; they
    move the other way if the curvature is negative. Raises ValueError if either is not finite.
    (2.8) and (2.9) with the angle k z, where the text divides by k, and with the coordinate x cos +
    y sin, where it takes an arc tangent. No form here loses digits as k vanishes.
    """

    curvature: float
    direction: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.curvature) and math.isfinite(self.direction)):
            raise ValueError(
                "a bend must have a finite curvature and direction, "
                f"got {self.curvature} 1/m and {self.direction} rad"
            )

    def __call__(self, points: Floats) -> Floats:
        """Points (n, 3), bent.

        Raises ValueError if a point lies at or beyond the centre of curvature, or so high or low
        that the axis would close to a circle: bent, it would meet others.
        """
        inwards, height = points[:, :2] @ self.towards, points[:, 2]
        k = self.curvature
        nearest = float((k * inwards).max(initial=0.0))
        if not nearest < 1.0:
            raise ValueError(
                f"a bend of {k:g} 1/m has its centre {1 / abs(k):.3g} m from the axis: all that is "
                f"bent must be nearer, got {nearest / abs(k):.3g} m"
            )
        highest = float(np.abs(height).max(initial=0.0))
        if not abs(k) * highest < math.pi:
            raise ValueError(
                f"a bend of {k:g} 1/m closes the circle {math.pi / abs(k):.3g} m above and below "
                f"the middle: all that is bent must be nearer, got {highest:.3g} m"
            )
        angle = k * height
        moved = 0.5 * height * angle * _sinc(0.5 * angle) ** 2 + inwards * (np.cos(angle) - 1.0)
        height = height * _sinc(angle) - inwards * np.sin(angle)
        return np.column_stack([points[:, :2] + moved[:, None] * self.towards, height])

    def inverse(self, points: Floats) -> Floats:
        """Where bent points (n, 3) were before."""
        inwards = points[:, :2] @ self.towards
        straight = self.unbend(inwards, points[:, 2])
        moved = (straight.inwards - inwards)[:, None] * self.towards
        return np.column_stack([points[:, :2] + moved, straight.along])

    @property
    def towards(self) -> Floats:
        """The direction, (2,)."""
        return np.array([math.cos(self.direction), math.sin(self.direction)])

    def unbend(self, inwards: Floats, height: Floats) -> Unbent:
        """Where places of the bend's plane, (n,) each, in m, were before."""
        k = self.curvature
        if abs(k) < LEAST_CURVATURE:
            one = np.ones_like(inwards)
            return Unbent(inwards, height, one, one, 0.0 * one)
        rise, level = k * height, 1.0 - k * inwards
        stretch = np.sqrt(rise * rise + level * level)
        before = (2.0 * inwards - k * (inwards * inwards + height * height)) / (1.0 + stretch)
        centre = np.maximum(stretch, LEAST_CURVATURE)
        return Unbent(before, np.arctan2(rise, level) / k, stretch, level / centre, rise / centre)


def _sinc(angle: Floats) -> Floats:
    """sin(angle) / angle, 1 at 0."""
    safe = np.where(angle == 0.0, 1.0, angle)
    return np.where(angle == 0.0, 1.0, np.sin(safe) / safe)


def clip_to_bent_box(
    origins: Floats, direction: Floats, half: Floats, curvature: float
) -> tuple[Floats, Floats, tuple[RayGap, ...]]:
    """Where parallel rays enter and leave a box that was bent with its axis.

    `origins` (3, n), `direction` (3,) and `half` (3,), half the edges before it was bent, are by
    coordinate: towards the centre of curvature, square to the bend's plane, up. Returns where they
    enter, at least 0 and after the end for a ray that misses, and leave for good, (n,), m; and gaps
    in between, of which no two of a ray meet.
    """
    if abs(curvature) < LEAST_CURVATURE:
        return *clip_to_box(origins, direction, half), ()
    inwards, aside, height = half * (1.0 + ROOM)
    across, slope = origins[1], float(direction[1])
    starts, ends = _common(_part_above(across + aside, slope), _part_above(aside - across, -slope))
    begin, end = _part_in_circle(origins, direction, curvature, inwards)
    starts, ends = np.maximum(np.maximum(starts, begin), 0.0), np.minimum(ends, end)
    hole = _part_in_circle(origins, direction, curvature, -inwards)
    if abs(curvature) * height < 0.5 * math.pi:
        begin, end = _part_between_ends(origins, direction, curvature, height, 1.0)
        return np.maximum(starts, begin), np.minimum(ends, end), (hole,)
    # More than half a circle: what is left out between the ends is the wedge.
    wedge = _part_between_ends(origins, direction, curvature, height, -1.0)
    return starts, ends, _joined(hole, wedge)


def _part_in_circle(
    origins: Floats, direction: Floats, curvature: float, outwards: float
) -> RayGap:
    """Where rays are in the cylinder about the bend's axis, `outwards` from its bent axis."""
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


def _part_between_ends(
    origins: Floats, direction: Floats, curvature: float, height: float, sign: float
) -> RayGap:
    """Where rays are on the body's side of both its end planes; of neither if `sign` is -1."""
    angle = curvature * height
    lever, tilt = height * math.sin(angle) / angle, math.cos(angle)
    level, slope = (1.0 - curvature * origins[0]) * lever, -curvature * direction[0] * lever
    rise, climb = origins[2] * tilt, direction[2] * tilt
    below = _part_above(sign * (level - rise), sign * (slope - climb))
    above = _part_above(sign * (level + rise), sign * (slope + climb))
    return _common(below, above)


def _part_above(value: Floats, slope: float) -> RayGap:
    """Where value + slope t is not negative."""
    never, ever = np.full(len(value), np.inf), np.full(len(value), -np.inf)
    if slope > LEAST:
        return -value / slope, never
    if slope < -LEAST:
        return ever, -value / slope
    return np.where(value >= 0.0, ever, never), np.where(value >= 0.0, never, ever)


def _common(first: RayGap, second: RayGap) -> RayGap:
    begin, end = np.maximum(first[0], second[0]), np.minimum(first[1], second[1])
    empty = begin >= end
    return np.where(empty, np.inf, begin), np.where(empty, -np.inf, end)


def _joined(first: RayGap, second: RayGap) -> tuple[RayGap, RayGap]:
    """Two gaps; those that meet are both the whole of them."""
    meet = (first[0] <= second[1]) & (second[0] <= first[1])
    begin, end = np.minimum(first[0], second[0]), np.maximum(first[1], second[1])
    first = np.where(meet, begin, first[0]), np.where(meet, end, first[1])
    return first, (np.where(meet, begin, second[0]), np.where(meet, end, second[1]))
