"""Pieces of a closed surface: what closes a side at an end, and splines through samples.

Samples lie evenly along and around, whatever the parameters of what gives them: the spline's own
error then shows only at edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.geometry import area_centroid, kernel_point
from palpate.core.rebuild.contours import are_star_shaped
from palpate.core.rebuild.ends import End, ProfileCurve, StraightCurve, profile_curves
from palpate.core.splines import (
    CUBIC,
    Basis,
    PeriodicBasis,
    clamped_basis,
    evaluate_grid,
    evaluate_scattered,
    interpolate_grid,
    periodic_knots,
)

RIM = 720  # Points of a rim from which its middle is taken
ROWS, TURNS = 161, 256  # Points along and around
FINER = 8  # Times as many places tell how to set them evenly,
FEW = 31  # each on so many lines across
# Share of the steps that goes with the parameter and not with the length: what has no length still
# has places.
SPREAD = 0.05
# Points (a, b, 3) at places (a,) along, from 0 to 1, and turns (b,), from 0 to 1.
Grid = Callable[[Floats, Floats], Floats]


class Patch(Protocol):
    """A piece of a surface, from one ring to another."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), or derivatives of them.

        Parameters
        ----------
        v, turns : (n,) arrays
            From 0 at its lower ring to 1 at its upper; counter-clockwise seen from above, a whole
            turn is 1.
        by : pair of int
            How often it is differentiated by v and by turns; together up to 2.
        """


@dataclass(frozen=True, slots=True, eq=False)
class EndPatch:
    """A ring's shape, scaled along a curve until it is a point or another ring."""

    side: Patch  # Whose last ring it begins at
    curve: ProfileCurve
    rim: Floats  # Middle of the side's last ring, (3,): from where it is seen whole, if it can be
    middle: Floats  # Middle of the end, (3,)
    upper: bool  # Whether it lies on the side or under it

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """See `Patch.at`."""
        way = v if self.upper else 1.0 - v
        sign = 1.0 if self.upper else (-1.0) ** by[0]
        along, share = (sign * self.curve.at(way, by[0])).T
        edge = np.full(len(turns), 1.0 if self.upper else 0.0)
        offset = self.side.at(edge, turns, (0, by[1]))
        if by[1]:
            return np.asarray(share[:, None] * offset)
        moved = along[:, None] * (self.middle - self.rim) + share[:, None] * (offset - self.rim)
        return np.asarray(moved + self.rim if by[0] == 0 else moved)

    @property
    def folded(self) -> float:
        """How much of a level end lies on itself, over the area that its ring encloses.

        More than 0 where no place sees the ring whole.
        """
        curve = self.curve
        rises = isinstance(curve, StraightCurve) and curve.begin[0] != curve.end[0]
        if not isinstance(curve, StraightCurve) or (rises and self.middle[2] != self.rim[2]):
            return 0.0
        seen = _ring(self.side, self.upper)[:, :2] - self.rim[:2]
        onwards = np.roll(seen, -1, axis=0)
        twice = seen[:, 0] * onwards[:, 1] - seen[:, 1] * onwards[:, 0]
        whole = float(twice.sum())
        return float(np.maximum(-twice, 0.0).sum()) / whole if whole > 0.0 else 1.0


def end_patches(side: Patch, end: End, *, upper: bool) -> tuple[Patch, ...]:
    """What closes a side at an end, from below upwards.

    The end's gap is that of the contours; it is set onto the side's last ring, wherever that lies.
    """
    ring = _ring(side, upper)
    centroid = area_centroid(ring)
    shift = _whole_view(ring[:, :2], centroid) - centroid
    rim = np.array([*(centroid + shift), ring[:, 2].mean()])
    gap = end.height - float(rim[2]) if end.height != end.rim else 0.0
    middle = np.array([*(end.middle + shift), rim[2] + gap]) if gap else rim
    curves = profile_curves(end.profile, gap)
    found = tuple(EndPatch(side, curve, rim, middle, upper) for curve in curves)
    return found if upper else found[::-1]


def _ring(side: Patch, upper: bool) -> Floats:
    """Points (n, 3) of a side's last ring."""
    return side.at(np.full(RIM, 1.0 if upper else 0.0), np.arange(RIM) / RIM)


def _whole_view(ring: Floats, centroid: Floats) -> Floats:
    """From where a ring (n, 2) is seen whole: its centroid, if nowhere or from there, too."""
    if are_star_shaped(ring[None] - centroid)[0]:
        return centroid
    found = kernel_point(ring)
    return centroid if found is None else found


@dataclass(frozen=True, slots=True, eq=False)
class SampledPatch:
    """A spline through samples: see `Patch`."""

    control: Floats  # (n, k, 3)
    miss: float  # Largest distance from what was sampled, seen at places between the samples

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """See `Patch.at`."""
        at = np.stack([np.clip(v, 0.0, 1.0), np.mod(turns, 1.0)], axis=-1)
        return np.asarray(evaluate_scattered(self._bases, self._wound, at, [by])[0])

    def on_grid(self, v: Floats, turns: Floats) -> Floats:
        """Points (a, b, 3) at places v (a,) and turns (b,)."""
        return np.asarray(evaluate_grid(self._bases, self._wound, [v, np.mod(turns, 1.0)]))

    @property
    def _bases(self) -> tuple[Basis, Basis]:
        along, around = self.control.shape[:2]
        return clamped_basis(along), Basis(periodic_knots(around), CUBIC)

    @property
    def _wound(self) -> Floats:
        return np.concatenate([self.control, self.control[:, :CUBIC]], axis=1)


def sampled_patch(grid: Grid, rows: int = ROWS, turns: int = TURNS) -> SampledPatch:
    """Spline through so many evenly spaced points of a surface that is closed around."""
    alongs, arounds = (np.linspace(0.0, 1.0, FINER * count + 1) for count in (rows, turns))
    few = np.linspace(0.0, 1.0, FEW + 2)[1:-1]
    lengths = _ways(grid(alongs, few), axis=0)
    widths = _ways(grid(few, arounds), axis=1)

    def points(v: Floats, t: Floats) -> Floats:
        return grid(np.interp(v, lengths, alongs), np.interp(t, widths, arounds))

    along = clamped_basis(rows)
    places, ends = along.greville(), np.arange(turns) / turns
    values = points(places, ends).transpose(1, 0, 2)
    circle = PeriodicBasis(turns).matrix(ends).toarray()
    around = np.linalg.solve(circle, values.reshape(turns, -1)).reshape(values.shape)
    rings = around.transpose(1, 0, 2).reshape(rows, -1)
    control = interpolate_grid([along], [places], rings).control
    patch = SampledPatch(control.reshape(rows, turns, 3), 0.0)
    between = 0.5 * (places[1:] + places[:-1])
    middles = ends + 0.5 / turns
    off = np.linalg.norm(patch.on_grid(between, middles) - points(between, middles), axis=-1)
    return SampledPatch(patch.control, float(off.max()))


def _ways(points: Floats, axis: int) -> Floats:
    """Share of the way along an axis of a grid of points at which each lies, on the mean."""
    steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1).mean(axis=1 - axis)
    total = max(float(steps.sum()), np.finfo(float).tiny)
    steps = (1.0 - SPREAD) * steps / total + SPREAD / len(steps)
    ways = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(ways / ways[-1])
