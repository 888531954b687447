"""A piece of a surface that anything gives point by point, as a spline through many points.

The points lie evenly along and around, whatever the parameters of what gives them: the spline's
own error then shows only at edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.splines.basis import Basis, PeriodicBasis, clamped_basis
from palpate.core.splines.collocation import interpolate
from palpate.core.splines.knots import CUBIC, periodic_knots
from palpate.core.splines.tensor import evaluate, evaluate_grid

ROWS, TURNS = 161, 256
"""Points along and around."""
FINER = 8
"""Times as many places tell how to set them evenly,"""
FEW = 31
"""each on so many lines across."""
SPREAD = 0.05
"""Share of the steps that goes with the parameter and not with the length: what has no length
still has places."""

Grid = Callable[[Floats, Floats], Floats]
"""Points (a, b, 3) at places (a,) along, from 0 to 1, and turns (b,), from 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledPatch:
    """A spline through samples: see `Patch`."""

    control: Floats
    """(n, k, 3)."""
    miss: float
    """Largest distance from what was sampled, seen at places between the samples."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """See `Patch.at`."""
        at = np.stack([np.clip(v, 0.0, 1.0), np.mod(turns, 1.0)], axis=-1)
        found: Floats = evaluate(self._bases, self._wound, at, [by])[0]
        return found

    def on_grid(self, v: Floats, turns: Floats) -> Floats:
        """Points (a, b, 3) at places v (a,) and turns (b,)."""
        found: Floats = evaluate_grid(self._bases, self._wound, [v, np.mod(turns, 1.0)])
        return found

    @property
    def _bases(self) -> tuple[Basis, Basis]:
        along, around = self.control.shape[:2]
        return clamped_basis(along), Basis(periodic_knots(around), CUBIC)

    @property
    def _wound(self) -> Floats:
        return np.concatenate([self.control, self.control[:, :CUBIC]], axis=1)


def sampled_patch(grid: Grid, rows: int = ROWS, turns: int = TURNS) -> SampledPatch:
    """Spline through evenly spaced points of a surface that is closed around.

    Parameters
    ----------
    grid : callable
        Gives the points.
    rows, turns : int
        How many.
    """
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
    control = interpolate([along], [places], around.transpose(1, 0, 2).reshape(rows, -1)).control
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
    shares: Floats = ways / ways[-1]
    return shares
