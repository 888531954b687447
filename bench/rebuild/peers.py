"""Other ways to rebuild a solid from contours, and how far a mesh is from the truth.

Lofts, radial functions, the thesis's solid, and Poisson surfaces: Kazhdan and Hoppe, *Screened
Poisson surface reconstruction*, 2013, by PyMeshLab where that is installed.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, RBFInterpolator

from palpate.bench.objects import REBUILT_SHAPES, closed_mesh
from palpate.core import Floats, geometry
from palpate.core.shapes import Mesh
from palpate.core.thesis import rebuild_thesis

LOFT_ROWS, LOFT_COLUMNS = 121, 180  # Of the lofts' meshes
HARMONICS = 16  # Of a contour that are kept by the smoothed loft
OFFSET = 0.02  # Of the size: by how much the points inside and outside lie off the surface
FIELD_ROWS, FIELD_COLUMNS = 81, 120  # Of the mesh of the radial functions
STEPS = 6  # Secant steps from the loft to the zero of the radial functions
PACKAGE = "pymeshlab"
OCTREE_DEPTH = 8  # Of the octree: 256 cells along the object


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


class Peer(NamedTuple):
    """Another way of rebuilding."""

    name: str  # What it is called in tables
    build: Callable[[Floats], Mesh]  # From contours (m, n, 3), upwards, points by number


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
    out = _normals(contours).reshape(-1, 3) * OFFSET * size
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


def poisson_surface(contours: Floats, normals: Floats | None = None) -> Mesh:
    """A Poisson surface of points (m, n, 3); its ends are what it makes them.

    `normals` (m, n, 3): outward, else from differences between neighbours. Raises ImportError if
    the package is not installed.
    """
    import pymeshlab

    normals = _normals(contours) if normals is None else normals
    meshes = pymeshlab.MeshSet()
    points = {"vertex_matrix": contours, "v_normals_matrix": normals}
    meshes.add_mesh(pymeshlab.Mesh(**{name: one.reshape(-1, 3) for name, one in points.items()}))
    meshes.generate_surface_reconstruction_screened_poisson(depth=OCTREE_DEPTH, threads=1)
    found = meshes.current_mesh()
    vertices = np.asarray(found.vertex_matrix(), np.float64)
    return Mesh(vertices, np.asarray(found.face_matrix(), np.int32))


def poisson_installed() -> bool:
    """Whether the package is there."""
    return importlib.util.find_spec(PACKAGE) is not None


def _normals(contours: Floats) -> Floats:
    around = np.roll(contours, -1, axis=1) - np.roll(contours, 1, axis=1)
    normals = np.cross(around, np.gradient(contours, axis=0))
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


LOFT, SMOOTHED = Peer("loft", loft), Peer("smoothed loft", smoothed_loft)
POISSON = Peer("Poisson surface", poisson_surface)
THESIS, RADIAL = Peer("thesis", shell_and_core), Peer("radial functions", radial_functions)
