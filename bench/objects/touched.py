"""Solids that are touched: explored, drawn by chance, traced along known slices, and grasped.

Explored ones are about 90 mm high and star-shaped in every slice. What no pad could enter is not
drawn: a ball of the dome's radius, rolled along the side, comes near to all of it. No constant
of the grasp was chosen for one object alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from palpate.bench.objects.contoured import radial_rings
from palpate.core import Floats
from palpate.core.explore.planners import TUNED, Radius, drawn_objects
from palpate.core.geometry import close_rings
from palpate.core.shapes import (
    INSIDE,
    MISS,
    Bend,
    DeformedSuperquadric,
    Mesh,
    Shape,
    Superquadric,
    TriangleShape,
)

EXPLORED_HEIGHT = 0.09  # Of every object that is given by its radius, m
# Radius of the rounding where a side meets a flat end, over the height.
ROUNDING = 4e-3 / EXPLORED_HEIGHT
BLUNT = 2.0  # Roundings: an end that is narrower comes to a point by itself, and is not rounded
RINGS, TURNS = 400, 288  # Of a mesh: its facets are off by 2 um, a tenth of what a touch tells
Kind = Literal["plain", "featured"]
DOME = 0.015  # Radius of the default pad, m
# How far the pad is pressed at most, m: what lies deeper under the ball cannot be touched.
DEEPEST = 2.2e-3
SAMPLES = 361  # Along the height: a quarter of a millimetre apart
AZIMUTHS = 24
DRAWS = 200
MARCH_STEP = 0.4e-3  # Of the march along a ray, m: nothing thinner is met for certain
HALVINGS = 40
FINE = 400_000  # Points from which a superellipse is sampled anew at even distances
POINTS = 6000  # Points of an outline
# Distance of the surface from the z axis, at heights and azimuths, m.
TracedRadius = Callable[[Floats, Floats], Floats]
GRASPED_RINGS, GRASPED_TURNS = 160, 96
GraspedRadius = Callable[[Floats, Floats], Floats]  # Of heights from -1 to 1 and azimuths, m


class ExploreObject(NamedTuple):
    """Something to explore."""

    kind: Kind  # Convex without features, or with some
    solid: Mapping[str, Any] | None = None  # As a scene describes it, standing on z = 0; or else:
    # Radius over height and azimuth; heights and radii over `EXPLORED_HEIGHT`.
    radius: Radius | None = None

    def mesh(self) -> Mesh:
        """The object by its radius, standing on z = 0, m.

        Raises ValueError if it is none that is given by its radius.
        """
        if self.radius is None:
            raise ValueError("radius must be given for an object to have a mesh of its own")
        return mesh_of_radius(self.radius)


def mesh_of_radius(radius: Radius) -> Mesh:
    """The solid within a radius, with flat or pointed ends, as a closed mesh, m."""
    # Closer together towards the ends, where a rounding or a pole bends most.
    z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, RINGS))
    t = 2.0 * np.pi * np.arange(TURNS) / TURNS
    wide = EXPLORED_HEIGHT * np.asarray(radius(z[:, None], t[None, :]))
    rings = radial_rings(wide, EXPLORED_HEIGHT * z, t)
    low, high = np.zeros(3), np.array([0.0, 0.0, EXPLORED_HEIGHT])
    return Mesh(*close_rings(low, rings, high))


def drawn_object(seed: int) -> ExploreObject:
    """An object by chance: round or straight, plain, lobed, twisted, necked, stepped or wavy.

    `seed`: the same seed, the same object. Raises ValueError if the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"seed must be 0 or more, got {seed}")
    for radius in drawn_objects(DRAWS, seed).values():
        if hidden_depth(radius) <= DEEPEST:
            return ExploreObject("featured", radius=rounded(radius))
    raise ValueError(f"seed must lead to an object that a pad can touch, {seed} does not")


def hidden_depth(radius: Radius) -> float:
    """How deep the side lies at most under a ball of the dome's radius, m."""
    from scipy.ndimage import grey_closing

    step = EXPLORED_HEIGHT / (SAMPLES - 1)
    reach = int(DOME / step)
    away = step * np.arange(-reach, reach + 1)
    ball = np.sqrt(DOME**2 - away**2) - DOME
    z, t = np.linspace(0.0, 1.0, SAMPLES), 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    side = EXPLORED_HEIGHT * np.asarray(radius(z[:, None], t[None, :]))
    beyond = ((2 * reach, 2 * reach), (0, 0))  # nothing holds the ball off there
    padded = np.pad(side, beyond, constant_values=-1.0)
    closed: Floats = grey_closing(padded, structure=ball[:, None])
    return float((closed - padded)[2 * reach : -2 * reach].max())


