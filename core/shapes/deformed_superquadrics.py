"""A superquadric that is tapered, then bent: cast exactly, without a mesh.

In the undeformed solid a ray is a curve c(t), and the gauge N(c) is below 1 inside. A taper divides
by the width w of the section; the curve w c needs no division, and

    f(t) = N(w c) - w

vanishes on the surface. N is a norm, so that f is convex except for the bending of the curve
itself: f'' >= -N((w c)'') - |w''|, which is bounded by the solid's dimensions alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import Pose
from palpate.core.shapes import ray_casting
from palpate.core.shapes.global_deformations import Bend, Taper, clip_to_bent_box
from palpate.core.shapes.protocol import ImplicitShape, Mesh, PosedShape
from palpate.core.shapes.superquadrics import RANGE_TOLERANCE, TINY, Superquadric

NO_BEND = Bend(0.0)
# Places and slopes (3, m) to a norm and its slope.
NormFunction = Callable[[Floats, Floats], tuple[Floats, Floats]]


class DeformedSuperquadric(ImplicitShape):
    """A superquadric about the origin, tapered along z, then bent.

    `base`: the undeformed solid. `taper` (2,): relative widening of x and y at the top: see
    `Taper`. `bend`: of the tapered solid. Raises ValueError if a taper collapses the solid, or the
    bend folds it or closes it to a ring.
    """

    def __init__(self, base: Superquadric, taper: Floats, bend: Bend = NO_BEND):
        self._base, self._bend = base, bend
        self._taper = Taper(float(taper[0]), float(taper[1]), float(base.size[2]))
        limit = largest_curvature(base, taper, bend.direction)
        if not abs(bend.curvature) <= limit:
            raise ValueError(
                f"bend must lie between {-limit:.4g} and {limit:.4g} 1/m, or this solid folds, "
                f"got {bend.curvature:g}"
            )
        self._half = _half_box(base, taper, bend.direction)
        self._straightening = Straightening(base.size, taper, bend)
        cosine, sine = bend.towards
        self._axes = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def enclosure(self) -> Floats:
        """An upright box about the solid: see `ImplicitShape.enclosure`."""
        inwards, _, height = self._half.tolist()
        # A bend moves sideways most at the ends; up most there, or where the axis is level.
        turned = 0.5 * math.pi / max(abs(self._bend.curvature), TINY)
        edge, rise = np.array([-inwards, inwards] * 3), [0.0, min(height, turned), height]
        bent = Bend(self._bend.curvature)(np.column_stack([edge, 0.0 * edge, np.repeat(rise, 2)]))
        moved = np.outer(bent[:, 0] - edge, self._bend.towards)
        width, depth = self._base.size[:2] * (1.0 + np.abs(self._straightening.taper))
        top = float(bent[:, 2].max())
        low = [-width + moved[:, 0].min(), -depth + moved[:, 1].min(), -top]
        return np.array([low, [width + moved[:, 0].max(), depth + moved[:, 1].max(), top]])

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """The gauge less 1, times the section's width: see `ImplicitShape.inside_out`."""
        return self._height(self._axes.T @ points.T, self._axes.T @ directions.T)

    def gauge(self, points: Floats) -> Floats:
        """The base's gauge of points (n, 3), straightened: below 1 inside, above 1 outside."""
        return self._base.gauge(self._taper.inverse(self._bend.inverse(points)))

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) to the surface along parallel rays: see `Shape.cast`."""
        places, towards = self._axes.T @ origins.T, self._axes.T @ direction
        curvature, along = self._bend.curvature, towards[:, None]
        starts, ends, gaps = clip_to_bent_box(places, towards, self._half, curvature)
        ends = np.minimum(ends, reach)
        dip, rise = self._dip_and_rise(towards)

        def roots(met: Ints) -> Floats:
            near = places[:, met]

            def height(travelled: Floats, which: ray_casting.RaySelection) -> tuple[Floats, Floats]:
                return self._height(near[:, which] + along * travelled, towards)

            return ray_casting.first_roots(
                height,
                starts[met],
                ends[met],
                tolerance=RANGE_TOLERANCE * float(self._base.size.min()),
                dip=dip,
                rise=rise,
                gaps=tuple((begin[met], end[met]) for begin, end in gaps),
            )

        return ray_casting.ranges_of(starts, ends, roots)

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside: see `CsgSolid.spans`."""
        places, towards = self._axes.T @ origins.T, self._axes.T @ direction
        starts, ends, gaps = clip_to_bent_box(places, towards, self._half, self._bend.curvature)
        along = towards[:, None]

        def curve(travelled: Floats, which: Ints) -> StraightenedRays:
            return self._straightening.along(places[:, which] + along * travelled, towards)

        dip = self._dip_and_rise(towards)[0]
        return ray_casting.marched_spans(
            outside_minorant(curve, self._base.gauge_along, dip, gaps),
            inside_minorant(curve, self._base.gauge_along, dip),
            starts,
            ends,
            RANGE_TOLERANCE * float(self._base.size.min()),
        )

    def mesh(self, level: int) -> Mesh:
        """The base's tessellation, tapered and bent: see `Shape.mesh`."""
        vertices, faces = self._base.mesh(level)
        return Mesh(self._bend(self._taper(vertices)), faces)

    def _height(self, places: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """A function that is 0 on the surface and its slope along rays: `Straightening`."""
        place, slope, width, width_slope = self._straightening.along(places, direction)
        gauge, gauge_slope = self._base.gauge_along(place, slope)
        return gauge - width, gauge_slope - width_slope

    def _dip_and_rise(self, direction: Floats) -> tuple[float, float]:
        """Bounds [1/m2] of that function's downward and upward bend where it is positive."""
        place, width, least_width = self._straightening.bound(direction, self._half)
        most = np.array(place)[:, 1:]  # slope and curve of each coordinate
        speed, down = self._base.gauge_along(most, np.zeros((3, 1)))[0].tolist()
        dip = down + width.curve
        return dip, self._base.smoothness() * speed**2 / least_width + dip


def largest_curvature(
    base: Superquadric, taper: Floats, direction: float, share: float = 0.98
) -> float:
    """Largest curvature [1/m] to which a tapered superquadric may be bent.

    `base`: the undeformed solid. `taper` (2,): widening of x and y at the top. `direction`: azimuth
    of the bend [rad]. `share`: of the curvature that folds the inner side, or closes a ring.
    """
    inwards, _, height = _half_box(base, taper, direction).tolist()
    return share * float(min(1.0 / inwards, math.pi / height))


def _half_box(base: Superquadric, taper: Floats, direction: float) -> Floats:
    """Half edges of a box about the tapered solid, along the bend, by the dual of its norm."""
    width, depth = (base.size[:2] * (1.0 + np.abs(taper))).tolist()
    cosine, sine = math.cos(direction), math.sin(direction)
    e2 = float(base.exponents[1])
    inwards = _dual_norm(width * cosine, depth * sine, e2)
    return np.array([inwards, _dual_norm(width * sine, depth * cosine, e2), base.size[2]])


def _dual_norm(x: float, y: float, e2: float) -> float:
    small, large = sorted((abs(x), abs(y)))
    if e2 == 2.0:
        return large
    power = 2.0 / (2.0 - e2)
    result: float = large * (1.0 + (small / large) ** power) ** (1.0 / power)
    return result


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FittedSuperquadric:
    """A superquadric, tapered and bent, fitted to points."""

    size: Floats  # semi-axes (3,) [m]
    exponents: Floats  # e1 and e2, (2,)
    pose: Floats  # (7,)
    taper: Floats  # widening of x and y at the top, (2,)
    bend: Bend  # of the tapered solid
    residuals: Floats  # first-order distances along the normal, (n,) [m]; negative inside
    rms: float  # [m] root mean square of the inliers' residuals
    warnings: tuple[str, ...]  # reasons to doubt the fit

    @property
    def fitted(self) -> bool:
        """False if no fit was possible, and the solid is only an ellipsoid around the points."""
        return not any(warning.endswith("points") for warning in self.warnings)

    def shape(self) -> PosedShape:
        """The solid at its pose; ValueError if it has no extent, or its bend folds it."""
        base, pose = Superquadric(self.size, self.exponents), Pose.from_array(self.pose)
        if not self.taper.any() and self.bend.curvature == 0.0:
            return PosedShape(base, pose)
        return PosedShape(DeformedSuperquadric(base, self.taper, self.bend), pose)


class StraightenedRays(NamedTuple):
    """Places on curves, times the width there, in semi-axes."""

    place: Floats  # by coordinate, (3, n)
    slope: Floats  # derivative of the place, (3, n)
    width: Floats | float  # (n,) or 1
    width_slope: Floats | float  # derivative of the width


@dataclass(frozen=True, slots=True, eq=False)
class Straightening:
    """Inverse of a taper and a bend along rays; axes towards the centre, across the plane, up."""

    size: Floats
    taper: Floats
    bend: Bend

    def along(self, places: Floats, direction: Floats) -> StraightenedRays:
        """Curves at places (3, n) [m] on rays in a direction (3,) or (3, n)."""
        u, v, height = places
        du, dv, rise = direction
        r, z, stretch, cosine, sine = self.bend.unbend(u, height)
        dr = cosine * du - sine * rise
        dz = (cosine * rise + sine * du) / stretch
        z, dz = z / self.size[2], dz / self.size[2]
        (xr, xv), (yr, yv) = self._turn()
        x, dx = xr * r + xv * v, xr * dr + xv * dv
        y, dy = yr * r + yv * v, yr * dr + yv * dv
        kx, ky = self.taper.tolist()
        if kx == ky:
            width, slope = 1.0 + kx * z, kx * dz
            place, rates = [x, y, z * width], [dx, dy, dz * width + z * slope]
            return StraightenedRays(np.stack(place), np.stack(rates), width, slope)
        wide, deep, dwide, ddeep = 1.0 + kx * z, 1.0 + ky * z, kx * dz, ky * dz
        width, slope = wide * deep, dwide * deep + wide * ddeep
        place = [x * deep, y * wide, z * width]
        rates = [dx * deep + x * ddeep, dy * wide + y * dwide, dz * width + z * slope]
        return StraightenedRays(np.stack(place), np.stack(rates), width, slope)

    def bound(
        self, direction: Floats, half: Floats
    ) -> tuple[tuple[DerivativeBound, ...], DerivativeBound, float]:
        """Bounds of the coordinates times the width, of the width, and the least width.

        For all rays in a direction (3,), in a bent box of half edges (3,) [m].
        """
        r, v, z = self._unbent_bound(direction, half)
        (xr, xv), (yr, yv) = self._turn()
        x, y = r.scaled(xr).plus(v.scaled(xv)), r.scaled(yr).plus(v.scaled(yv))
        z = z.scaled(1.0 / float(self.size[2]))
        kx, ky = self.taper.tolist()
        wide, deep = UNIT_BOUND.plus(z.scaled(kx)), UNIT_BOUND.plus(z.scaled(ky))
        if kx == ky:
            return (x, y, z.times(wide)), wide, 1.0 - abs(kx)
        width = wide.times(deep)
        least = (1.0 - abs(kx)) * (1.0 - abs(ky))
        return (x.times(deep), y.times(wide), z.times(width)), width, least

    def _unbent_bound(
        self, direction: Floats, half: Floats
    ) -> tuple[DerivativeBound, DerivativeBound, DerivativeBound]:
        """Bounds of the coordinates of `Bend.unbend`.

        With s the stretch, r'' = -k (s z')^2 / s and z'' = 2 k z' r' / s.
        """
        du, dv, rise = (abs(d) for d in direction.tolist())
        inwards, aside, height = half.tolist()
        k = abs(self.bend.curvature)
        least_stretch = 1.0 - k * inwards
        sine = math.sin(min(k * height, 0.5 * math.pi))
        speed = math.hypot(du, rise)
        dr, along = min(du + sine * rise, speed), min(rise + sine * du, speed)
        dz = along / least_stretch
        return (
            DerivativeBound(inwards, dr, k * along * dz),
            DerivativeBound(aside, dv, 0.0),
            DerivativeBound(height, dz, 2.0 * k * dz * dr / least_stretch),
        )

    def _turn(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Coefficients of x and y, in semi-axes, by coordinates in and across the bend's plane."""
        cosine, sine = self.bend.towards.tolist()
        a, b, _ = self.size.tolist()
        return (cosine / a, -sine / a), (sine / b, cosine / b)


class DerivativeBound(NamedTuple):
    """Bounds of a quantity's absolute values along rays."""

    value: float
    slope: float  # of the first derivative
    curve: float  # of the second derivative

    def times(self, other: DerivativeBound) -> DerivativeBound:
        """Bound of the product of two quantities."""
        return DerivativeBound(
            self.value * other.value,
            self.slope * other.value + self.value * other.slope,
            self.curve * other.value + 2.0 * self.slope * other.slope + self.value * other.curve,
        )

    def plus(self, other: DerivativeBound) -> DerivativeBound:
        """Bound of the sum of two quantities."""
        return DerivativeBound(
            self.value + other.value, self.slope + other.slope, self.curve + other.curve
        )

    def scaled(self, factor: float) -> DerivativeBound:
        """Bound of a multiple of the quantity."""
        factor = abs(factor)
        return DerivativeBound(factor * self.value, factor * self.slope, factor * self.curve)


def outside_minorant(
    curve: RaysAt, norm: NormFunction, dip: float, gaps: tuple[ray_casting.RayGap, ...]
) -> ray_casting.MinorantFunction:
    """Lower bounds of f, from c, w, N and a bound of N(c'') + |w''|; 1 in the gaps."""

    def floor(places: Floats, lengths: Floats, which: Ints) -> ray_casting.Minorant:
        in_gap = np.zeros(len(places), bool)
        for begin, end in ((begin[which], end[which]) for begin, end in gaps):
            is_in = (begin <= places) & (places < end)
            stop = np.where(places < begin, begin, np.where(is_in, end, np.inf))
            lengths = np.minimum(lengths, stop - places)
            in_gap = in_gap | is_in
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # only in gaps
            at = curve(places, which)
            value, slope = norm(at.place, at.slope)
        value = np.where(in_gap, 1.0, value - at.width)
        slope = np.where(in_gap, 0.0, slope - at.width_slope)
        bend = np.where(in_gap, 0.0, dip)
        return ray_casting.Minorant(value, slope, bend, lengths, np.zeros_like(value))

    return floor


def inside_minorant(curve: RaysAt, norm: NormFunction, dip: float) -> ray_casting.MinorantFunction:
    """Lower bounds of -f, for places inside; parameters as of `outside_minorant`."""

    def floor(places: Floats, lengths: Floats, which: Ints) -> ray_casting.Minorant:
        at = curve(places, which)
        here = norm(at.place, at.slope)[0]
        there = norm(at.place + lengths * at.slope, at.slope)[0]
        rise = (there - here) / (lengths + TINY)
        bend = np.full_like(places, dip)
        width, slope = at.width - here, at.width_slope - rise
        return ray_casting.Minorant(width, slope, bend, lengths, np.zeros_like(here))

    return floor


UNIT_BOUND = DerivativeBound(1.0, 0.0, 0.0)  # of the constant 1
# Places (m,) on selected rays to the curves there.
RaysAt = Callable[[Floats, Ints], StraightenedRays]
