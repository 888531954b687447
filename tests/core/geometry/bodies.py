"""Closed meshes that the tests of geometry share."""

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.shapes import Mesh, Superquadric


def box() -> Mesh:
    """Unit cube, from (0, 0, 0) to (1, 1, 1)."""
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]
    for here in range(4):
        after = (here + 1) % 4
        faces += [[here, after, after + 4], [here, after + 4, here + 4]]
    vertices = [[x, y, z] for z in (0, 1) for x, y in square]
    return Mesh(np.array(vertices, float), np.array(faces, np.int32))


def torus() -> Mesh:
    """Radii 3 and 1: 30 by 20 quadrangles, each cut in two."""
    u, v = np.meshgrid(np.arange(30), np.arange(20), indexing="ij")
    a, b = u * (2 * np.pi / 30), v * (2 * np.pi / 20)
    ring = 3 + np.cos(b)
    vertices = np.stack([ring * np.cos(a), ring * np.sin(a), np.sin(b)], axis=-1).reshape(-1, 3)
    here, right = u * 20 + v, (u + 1) % 30 * 20 + v
    up, both = u * 20 + (v + 1) % 20, (u + 1) % 30 * 20 + (v + 1) % 20
    halves = [np.stack(f, axis=-1).reshape(-1, 3) for f in ((here, right, both), (here, both, up))]
    return Mesh(vertices, np.concatenate(halves).astype(np.int32))


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


BOX, TORUS, SPHERE = box(), torus(), ball(0.04, 3)
