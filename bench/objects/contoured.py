"""Objects of a formula that give exact contours, and the true surfaces of eight of them.

None of the round objects was used to choose a constant of the methods; the eight shapes are 100
mm high, smooth and sharp, with plane, round and rounded ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate.core import Floats
from palpate.core.geometry import (
    PreparedSurface,
    close_rings,
    compare_surfaces,
    facet_sag,
    prepare_surface,
    solidity,
)
from palpate.core.shapes import Bend, Mesh, Superquadric, Taper

SHAPE_HEIGHT = 100.0  # Of every object, mm; it lies from -50 to 50, the bent one nearly
HALF = 0.5 * SHAPE_HEIGHT
TRUE_ROWS, TRUE_COLUMNS = 241, 360  # Of the meshes of the true surfaces
TRUE_LEVEL = 7  # Of the mesh of the bent one: 328,000 faces
ROUGH_LEVEL = 6  # Of that in which the middles of its sections are looked for
HALVINGS = 60  # Steps that find a radius to the last bit
Radius = Callable[[Floats, Floats], Floats]
SOLID = Superquadric(np.array([32.0, 26.0, HALF]), np.array([0.7, 0.8]))
TAPER, BEND = Taper(0.25, 0.15, HALF), Bend(0.006)
ROUND_HEIGHT = 2.0  # Of every object that is measured; its contours lie from -1 to 1
SLOPE_STEP = 1e-5  # Over which slopes are taken
Middle = Callable[[Floats], Floats]


def straight(z: Floats) -> Floats:
    """The axis through the origin."""
    return np.zeros((*np.shape(z), 2))


class ContouredShape(NamedTuple):
    """An object and how it is sampled."""

    # Distance of the surface from the axis, mm, by height from -50 to 50 and azimuth.
    radius: Radius
    axis: Middle  # Places (..., 2) of the axis at heights, mm
    true_mesh: Callable[[], Mesh]  # Fine mesh of the surface
    low: float  # Its lower end, mm
    high: float  # Its upper end, mm

    def contours(self, heights: Floats, around: int, first: float = 0.0) -> Floats:
        """Exact contours (m, around, 3), counter-clockwise, at even azimuths from the first."""
        angles = 2.0 * np.pi * (first + np.arange(around) / around)
        return _rings(self.radius, self.axis, heights, angles)


@cache
def truth_of(name: str) -> TrueSurface:
    """The true surface of one of the `REBUILT_SHAPES`, in mm, prepared once."""
    return truth_of_mesh(REBUILT_SHAPES[name].true_mesh())


class RoundObject(NamedTuple):
    """What its contours at heights z and azimuths t about its axis are."""

    radius: Radius  # Of the arrays z and t
    axis: Middle = straight  # Places (..., 2) of the axis at heights

    def contours(self, heights: Floats, turns: int) -> Floats:
        """Points (m, turns, 2) at even azimuths."""
        angle = 2.0 * np.pi * np.arange(turns) / turns
        rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        radius = self.radius(heights[:, None], angle)
        return np.asarray(self.axis(heights)[:, None] + radius[..., None] * rim)

    def distances(self, places: Floats, heights: Floats) -> tuple[Floats, Floats]:
        """Normal distances (m, k) of places (m, k, 2) at heights (m,), and area elements.

        To first order: how far outside, over its slope.
        """
        z = np.broadcast_to(heights[:, None], places.shape[:2])
        outside = self._outside(places, z)
        slopes = [
            (self._outside(places + step, z) - self._outside(places - step, z)) / (2.0 * SLOPE_STEP)
            for step in SLOPE_STEP * np.eye(2)
        ]
        low, high = np.maximum(z - SLOPE_STEP, -1.0), np.minimum(z + SLOPE_STEP, 1.0)
        slopes.append((self._outside(places, high) - self._outside(places, low)) / (high - low))
        level = np.hypot(slopes[0], slopes[1])
        whole = np.hypot(level, slopes[2])
        around = np.linalg.norm(np.roll(places, -1, 1) - places, axis=-1)
        return outside / whole, around * whole / level

    def _outside(self, places: Floats, z: Floats) -> Floats:
        away = places - self.axis(z)
        angle = np.arctan2(away[..., 1], away[..., 0])
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) - self.radius(z, angle))


class MeshErrors(NamedTuple):
    """How far a mesh is from the truth; lengths in the truth's unit."""

    chamfer: float
    hausdorff: float
    normal_deg: float  # Mean angle between normals, degrees
    volume: float  # Over the true one, less 1


