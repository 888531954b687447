"""Objects that are rebuilt from contours, and the errors of a mesh of one of them.

Each is 100 mm high and defined by its radius about an axis, as a function of height and azimuth.
They are smooth or sharp, with plane, round or rounded ends. Add an object at the end of the table.
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

SHAPE_HEIGHT = 100.0  # [mm] of every rebuilt object, from -50 to 50; nearly, of the bent one
HALF_HEIGHT = 0.5 * SHAPE_HEIGHT


def straight(z: Floats) -> Floats:
    """The axis through the origin."""
    return np.zeros((*np.shape(z), 2))


class RoundObject(NamedTuple):
    """An object that is defined by its radius, in any unit of length."""

    radius: Radius
    axis: Callable[[Floats], Floats] = straight  # Positions (..., 2) of the axis at heights
    low: float = -1.0  # Height of its lower end
    high: float = 1.0  # Height of its upper end
    fine: Callable[[], shapes.Mesh] | None = None  # Its fine mesh, if that is not made of rings

    def rings(self, heights: Floats, angles: Floats) -> Floats:
        """Points (m, n, 3) of the surface at heights (m,) and azimuths (n,)."""
        points = radial_rings(self.radius(heights[:, None], angles[None]), heights, angles)
        points[..., :2] += self.axis(heights)[:, None]
        return points

    def contours(self, heights: Floats, around: int, first: float = 0.0) -> Floats:
        """Exact contours (m, around, 3), counter-clockwise, at even azimuths from the first."""
        return self.rings(heights, 2.0 * np.pi * (first + np.arange(around) / around))

    def true_mesh(self, n_rows: int = 241, n_columns: int = 360) -> shapes.Mesh:
        """A fine mesh of the surface, closed by planes or, where the radius is 0, by points."""
        if self.fine is not None:
            return self.fine()
        # Rows are denser towards the ends, where round objects have most curvature.
        heights = self.low * np.cos(np.linspace(0.0, np.pi, n_rows))
        angles = 2.0 * np.pi * np.arange(n_columns) / n_columns
        low, high = (np.array([*self.axis(z), z]) for z in map(np.array, (self.low, self.high)))
        ends = np.broadcast_to(self.radius(np.array([self.low, self.high]), np.zeros(2)), 2)
        pointed = ends < 1e-9 * (self.high - self.low)
        kept = heights[int(pointed[0]) : len(heights) - int(pointed[1])]
        return closed_mesh(self.rings(kept, angles), low, high)


def _bent(fine_level: int = 7, rough_level: int = 6, n_halvings: int = 60) -> RoundObject:
    """A superquadric, tapered along its axis and then bent.

    Levels of subdivision: of its fine mesh, of 328,000 faces, and of the one in which the centres
    of its sections are found. The default `n_halvings` find a radius to the last bit.
    """
    solid = shapes.Superquadric(np.array([32.0, 26.0, HALF_HEIGHT]), np.array([0.7, 0.8]))
    taper, bend = shapes.Taper(0.25, 0.15, HALF_HEIGHT), shapes.Bend(0.006)

    def deformed(level: int) -> shapes.Mesh:
        base = solid.mesh(level)
        return shapes.Mesh(bend(taper(base.vertices)), base.faces)

    coarse, faces = deformed(rough_level)
    triangles = coarse[faces]

    def section_centre(height: float) -> Floats:
        """Centre (2,) of the bounding box of the triangles that cross a height."""
        above = triangles[:, :, 2] > height
        near = triangles[above.any(axis=1) & ~above.all(axis=1)].reshape(-1, 3)[:, :2]
        centre: Floats = 0.5 * (near.min(axis=0) + near.max(axis=0))
        return centre

    def axis(z: Floats) -> Floats:
        return np.array([section_centre(height) for height in z.ravel()]).reshape(*z.shape, 2)

    def radius(z: Floats, t: Floats) -> Floats:
        z, t = np.broadcast_arrays(z, t)
        centre = np.broadcast_to(axis(z[:, :1]), (*z.shape, 2))
        rim = np.stack([np.cos(t), np.sin(t)], axis=-1)
        low, high = np.zeros(z.shape), np.full(z.shape, HALF_HEIGHT)
        for _ in range(n_halvings):
            half = 0.5 * (low + high)
            places = np.concatenate([centre + half[..., None] * rim, z[..., None]], axis=-1)
            back = taper.inverse(bend.inverse(places.reshape(-1, 3)))
            inside = solid.inside_out(back, np.ones_like(back))[0].reshape(z.shape) < 0.0
            low, high = np.where(inside, half, low), np.where(inside, high, half)
        return low

    ends = float(coarse[:, 2].min()), float(coarse[:, 2].max())
    return RoundObject(radius, axis, *ends, partial(deformed, fine_level))


def _vase(z: Floats, t: Floats) -> Floats:
    h = z / HALF_HEIGHT
    outline = 28.0 + 9.0 * np.sin(2.6 * h - 0.6) - 5.0 * h**2 + 3.0 * h
    outline = outline * np.sqrt(np.maximum(1.0 - h**6, 0.0))
    return np.asarray(outline * (1.0 + 0.1 * np.cos(2.0 * t + 0.8 * h) + 0.05 * np.sin(3.0 * t)))


def _vase_axis(z: Floats) -> Floats:
    h = z / HALF_HEIGHT
    return np.stack([6.0 * h**2 - 2.0 * h, 3.0 * np.sin(2.0 * h)], axis=-1)


def _box(z: Floats, t: Floats) -> Floats:
    section = (np.abs(np.cos(t) / 40.0) ** 10 + np.abs(np.sin(t) / 30.0) ** 10) ** -0.1
    return np.asarray(section * np.maximum(1.0 - np.abs(z / HALF_HEIGHT) ** 10, 0.0) ** 0.1)


def _zigzag(half: float, z: Floats, t: Floats) -> Floats:
    h = z / half
    outline = np.sqrt(1.04 - h**2) * (0.75 + 0.18 * np.sin(9.0 * h))
    lobes = 1.0 + 0.12 * np.cos(3.0 * t) + 0.08 * np.sin(2.0 * t + 2.0 * h)
    return np.asarray(half * outline * lobes)


class MeshErrors(NamedTuple):
    """Errors of a mesh; lengths in the unit of the truth."""

    chamfer: float
    rms: float  # Root mean square distance, of both directions
    hausdorff: float
    normal_deg: float  # Mean angle between normals [deg]
    volume: float  # Relative error of the volume


class TrueSurface(NamedTuple):
    """A true surface, prepared for comparisons."""

    surface: geometry.PreparedSurface
    volume: float  # In the mesh's unit, cubed
    floor: float  # Mean error of its own facets / `unit`: smaller errors cannot be measured
    unit: float  # Length over which errors are given, in the mesh's unit

    def errors_of(self, mesh: Mesh) -> MeshErrors:
        """Errors of a closed mesh."""
        distances = geometry.compare_surfaces(geometry.prepare_surface(*mesh), self.surface)
        volume = geometry.solidity(*mesh).volume / self.volume - 1.0
        chamfer, rms, hausdorff = (
            v / self.unit for v in (distances.chamfer, distances.rms, distances.hausdorff)
        )
        return MeshErrors(chamfer, rms, hausdorff, distances.normal_deg, volume)


def truth_of_mesh(mesh: Mesh, unit: float = 1.0) -> TrueSurface:
    """A fine closed mesh as the truth; errors are given over `unit`."""
    volume = geometry.solidity(*mesh).volume
    floor = geometry.facet_sag(mesh.vertices, mesh.faces) / unit
    return TrueSurface(geometry.prepare_surface(*mesh), volume, floor, unit)


@cache
def truth_of(name: str) -> TrueSurface:
    """The true surface [mm] of one of the `REBUILT_SHAPES`, prepared once."""
    return truth_of_mesh(REBUILT_SHAPES[name].true_mesh())


def loft_rings(contours: Floats, heights: Floats, rows: int, columns: int) -> Floats:
    """Cubic splines through points of equal index, around and then upwards: (rows, columns, 3).

    `contours` (m, n, 3): from below upwards; the last point of each repeats its first.
    """
    turns = np.arange(contours.shape[1]) / (contours.shape[1] - 1)
    around = CubicSpline(turns, contours[..., :2], axis=1, bc_type="periodic")
    along = CubicSpline(heights, around(np.arange(columns) / columns), axis=0)
    levels = np.linspace(heights[0], heights[-1], rows)
    flat = np.broadcast_to(levels[:, None, None], (rows, columns, 1))
    return np.concatenate([along(levels), flat], axis=-1)


_tall = partial(RoundObject, low=-HALF_HEIGHT, high=HALF_HEIGHT)
REBUILT_SHAPES: Mapping[str, RoundObject] = {
    "sphere": _tall(lambda z, t: np.sqrt(np.maximum(HALF_HEIGHT**2 - z**2, 0.0)) + 0.0 * t),
    "rounded box": _tall(_box),
    "cylinder": _tall(lambda z, t: np.asarray(30.0)),
    "tapered, bent": _bent(),
    "lobed zig-zag": _tall(partial(_zigzag, HALF_HEIGHT)),
    "vase": _tall(_vase, _vase_axis),
    "groove": _tall(lambda z, t: 32.0 - 6.0 * np.exp(-(((z - 8.0) / 5.0) ** 2))),
    "step": _tall(lambda z, t: 29.0 - 7.0 * np.tanh((z + 6.0) / 3.0)),
}
WAVY = RoundObject(partial(_zigzag, 1.0))  # The object on which lattices and skins were compared
