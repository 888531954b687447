"""The section of an undeformed prism: a superellipse, walked around by the turns of a skin.

Which place of the section becomes which place of the skin is free. The nearer both run around
in step, the less is left to deform: so the section is walked by the azimuths that the skin's
own mean section has at the same turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats
from palpate.core.splines.basis import PeriodicBasis
from palpate.core.splines.frame import Frame

Complexes = NDArray[np.complex128]

ROUNDEST, SHARPEST = 1.0, 0.2
"""Exponents: beyond 1 the rim bends without bound where it crosses the axes, and a square on
its corner is a turned one; a sharper one would turn its corners between two places."""
RADIAL, ANGULAR = 7, 48
"""Places of integrals over the section, at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """A superellipse in the plane."""

    middle: Floats
    """(2,), m."""
    axes: Floats
    """Rows are the semi-axes, (2, 2), m; the second lies counter-clockwise of the first."""
    exponent: float
    """1 is an ellipse, towards 0 it becomes a rectangle."""
    lead: Floats
    """By how much the azimuth runs ahead of the turn, in turns: coefficients of a closed
    spline, (k,)."""

    @property
    def half_extent(self) -> Floats:
        """Semi-axes (2,), m."""
        lengths: Floats = np.linalg.norm(self.axes, axis=1)
        return lengths

    def frame(self, low: float, high: float) -> Frame:
        """The box around the prism that stands on it, from one height to another, m."""
        edges = np.zeros((3, 3))
        edges[:2, :2], edges[2, 2] = 2.0 * self.axes, high - low
        return Frame(np.array([*(self.middle - self.axes.sum(axis=0)), low]), edges)

    def rim(self, turns: Floats, derivative: int = 0) -> Floats:
        """Places (n, 2) of the rim in the box, from 0 to 1, or a derivative by the turn, to 2."""
        basis = PeriodicBasis(len(self.lead))
        lead = [basis.matrix(turns, order) @ self.lead for order in range(derivative + 1)]
        azimuth = 2.0 * np.pi * (turns + lead[0])
        around = rim_of(self.exponent, azimuth, derivative)
        found = around[derivative]
        if derivative:
            speed = 2.0 * np.pi * (1.0 + lead[1])
            found = found * speed**derivative
        if derivative == 2:
            found = found + around[1] * 2.0 * np.pi * lead[2]
        return np.column_stack([found.real, found.imag]) * 0.5 + (0.5 if derivative == 0 else 0.0)

    def inside(self, radial: int = RADIAL, angular: int = ANGULAR) -> tuple[Floats, Floats]:
        """Places (n, 2) in the box with weights (n,) of an integral over the section.

        The weights sum to the section's share of the box.
        """
        nodes, weights = np.polynomial.legendre.leggauss(radial)
        shares = 0.5 * (nodes + 1.0)
        rim = rim_of(self.exponent, 2.0 * np.pi * (np.arange(angular) + 0.5) / angular)[0]
        places = (shares[:, None] * rim).ravel()
        area = 0.25 * np.pi * (weights * shares)[:, None] * np.square(np.abs(rim)) / angular
        return 0.5 + 0.5 * np.column_stack([places.real, places.imag]), area.ravel()


def rim_of(exponent: float, azimuth: Floats, derivatives: int = 0) -> list[Complexes]:
    """Superellipse of semi-axes 1 at azimuths (n,), rad, as x + iy, with derivatives up to 2."""
    power = 2.0 / exponent
    c, s = np.cos(azimuth), np.sin(azimuth)
    a, b = np.abs(c), np.abs(s)
    gauge = a**power + b**power
    way = np.exp(1j * azimuth)
    radius = gauge ** (-1.0 / power)
    found = [radius * way]
    if derivatives:
        first = power * (b ** (power - 1.0) * np.sign(s) * c - a ** (power - 1.0) * np.sign(c) * s)
        slope = -radius / gauge * first / power
        found.append((slope + 1j * radius) * way)
    if derivatives == 2:
        bend = (power - 1.0) * (a ** (power - 2.0) * s**2 + b ** (power - 2.0) * c**2) - gauge
        second = -radius / gauge * (bend - (1.0 / power + 1.0) * first**2 / (gauge * power))
        found.append((second + 2j * slope - radius) * way)
    return found
