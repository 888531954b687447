"""Linear tapering along z, bending of the z axis to an arc, and rays clipped to a bent box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.ray_casting import BOX_MARGIN, RayGap, clip_to_box

MIN_CURVATURE = 1e-200  # [1/m]; a smaller bend moves nothing, but could underflow
MIN_DIVISOR = 1e-200  # replaces a vanishing divisor, so that no quotient is 0 / 0 or overflows


@dataclass(frozen=True, slots=True)
class Taper:
    """Widens x and y in proportion to the height: Fung, 1999, (2.7).

    Beyond the ends of the tapered solid the widths are those of the ends, so that space is mapped
    one to one. `along_x` and `along_y`: widening at the top, and narrowing at the bottom, as a
    fraction of the width; between -1 and 1, so that no section collapses. `half_height`: of the
    tapered solid [m]. Raises ValueError if a fraction is not between -1 and 1.
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
        """Points (n, 3) before the taper."""
        return points / self._widths(points[:, 2])

    def _widths(self, height: Floats) -> Floats:
        share = np.clip(height / self.half_height, -1.0, 1.0)
        return np.column_stack(
            [1.0 + self.along_x * share, 1.0 + self.along_y * share, np.ones_like(share)]
        )


class Unbent(NamedTuple):
    """Places in the plane of a bend, straightened."""

    inwards: Floats  # [m] towards the centre of curvature, if the curvature is not negative
    along: Floats  # [m] height
    stretch: Floats  # length of the fibre through the place over that of the axis
    cosine: Floats  # of the angle by which the bend has turned the place
    sine: Floats  # of the same angle, from upwards to inwards


@dataclass(frozen=True, slots=True)
class Bend:
    """Bends the z axis to a circle whose centre is level with the origin: Fung, 1999, (2.8).

    The axis keeps its length; sections across it stay plane and perpendicular to it. `curvature`:
    of the bent axis [1/m]; 0 bends nothing. `direction`: azimuth towards which both ends move
    [rad], or away from which if the curvature is negative. Raises ValueError if either is not
    finite. (2.8) and (2.9) with the angle k z, where the text divides by k, and with the coordinate
    x cos + y sin, where it takes an arc tangent. No form here loses digits as k vanishes.
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
        that the axis would close to a circle, where bent points coincide.
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
        """Points (n, 3) before the bend."""
        inwards = points[:, :2] @ self.towards
        straight = self.unbend(inwards, points[:, 2])
        moved = (straight.inwards - inwards)[:, None] * self.towards
        return np.column_stack([points[:, :2] + moved, straight.along])

    @property
    def towards(self) -> Floats:
        """Unit vector (2,) of the direction."""
        return np.array([math.cos(self.direction), math.sin(self.direction)])

    def unbend(self, inwards: Floats, height: Floats) -> Unbent:
        """Places before the bend, from those in the bend's plane, (n,) each [m]."""
        k = self.curvature
        if abs(k) < MIN_CURVATURE:
            ones = np.ones_like(inwards)
            return Unbent(inwards, height, ones, ones, 0.0 * ones)
        rise, level = k * height, 1.0 - k * inwards
        stretch = np.sqrt(rise * rise + level * level)
        before = (2.0 * inwards - k * (inwards * inwards + height * height)) / (1.0 + stretch)
        centre = np.maximum(stretch, MIN_CURVATURE)
        return Unbent(before, np.arctan2(rise, level) / k, stretch, level / centre, rise / centre)


def _sinc(angle: Floats) -> Floats:
    """sin(angle) / angle, 1 at 0."""
    safe = np.where(angle == 0.0, 1.0, angle)
    return np.where(angle == 0.0, 1.0, np.sin(safe) / safe)


