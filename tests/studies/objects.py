"""Objects that are traced and grasped part by part, with exact slices or meshes as their truth.

Add an object at the end of its table. No constant of the grasp was chosen for one object alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from palpate.core import Floats, shapes
from tests.studies.explored import Radius, closed_mesh, radial_rings

MARCH_STEP = 0.4e-3  # Of the march along a ray, m: nothing thinner is met for certain
CAST_HALVINGS = 40
FINE = 400_000  # Points from which a superellipse is sampled anew at even distances
POINTS = 6000  # Points of an outline
GRASPED_RINGS, GRASPED_TURNS = 160, 96


class RadialSolid(NamedTuple):
    """All points nearer to the z axis than a radius; it is only ever touched, and has no mesh."""

    radius: Radius  # m, of heights in m
    half: float  # Half the height: the ends are flat, m
    widest: float  # No radius is larger, m

    def bounds(self) -> Floats:
        """Smallest and largest coordinates of a box that holds it, (2, 3), m."""
        corner = np.array([self.widest, self.widest, self.half])
        return np.stack([-corner, corner])

    def cast(self, origins: Floats, direction: Floats, reach: float) -> Floats:
        """Range (n,) along parallel rays: see `Shape.cast`."""
        start = self._level(origins)
        ranges = np.where(start < 0.0, shapes.INSIDE, shapes.MISS)
        ball = math.hypot(self.widest, self.half)
        nearest = -(origins @ direction)
        low, high = max(float(nearest.min()) - ball, 0.0), min(float(nearest.max()) + ball, reach)
        if high <= low:
            return ranges
        steps = np.linspace(low, high, int((high - low) / MARCH_STEP) + 2)
        inside = self._level(origins[:, None] + steps[:, None] * direction) < 0.0
        met = (start >= 0.0) & inside.any(axis=1)
        first = np.maximum(inside[met].argmax(axis=1), 1)
        before, after = steps[first - 1], steps[first]
        for _ in range(CAST_HALVINGS):
            middle = 0.5 * (before + after)
            hit = self._level(origins[met] + middle[:, None] * direction) < 0.0
            before, after = np.where(hit, before, middle), np.where(hit, middle, after)
        ranges[met] = after
        return ranges

    def mesh(self, level: int) -> shapes.Mesh:
        """Refuse."""
        raise NotImplementedError("a radial solid has no mesh")

    def _level(self, points: Floats) -> Floats:
        """Negative inside, (...,)."""
        x, y, z = np.moveaxis(points, -1, 0)
        side = np.hypot(x, y) - self.radius(z, np.arctan2(y, x))
        return np.asarray(np.maximum(side, np.abs(z) - self.half))


class TracedSolid(NamedTuple):
    """A solid to be traced, about the origin."""

    shape: shapes.Superquadric | RadialSolid
    half: float  # Half its height, m

    def outline(self, height: float) -> Floats:
        """Points (n, 2) of the slice at a height, counter-clockwise, m."""
        if isinstance(self.shape, RadialSolid):
            azimuth = np.linspace(0.0, 2.0 * math.pi, POINTS, endpoint=False)
            radius = self.shape.radius(np.full(POINTS, height), azimuth)
            return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])
        e1, e2 = self.shape.exponents.tolist()
        scale = (1.0 - abs(height / self.shape.size[2]) ** (2.0 / e1)) ** (0.5 * e1)
        angle = np.linspace(0.0, 0.5 * math.pi, FINE)
        x = scale * self.shape.size[0] * np.cos(angle).clip(0.0) ** e2
        y = scale * self.shape.size[1] * np.sin(angle) ** e2
        way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        even = np.linspace(0.0, way[-1], POINTS // 4)
        quarter = np.column_stack([np.interp(even, way, x), np.interp(even, way, y)])
        back = quarter[::-1]
        return np.concatenate([quarter, back * [-1.0, 1.0], -quarter, back * [1.0, -1.0]])


def carved(profile: str, depth: float, half_width: float) -> TracedSolid:
    """An upright cylinder of 28 mm with one hollow, widest at its mouth, opposite azimuth 0."""

    def radius(height: Floats, azimuth: Floats) -> Floats:
        beside = 0.028 * (math.pi - np.abs(azimuth))
        return 0.028 - depth * CARVED[profile](beside, height, half_width)

    return TracedSolid(RadialSolid(radius, 0.045, 0.028), 0.045)


def turned(radius: Radius, half_height: float = 0.045) -> shapes.TriangleShape:
    """The solid with this radius over -1 to 1, and flat ends where it is not 0 there, m."""
    z = -np.cos(np.linspace(0.0, np.pi, GRASPED_RINGS))
    angle = 2.0 * np.pi * np.arange(GRASPED_TURNS) / GRASPED_TURNS
    rings = radial_rings(np.maximum(radius(z[:, None], angle), 1e-6), half_height * z, angle)
    low, high = np.array([[0.0, 0.0, -half_height], [0.0, 0.0, half_height]])
    return shapes.TriangleShape(*closed_mesh(rings, low, high))


def _superquadric(x: float, y: float, z: float, e1: float, e2: float) -> shapes.Superquadric:
    return shapes.Superquadric(np.array([x, y, z]), np.array([e1, e2]))


def _traced(x: float, y: float, z: float, e1: float, e2: float) -> TracedSolid:
    return TracedSolid(_superquadric(x, y, z, e1, e2), z)


def _rise(z: Floats, at: float, width: float) -> Floats:
    """0 below a height, 1 above it."""
    return np.asarray(0.5 * (1.0 + np.tanh((z - at) / width)))


def _traced_pear(height: Floats, azimuth: Floats) -> Floats:
    share = np.clip(height / 0.045, -1.0, 1.0)
    return 0.03 * np.sqrt(1.0 - share**2) * (1.0 - 0.42 * share)


def _lobed(z: Floats, t: Floats) -> Floats:
    """Not symmetric: its middle leaves the axis."""
    lobes = 1.0 + 0.15 * np.cos(t + 1.5 * z) + 0.08 * np.cos(3.0 * t)
    return np.asarray(0.024 * lobes * np.sqrt(np.maximum(1.02 - z**4, 0.0)))


# How deep a hollow is at places beside its middle, as a share of its depth.
CARVED: Mapping[str, Callable[[Floats, Floats, float], Floats]] = {
    "dent": lambda beside, z, half: np.exp(-(((beside**2 + z**2) / half**2) ** 2)),
    "wedge": lambda beside, z, half: np.maximum(1.0 - np.abs(beside) / half, 0.0),
    "slot": lambda beside, z, half: np.exp(-((beside / half) ** 6)),
}
HOLLOWS: Mapping[str, TracedSolid] = {
    "slot 5 mm wide, 10 deep": carved("slot", 0.010, 0.0025),
    "slot 8 mm wide, 10 deep": carved("slot", 0.010, 0.004),
    "slot 10 mm wide, 20 deep": carved("slot", 0.020, 0.005),
    "slot 3 mm wide, 3 deep": carved("slot", 0.003, 0.0015),
    "wedge 10 mm wide, 6 deep": carved("wedge", 0.006, 0.005),
    "wedge 8 mm wide, 8 deep": carved("wedge", 0.008, 0.004),
    "dent 10 mm wide, 3 deep": carved("dent", 0.003, 0.005),
    "dent 12 mm wide, 5 deep": carved("dent", 0.005, 0.006),
}
TRACED_OBJECTS: Mapping[str, TracedSolid] = {
    "sphere": _traced(0.03, 0.03, 0.03, 1.0, 1.0),
    "egg": _traced(0.03, 0.024, 0.042, 1.0, 1.0),
    "cylinder": _traced(0.025, 0.025, 0.04, 0.1, 1.0),
    "pear": TracedSolid(RadialSolid(_traced_pear, 0.045, 0.043), 0.045),
    "box": _traced(0.03, 0.02, 0.04, 0.1, 0.1),
    "superellipsoid": _traced(0.04, 0.03, 0.03, 0.5, 0.3),
    # Four lobes of 6 %, twisted by half a turn in 180 mm.
    "star": TracedSolid(
        RadialSolid(
            lambda z, t: 0.028 * (1.0 + 0.06 * np.cos(4.0 * (t - z * math.pi / 0.18))), 0.045, 0.03
        ),
        0.045,
    ),
}
GRASPED_OBJECTS: Mapping[str, Callable[[], shapes.Shape]] = {
    "egg": lambda: shapes.DeformedSuperquadric(
        _superquadric(0.026, 0.026, 0.038, 1.0, 1.0), np.array([-0.3, -0.3])
    ),
    "ellipsoid": partial(_superquadric, 0.022, 0.03, 0.042, 1.0, 1.0),
    "box": partial(_superquadric, 0.03, 0.02, 0.04, 0.1, 0.1),
    "cylinder": partial(_superquadric, 0.022, 0.022, 0.045, 0.1, 1.0),
    "tapered and bent": lambda: shapes.DeformedSuperquadric(
        _superquadric(0.02, 0.018, 0.045, 0.5, 0.7), np.array([0.3, 0.3]), shapes.Bend(6.0)
    ),
    "tile": partial(_superquadric, 0.04, 0.04, 0.015, 0.2, 1.0),
    "bottle": partial(
        turned, lambda z, t: (0.032 - 0.018 * _rise(z, 0.45, 0.08)) * (1.02 - z**20) ** 0.2, 0.05
    ),
    "vase": partial(turned, lambda z, t: 0.024 + 0.008 * np.sin(4.0 * z + 0.5)),
    "pear": partial(
        turned,
        lambda z, t: np.sqrt(np.maximum(1.0 - z**2, 0.0)) * (0.028 - 0.01 * np.tanh(2.5 * z)),
    ),
    "groove": partial(turned, lambda z, t: 0.028 - 0.0035 * np.exp(-((z / 0.16) ** 4))),
    "step": partial(turned, lambda z, t: 0.03 - 0.012 * _rise(z, 0.1, 0.01)),
    "twisted star": partial(turned, lambda z, t: 0.026 * (1.0 + 0.06 * np.cos(4.0 * t - 1.2 * z))),
    "lobed": partial(turned, _lobed),
    "ball": partial(_superquadric, 0.03, 0.03, 0.03, 1.0, 1.0),
    "cube": partial(_superquadric, 0.03, 0.03, 0.03, 0.1, 0.1),
}
