"""Objects that are rebuilt from contours, and how far a mesh is from one of them.

Each is a radius about an axis, over height and azimuth, 100 mm high, smooth or sharp, with plane,
round or rounded ends; none of the methods was chosen for a round one. Add one at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.bench.explored import Radius, closed_mesh, radial_rings
from palpate.core import geometry, shapes
from palpate.core.arrays import Floats
from palpate.core.shapes import Mesh

SHAPE_HEIGHT = 100.0  # Of every rebuilt object, mm; it lies from -50 to 50, the bent one nearly
HALF = 0.5 * SHAPE_HEIGHT
TRUE_ROWS, TRUE_COLUMNS = 241, 360  # Of the meshes of the true surfaces
TRUE_LEVEL = 7  # Of the mesh of the bent one: 328,000 faces
ROUGH_LEVEL = 6  # Of that in which the middles of its sections are looked for
HALVINGS = 60  # Steps that find a radius to the last bit
SOLID = shapes.Superquadric(np.array([32.0, 26.0, HALF]), np.array([0.7, 0.8]))
TAPER, BEND = shapes.Taper(0.25, 0.15, HALF), shapes.Bend(0.006)


def straight(z: Floats) -> Floats:
    """The axis through the origin."""
    return np.zeros((*np.shape(z), 2))


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


class MeshErrors(NamedTuple):
    """How far a mesh is from the truth; lengths in the truth's unit."""

    chamfer: float
    rms: float  # Root mean square, both ways
    hausdorff: float
    normal_deg: float  # Mean angle between normals, degrees
    volume: float  # Over the true one, less 1


class TrueSurface(NamedTuple):
    """A true surface, ready to be compared with."""

    surface: geometry.PreparedSurface
    volume: float  # In the mesh's unit, cubed
    floor: float  # Mean error of its own facets, in the truth's unit: less cannot be told
    unit: float  # Length in which errors are told

    def errors_of(self, mesh: Mesh) -> MeshErrors:
        """How far a closed mesh is from it."""
        found = geometry.compare_surfaces(geometry.prepare_surface(*mesh), self.surface)
        volume = geometry.solidity(*mesh).volume / self.volume - 1.0
        chamfer, rms, most = (v / self.unit for v in (found.chamfer, found.rms, found.hausdorff))
        return MeshErrors(chamfer, rms, most, found.normal_deg, volume)


def truth_of_mesh(mesh: Mesh, unit: float = 1.0) -> TrueSurface:
    """The truth that a fine closed mesh stands for."""
    volume = geometry.solidity(*mesh).volume
    floor = geometry.facet_sag(mesh.vertices, mesh.faces) / unit
    return TrueSurface(geometry.prepare_surface(*mesh), volume, floor, unit)


@cache
def truth_of(name: str) -> TrueSurface:
    """The true surface of one of the `REBUILT_SHAPES`, in mm, prepared once."""
    return truth_of_mesh(REBUILT_SHAPES[name].true_mesh())


def loft_rings(contours: Floats, heights: Floats, rows: int, columns: int) -> Floats:
    """Cubic splines through points of one number, around and then upwards, (rows, columns, 3).

    `contours` (m, n, 3): upwards, the first point of each again at its end.
    """
    turns = np.arange(contours.shape[1]) / (contours.shape[1] - 1)
    around = CubicSpline(turns, contours[..., :2], axis=1, bc_type="periodic")
    along = CubicSpline(heights, around(np.arange(columns) / columns), axis=0)
    levels = np.linspace(heights[0], heights[-1], rows)
    flat = np.broadcast_to(levels[:, None, None], (rows, columns, 1))
    return np.concatenate([along(levels), flat], axis=-1)


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
