"""Open edges that pass corners of other open edges: T-junctions, gaps of no width."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints

Indices = NDArray[np.intp]

MAX_ROUNDS = 8  # An edge of a face is parted in each: a face has three, its pieces what is left


def split_at_junctions(vertices: Floats, faces: Ints, tolerance: float) -> tuple[Ints, int]:
    """Faces (m, 3) parted where corners of open edges lie on their own open edges.

    `tolerance`: how far from an edge a corner lies at most, in the unit of the vertices (n, 3).
    Returns the faces, and the number of corners that were set into edges.
    """
    parted = 0
    for _ in range(MAX_ROUNDS):
        edge, corner = _corners_on_edges(vertices, faces, tolerance)
        if not len(edge):
            break
        face = edge // 3
        alone = edge == edge[np.searchsorted(face, face)]  # of each face one edge at a time
        edge, corner = edge[alone], corner[alone]
        faces = _parted(faces, edge, corner)
        parted += len(edge)
    return faces, parted


def _corners_on_edges(vertices: Floats, faces: Ints, tolerance: float) -> tuple[Indices, Indices]:
    """Open edges, numbered 3 f + i, and corners on them: by edge, and from its begin to its end."""
    from scipy.spatial import cKDTree

    begin, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    key = np.minimum(begin, end) * (int(faces.max()) + 1) + np.maximum(begin, end)
    _, which, sizes = np.unique(key, return_inverse=True, return_counts=True)
    opened = np.flatnonzero(sizes[which.reshape(-1)] == 1)
    none = np.zeros(0, np.intp)
    if not len(opened):
        return none, none
    rim = np.unique(np.concatenate([begin[opened], end[opened]]))
    start, along = vertices[begin[opened]], vertices[end[opened]] - vertices[begin[opened]]
    length = np.linalg.norm(along, axis=1)
    near = cKDTree(vertices[rim]).query_ball_point(start + 0.5 * along, 0.5 * length + tolerance)
    counts = np.array([len(one) for one in near])
    row = np.repeat(np.arange(len(opened)), counts)
    corner = rim[np.concatenate([np.array(one, np.intp) for one in near])]
    away = vertices[corner] - start[row]
    way = np.einsum("ni,ni->n", away, along[row]) / np.maximum(length[row], np.finfo(float).tiny)
    off = np.linalg.norm(away - (way / length[row])[:, None] * along[row], axis=1)
    on = (off <= tolerance) & (way > tolerance) & (way < length[row] - tolerance)
    on &= ~(faces[opened[row] // 3] == corner[:, None]).any(axis=1)
    row, corner, way = row[on], corner[on], way[on]
    order = np.lexsort((way, opened[row]))
    return opened[row][order], corner[order]


def _parted(faces: Ints, edge: Indices, corner: Indices) -> Ints:
    """Faces of which one edge each is parted at corners, all pieces with the corner opposite."""
    first = np.concatenate([[True], edge[1:] != edge[:-1]])
    last = np.concatenate([first[1:], [True]])
    face, at = edge // 3, edge % 3
    begin, end, top = (faces[face, (at + step) % 3] for step in range(3))
    before = np.where(first, begin, np.roll(corner, 1))
    pieces = np.stack([before, corner, top], axis=1)
    ends = np.stack([corner, end, top], axis=1)[last]
    whole = np.ones(len(faces), bool)
    whole[face] = False
    return np.concatenate([faces[whole], pieces, ends]).astype(faces.dtype)
