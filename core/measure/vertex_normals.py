"""Normals at the corners of a mesh's faces, smooth across blunt edges only."""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from palpate.core.arrays import Floats, Ints
from palpate.core.measure.triangles import areas_and_normals


def corner_angles(corners: Floats) -> Floats:
    """Angles (m, 3) of triangles (m, 3, 3) at their corners, rad."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, -2, axis=1) - corners
    sine = np.linalg.norm(np.cross(ahead, back), axis=2)
    angles: Floats = np.arctan2(sine, np.einsum("ijk,ijk->ij", ahead, back))
    return angles


def neighbours(faces: Ints) -> Ints:
    """The face over the edge that begins at each corner, (m, 3); itself where there is none."""
    begin = faces.astype(np.int64)
    end = np.roll(begin, -1, axis=1)
    count = int(begin.max()) + 1
    keys, wanted = (begin * count + end).ravel(), (end * count + begin).ravel()
    order = np.argsort(keys, kind="stable")
    found = order[np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)]
    over = np.where(keys[found] == wanted, found, np.arange(len(keys))) // 3
    return over.reshape(faces.shape).astype(np.int32)


def corner_normals(vertices: Floats, faces: Ints, sharp: float) -> Floats:
    """Unit normals (m, 3, 3) at the corners of faces.

    Parameters
    ----------
    vertices : (n, 3) array
        m.
    faces : (m, 3) array
        Rows of `vertices`, turned alike.
    sharp : float
        Angle between neighbouring faces, rad, from which the edge between them is one of the
        solid; pi or more for none.

    Notes
    -----
    The faces at a vertex that hang together by blunt edges share a normal: the sum of theirs,
    each by its angle there.
    """
    corners = vertices[faces]
    normals = areas_and_normals(corners)[1]
    over = neighbours(faces)
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
    found: Floats = units[group].reshape(-1, 3, 3)
    return found
