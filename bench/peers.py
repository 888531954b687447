"""Other methods for a solid from contours: lofts, radial functions, the thesis's solid."""

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


class Peer(NamedTuple):
    """Another method."""

    name: str  # In tables
    build: Callable[[Floats], Mesh]  # From contours (m, n, 3), from below upwards


def contour_normals(contours: Floats) -> Floats:
    """Outward unit normals (m, n, 3) of contours, from differences between neighbours."""
    around = np.roll(contours, -1, axis=1) - np.roll(contours, 1, axis=1)
    normals = np.cross(around, np.gradient(contours, axis=0))
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def loft(contours: Floats, n_rows: int = 121, n_columns: int = 180) -> Mesh:
    """Cubic splines through points of equal index: periodic around, then upwards; plane ends."""
    return closed_mesh(_loft_rings(contours, n_rows, n_columns))


def smoothed_loft(contours: Floats, n_harmonics: int = 16) -> Mesh:
    """A loft of the lowest harmonics of each contour."""
    waves = np.fft.rfft(contours, axis=1)
    waves[:, n_harmonics + 1 :] = 0.0
    return loft(np.fft.irfft(waves, contours.shape[1], axis=1))


def radial_functions(
    contours: Floats, offset: float = 0.02, n_rows: int = 81, n_columns: int = 120
) -> Mesh:
    """Zero of cubic radial functions whose values are given on the contours and beside them.

    The points beside the contours lie inside and outside along the normals, at `offset` as a
    fraction of the size. The zero is found outwards from the centre of each section, starting at
    the loft; the ends are plane.
    """
    points = contours.reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    out = contour_normals(contours).reshape(-1, 3) * offset * size
    places = np.concatenate([points, points + out, points - out])
    values = np.repeat([0.0, offset * size, -offset * size], len(points))
    field = RBFInterpolator(places, values, kernel="cubic")
    rings = _loft_rings(contours, n_rows, n_columns)
    outwards = rings - rings.mean(axis=1, keepdims=True)
    outwards /= np.linalg.norm(outwards, axis=-1, keepdims=True)
    surface = _zero(field, rings.reshape(-1, 3), outwards.reshape(-1, 3))
    return closed_mesh(surface.reshape(rings.shape))


def _loft_rings(contours: Floats, n_rows: int, n_columns: int) -> Floats:
    closed = np.concatenate([contours, contours[:, :1]], axis=1)
    return loft_rings(closed, contours[..., 2].mean(axis=1), n_rows, n_columns)


def _zero(
    field: RBFInterpolator,
    start: Floats,
    directions: Floats,
    n_steps: int = 6,
    min_slope: float = 0.3,
) -> Floats:
    """Where a field of about unit slope is 0 along directions (n, 3) from points (n, 3).

    By secant steps, which `min_slope` limits where the field is flat.
    """
    last_offset, last_value = np.zeros(len(start)), np.asarray(field(start))
    offset = -last_value
    for _ in range(n_steps):
        value = np.asarray(field(start + offset[:, None] * directions))
        step = offset - last_offset
        slope = np.divide(value - last_value, step, out=np.ones_like(offset), where=step != 0.0)
        last_offset, last_value = offset, value
        offset = offset - value / np.maximum(slope, min_slope)
    return start + offset[:, None] * directions


def shell_and_core(contours: Floats, n_rows: int = 121, n_columns: int = 180) -> Mesh:
    """The thesis's solid, corrected."""
    level = contours.copy()
    level[..., 2] = contours[..., 2].mean(axis=1, keepdims=True)
    return rebuild_thesis(level).mesh(n_rows, n_columns)


LOFT, SMOOTHED = Peer("loft", loft), Peer("smoothed loft", smoothed_loft)
POISSON = Peer(
    "Poisson surface", lambda contours: poisson_surface(contours, contour_normals(contours))
)
THESIS, RADIAL = Peer("thesis", shell_and_core), Peer("radial functions", radial_functions)
