"""Normals at a mesh's corners, and what they tell: points outside, the sag of facets.

A normal is smooth across blunt edges only. Each face at a vertex counts by its angle there: no
other weights tell the side of every mesh (Bærentzen and Aanæs, 2005).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry.meshes import areas_and_normals
from palpate.core.geometry.nearest import Nearest

AT_CORNER = 1e-9  # Barycentric coordinate below which a nearest point lies on the opposite edge
# Neighbouring faces that meet at more than this meet at an edge of the solid.
SHARP = math.radians(30.0)


def are_outside(vertices: Floats, faces: Ints, points: Floats, nearest: Nearest) -> Bools:
    """Whether points (n, 3) lie outside a closed mesh, or on it.

    `vertices` (m, 3), m. `faces` (f, 3): counter-clockwise seen from outside. `points` (n, 3), m.
    `nearest`: where the mesh is nearest to each.

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
        across[at_edge] += normals[face_neighbours(faces)[nearest.faces[at_edge], begin]]
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


def facet_sag(vertices: Floats, faces: Ints) -> float:
    """Mean distance between a mesh and the surface that its corners' normals tell, m.

    `vertices` (n, 3), m. `faces` (m, 3): rows of `vertices`, turned alike.

    A linear triangle misses a curved one by half the sum over its edges e of l_i l_j II(e, e),
    with the barycentric coordinates l at the edge's ends; their product is 1/12 on average.
    How the normal turns along an edge tells II(e, e).
    """
    corners = vertices[faces]
    normals = corner_normals(vertices, faces, SHARP)
    edges = np.roll(corners, -1, axis=1) - corners
    turned = np.roll(normals, -1, axis=1) - normals
    sag = np.abs(np.einsum("mij,mij->m", turned, edges)) / 24.0
    areas = areas_and_normals(corners)[0]
    total = float(areas.sum())
    return float(areas @ sag) / total if total > 0.0 else 0.0


def corner_normals(vertices: Floats, faces: Ints, sharp: float) -> Floats:
    """Unit normals (m, 3, 3) at the corners of faces.

    `vertices` (n, 3), m. `faces` (m, 3): rows of `vertices`, turned alike. `sharp`: angle between
    neighbouring faces, rad, from which the edge between them is one of the solid; pi or more for
    none.

    The faces at a vertex that hang together by blunt edges share a normal: the sum of theirs,
    each by its angle there.
    """
    corners = vertices[faces]
    normals = areas_and_normals(corners)[1]
    over = face_neighbours(faces)
    blunt = np.einsum("mi,mji->mj", normals, normals[over]) > math.cos(min(sharp, math.pi))
    face, edge = np.nonzero(blunt & (over != np.arange(len(faces))[:, None]))
    other = over[face, edge]
    links = []
    for corner in (edge, (edge + 1) % 3):
        there = (faces[other] == faces[face, corner][:, None]).argmax(axis=1)
        links.append((3 * face + corner, 3 * other + there))
    one, two = (np.concatenate(part) for part in zip(*links, strict=True))
    size = faces.size
    graph = coo_array((np.ones(len(one), bool), (one, two)), shape=(size, size))
    group = connected_components(graph, directed=False)[1]
    weighted = (corner_angles(corners)[:, :, None] * normals[:, None]).reshape(-1, 3)
    sums = np.stack([np.bincount(group, column) for column in weighted.T], axis=-1)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    units = sums / np.where(length > 0.0, length, 1.0)
    return units[group].reshape(-1, 3, 3)


def face_neighbours(faces: Ints) -> Ints:
    """The face over the edge that begins at each corner, (m, 3); itself where there is none."""
    begin = faces.astype(np.int64)
    end = np.roll(begin, -1, axis=1)
    count = int(begin.max()) + 1
    keys, wanted = (begin * count + end).ravel(), (end * count + begin).ravel()
    order = np.argsort(keys, kind="stable")
    found = order[np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)]
    over = np.where(keys[found] == wanted, found, np.arange(len(keys))) // 3
    return over.reshape(faces.shape).astype(np.int32)


def corner_angles(corners: Floats) -> Floats:
    """Angles (m, 3) of triangles (m, 3, 3) at their corners, rad."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, -2, axis=1) - corners
    sine = np.linalg.norm(np.cross(ahead, back), axis=2)
    angles: Floats = np.arctan2(sine, np.einsum("ijk,ijk->ij", ahead, back))
    return angles
