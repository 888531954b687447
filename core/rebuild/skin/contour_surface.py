"""A spline surface around an axis: clamped along it, closed around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.skin.latitude import Latitude
from palpate.core.splines.basis import Basis
from palpate.core.splines.knots import CUBIC, periodic_knots
from palpate.core.splines.tensor import evaluate, evaluate_grid


@dataclass(frozen=True, slots=True, eq=False)
class ContourSurface:
    """The surface, from its lowest contour or pole to its highest."""

    latitude: Latitude
    """Parameter along the axis."""
    along: Basis
    """Splines along it; the surface spans their domain."""
    control: Floats
    """Coefficients (n, k, 2) about `middle`, m."""
    middle: Floats
    """(2,), m."""

    @property
    def reach(self) -> tuple[float, float]:
        """Heights at which it begins and ends, m."""
        low, high = self.latitude.height(np.array(self.along.domain))
        return float(low), float(high)

    def at(self, heights: ArrayLike, turns: ArrayLike, by: tuple[int, int] = (0, 0)) -> Floats:
        """Places in the plane at heights, m, and turns, which are broadcast: (..., 2), m.

        Beyond its reach its section is carried on.

        Parameters
        ----------
        heights, turns : arrays
            Any; a whole turn is 1.
        by : pair of int
            How often to differentiate by the height, once at most, and by the turn. At a round
            end the slope by the height grows without limit: see `places`.

        Raises
        ------
        ValueError
            If a number is not finite, or a derivative is negative or not offered.
        """
        if by[0] not in (0, 1):
            raise ValueError(f"by must be 0 or 1 in the height, got {by[0]}")
        heights, turns = np.broadcast_arrays(np.asarray(heights, float), np.asarray(turns, float))
        flat = finite_array("heights", heights.ravel(), (None,))
        latitudes = self.within(flat)
        plane = self.places(latitudes, turns.ravel(), by)[:, :2]
        if by[0]:
            rise = np.maximum(self.latitude.height(latitudes, 1), np.finfo(float).tiny)
            outside = (flat < self.reach[0]) | (flat > self.reach[1])
            plane = np.where(outside, 0.0, 1.0 / rise)[:, None] * plane
        return plane.reshape(*heights.shape, 2)

    def within(self, heights: Floats) -> Floats:
        """Latitudes (n,) of heights (n,), m; those beyond its reach are taken to its ends."""
        low, high = self.along.domain
        latitudes: Floats = np.clip(self.latitude.of(heights), low, high)
        return latitudes

    def places(self, latitudes: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), m, at latitudes and turns (n,), or derivatives by them.

        Raises
        ------
        ValueError
            If a number is not finite, a latitude lies outside the domain, or a derivative is
            negative.
        """
        at = np.stack([latitudes, np.mod(finite_array("turns", turns, (None,)), 1.0)], axis=-1)
        (plane,) = evaluate(self._bases, self._wound, at, [by])
        rise = self.latitude.height(latitudes, by[0]) if by[1] == 0 else np.zeros(len(at))
        return np.column_stack([plane + self.middle if by == (0, 0) else plane, rise])

    def on_grid(self, latitudes: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Their first two coordinates at every pair of latitudes (a,) and turns (b,): (a, b, 2)."""
        plane = evaluate_grid(self._bases, self._wound, [latitudes, np.mod(turns, 1.0)], by)
        return plane + self.middle if by == (0, 0) else plane

    @property
    def _bases(self) -> tuple[Basis, Basis]:
        return self.along, Basis(periodic_knots(self.control.shape[1]), CUBIC)

    @property
    def _wound(self) -> Floats:
        return np.concatenate([self.control, self.control[:, :CUBIC]], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class SidePatch:
    """The same from 0 at its lower end to 1 at its upper one, evenly in the latitude."""

    surface: ContourSurface
    """The surface."""

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3), m, at shares v and turns (n,), or derivatives by them."""
        low, high = self.surface.along.domain
        latitudes = np.clip(low + (high - low) * v, low, high)
        return (high - low) ** by[0] * self.surface.places(latitudes, turns, by)
