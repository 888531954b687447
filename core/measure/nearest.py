"""Exact nearest points on a triangle mesh, for many queries at once.

The triangle with the nearest centre gives each query an upper bound. Every triangle whose box
begins nearer than that, and whose disc does too, is then measured. Large triangles are cut up for
the search, so that long thin ones do not lie in boxes that are mostly empty.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.measure.boxes import BoxTree
from palpate.core.measure.discs import Discs
from palpate.core.measure.pieces import cut
from palpate.core.measure.point_triangle import Triangles, nearest_on

Indices = NDArray[np.intp]


class Nearest(NamedTuple):
    """Where the surface is nearest to each query."""

    distances: Floats
    """(n,), m."""
    points: Floats
    """(n, 3), m."""
    faces: Indices
    """(n,): the face on which each point lies."""


@dataclass(frozen=True, slots=True, eq=False)
class NearestSearch:
    """A surface, ready to be asked for its nearest points."""

    triangles: Triangles
    centres: cKDTree
    """Over the centres of the pieces."""
    boxes: BoxTree
    """About the pieces."""
    discs: Discs
    """About the pieces."""
    face: Indices
    """The face that each piece was cut from."""


def search_of(corners: Floats) -> NearestSearch:
    """Prepare triangles (m, 3, 3) for the search."""
    pieces, face = cut(corners)
    return NearestSearch(
        triangles=Triangles.of(corners),
        centres=cKDTree(pieces.mean(axis=1), balanced_tree=False, compact_nodes=False),
        boxes=BoxTree.about(pieces.min(axis=1), pieces.max(axis=1)),
        discs=Discs.about(pieces),
        face=face,
    )


def nearest_points(search: NearestSearch, queries: Floats) -> Nearest:
    """Nearest point of the surface to each query (n, 3).

    Where several faces are equally near, which of them is named is fixed but arbitrary.
    """
    faces = search.face[search.centres.query(queries)[1]]
    distances, points = _measure(search.triangles, faces, queries)
    best = Nearest(distances, points, faces)
    for query, piece in search.boxes.within(queries, distances.copy()):
        near = search.discs.within(piece, queries[query], distances[query])
        query, piece = query[near], piece[near]
        _improve(search.triangles, queries, query, search.face[piece], best)
    return best


def _improve(
    triangles: Triangles, queries: Floats, query: Indices, faces: Indices, best: Nearest
) -> None:
    """Take over what is nearer among these pairs of a query and a face."""
    distances, points = _measure(triangles, faces, queries[query])
    nearer = np.flatnonzero(distances < best.distances[query])
    nearer = nearer[np.lexsort((distances[nearer], query[nearer]))]
    rows = query[nearer]
    is_first = np.diff(rows, prepend=-1) > 0
    rows, won = rows[is_first], nearer[is_first]
    best.distances[rows] = distances[won]
    best.points[rows] = points[won]
    best.faces[rows] = faces[won]


def _measure(triangles: Triangles, faces: Indices, points: Floats) -> tuple[Floats, Floats]:
    """Distance (n,) of each point from one face, and the face's nearest point (n, 3)."""
    nearest = nearest_on(triangles, faces, points)
    offset = nearest - points
    return np.sqrt(np.einsum("ij,ij->i", offset, offset)), nearest
