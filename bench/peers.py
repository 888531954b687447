"""Other ways to rebuild a solid from contours: lofts, radial functions, the thesis's solid."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from palpate.bench.accuracy.methods import poisson_surface
from palpate.bench.explored import closed_mesh
from palpate.bench.rebuilt import loft_rings
from palpate.core.arrays import Floats
from palpate.core.shapes import Mesh
from palpate.core.thesis import rebuild_thesis

LOFT_ROWS, LOFT_COLUMNS = 121, 180  # Of the lofts' meshes
HARMONICS = 16  # Of a contour that are kept by the smoothed loft
OFFSET = 0.02  # Of the size: by how much the points inside and outside lie off the surface
FIELD_ROWS, FIELD_COLUMNS = 81, 120  # Of the mesh of the radial functions
STEPS = 6  # Secant steps from the loft to the zero of the radial functions


class Peer(NamedTuple):
    """Another way of rebuilding."""

    name: str  # What it is called in tables
    build: Callable[[Floats], Mesh]  # From contours (m, n, 3), upwards, points by number


def contour_normals(contours: Floats) -> Floats:
    """Outward unit normals (m, n, 3) of contours, from differences between neighbours."""
    around = np.roll(contours, -1, axis=1) - np.roll(contours, 1, axis=1)
    normals = np.cross(around, np.gradient(contours, axis=0))
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def loft(contours: Floats) -> Mesh:
    """Cubic splines through points of one number: periodic around, then upwards; plane ends."""
    return closed_mesh(_loft_rings(contours, LOFT_ROWS, LOFT_COLUMNS))


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
    out = contour_normals(contours).reshape(-1, 3) * OFFSET * size
    places = np.concatenate([points, points + out, points - out])
    values = np.repeat([0.0, OFFSET * size, -OFFSET * size], len(points))
    field = RBFInterpolator(places, values, kernel="cubic")
    rings = _loft_rings(contours, FIELD_ROWS, FIELD_COLUMNS)
    outwards = rings - rings.mean(axis=1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    found = _zero(field, rings.reshape(-1, 3), outwards.reshape(-1, 3))
    return closed_mesh(found.reshape(rings.shape))


def _loft_rings(contours: Floats, rows: int, columns: int) -> Floats:
    closed = np.concatenate([contours, contours[:, :1]], axis=1)
    return loft_rings(closed, contours[..., 2].mean(axis=1), rows, columns)


def _zero(field: RBFInterpolator, start: Floats, way: Floats) -> Floats:
    """Where a field of about unit slope is 0 along ways (n, 3) from places (n, 3)."""
    before, value = np.zeros(len(start)), np.asarray(field(start))
    here = -value
    for _ in range(STEPS):
        found = np.asarray(field(start + here[:, None] * way))
        step = here - before
        slope = np.divide(found - value, step, out=np.ones_like(here), where=step != 0.0)
        before, value = here, found
        here = here - found / np.maximum(slope, 0.3)  # where it is flat, no wild step
    return start + here[:, None] * way


def shell_and_core(contours: Floats) -> Mesh:
    """The thesis's solid, corrected."""
    level = contours.copy()
    level[..., 2] = contours[..., 2].mean(axis=1, keepdims=True)
    return rebuild_thesis(level).mesh(LOFT_ROWS, LOFT_COLUMNS)


LOFT, SMOOTHED = Peer("loft", loft), Peer("smoothed loft", smoothed_loft)
POISSON = Peer(
    "Poisson surface", lambda contours: poisson_surface(contours, contour_normals(contours))
)
THESIS, RADIAL = Peer("thesis", shell_and_core), Peer("radial functions", radial_functions)
