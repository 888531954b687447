"""T-junctions: corners of open edges that lie on other open edges, gaps without width."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints

Indices = NDArray[np.intp]


def split_at_junctions(
    vertices: Floats, faces: Ints, tolerance: float, max_rounds: int = 8
) -> tuple[Ints, int]:
    """Faces (m, 3) split where corners of other open edges lie on their open edges.

    `tolerance`: of a corner from an edge, in the unit of the vertices (n, 3). `max_rounds`: one
    edge of each face is split in each. Returns the faces, and the number of corners inserted into
    edges.
    """
    n_inserted = 0
    for _ in range(max_rounds):
        edge, corner = _corners_on_edges(vertices, faces, tolerance)
        if not len(edge):
            break
        face = edge // 3
        chosen = edge == edge[np.searchsorted(face, face)]  # one edge of each face
        edge, corner = edge[chosen], corner[chosen]
        faces = _split(faces, edge, corner)
        n_inserted += len(edge)
    return faces, n_inserted


def _corners_on_edges(vertices: Floats, faces: Ints, tolerance: float) -> tuple[Indices, Indices]:
    """Open edges, numbered 3 f + i, and corners on them, sorted by edge and place along it."""
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
    counts = np.array([len(indices) for indices in near])
    row = np.repeat(np.arange(len(opened)), counts)
    corner = rim[np.concatenate([np.array(indices, np.intp) for indices in near])]
    away = vertices[corner] - start[row]
    tiny = np.finfo(float).tiny
    place = np.einsum("ni,ni->n", away, along[row]) / np.maximum(length[row], tiny)
    offset = np.linalg.norm(away - (place / length[row])[:, None] * along[row], axis=1)
    on = (offset <= tolerance) & (place > tolerance) & (place < length[row] - tolerance)
    on &= ~(faces[opened[row] // 3] == corner[:, None]).any(axis=1)
    row, corner, place = row[on], corner[on], place[on]
    order = np.lexsort((place, opened[row]))
    return opened[row][order], corner[order]


def _split(faces: Ints, edge: Indices, corner: Indices) -> Ints:
    """Faces with one edge each split at corners, joined to the opposite corner."""
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
