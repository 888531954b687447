"""The objects of all measurements, with exact contours, slices or meshes as their truth.

Add an object at the end of its table; one that is held out must have no say in any number of
palpate. Nearly all are a radius about an axis, over height and azimuth. Those that are rebuilt are
100 mm high, smooth and sharp, with plane, round and rounded ends; those that are explored about
90 mm, and star-shaped in every slice; none of the methods was chosen for a round one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from palpate.core import Floats, shapes
from palpate.core.explore.planners import HELD_OUT, TUNED
from palpate.core.geometry import close_rings

Radius = Callable[[Floats, Floats], Floats]  # Distance from the axis, by height and azimuth
# What is explored: as a scene describes it, or by its radius, heights from 0 to 1 and both over
# the object's height, or by its mesh in m; each stands on z = 0.
ExploreObject = Mapping[str, Any] | Radius | shapes.Mesh
SHAPE_HEIGHT = 100.0  # Of every rebuilt object, mm; it lies from -50 to 50, the bent one nearly
HALF = 0.5 * SHAPE_HEIGHT
TRUE_ROWS, TRUE_COLUMNS = 241, 360  # Of the meshes of the true surfaces
TRUE_LEVEL = 7  # Of the mesh of the bent one: 328,000 faces
ROUGH_LEVEL = 6  # Of that in which the middles of its sections are looked for
HALVINGS = 60  # Steps that find a radius to the last bit
SOLID = shapes.Superquadric(np.array([32.0, 26.0, HALF]), np.array([0.7, 0.8]))
TAPER, BEND = shapes.Taper(0.25, 0.15, HALF), shapes.Bend(0.006)
EXPLORED_HEIGHT = 0.09  # Of every object that is given by its radius, m
ROUNDING = 4e-3 / EXPLORED_HEIGHT  # Radius where a side meets a flat end, over the height
BLUNT = 2.0  # Roundings: an end that is narrower comes to a point by itself, and is not rounded
RINGS, TURNS = 400, 288  # Of a mesh: its facets are off by 2 um, a tenth of what a touch tells


def straight(z: Floats) -> Floats:
    """The axis through the origin."""
    return np.zeros((*np.shape(z), 2))


def radial_rings(radii: Floats, heights: Floats, angles: Floats) -> Floats:
    """Points (m, n, 3) at radii about the z axis, at heights (m,) and azimuths (n,)."""
    radii = np.broadcast_to(radii, (len(heights), len(angles)))
    level = np.broadcast_to(heights[:, None], radii.shape)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), level], axis=-1)


def closed_mesh(
    rings: Floats, low: Floats | None = None, high: Floats | None = None
) -> shapes.Mesh:
    """A mesh of rings (m, n, 3), closed towards two places, else the middles of its ends."""
    low = rings[0].mean(axis=0) if low is None else low
    return shapes.Mesh(*close_rings(low, rings, rings[-1].mean(axis=0) if high is None else high))


class RoundObject(NamedTuple):
    """An object by its radius, in any unit."""

    radius: Radius
    axis: Callable[[Floats], Floats] = straight  # Places (..., 2) of the axis at heights
    low: float = -1.0  # Its lower end
    high: float = 1.0  # Its upper end
    fine: Callable[[], shapes.Mesh] | None = None  # Its mesh, where that is not made of rings

    def rings(self, heights: Floats, angles: Floats) -> Floats:
        """Points (m, n, 3) of the surface at heights (m,) and azimuths (n,)."""
        found = radial_rings(self.radius(heights[:, None], angles[None]), heights, angles)
        found[..., :2] += self.axis(heights)[:, None]
        return found

    def contours(self, heights: Floats, around: int, first: float = 0.0) -> Floats:
        """Exact contours (m, around, 3), counter-clockwise, at even azimuths from the first."""
        return self.rings(heights, 2.0 * np.pi * (first + np.arange(around) / around))

    def true_mesh(self) -> shapes.Mesh:
        """A fine mesh of the surface, closed by planes or, where the radius is 0, by points."""
        if self.fine is not None:
            return self.fine()
        # Closer together towards the ends, where round ones bend.
        heights = self.low * np.cos(np.linspace(0.0, np.pi, TRUE_ROWS))
        angles = 2.0 * np.pi * np.arange(TRUE_COLUMNS) / TRUE_COLUMNS
        low, high = (np.array([*self.axis(z), z]) for z in map(np.array, (self.low, self.high)))
        ends = np.broadcast_to(self.radius(np.array([self.low, self.high]), np.zeros(2)), 2)
        pointed = ends < 1e-9 * (self.high - self.low)
        kept = heights[int(pointed[0]) : len(heights) - int(pointed[1])]
        return closed_mesh(self.rings(kept, angles), low, high)


def _bent() -> RoundObject:
    """A superquadric, tapered along its axis and then bent."""

    def deformed(level: int) -> shapes.Mesh:
        base = SOLID.mesh(level)
        return shapes.Mesh(BEND(TAPER(base.vertices)), base.faces)

    coarse, faces = deformed(ROUGH_LEVEL)
    triangles = coarse[faces]

    def section_middle(height: float) -> Floats:
        """Middle of the box (2,) about where the triangles stand across a height."""
        above = triangles[:, :, 2] > height
        near = triangles[above.any(axis=1) & ~above.all(axis=1)].reshape(-1, 3)[:, :2]
        middle: Floats = 0.5 * (near.min(axis=0) + near.max(axis=0))
        return middle

    def axis(z: Floats) -> Floats:
        return np.array([section_middle(height) for height in z.ravel()]).reshape(*z.shape, 2)

    def radius(z: Floats, t: Floats) -> Floats:
        z, t = np.broadcast_arrays(z, t)
        middle = np.broadcast_to(axis(z[:, :1]), (*z.shape, 2))
        rim = np.stack([np.cos(t), np.sin(t)], axis=-1)
        low, high = np.zeros(z.shape), np.full(z.shape, HALF)
        for _ in range(HALVINGS):
            half = 0.5 * (low + high)
            places = np.concatenate([middle + half[..., None] * rim, z[..., None]], axis=-1)
            back = TAPER.inverse(BEND.inverse(places.reshape(-1, 3)))
            inside = SOLID.inside_out(back, np.ones_like(back))[0].reshape(z.shape) < 0.0
            low, high = np.where(inside, half, low), np.where(inside, high, half)
        return low

    ends = float(coarse[:, 2].min()), float(coarse[:, 2].max())
    return RoundObject(radius, axis, *ends, partial(deformed, TRUE_LEVEL))


def mesh_of_radius(radius: Radius) -> shapes.Mesh:
    """The solid within a radius, standing on z = 0 with flat or pointed ends, m."""
    # Closer together towards the ends, where a rounding or a pole bends most.
    z = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, RINGS))
    t = 2.0 * np.pi * np.arange(TURNS) / TURNS
    wide = EXPLORED_HEIGHT * np.asarray(radius(z[:, None], t[None, :]))
    rings = radial_rings(wide, EXPLORED_HEIGHT * z, t)
    return closed_mesh(rings, np.zeros(3), np.array([0.0, 0.0, EXPLORED_HEIGHT]))


def rounded(radius: Radius) -> Radius:
    """The same with its flat ends rounded off."""
    turns = np.linspace(0.0, 2.0 * np.pi, TURNS)
    wide = {end: float(np.min(radius(np.array(end), turns))) for end in (0.0, 1.0)}
    ends = [end for end, width in wide.items() if width > BLUNT * ROUNDING]

    def shape(z: Floats, t: Floats) -> Floats:
        found = radius(z, t)
        for end in ends:
            inside = np.clip(1.0 - np.abs(z - end) / ROUNDING, 0.0, 1.0)
            found = found - ROUNDING * (1.0 - np.sqrt(1.0 - inside**2))
        return np.asarray(found)

    return shape


def described(x: float, y: float, z: float, e1: float, e2: float, **more: Any) -> dict[str, Any]:
    """A tapered or bent superquadric that stands on z = 0, as a scene describes it."""
    described = {"size": [x, y, z], "exponents": [e1, e2], **more}
    return {"superquadric": described, "pose": {"position": [0.0, 0.0, z]}}


def _vase(z: Floats, t: Floats) -> Floats:
    h = z / HALF
    outline = 28.0 + 9.0 * np.sin(2.6 * h - 0.6) - 5.0 * h**2 + 3.0 * h
    outline = outline * np.sqrt(np.maximum(1.0 - h**6, 0.0))
    return np.asarray(outline * (1.0 + 0.1 * np.cos(2.0 * t + 0.8 * h) + 0.05 * np.sin(3.0 * t)))


def _vase_axis(z: Floats) -> Floats:
    h = z / HALF
    return np.stack([6.0 * h**2 - 2.0 * h, 3.0 * np.sin(2.0 * h)], axis=-1)


def _box(z: Floats, t: Floats) -> Floats:
    section = (np.abs(np.cos(t) / 40.0) ** 10 + np.abs(np.sin(t) / 30.0) ** 10) ** -0.1
    return np.asarray(section * np.maximum(1.0 - np.abs(z / HALF) ** 10, 0.0) ** 0.1)


def _zigzag(half: float, z: Floats, t: Floats) -> Floats:
    h = z / half
    outline = np.sqrt(1.04 - h**2) * (0.75 + 0.18 * np.sin(9.0 * h))
    lobes = 1.0 + 0.12 * np.cos(3.0 * t) + 0.08 * np.sin(2.0 * t + 2.0 * h)
    return np.asarray(half * outline * lobes)


_tall = partial(RoundObject, low=-HALF, high=HALF)
REBUILT_SHAPES: Mapping[str, RoundObject] = {
    "sphere": _tall(lambda z, t: np.sqrt(np.maximum(HALF**2 - z**2, 0.0)) + 0.0 * t),
    "rounded box": _tall(_box),
    "cylinder": _tall(lambda z, t: np.asarray(30.0)),
    "tapered, bent": _bent(),
    "lobed zig-zag": _tall(partial(_zigzag, HALF)),
    "vase": _tall(_vase, _vase_axis),
    "groove": _tall(lambda z, t: 32.0 - 6.0 * np.exp(-(((z - 8.0) / 5.0) ** 2))),
    "step": _tall(lambda z, t: 29.0 - 7.0 * np.tanh((z + 6.0) / 3.0)),
}
WAVY = RoundObject(partial(_zigzag, 1.0))  # On which lattices and skins were compared
LATTICE: Mapping[str, Any] = {
    **described(0.029, 0.025, 0.045, 0.4, 0.8),
    "lattice": [
        *({"scale": 0.8}, {"scale": 1.15}, {"scale": 1.25, "shift": [0.002, 0.0]}),
        *({"scale": 0.8, "turn": 10.0}, {"scale": 0.75, "turn": 15.0}, {"turn": 15.0}),
    ],
}
EXPLORED_OBJECTS: Mapping[str, ExploreObject] = {
    "sphere": described(0.045, 0.045, 0.045, 1.0, 1.0),
    "ellipsoid": described(0.036, 0.029, 0.045, 1.0, 1.0),
    "cylinder": described(0.028, 0.028, 0.045, 0.1, 1.0),
    "box": described(0.03, 0.022, 0.045, 0.2, 0.2),
    "egg": described(0.032, 0.032, 0.045, 1.0, 1.0, taper=[-0.2, -0.2]),
    "tapered and bent": described(0.028, 0.022, 0.045, 0.5, 0.7, taper=[0.3, 0.3], bend=5.0),
    "cone": rounded(lambda z, t: 0.36 - 0.2 * z + 0.0 * t),
    **{name: rounded(TUNED[name]) for name in ("bottle", "vase", "pear", "groove")},
    "step": rounded(TUNED["stepped"]),
    "twist": rounded(TUNED["twisted"]),
    **{name: rounded(TUNED[name]) for name in ("star", "hourglass")},
    "lattice": LATTICE,
    **{name: rounded(HELD_OUT[name]) for name in ("goblet", "potato")},
}
