"""How far a mesh is from the truth, and Poisson surfaces of contours.

Kazhdan and Hoppe, *Screened Poisson surface reconstruction*, 2013, by PyMeshLab where that is
installed.
"""

from __future__ import annotations

import importlib.util
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from palpate.bench.objects import REBUILT_SHAPES
from palpate.core import Floats, geometry
from palpate.core.shapes import Mesh

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


def poisson_surface(contours: Floats, normals: Floats) -> Mesh:
    """A Poisson surface of points (m, n, 3); its ends are what it makes them.

    `normals` (m, n, 3): outward, else from differences between neighbours. Raises ImportError if
    the package is not installed.
    """
    import pymeshlab

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
