"""Closed meshes that the tests of geometry share."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from palpate.core.shapes import Mesh, Superquadric


def arrays(mesh: Any) -> Mesh:
    """A mesh of trimesh."""
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces, np.int32))


def moved(mesh: Mesh, shift: ArrayLike, size: ArrayLike = 1.0) -> Mesh:
    return Mesh(mesh.vertices * np.asarray(size) + np.asarray(shift), mesh.faces)


def joined(*meshes: Mesh) -> Mesh:
    """All meshes as one; no vertex is shared."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def ball(radius: float, level: int) -> Mesh:
    """Sphere of 20 * 4**level faces."""
    return Superquadric(np.full(3, radius), np.ones(2)).mesh(level)


BOX = arrays(trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 1]]))
TORUS = arrays(trimesh.creation.torus(3.0, 1.0, 30, 20))
SPHERE = ball(0.04, 3)