class TrueSurface(NamedTuple):
    """A true surface, ready to be compared with."""

    surface: PreparedSurface
    volume: float  # In the mesh's unit, cubed
    # What its own facets are off by on average, in the truth's unit: less cannot be told.
    floor: float
    unit: float  # Length in which errors are told

    def errors_of(self, mesh: Mesh) -> MeshErrors:
        """How far a closed mesh is from it."""
        found = compare_surfaces(prepare_surface(*mesh), self.surface)
        volume = solidity(*mesh).volume / self.volume - 1.0
        return MeshErrors(
            found.chamfer / self.unit, found.hausdorff / self.unit, found.normal_deg, volume
        )


def truth_of_mesh(mesh: Mesh, unit: float = 1.0) -> TrueSurface:
    """The truth that a fine closed mesh stands for."""
    floor = facet_sag(mesh.vertices, mesh.faces) / unit
    return TrueSurface(prepare_surface(*mesh), solidity(*mesh).volume, floor, unit)


def radial_rings(radii: Floats, heights: Floats, angles: Floats) -> Floats:
    """Points (m, n, 3) at radii (m, n) about the z axis, at heights (m,) and azimuths (n,)."""
    level = np.broadcast_to(heights[:, None], radii.shape)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), level], axis=-1)


def _rings(radius: Radius, axis: Middle, heights: Floats, angles: Floats) -> Floats:
    found = radial_rings(radius(heights[:, None], angles[None]), heights, angles)
    found[..., :2] += axis(heights)[:, None]
    return found


def _turned(radius: Radius, axis: Middle = straight) -> ContouredShape:
    """An object of this radius, closed by planes or, where the radius is 0, by points."""

    def mesh() -> Mesh:
        # Closer together towards the ends, where round ones bend.
        heights = -HALF * np.cos(np.linspace(0.0, np.pi, TRUE_ROWS))
        angles = 2.0 * np.pi * np.arange(TRUE_COLUMNS) / TRUE_COLUMNS
        low, high = (np.array([*axis(z), z]) for z in (np.array(-HALF), np.array(HALF)))
        pointed = radius(np.array([-HALF, HALF]), np.zeros(2)) < 1e-9 * SHAPE_HEIGHT
        kept = heights[int(pointed[0]) : len(heights) - int(pointed[1])]
        return Mesh(*close_rings(low, _rings(radius, axis, kept, angles), high))

    return ContouredShape(radius, axis, mesh, -HALF, HALF)


def _sphere(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(np.maximum(HALF**2 - z**2, 0.0)) + 0.0 * t)


def _box(z: Floats, t: Floats) -> Floats:
    section = (np.abs(np.cos(t) / 40.0) ** 10 + np.abs(np.sin(t) / 30.0) ** 10) ** -0.1
    return np.asarray(section * np.maximum(1.0 - np.abs(z / HALF) ** 10, 0.0) ** 0.1)


def _cylinder(z: Floats, t: Floats) -> Floats:
    return np.asarray(30.0 + 0.0 * z + 0.0 * t)


def _zigzag(z: Floats, t: Floats) -> Floats:
    h = z / HALF
    outline = np.sqrt(1.04 - h**2) * (0.75 + 0.18 * np.sin(9.0 * h))
    return np.asarray(
        HALF * outline * (1.0 + 0.12 * np.cos(3.0 * t) + 0.08 * np.sin(2.0 * t + 2.0 * h))
    )


def _vase(z: Floats, t: Floats) -> Floats:
    h = z / HALF
    outline = 28.0 + 9.0 * np.sin(2.6 * h - 0.6) - 5.0 * h**2 + 3.0 * h
    outline = outline * np.sqrt(np.maximum(1.0 - h**6, 0.0))
    return np.asarray(outline * (1.0 + 0.1 * np.cos(2.0 * t + 0.8 * h) + 0.05 * np.sin(3.0 * t)))


def _vase_axis(z: Floats) -> Floats:
    h = z / HALF
    return np.stack([6.0 * h**2 - 2.0 * h, 3.0 * np.sin(2.0 * h)], axis=-1)


def _groove(z: Floats, t: Floats) -> Floats:
    return np.asarray(32.0 - 6.0 * np.exp(-(((z - 8.0) / 5.0) ** 2)) + 0.0 * t)


def _step(z: Floats, t: Floats) -> Floats:
    return np.asarray(29.0 - 7.0 * np.tanh((z + 6.0) / 3.0) + 0.0 * t)