def clip_to_bent_box(
    origins: Floats, direction: Floats, half: Floats, curvature: float
) -> tuple[Floats, Floats, tuple[RayGap, ...]]:
    """Ranges at which parallel rays enter and leave a box that was bent with its axis.

    `origins` (3, n), `direction` (3,) and `half` (3,), half the edges before the bend, are by
    coordinate: towards the centre of curvature, perpendicular to the bend's plane, up. Returns the
    first entry, at least 0 and after the end for a ray that misses, and the last exit, (n,) [m];
    and disjoint gaps between them.
    """
    if abs(curvature) < MIN_CURVATURE:
        return *clip_to_box(origins, direction, half), ()
    inwards, aside, height = half * (1.0 + BOX_MARGIN)
    across, slope = origins[1], float(direction[1])
    starts, ends = _common(_part_above(across + aside, slope), _part_above(aside - across, -slope))
    begin, end = _part_in_circle(origins, direction, curvature, inwards)
    starts, ends = np.maximum(np.maximum(starts, begin), 0.0), np.minimum(ends, end)
    hole = _part_in_circle(origins, direction, curvature, -inwards)
    if abs(curvature) * height < 0.5 * math.pi:
        begin, end = _part_between_ends(origins, direction, curvature, height, 1.0)
        return np.maximum(starts, begin), np.minimum(ends, end), (hole,)
    # More than half a circle: the part outside is the wedge between the ends.
    wedge = _part_between_ends(origins, direction, curvature, height, -1.0)
    return starts, ends, _joined(hole, wedge)


def _part_in_circle(
    origins: Floats, direction: Floats, curvature: float, outwards: float
) -> RayGap:
    """Interval of rays in a cylinder about the bend's axis.

    Its radius is that of the bent z axis plus `outwards` [m].
    """
    k, sign = abs(curvature), math.copysign(1.0, curvature)
    across, _, up = direction
    x, _, z = origins
    a = max(k * (across * across + up * up), MIN_DIVISOR)
    b = k * (x * across + z * up) - sign * across
    c = k * (x * x + z * z) - sign * 2.0 * x - outwards * (2.0 + k * outwards)
    inner = b * b - a * c
    root = b + np.copysign(np.sqrt(np.maximum(inner, 0.0)), b)
    root = np.where(root == 0.0, MIN_DIVISOR, root)
    with np.errstate(over="ignore"):
        first, second = -root / a, -c / root
    met = inner > 0.0
    begin = np.where(met, np.minimum(first, second), np.inf)
    return begin, np.where(met, np.maximum(first, second), -np.inf)


def _part_between_ends(
    origins: Floats, direction: Floats, curvature: float, height: float, sign: float
) -> RayGap:
    """Interval of rays on the solid's side of both end planes; of neither if `sign` is -1."""
    angle = curvature * height
    lever, tilt = height * math.sin(angle) / angle, math.cos(angle)
    level, slope = (1.0 - curvature * origins[0]) * lever, -curvature * direction[0] * lever
    rise, climb = origins[2] * tilt, direction[2] * tilt
    below = _part_above(sign * (level - rise), sign * (slope - climb))
    above = _part_above(sign * (level + rise), sign * (slope + climb))
    return _common(below, above)


def _part_above(value: Floats, slope: float) -> RayGap:
    """Interval where value + slope t is not negative."""
    never, ever = np.full(len(value), np.inf), np.full(len(value), -np.inf)
    if slope > MIN_DIVISOR:
        return -value / slope, never
    if slope < -MIN_DIVISOR:
        return ever, -value / slope
    return np.where(value >= 0.0, ever, never), np.where(value >= 0.0, never, ever)


def _common(first: RayGap, second: RayGap) -> RayGap:
    begin, end = np.maximum(first[0], second[0]), np.minimum(first[1], second[1])
    empty = begin >= end
    return np.where(empty, np.inf, begin), np.where(empty, -np.inf, end)


def _joined(first: RayGap, second: RayGap) -> tuple[RayGap, RayGap]:
    """Two gaps of each ray; if they overlap, both are their union."""
    meet = (first[0] <= second[1]) & (second[0] <= first[1])
    begin, end = np.minimum(first[0], second[0]), np.maximum(first[1], second[1])
    first = np.where(meet, begin, first[0]), np.where(meet, end, first[1])
    return first, (np.where(meet, begin, second[0]), np.where(meet, end, second[1]))