class RadialSolid:
    """All points nearer to the z axis than a radius that depends on height and azimuth.

    `radius`: the radius. `half`: half the height: the ends are flat, m. `widest`: no radius is
    larger, m.
    """

    def __init__(self, radius: TracedRadius, half: float, widest: float):
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
        steps = np.linspace(low, high, int((high - low) / MARCH_STEP) + 2)
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


class TracedSolid(NamedTuple):
    """A solid to be traced."""

    shape: Superquadric | RadialSolid  # The solid, about the origin
    half: float  # Half its height, m

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


def dented(depth: float, half_width: float) -> TracedSolid:
    """An upright cylinder of 28 mm with a round dent at mid-height across the touch's way."""
    return _carved(depth, lambda beside, z: np.exp(-(((beside**2 + z**2) / half_width**2) ** 2)))


def wedged(depth: float, half_width: float) -> TracedSolid:
    """The same cylinder with a sharp wedge cut out of it."""
    return _carved(depth, lambda beside, z: np.maximum(1.0 - np.abs(beside) / half_width, 0.0))


def notched(depth: float, half_width: float) -> TracedSolid:
    """The same cylinder with one slot."""
    return _carved(depth, lambda beside, z: np.exp(-((beside / half_width) ** 6)))


def _carved(depth: float, profile: Callable[[Floats, Floats], Floats]) -> TracedSolid:
    def radius(height: Floats, azimuth: Floats) -> Floats:
        return 0.028 - depth * profile(0.028 * (math.pi - np.abs(azimuth)), height)

    return TracedSolid(RadialSolid(radius, 0.045, 0.028), 0.045)


def rounded(radius: Radius) -> Radius:
    """The same with its flat ends rounded off."""
    turns = np.linspace(0.0, 2.0 * np.pi, TURNS)
    low, high = (float(np.min(radius(np.array(z), turns))) for z in (0.0, 1.0))
    ends = [end for end, wide in ((0.0, low), (1.0, high)) if wide > BLUNT * ROUNDING]

    def shape(z: Floats, t: Floats) -> Floats:
        found = radius(z, t)
        for end in ends:
            inside = np.clip(1.0 - np.abs(z - end) / ROUNDING, 0.0, 1.0)
            found = found - ROUNDING * (1.0 - np.sqrt(1.0 - inside**2))
        return np.asarray(found)

    return shape


def _described(
    size: tuple[float, float, float], e1: float, e2: float, **more: Any
) -> ExploreObject:
    described = {"size": list(size), "exponents": [e1, e2], **more}
    return ExploreObject("plain", {"superquadric": described, **_on_the_floor(size[2])})


def _on_the_floor(half: float) -> dict[str, Any]:
    return {"pose": {"position": [0.0, 0.0, half]}}


def _featured(radius: Radius) -> ExploreObject:
    return ExploreObject("featured", radius=rounded(radius))


def _cone(z: Floats, t: Floats) -> Floats:
    return np.asarray(0.36 - 0.2 * z + 0.0 * t)


def _traced(size: tuple[float, float, float], e1: float, e2: float) -> TracedSolid:
    return TracedSolid(_superquadric(size, e1, e2), size[2])


def _twisted_star(height: Floats, azimuth: Floats) -> Floats:
    """Four lobes of 6 %, twisted by half a turn in 180 mm."""
    return 0.028 * (1.0 + 0.06 * np.cos(4.0 * (azimuth - height * math.pi / 0.18)))


def _traced_pear(height: Floats, azimuth: Floats) -> Floats:
    share = np.clip(height / 0.045, -1.0, 1.0)
    return 0.03 * np.sqrt(1.0 - share**2) * (1.0 - 0.42 * share)


def turned(radius: GraspedRadius, half_height: float) -> TriangleShape:
    """The solid about the z axis with this radius, and flat ends where it is not 0 there."""
    z = -np.cos(np.linspace(0.0, np.pi, GRASPED_RINGS))
    angle = 2.0 * np.pi * np.arange(GRASPED_TURNS) / GRASPED_TURNS
    rings = radial_rings(np.maximum(radius(z[:, None], angle), 1e-6), half_height * z, angle)
    low, high = np.array([[0.0, 0.0, -half_height], [0.0, 0.0, half_height]])
    return TriangleShape(*close_rings(low, rings, high))


def _round(profile: Callable[[Floats], Floats]) -> GraspedRadius:
    return lambda z, t: np.asarray(profile(z) + 0.0 * t)


def _rise(z: Floats, at: float, width: float) -> Floats:
    """0 below a height, 1 above it."""
    return np.asarray(0.5 * (1.0 + np.tanh((z - at) / width)))


def _star(z: Floats, t: Floats) -> Floats:
    return np.asarray(0.026 * (1.0 + 0.06 * np.cos(4.0 * t - 1.2 * z)) + 0.0 * z)


def _leaning(z: Floats, t: Floats) -> Floats:
    """Lobed and not symmetric: its middle leaves the axis."""
    lobes = 1.0 + 0.15 * np.cos(t + 1.5 * z) + 0.08 * np.cos(3.0 * t)
    return np.asarray(0.024 * lobes * np.sqrt(np.maximum(1.02 - z**4, 0.0)))


