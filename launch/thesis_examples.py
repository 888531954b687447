"""Stand-ins for the two objects that the thesis rebuilds, whose shapes it only draws.

The first is turned and lobed, with 27 contours of 81 points at even heights; the second smoother,
with 24 contours of 41 points, closer together where its outline bends more. The first point of
each contour comes again at its end, and each begins at azimuth -pi, as the thesis's program needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.rings import close_rings
from palpate.core.shapes.protocol import Mesh
from palpate.launch.mesh_truth import Truth, truth_of_mesh

SIZE = 2.0
"""Height of both objects; all figures are over it, so that its unit does not matter."""
ROWS, COLUMNS = 161, 240
"""Of the meshes that are compared."""
TRUE_ROWS, TRUE_COLUMNS = 401, 720
FLOOR_ROWS, FLOOR_COLUMNS = 301, 541
"""Of the truth, and of the other mesh of it that shows what measuring alone adds."""


class Example(NamedTuple):
    """An object and the contours that were felt of it."""

    name: str
    """What it is called in tables and files."""
    radius: Callable[[Floats, Floats], Floats]
    """Distance of its surface from the z axis, by height (-1 to 1) and azimuth."""
    heights: Floats
    """Of its contours, (m,)."""
    around: int
    """Points of a contour, the first twice."""

    def contours(self) -> Floats:
        """What a perfect finger feels, (m, around, 3)."""
        return self._rings(self.heights, np.linspace(-np.pi, np.pi, self.around))

    def mesh(self, rows: int, columns: int) -> Mesh:
        """The object itself, with plane ends."""
        azimuths = 2.0 * np.pi * np.arange(columns) / columns
        rings = self._rings(np.linspace(-1.0, 1.0, rows), azimuths)
        return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))

    def _rings(self, heights: Floats, azimuths: Floats) -> Floats:
        radius = self.radius(heights[:, None], azimuths[None, :])
        level = np.broadcast_to(heights[:, None], radius.shape)
        return np.stack([radius * np.cos(azimuths), radius * np.sin(azimuths), level], axis=-1)


def truth_of(example: Example) -> Truth:
    """The example's own surface, finely meshed; errors are over its height."""
    return truth_of_mesh(example.mesh(TRUE_ROWS, TRUE_COLUMNS), SIZE)


def loft(contours: Floats) -> Mesh:
    """The plain way: cubic splines through points of one number, around and then upwards.

    Parameters
    ----------
    contours : (m, n, 3) array
        Upwards, the first point of each again at its end. The ends are closed by planes.
    """
    turns = np.linspace(0.0, 1.0, contours.shape[1])
    around = CubicSpline(turns, contours[..., :2], axis=1, bc_type="periodic")
    heights = contours[:, 0, 2]
    along = CubicSpline(heights, around(np.arange(COLUMNS) / COLUMNS), axis=0)
    levels = np.linspace(heights[0], heights[-1], ROWS)
    flat = np.broadcast_to(levels[:, None, None], (ROWS, COLUMNS, 1))
    rings = np.concatenate([along(levels), flat], axis=-1)
    return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))


def _turned(height: Floats, azimuth: Floats) -> Floats:
    outline = np.sqrt(1.04 - height**2) * (0.75 + 0.18 * np.sin(9.0 * height))
    lobes = 1.0 + 0.12 * np.cos(3.0 * azimuth) + 0.08 * np.sin(2.0 * azimuth + 2.0 * height)
    return np.asarray(outline * lobes)


def _smooth(height: Floats, azimuth: Floats) -> Floats:
    outline = (1.02 - height**2) ** 0.35 * (0.8 + 0.1 * height)
    return np.asarray(outline * (1.0 + 0.15 * np.cos(2.0 * azimuth)))


FIRST = Example("example 1", _turned, np.linspace(-1.0, 1.0, 27), 81)
SECOND = Example("example 2", _smooth, np.sin(0.5 * np.pi * np.linspace(-1.0, 1.0, 24)), 41)
EXAMPLES = (FIRST, SECOND)
