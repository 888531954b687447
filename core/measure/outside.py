"""On which side of a closed mesh points lie, from its nearest points."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.measure.nearest import Nearest
from palpate.core.measure.triangles import areas_and_normals
from palpate.core.measure.vertex_normals import corner_normals, neighbours

AT_CORNER = 1e-9
"""Barycentric coordinate below which a nearest point lies on the opposite edge."""


def outside(vertices: Floats, faces: Ints, points: Floats, nearest: Nearest) -> Bools:
    """Whether points (n, 3) lie outside a closed mesh, or on it.

    Parameters
    ----------
    vertices : (m, 3) array
        m.
    faces : (f, 3) array
        Counter-clockwise seen from outside.
    points : (n, 3) array
        m.
    nearest : Nearest
        Where the mesh is nearest to each.

    Notes
    -----
    By the normal at the nearest point: of the face, the sum of two along an edge, and at a
    vertex that of all its faces, each by its angle there. No other weights are right for every
    mesh: Bærentzen and Aanæs, *Signed distance computation using the angle weighted
    pseudonormal*, 2005.
    """
    corners = vertices[faces]
    normals = areas_and_normals(corners)[1]
    shares = _barycentric(corners[nearest.faces], normals[nearest.faces], nearest.points)
    on = shares > AT_CORNER
    count = on.sum(axis=1)
    across = normals[nearest.faces]
    at_vertex, at_edge = np.flatnonzero(count <= 1), np.flatnonzero(count == 2)
    if len(at_vertex):
        sums = corner_normals(vertices, faces, math.inf)
        across[at_vertex] = sums[nearest.faces[at_vertex], shares[at_vertex].argmax(axis=1)]
    if len(at_edge):
        begin = (np.argmin(on[at_edge], axis=1) + 1) % 3  # the edge opposite the missing corner
        across[at_edge] += normals[neighbours(faces)[nearest.faces[at_edge], begin]]
    found: Bools = np.einsum("ni,ni->n", points - nearest.points, across) >= 0.0
    return found


def _barycentric(corners: Floats, normals: Floats, points: Floats) -> Floats:
    """Shares (n, 3) of the corners in points of triangles (n, 3, 3)."""
    following = np.roll(corners, -1, axis=1) - points[:, None]
    beyond = np.roll(corners, -2, axis=1) - points[:, None]
    areas = np.einsum("ijk,ik->ij", np.cross(following, beyond), normals)
    total = areas.sum(axis=1, keepdims=True)
    shares: Floats = areas / np.where(total > 0.0, total, 1.0)
    return shares