def _superquadric(size: tuple[float, float, float], e1: float, e2: float) -> Superquadric:
    return Superquadric(np.array(size), np.array([e1, e2]))


LATTICE: Mapping[str, Any] = {
    "superquadric": {"size": [0.029, 0.025, 0.045], "exponents": [0.4, 0.8]},
    "lattice": [
        *({"scale": 0.8}, {"scale": 1.15}, {"scale": 1.25, "shift": [0.002, 0.0]}),
        *({"scale": 0.8, "turn": 10.0}, {"scale": 0.75, "turn": 15.0}, {"turn": 15.0}),
    ],
    **_on_the_floor(0.045),
}
# All of the benches, by name.
EXPLORED_OBJECTS: Mapping[str, ExploreObject] = {
    "sphere": _described((0.045, 0.045, 0.045), 1.0, 1.0),
    "ellipsoid": _described((0.036, 0.029, 0.045), 1.0, 1.0),
    "cylinder": _described((0.028, 0.028, 0.045), 0.1, 1.0),
    "box": _described((0.03, 0.022, 0.045), 0.2, 0.2),
    "egg": _described((0.032, 0.032, 0.045), 1.0, 1.0, taper=[-0.2, -0.2]),
    "tapered and bent": _described((0.028, 0.022, 0.045), 0.5, 0.7, taper=[0.3, 0.3], bend=5.0),
    "cone": ExploreObject("plain", radius=rounded(_cone)),
    "bottle": _featured(TUNED["bottle"]),
    "vase": _featured(TUNED["vase"]),
    "pear": _featured(TUNED["pear"]),
    "groove": _featured(TUNED["groove"]),
    "step": _featured(TUNED["stepped"]),
    "twist": _featured(TUNED["twisted"]),
    "star": _featured(TUNED["star"]),
    "hourglass": _featured(TUNED["hourglass"]),
    "lattice": ExploreObject("featured", LATTICE),
}
TRACED_OBJECTS: Mapping[str, TracedSolid] = {
    "sphere": _traced((0.03, 0.03, 0.03), 1.0, 1.0),
    "egg": _traced((0.03, 0.024, 0.042), 1.0, 1.0),
    "cylinder": _traced((0.025, 0.025, 0.04), 0.1, 1.0),
    "pear": TracedSolid(RadialSolid(_traced_pear, 0.045, 0.043), 0.045),
    "box": _traced((0.03, 0.02, 0.04), 0.1, 0.1),
    "superellipsoid": _traced((0.04, 0.03, 0.03), 0.5, 0.3),
    "star": TracedSolid(RadialSolid(_twisted_star, 0.045, 0.03), 0.045),
}
GRASPED_OBJECTS: Mapping[str, Callable[[], Shape]] = {
    "egg": lambda: DeformedSuperquadric(
        _superquadric((0.026, 0.026, 0.038), 1.0, 1.0), np.array([-0.3, -0.3])
    ),
    "ellipsoid": lambda: _superquadric((0.022, 0.03, 0.042), 1.0, 1.0),
    "box": lambda: _superquadric((0.03, 0.02, 0.04), 0.1, 0.1),
    "cylinder": lambda: _superquadric((0.022, 0.022, 0.045), 0.1, 1.0),
    "tapered and bent": lambda: DeformedSuperquadric(
        _superquadric((0.02, 0.018, 0.045), 0.5, 0.7), np.array([0.3, 0.3]), Bend(6.0)
    ),
    "tile": lambda: _superquadric((0.04, 0.04, 0.015), 0.2, 1.0),
    "bottle": lambda: turned(
        _round(lambda z: (0.032 - 0.018 * _rise(z, 0.45, 0.08)) * (1.02 - z**20) ** 0.2), 0.05
    ),
    "vase": lambda: turned(_round(lambda z: 0.024 + 0.008 * np.sin(4.0 * z + 0.5)), 0.045),
    "pear": lambda: turned(
        _round(lambda z: np.sqrt(np.maximum(1.0 - z**2, 0.0)) * (0.028 - 0.01 * np.tanh(2.5 * z))),
        0.045,
    ),
    "groove": lambda: turned(_round(lambda z: 0.028 - 0.0035 * np.exp(-((z / 0.16) ** 4))), 0.045),
    "step": lambda: turned(_round(lambda z: 0.03 - 0.012 * _rise(z, 0.1, 0.01)), 0.045),
    "twisted star": lambda: turned(_star, 0.045),
    "lobed": lambda: turned(_leaning, 0.045),
    "ball": lambda: _superquadric((0.03, 0.03, 0.03), 1.0, 1.0),
    "cube": lambda: _superquadric((0.03, 0.03, 0.03), 0.1, 0.1),
}
