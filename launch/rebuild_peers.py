"""Other ways from contours to a closed mesh, which rebuilding is compared with.

What an engineer would do without palpate: a spline loft, plain or with its contours smoothed, and
radial basis functions; and the thesis's own shell and core.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, RBFInterpolator

from palpate.core.arrays import Floats
from palpate.core.rebuild.surface.rings import close_rings
from palpate.core.rebuild.thesis.rebuild import rebuild_thesis
from palpate.core.shapes.protocol import Mesh
from palpate.launch.poisson_peer import poisson

ROWS, COLUMNS = 121, 180
"""Of the lofts' meshes."""
HARMONICS = 16
"""Of a contour that are kept by the smoothed loft."""
OFFSET = 0.02
"""Of the size: by how much the points inside and outside lie off the surface."""
FIELD_ROWS, FIELD_COLUMNS = 81, 120
"""Of the mesh of the radial functions."""
STEPS = 6
"""Secant steps from the loft to the zero of the radial functions."""


class Peer(NamedTuple):
    """Another way of rebuilding."""

    name: str
    """What it is called in tables."""
    build: Callable[[Floats], Mesh]
    """From contours (m, n, 3) whose points correspond by number, upwards, to a closed mesh."""


def loft(contours: Floats) -> Mesh:
    """Cubic splines through points of one number: periodic around, then upwards; plane ends."""
    return _closed(_loft_rings(contours, ROWS, COLUMNS))


def smoothed_loft(contours: Floats) -> Mesh:
    """The same with no more than 16 harmonics of each contour."""
    waves = np.fft.rfft(contours, axis=1)
    waves[:, HARMONICS + 1 :] = 0.0
    return loft(np.fft.irfft(waves, contours.shape[1], axis=1))


def radial_functions(contours: Floats) -> Mesh:
    """Zero of cubic radial functions that are known on the contours and a bit off them.

    The off-points lie along normals from differences between neighbours. Searched for outwards
    from the middle of each section, beginning at the loft; the ends are plane.
    """
    points = contours.reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    out = _normals(contours).reshape(-1, 3) * OFFSET * size
    places = np.concatenate([points, points + out, points - out])
    values = np.repeat([0.0, OFFSET * size, -OFFSET * size], len(points))
    field = RBFInterpolator(places, values, kernel="cubic")
    rings = _loft_rings(contours, FIELD_ROWS, FIELD_COLUMNS)
    outwards = rings - rings.mean(axis=1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    return _closed(_zero(field, rings.reshape(-1, 3), outwards.reshape(-1, 3)).reshape(rings.shape))


def shell_and_core(contours: Floats) -> Mesh:
    """The thesis's solid, corrected."""
    level = contours.copy()
    level[..., 2] = contours[..., 2].mean(axis=1, keepdims=True)
    return rebuild_thesis(level).mesh(ROWS, COLUMNS)


def poisson_surface(contours: Floats) -> Mesh:
    """A Poisson surface of the points, with normals from differences between neighbours."""
    return poisson(contours, _normals(contours))


def _closed(rings: Floats) -> Mesh:
    return Mesh(*close_rings(rings[0].mean(axis=0), rings, rings[-1].mean(axis=0)))


def _loft_rings(contours: Floats, rows: int, columns: int) -> Floats:
    count = contours.shape[1]
    closed = np.concatenate([contours, contours[:, :1]], axis=1)
    around = CubicSpline(np.arange(count + 1) / count, closed[..., :2], axis=1, bc_type="periodic")
    levels = contours[..., 2].mean(axis=1)
    along = CubicSpline(levels, around(np.arange(columns) / columns), axis=0)
    heights = np.linspace(levels[0], levels[-1], rows)
    level = np.broadcast_to(heights[:, None, None], (rows, columns, 1))
    return np.concatenate([along(heights), level], axis=-1)


def _zero(field: RBFInterpolator, start: Floats, way: Floats) -> Floats:
    """Where a field of about unit slope is 0 along ways (n, 3) from places (n, 3)."""
    before, value = np.zeros(len(start)), np.asarray(field(start))
    here = -value
    for _ in range(STEPS):
        found = np.asarray(field(start + here[:, None] * way))
        slope = np.divide(
            found - value, here - before, out=np.ones_like(here), where=here != before
        )
        before, value = here, found
        here = here - found / np.maximum(slope, 0.3)  # where it is flat, no wild step
    return start + here[:, None] * way


def _normals(contours: Floats) -> Floats:
    around = np.roll(contours, -1, axis=1) - np.roll(contours, 1, axis=1)
    upwards = np.gradient(contours, axis=0)
    normals = np.cross(around, upwards)
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))
