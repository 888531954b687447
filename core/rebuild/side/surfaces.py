"""A spline surface around an axis, and its parameter along the axis: a latitude where it is round.

Towards a round end the radius falls like the root of the distance from it, with a slope that no
spline in the height can follow; in the latitude the radius is smooth (that of an ellipsoid is a
cosine). Contours on either side of a step lie close together and differ much: there the parameter
follows the arc length along the surface (Gregory and Delbourgo, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.splines import (
    CUBIC,
    Basis,
    averaged_knots,
    clamped_basis,
    evaluate_grid,
    evaluate_scattered,
    wound_basis,
)


@dataclass(frozen=True, slots=True, eq=False)
class LoftPatch:
    """The surface, from 0 at its lowest contour or pole to 1 at its highest, by the parameter."""

    axial_parameter: AxialParameter  # parameter along the axis
    basis: Basis  # splines along it; the surface spans their domain
    control: Floats  # coefficients (n, k, 2) about `middle` [m]
    middle: Floats  # (2,) [m]

    @property
    def reach(self) -> tuple[float, float]:
        """Heights at which it begins and ends [m]."""
        low, high = self.axial_parameter.height(np.array(self.basis.domain))
        return float(low), float(high)

    @property
    def along(self) -> Basis:
        """Its splines along, from 0 to 1; of few contours, which have lower degrees, cubic ones."""
        low, high = self.basis.domain
        if self.basis.degree != CUBIC:
            return clamped_basis(CUBIC + 1)
        return Basis((self.basis.knots - low) / (high - low), CUBIC)

    @property
    def around(self) -> int:
        """Number of its coefficients around."""
        return int(self.control.shape[1])

    def at(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """Points (n, 3) [m] at parameters v and turns (n,), or derivatives by them."""
        parameters, extent = self._parameters(v)
        places = np.stack([parameters, np.mod(turns, 1.0)], axis=-1)
        (plane,) = evaluate_scattered(self._bases, self._wound, places, [by])
        rise = self.axial_parameter.height(parameters, by[0]) if by[1] == 0 else np.zeros(len(v))
        points = np.column_stack([plane + self.middle if by == (0, 0) else plane, rise])
        return extent ** by[0] * points

    def on_grid(self, v: Floats, turns: Floats, by: tuple[int, int] = (0, 0)) -> Floats:
        """The same at each pair of parameters v (a,) and turns (b,): (a, b, 3) [m]."""
        parameters, extent = self._parameters(v)
        points = np.zeros((len(v), len(turns), 3))
        points[..., :2] = self.by_parameters(parameters, turns, by)
        if by[1] == 0:
            points[..., 2] = self.axial_parameter.height(parameters, by[0])[:, None]
        return extent ** by[0] * points

    def rings(self, heights: Floats, turns: Floats) -> Floats:
        """Places in the plane (a, b, 2) [m] at heights (a,) [m] and turns (b,).

        Beyond its reach the section is that at its end.
        """
        parameters = np.clip(self.axial_parameter.of(heights), *self.basis.domain)
        return self.by_parameters(parameters, turns)

    def by_parameters(
        self, parameters: Floats, turns: Floats, by: tuple[int, int] = (0, 0)
    ) -> Floats:
        """Places in the plane at parameters (a,) along the axis and turns (b,), or derivatives."""
        plane = evaluate_grid(self._bases, self._wound, [parameters, np.mod(turns, 1.0)], by)
        return plane + self.middle if by == (0, 0) else plane

    def _parameters(self, v: Floats) -> tuple[Floats, float]:
        low, high = self.basis.domain
        return np.clip(low + (high - low) * v, low, high), high - low

    @property
    def _bases(self) -> tuple[Basis, Basis]:
        return self.basis, wound_basis(self.control.shape[1])

    @property
    def _wound(self) -> Floats:
        return np.concatenate([self.control, self.control[:, :CUBIC]], axis=1)


@dataclass(frozen=True, slots=True)
class AxialParameter:
    """Parameter of the heights between two ends, each of which may be round.

    It is the angle whose sine is the height if both are round, the root of the distance from a
    single round end, and the height if none is. All are about 1 in size.
    """

    low: float  # height of the lower end [m]
    high: float  # height of the upper end [m]
    round: tuple[bool, bool]  # whether it closes with a sphere's slope: below, above
    reparametrisation: Reparametrisation | None = None  # from that to another parameter

    def of(self, heights: Floats) -> Floats:
        """Parameters (n,) of heights (n,) [m]; heights beyond an end are clipped to it."""
        above = np.clip((heights - self.low) / (self.high - self.low), 0.0, 1.0)
        below = np.clip((self.high - heights) / (self.high - self.low), 0.0, 1.0)
        match self.round:
            case (True, True):
                # By both distances: the arcsine is inexact next to an end.
                parameters = 2.0 * np.arctan2(np.sqrt(above), np.sqrt(below)) - 0.5 * np.pi
            case (True, False):
                parameters = np.sqrt(above)
            case (False, True):
                parameters = -np.sqrt(below)
            case _:
                parameters = above
        result: Floats = (
            parameters if self.reparametrisation is None else self.reparametrisation.of(parameters)
        )
        return result

    def height(self, parameters: Floats, derivative: int = 0) -> Floats:
        """Heights (n,) [m] of parameters (n,), or their first or second derivative."""
        if self.reparametrisation is None:
            return self._height(parameters, derivative)
        even = self.reparametrisation.value(parameters)
        if derivative == 0:
            return self._height(even, 0)
        slope = self.reparametrisation.value(parameters, 1)
        if derivative == 1:
            return slope * self._height(even, 1)
        bend = self.reparametrisation.value(parameters, 2)
        return slope**2 * self._height(even, 2) + bend * self._height(even, 1)

    def _height(self, parameters: Floats, derivative: int) -> Floats:
        """Heights [m] or derivatives, without the reparametrisation."""
        extent = self.high - self.low
        if self.round == (True, True):
            half, angle = 0.5 * extent, parameters + 0.5 * np.pi * derivative
            middle = 0.5 * (self.low + self.high)
            return np.asarray(half * np.sin(angle) + (middle if derivative == 0 else 0.0))
        powers = {
            (True, False): [extent, 0.0, self.low],
            (False, True): [-extent, 0.0, self.high],
            (False, False): [extent, self.low],
        }[self.round]
        return np.polyval(np.polyder(powers, derivative), parameters)


def basis_along(sites: Floats, ends: tuple[float, float], max_sites: int = 128) -> Basis:
    """Spline basis that interpolates values at rising parameters (n,).

    Cubic, or lower of few sites, with averaged knots; of one site linear between two `ends`. It has
    at most `max_sites` functions: of more sites, some share a knot interval.
    """
    if len(sites) == 1:
        low, high = ends
        return Basis(np.array([low, low, high, high]), 1)
    if len(sites) > max_sites:
        places = np.linspace(0.0, len(sites) - 1.0, max_sites)
        sites = np.interp(places, np.arange(len(sites)), sites)
    degree = min(CUBIC, len(sites) - 1)
    return Basis(averaged_knots(sites, degree), degree)


@dataclass(frozen=True, slots=True, eq=False)
class Reparametrisation:
    """A rising function through places, with a continuous slope, and its inverse.

    Gregory and Delbourgo, *Piecewise rational quadratic interpolation to monotonic data*, 1982:
    within each step the inverse is the root of a quadratic.
    """

    given: Floats  # rising values (m,) that are mapped
    mapped: Floats  # rising places (m,) to which they are mapped
    slopes: Floats  # positive derivatives (m,) of the values by the places

    def of(self, values: Floats) -> Floats:
        """Places (n,) of values (n,); values beyond the ends are clipped to them."""
        value = np.clip(values, self.given[0], self.given[-1])
        step = self._step(self.given, value)
        rise, run, mean, begin, more = self._terms(step)
        share = (value - self.given[step]) / rise
        # share (mean + more t (1 - t)) = mean t^2 + begin t (1 - t) in t.
        square = mean - begin + share * more
        linear = begin - share * more
        constant = -share * mean
        root = np.sqrt(np.maximum(linear**2 - 4.0 * square * constant, 0.0))
        t = 2.0 * constant / -(linear + root)
        return self.mapped[step] + run * np.clip(t, 0.0, 1.0)

    def value(self, mapped: Floats, derivative: int = 0) -> Floats:
        """Values (n,) at places (n,), or their first or second derivative."""
        place = np.clip(mapped, self.mapped[0], self.mapped[-1])
        step = self._step(self.mapped, place)
        rise, run, mean, begin, more = self._terms(step)
        t = (place - self.mapped[step]) / run
        over, under = mean * t**2 + begin * t * (1.0 - t), mean + more * t * (1.0 - t)
        share = over / under
        if derivative == 0:
            return np.asarray(self.given[step] + rise * share)
        under_slope = more * (1.0 - 2.0 * t)
        slope = (2.0 * mean * t + begin * (1.0 - 2.0 * t) - share * under_slope) / under
        if derivative == 1:
            return np.asarray(rise / run * slope)
        bend = 2.0 * (mean - begin) - 2.0 * slope * under_slope + 2.0 * share * more
        return np.asarray(rise / run**2 * bend / under)

    def _step(self, knots: Floats, places: Floats) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(knots, places, "right") - 1, 0, len(knots) - 2)

    def _terms(self, step: NDArray[np.intp]) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Rise, run, mean slope and first slope of steps, and both slopes less twice the mean."""
        rise, run = np.diff(self.given)[step], np.diff(self.mapped)[step]
        mean = rise / run
        begin, end = self.slopes[step], self.slopes[step + 1]
        return rise, run, mean, begin, begin + end - 2.0 * mean


def reparametrisation_through(even: Floats, lengths: Floats) -> Reparametrisation:
    """Map from rising values (m,) to places with steps `lengths` (m - 1,), over the same range.

    Slopes of Fritsch and Butland, *Local monotone piecewise cubic interpolants*, 1984.
    """
    places = np.concatenate([[0.0], np.cumsum(lengths)])
    mapped = even[0] + (even[-1] - even[0]) * places / places[-1]
    means, runs = np.diff(even) / np.diff(mapped), np.diff(mapped)
    near, far = 2.0 * runs[1:] + runs[:-1], runs[1:] + 2.0 * runs[:-1]
    inner = (near + far) / (near / means[:-1] + far / means[1:])
    return Reparametrisation(even, mapped, np.concatenate([means[:1], inner, means[-1:]]))