def _bent() -> ContouredShape:
    """A superquadric, tapered along its axis and then bent."""

    def inside_out(points: Floats) -> Floats:
        back = TAPER.inverse(BEND.inverse(points))
        return SOLID.inside_out(back, np.ones_like(back))[0]

    def mesh() -> Mesh:
        base = SOLID.mesh(TRUE_LEVEL)
        return Mesh(BEND(TAPER(base.vertices)), base.faces)

    coarse = BEND(TAPER(SOLID.mesh(ROUGH_LEVEL).vertices))
    triangles = coarse[SOLID.mesh(ROUGH_LEVEL).faces]

    def axis(z: Floats) -> Floats:
        return np.array([_section_middle(triangles, height) for height in z.ravel()]).reshape(
            *z.shape, 2
        )

    def radius(z: Floats, t: Floats) -> Floats:
        z, t = np.broadcast_arrays(z, t)
        middle = np.broadcast_to(axis(z[:, :1]), (*z.shape, 2))
        rim = np.stack([np.cos(t), np.sin(t)], axis=-1)
        low, high = np.zeros(z.shape), np.full(z.shape, HALF)
        for _ in range(HALVINGS):
            half = 0.5 * (low + high)
            places = np.concatenate([middle + half[..., None] * rim, z[..., None]], axis=-1)
            inside = inside_out(places.reshape(-1, 3)).reshape(z.shape) < 0.0
            low, high = np.where(inside, half, low), np.where(inside, high, half)
        return low

    return ContouredShape(radius, axis, mesh, float(coarse[:, 2].min()), float(coarse[:, 2].max()))


def _section_middle(triangles: Floats, height: float) -> Floats:
    """Middle of the box (2,) about where triangles (n, 3, 3) stand across a height."""
    above = triangles[:, :, 2] > height
    across = above.any(axis=1) & ~above.all(axis=1)
    near = triangles[across].reshape(-1, 3)[:, :2]
    middle: Floats = 0.5 * (near.min(axis=0) + near.max(axis=0))
    return middle


def bent_axis(z: Floats) -> Floats:
    """An axis that leans and bends sideways by a third of the height."""
    return np.stack([0.6 * z**2 + 0.2 * z, 0.15 * np.sin(2.0 * z)], axis=-1)


def _wavy(z: Floats, t: Floats) -> Floats:
    """The lobed zig-zag on which lattices and skins were compared."""
    lobes = 1.0 + 0.12 * np.cos(3.0 * t) + 0.08 * np.sin(2.0 * t + 2.0 * z)
    return np.asarray(np.sqrt(1.04 - z**2) * (0.75 + 0.18 * np.sin(9.0 * z)) * lobes)


def _barrel(z: Floats, t: Floats) -> Floats:
    return np.asarray((0.62 - 0.2 * z**2) * (1.0 + 0.06 * np.cos(2.0 * t)))


def _pear(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(1.1 - z**2) * (0.5 - 0.22 * np.tanh(2.5 * z)) + 0.0 * t)


def _hourglass(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(0.1 + 0.25 * z**2) * (1.0 + 0.1 * np.sin(4.0 * t + z)))


def _screw(z: Floats, t: Floats) -> Floats:
    return np.asarray((0.5 - 0.08 * z) * (1.0 + 0.12 * np.cos(3.0 * t - 2.2 * z)))


def _tile(z: Floats, t: Floats) -> Floats:
    square = (np.abs(np.cos(t)) ** 6.0 + np.abs(np.sin(t) / 0.7) ** 6.0) ** (-1.0 / 6.0)
    return np.asarray(0.6 * square * (1.0 - 0.2 * z) * (1.08 - z**4) ** 0.25)


def _tube(z: Floats, t: Floats) -> Floats:
    oval = 1.0 / np.sqrt(np.cos(t) ** 2 + (np.sin(t) / 0.7) ** 2)
    return np.asarray(0.4 * oval * (1.0 - 0.25 * z**2))


def _ogive(z: Floats, t: Floats) -> Floats:
    return np.asarray(np.sqrt(2.1**2 - (z + 1.0) ** 2) - 0.35 + 0.04 * np.cos(5.0 * t))


def _ringed(z: Floats, t: Floats) -> Floats:
    return np.asarray(0.55 + 0.06 * np.cos(7.0 * z + 0.5 * np.sin(t)) - 0.1 * z)


REBUILT_SHAPES: Mapping[str, ContouredShape] = {
    "sphere": _turned(_sphere),
    "rounded box": _turned(_box),
    "cylinder": _turned(_cylinder),
    "tapered, bent": _bent(),
    "lobed zig-zag": _turned(_zigzag),
    "vase": _turned(_vase, _vase_axis),
    "groove": _turned(_groove),
    "step": _turned(_step),
}
WAVY = RoundObject(_wavy)
ROUND_OBJECTS: Mapping[str, RoundObject] = {
    "barrel": RoundObject(_barrel),
    "pear": RoundObject(_pear),
    "hourglass": RoundObject(_hourglass),
    "screw": RoundObject(_screw),
    "tile": RoundObject(_tile),
    "bent tube": RoundObject(_tube, bent_axis),
    "ogive": RoundObject(_ogive),
    "rings": RoundObject(_ringed),
}
