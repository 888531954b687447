"""Eight objects 100 mm high, on which ways of rebuilding are compared with each other.

Smooth and sharp ones, with plane, round and rounded ends; each gives exact contours and a fine
mesh of its true surface.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.rings import close_rings
from palpate.core.shapes.bend import Bend
from palpate.core.shapes.protocol import Mesh
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.shapes.taper import Taper
from palpate.launch.mesh_truth import Truth, truth_of_mesh

HEIGHT = 100.0
"""Of every object, mm; it lies from -50 to 50, the bent one nearly."""
HALF = 0.5 * HEIGHT
TRUE_ROWS, TRUE_COLUMNS = 241, 360
"""Of the meshes of the true surfaces."""
TRUE_LEVEL = 7
"""Of the mesh of the bent one: 328,000 faces."""
ROUGH_LEVEL = 6
"""Of that in which the middles of its sections are looked for."""
HALVINGS = 60
"""Steps that find a radius to the last bit."""

Radius = Callable[[Floats, Floats], Floats]


class RebuiltShape(NamedTuple):
    """An object and how it is sampled."""

    radius: Radius
    """Distance of the surface from the axis, mm, by height from -50 to 50 and azimuth."""
    axis: Callable[[Floats], Floats]
    """Places (..., 2) of the axis at heights, mm."""
    true_mesh: Callable[[], Mesh]
    """Fine mesh of the surface."""
    low: float
    """Its lower end, mm."""
    high: float
    """Its upper end, mm."""

    def contours(self, heights: Floats, around: int, first: float = 0.0) -> Floats:
        """Exact contours (m, around, 3), counter-clockwise, at even azimuths from the first."""
        angles = 2.0 * np.pi * (first + np.arange(around) / around)
        return _rings(self.radius, self.axis, heights, angles)


def straight(z: Floats) -> Floats:
    """The axis through the origin."""
    return np.zeros((*np.shape(z), 2))


@cache
def truth_of(name: str) -> Truth:
    """The true surface of one of the `SHAPES`, in mm, prepared once."""
    return truth_of_mesh(SHAPES[name].true_mesh())


def _rings(
    radius: Radius, axis: Callable[[Floats], Floats], heights: Floats, angles: Floats
) -> Floats:
    away = radius(heights[:, None], angles[None])[..., None]
    middle = axis(heights)[:, None]
    level = np.broadcast_to(heights[:, None, None], away.shape)
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.concatenate([middle + away * rim, level], axis=-1)


def _turned(radius: Radius, axis: Callable[[Floats], Floats] = straight) -> RebuiltShape:
    """An object of this radius, closed by planes or, where the radius is 0, by points."""

    def mesh() -> Mesh:
        # Closer together towards the ends, where round ones bend.
        heights = -HALF * np.cos(np.linspace(0.0, np.pi, TRUE_ROWS))
        angles = 2.0 * np.pi * np.arange(TRUE_COLUMNS) / TRUE_COLUMNS
        low, high = (np.array([*axis(z), z]) for z in (np.array(-HALF), np.array(HALF)))
        pointed = radius(np.array([-HALF, HALF]), np.zeros(2)) < 1e-9 * HEIGHT
        kept = heights[int(pointed[0]) : len(heights) - int(pointed[1])]
        return Mesh(*close_rings(low, _rings(radius, axis, kept, angles), high))

    return RebuiltShape(radius, axis, mesh, -HALF, HALF)


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


SOLID = Superquadric(np.array([32.0, 26.0, HALF]), np.array([0.7, 0.8]))
TAPER, BEND = Taper(0.25, 0.15, HALF), Bend(0.006)


def _bent() -> RebuiltShape:
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

    return RebuiltShape(radius, axis, mesh, float(coarse[:, 2].min()), float(coarse[:, 2].max()))


def _section_middle(triangles: Floats, height: float) -> Floats:
    """Middle of the box (2,) about where triangles (n, 3, 3) stand across a height."""
    above = triangles[:, :, 2] > height
    across = above.any(axis=1) & ~above.all(axis=1)
    near = triangles[across].reshape(-1, 3)[:, :2]
    middle: Floats = 0.5 * (near.min(axis=0) + near.max(axis=0))
    return middle


SHAPES: Mapping[str, RebuiltShape] = {
    "sphere": _turned(_sphere),
    "rounded box": _turned(_box),
    "cylinder": _turned(_cylinder),
    "tapered, bent": _bent(),
    "lobed zig-zag": _turned(_zigzag),
    "vase": _turned(_vase, _vase_axis),
    "groove": _turned(_groove),
    "step": _turned(_step),
}
