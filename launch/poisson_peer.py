"""Poisson surfaces, as point clouds are often rebuilt, by PyMeshLab where that is installed.

Kazhdan and Hoppe, *Screened Poisson surface reconstruction*, 2013. palpate does not need it.
"""

from __future__ import annotations

import importlib.util

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.shapes.protocol import Mesh

PACKAGE = "pymeshlab"
DEPTH = 8
"""Of the octree: 256 cells along the object."""


def poisson_installed() -> bool:
    """Whether the package is there."""
    return importlib.util.find_spec(PACKAGE) is not None


def poisson(contours: Floats, normals: Floats) -> Mesh:
    """Surface of points (m, n, 3) with outward normals (m, n, 3); its ends are what it makes them.

    Raises
    ------
    ImportError
        If the package is not installed.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    cloud = pymeshlab.Mesh(
        vertex_matrix=contours.reshape(-1, 3), v_normals_matrix=normals.reshape(-1, 3)
    )
    meshes.add_mesh(cloud)
    meshes.generate_surface_reconstruction_screened_poisson(depth=DEPTH)
    found = meshes.current_mesh()
    return Mesh(
        np.asarray(found.vertex_matrix(), np.float64), np.asarray(found.face_matrix(), np.int32)
    )
