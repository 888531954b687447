"""Solids whose slices are known exactly, for measuring how well they are traced."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import INSIDE, MISS, Mesh
from palpate.core.shapes.superquadric import Superquadric

STEP = 0.4e-3
"""Of the march along a ray, m: nothing thinner is met for certain."""
HALVINGS = 40
FINE = 400_000
"""Points from which a superellipse is sampled anew at even distances."""
POINTS = 6000
"""Points of an outline."""

Radius = Callable[[Floats, Floats], Floats]
"""Distance of the surface from the z axis, at heights and azimuths, m."""


class RadialSolid:
    """All points nearer to the z axis than a radius that depends on height and azimuth.

    Parameters
    ----------
    radius : function
        The radius.
    half : float
        Half the height: the ends are flat, m.
    widest : float
        No radius is larger, m.
    """

    def __init__(self, radius: Radius, half: float, widest: float):
        self._radius, self._half, self._widest = radius, half, widest

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a box that holds it, (2, 3), m."""
        corner = np.array([self._widest, self._widest, self._half])
        return np.stack([-corner, corner])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays: see `Shape.cast`."""
        start = self._level(origins)
        ranges = np.where(start < 0.0, INSIDE, MISS)
        ball = math.hypot(self._widest, self._half)
        nearest = -(origins @ direction)
        low, high = max(float(nearest.min()) - ball, 0.0), min(float(nearest.max()) + ball, reach)
        if high <= low:
            return ranges
        steps = np.linspace(low, high, int((high - low) / STEP) + 2)
        inside = self._level(origins[:, None] + steps[:, None] * direction) < 0.0
        met = (start >= 0.0) & inside.any(axis=1)
        first = np.maximum(inside[met].argmax(axis=1), 1)
        before, after = steps[first - 1], steps[first]
        for _ in range(HALVINGS):
            middle = 0.5 * (before + after)
            hit = self._level(origins[met] + middle[:, None] * direction) < 0.0
            before, after = np.where(hit, before, middle), np.where(hit, middle, after)
        ranges[met] = after
        return ranges

    def mesh(self, level: int) -> Mesh:
        """Refuse: it is only ever touched."""
        raise NotImplementedError("a radial solid has no mesh")

    def outline(self, height: float) -> Floats:
        """Points (n, 2) of the slice at a height, counter-clockwise, m."""
        azimuth = np.linspace(0.0, 2.0 * math.pi, POINTS, endpoint=False)
        radius = self._radius(np.full(POINTS, height), azimuth)
        return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])

    def _level(self, points: Floats) -> Floats:
        """Negative inside, (...,)."""
        x, y, z = np.moveaxis(points, -1, 0)
        side = np.hypot(x, y) - self._radius(z, np.arctan2(y, x))
        return np.asarray(np.maximum(side, np.abs(z) - self._half))


class Traced(NamedTuple):
    """A solid to be traced."""

    shape: Superquadric | RadialSolid
    """The solid, about the origin."""
    half: float
    """Half its height, m."""

    def outline(self, height: float) -> Floats:
        """Points (n, 2) of the slice at a height, counter-clockwise, m."""
        if isinstance(self.shape, RadialSolid):
            return self.shape.outline(height)
        return _superellipse(self.shape, height)


def _superellipse(shape: Superquadric, height: float) -> Floats:
    e1, e2 = shape.exponents.tolist()
    scale = (1.0 - abs(height / shape.size[2]) ** (2.0 / e1)) ** (0.5 * e1)
    angle = np.linspace(0.0, 0.5 * math.pi, FINE)
    x = scale * shape.size[0] * np.cos(angle).clip(0.0) ** e2
    y = scale * shape.size[1] * np.sin(angle) ** e2
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    even = np.linspace(0.0, way[-1], POINTS // 4)
    quarter = np.column_stack([np.interp(even, way, x), np.interp(even, way, y)])
    back = quarter[::-1]
    return np.concatenate([quarter, back * [-1.0, 1.0], -quarter, back * [1.0, -1.0]])


def _superquadric(size: tuple[float, float, float], exponents: tuple[float, float]) -> Traced:
    return Traced(Superquadric(np.array(size), np.array(exponents)), size[2])


def _star(height: Floats, azimuth: Floats) -> Floats:
    """Four lobes of 6 %, twisted by half a turn in 180 mm."""
    return 0.028 * (1.0 + 0.06 * np.cos(4.0 * (azimuth - height * math.pi / 0.18)))


def _pear(height: Floats, azimuth: Floats) -> Floats:
    share = np.clip(height / 0.045, -1.0, 1.0)
    return 0.03 * np.sqrt(1.0 - share**2) * (1.0 - 0.42 * share)


def dented(depth: float, half_width: float) -> Traced:
    """An upright cylinder of 28 mm with a round dent at mid-height across the touch's way."""

    def radius(height: Floats, azimuth: Floats) -> Floats:
        beside = 0.028 * (math.pi - np.abs(azimuth))
        return 0.028 - depth * np.exp(-(((beside**2 + height**2) / half_width**2) ** 2))

    return Traced(RadialSolid(radius, 0.045, 0.028), 0.045)


def wedged(depth: float, half_width: float) -> Traced:
    """An upright cylinder of 28 mm with a sharp wedge cut out of it across the touch's way."""

    def radius(height: Floats, azimuth: Floats) -> Floats:
        beside = 0.028 * (math.pi - np.abs(azimuth))
        return 0.028 - depth * np.maximum(1.0 - np.abs(beside) / half_width, 0.0)

    return Traced(RadialSolid(radius, 0.045, 0.028), 0.045)


def notched(depth: float, half_width: float) -> Traced:
    """An upright cylinder of 28 mm with one slot across the touch's way."""

    def radius(height: Floats, azimuth: Floats) -> Floats:
        beside = 0.028 * (math.pi - np.abs(azimuth))
        return 0.028 - depth * np.exp(-((beside / half_width) ** 6))

    return Traced(RadialSolid(radius, 0.045, 0.028), 0.045)


OBJECTS: Mapping[str, Traced] = {
    "sphere": _superquadric((0.03, 0.03, 0.03), (1.0, 1.0)),
    "egg": _superquadric((0.03, 0.024, 0.042), (1.0, 1.0)),
    "cylinder": _superquadric((0.025, 0.025, 0.04), (0.1, 1.0)),
    "pear": Traced(RadialSolid(_pear, 0.045, 0.043), 0.045),
    "box": _superquadric((0.03, 0.02, 0.04), (0.1, 0.1)),
    "superellipsoid": _superquadric((0.04, 0.03, 0.03), (0.5, 0.3)),
    "star": Traced(RadialSolid(_star, 0.045, 0.03), 0.045),
}
