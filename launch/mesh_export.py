"""A mesh written in the formats that other programs read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats

MILLIMETRES = 1000.0
"""STL has no unit; programs that slice it for printing assume mm."""
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns z up, as everywhere here, into y up, as glTF demands."""
UNITS: Mapping[str, str] = {".ply": "m", ".stl": "mm", ".glb": "m, y up", ".obj": "m"}
"""In which each format is written."""


def write_mesh(path: Path, vertices: Floats, faces: NDArray[np.int32]) -> None:
    """Write a mesh; the suffix is one of `UNITS`.

    Parameters
    ----------
    vertices : (n, 3) array
        m, z up.
    faces : (m, 3) array
        Counter-clockwise seen from outside.
    """
    import trimesh

    kind = path.suffix.lower()
    if kind == ".stl":
        vertices = vertices * MILLIMETRES
    elif kind == ".glb":
        vertices = vertices @ Y_UP.T
    trimesh.Trimesh(vertices, faces, process=False).export(path)
