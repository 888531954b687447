"""Bending of the z axis to an arc of a circle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats

LEAST_CURVATURE = 1e-200
"""A bend below it, 1/m, moves nothing by a rounding, but could underflow."""


class Unbent(NamedTuple):
    """Places in the plane of a bend, straightened."""

    inwards: Floats
    """Towards the centre of curvature (away from it where the curvature is negative), m."""
    along: Floats
    """Height, m."""
    stretch: Floats
    """Length of the fibre through the place, as a share of the axis's."""
    cosine: Floats
    """Of the angle through which the bend has turned the place."""
    sine: Floats
    """Of the same angle, from upwards to inwards."""


@dataclass(frozen=True, slots=True)
class Bend:
    """Bends the z axis to a circle whose centre is level with the origin: Fung, 1999, (2.8).

    The axis keeps its length, sections across it stay plane and square to it.

    Parameters
    ----------
    curvature : float
        Of the bent axis, 1/m; 0 bends nothing.
    direction : float
        Azimuth towards which both ends move, rad; they move the other way if the curvature
        is negative.

    Raises
    ------
    ValueError
        If either is not finite.

    Notes
    -----
    (2.8) and (2.9) with the angle k z, where the text divides by k, and with the coordinate
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

        Raises
        ------
        ValueError
            If a point lies at or beyond the centre of curvature, or so high or low that the
            axis would close to a circle: bent, it would meet others.
        """
        inwards, height = points[:, :2] @ self.towards, points[:, 2]
        self._check(inwards, height)
        angle = self.curvature * height
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

    def _check(self, inwards: Floats, height: Floats) -> None:
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


def _sinc(angle: Floats) -> Floats:
    """sin(angle) / angle, 1 at 0."""
    safe = np.where(angle == 0.0, 1.0, angle)
    return np.where(angle == 0.0, 1.0, np.sin(safe) / safe)
