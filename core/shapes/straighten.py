"""Rays through a tapered and bent solid, as they look in the solid before.

There a ray is a curve c(t), and a superquadric is where the gauge N(c) is below 1. A taper
divides by the width w of the section; the curve w c, which is what is given here, needs no
division, and

    f(t) = N(w c) - w

has the surface for its roots. N is a norm, so that f is convex but for the bending of the curve
itself: f'' >= -N((w c)'') - |w''|, and that is bounded by the solid's measures alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.bound import ONE, Bound


class Curve(NamedTuple):
    """Places on curves, times the width there, in semi-axes."""

    place: Floats
    """By coordinate, (3, n)."""
    slope: Floats
    """Its derivative, (3, n)."""
    width: Floats | float
    """The width alone, (n,) or 1."""
    width_slope: Floats | float
    """Its derivative."""


class CurveBound(NamedTuple):
    """Bounds of all curves that rays of one direction can be."""

    place: tuple[Bound, Bound, Bound]
    """Of the coordinates times the width."""
    width: Bound
    """Of the width."""
    least_width: float
    """Smallest width."""


@dataclass(frozen=True, slots=True, eq=False)
class Straightening:
    """Undoes a taper and a bend along rays.

    Rays are given by their coordinates towards the bend's centre, square to its plane and up.

    Parameters
    ----------
    size : (3,) array
        Semi-axes, m.
    taper : (2,) array
        Widening of x and y at the top.
    bend : Bend
        The bend.
    """

    size: Floats
    taper: Floats
    bend: Bend

    def along(self, places: Floats, direction: Floats) -> Curve:
        """Curves at places (3, n) on rays in a direction (3,) or (3, n), m."""
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
            return Curve(
                np.stack([x, y, z * width]),
                np.stack([dx, dy, dz * width + z * slope]),
                width,
                slope,
            )
        wide, deep, dwide, ddeep = 1.0 + kx * z, 1.0 + ky * z, kx * dz, ky * dz
        width, slope = wide * deep, dwide * deep + wide * ddeep
        return Curve(
            np.stack([x * deep, y * wide, z * width]),
            np.stack([dx * deep + x * ddeep, dy * wide + y * dwide, dz * width + z * slope]),
            width,
            slope,
        )

    def bound(self, direction: Floats, half: Floats) -> CurveBound:
        """Bounds for rays in a direction (3,), within a bent box of half edges (3,), m."""
        r, v, z = self._unbent_bound(direction, half)
        (xr, xv), (yr, yv) = self._turn()
        x, y = r.scaled(xr).plus(v.scaled(xv)), r.scaled(yr).plus(v.scaled(yv))
        z = z.scaled(1.0 / float(self.size[2]))
        kx, ky = self.taper.tolist()
        wide, deep = ONE.plus(z.scaled(kx)), ONE.plus(z.scaled(ky))
        if kx == ky:
            return CurveBound((x, y, z.times(wide)), wide, 1.0 - abs(kx))
        width = wide.times(deep)
        least = (1.0 - abs(kx)) * (1.0 - abs(ky))
        return CurveBound((x.times(deep), y.times(wide), z.times(width)), width, least)

    def _unbent_bound(self, direction: Floats, half: Floats) -> tuple[Bound, Bound, Bound]:
        """Bounds of the coordinates that `Bend.unbend` gives.

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
            Bound(inwards, dr, k * along * dz),
            Bound(aside, dv, 0.0),
            Bound(height, dz, 2.0 * k * dz * dr / least_stretch),
        )

    def _turn(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Shares of the coordinates in and across the bend's plane in x and in y, in semi-axes."""
        cosine, sine = self.bend.towards.tolist()
        a, b, _ = self.size.tolist()
        return (cosine / a, -sine / a), (sine / b, cosine / b)
