"""Rays at a hyperquadric: its terms along them, bounds of these, and where they first enter."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.shapes.certain_march import Below, Floor, certain_first_roots
from palpate.core.shapes.dent import Dent
from palpate.core.shapes.first_root import Which, first_roots
from palpate.core.shapes.powers import line_above, line_below, power_slopes, powers


class Beam(NamedTuple):
    """Some rays, by the values of the linear forms where they start."""

    h: Floats
    """Of the terms, (k, n)."""
    rate: Floats
    """How they change, (k, n) or (k, 1), 1/m."""
    exponents: Floats
    """(k, 1)."""
    dents: tuple[tuple[Dent, Floats, Floats], ...]
    """The dents with values and rates of their forms."""

    def of(self, which: Which) -> Beam:
        """Some of the rays."""
        dents = tuple((dent, h[:, which], _some(rate, which)) for dent, h, rate in self.dents)
        return Beam(self.h[:, which], _some(self.rate, which), self.exponents, dents)

    def at(self, places: Floats) -> Beam:
        """The same rays from places (n,) along them on."""
        dents = tuple((dent, h + rate * places, rate) for dent, h, rate in self.dents)
        return Beam(self.h + self.rate * places, self.rate, self.exponents, dents)

    def level(self) -> tuple[Floats, Floats]:
        """H less 1 and its slope where the rays start, (n,)."""
        value = powers(self.h, self.exponents).sum(axis=0) - 1.0
        slope = power_slopes(self.h, self.rate, self.exponents).sum(axis=0)
        for dent, h, rate in self.dents:
            more, steeper = dent.along(h, rate)
            value, slope = value + more, slope + steeper
        return value, slope


def beam(
    planes: Floats, exponents: Floats, dents: tuple[Dent, ...], origins: Floats, directions: Floats
) -> Beam:
    """Rays from origins (n, 3) in directions (n, 3), or in one, (1, 3)."""

    def forms(of: Floats) -> tuple[Floats, Floats]:
        return of[:, :3] @ origins.T + of[:, 3:], of[:, :3] @ directions.T

    kept = tuple((dent, *forms(dent.planes)) for dent in dents)
    return Beam(*forms(planes), exponents[:, None], kept)


def entries(rays: Beam, starts: Floats, ends: Floats, tolerance: float) -> Floats:
    """First place (n,) of each ray at which it is inside, or `MISS`.

    Notes
    -----
    Powers of 1 and more are convex along a ray, and a dent with powers of 2 and more bends
    downwards no more than is known: these go by `first_roots`, all others by bounds.
    """
    dip = sum(dent.dip(rate) for dent, _, rate in rays.dents)
    if (rays.exponents < 1.0).any() or not math.isfinite(dip):
        return certain_first_roots(below(rays), starts, ends, tolerance)

    def level(places: Floats, which: Which) -> tuple[Floats, Floats]:
        return rays.of(which).at(places).level()

    return first_roots(level, starts, ends, tolerance, dip=dip)


def below(rays: Beam) -> Below:
    """Bounds from below of H less 1."""

    def floor(places: Floats, lengths: Floats, which: Ints) -> Floor:
        now = rays.of(which).at(places)
        slope, drop = (part.sum(axis=0) for part in line_below(*now[:3], lengths))
        for dent, h, rate in now.dents:
            line = dent.line_below(h, rate, lengths)
            slope, drop = slope + line.slope, drop + line.gap
        return Floor(now.level()[0], slope, 0.0, lengths, drop)

    return floor


def above(rays: Beam) -> Below:
    """Bounds from below of 1 less H."""

    def floor(places: Floats, lengths: Floats, which: Ints) -> Floor:
        now = rays.of(which).at(places)
        slope, drop = (part.sum(axis=0) for part in line_above(*now[:3], lengths))
        for dent, h, rate in now.dents:
            line = dent.line_above(h, rate, lengths)
            slope, drop = slope + line.slope, drop + line.gap
        return Floor(-now.level()[0], -slope, 0.0, lengths, drop)

    return floor


def _some(rate: Floats, which: Which) -> Floats:
    return rate if rate.shape[1] == 1 else np.asarray(rate[:, which])
