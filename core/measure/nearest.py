"""Exact nearest points on a triangle mesh, for many queries at once.

A tree over the centres of the triangles gives the triangle with the nearest centre, and so an
upper bound. A triangle whose centre is farther than that bound and the largest radius together
cannot be nearer: the tree counts, for each query, the triangles that can, and those are looked
at. Large triangles are cut up for the search, or one long face would make every query costly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.measure.point_triangle import Triangles, nearest_on
from palpate.core.measure.triangles import areas_and_normals

Indices = NDArray[np.intp]

EXTRA_PIECES = 20_000
"""Pieces that may be cut beyond twice the number of faces."""
MOST_PAIRS = 1 << 20
"""Pairs of query and candidate looked at together: bounds the memory."""
SLACK = 1e-13
"""Of the square of the mesh's size: what rounding may take from a squared bound."""


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
    tree: cKDTree
    """Over the centres of the pieces."""
    face: Indices
    """(p,): the face that each piece belongs to."""
    radius: Floats
    """(p,): farthest corner of each piece from its centre, m."""
    plane: Floats
    """(p, 4): unit normal of each piece, and its distance from the origin, m."""
    slack: float
    """What rounding may take from a squared bound, m2."""


def search_of(corners: Floats) -> NearestSearch:
    """Prepare triangles (m, 3, 3) for the search."""
    pieces, face = _cut(corners)
    centres, radius = _discs(pieces)
    normals = areas_and_normals(pieces)[1]
    offset = np.einsum("ij,ij->i", normals, centres)
    size = 2.0 * float(np.abs(corners).max())
    return NearestSearch(
        triangles=Triangles.of(corners),
        tree=cKDTree(centres, balanced_tree=False, compact_nodes=False),
        face=face,
        radius=radius,
        plane=np.column_stack([normals, offset]),
        slack=SLACK * size * size,
    )


def nearest_points(search: NearestSearch, queries: Floats) -> Nearest:
    """Nearest point of the surface to each query (n, 3)."""
    count = len(queries)
    best = Nearest(np.full(count, np.inf), np.empty((count, 3)), np.zeros(count, np.intp))
    _improve(search, queries, np.arange(count), search.tree.query(queries)[1], best)
    reach = best.distances + search.radius.max()
    reach = np.sqrt(reach * reach + search.slack)
    needed = search.tree.query_ball_point(queries, reach, return_length=True)
    left, most = np.flatnonzero(needed > 1), 4
    while len(left):
        few = needed[left] <= most
        here, left = left[few], left[~few]
        block = max(1, MOST_PAIRS // most)
        for i in range(0, len(here), block):
            _look(search, queries, here[i : i + block], min(most, len(search.face)), best)
        most *= 2
    return best


def _look(search: NearestSearch, queries: Floats, rows: Indices, count: int, best: Nearest) -> None:
    """Look at so many candidates of each query, all but the first, which was seen before."""
    distance, piece = search.tree.query(queries[rows], k=range(2, count + 1))
    plane = search.plane[piece]
    height = np.einsum("nkj,nj->nk", plane[:, :, :3], queries[rows]) - plane[:, :, 3]
    beside = np.sqrt(np.maximum(distance * distance - height * height, 0.0))
    beside = np.maximum(beside - search.radius[piece], 0.0)
    # The distance to the disc about the piece: seldom more than one or two are near enough.
    bound = height * height + beside * beside - search.slack
    query, column = np.nonzero(bound < best.distances[rows, None] ** 2)
    _improve(search, queries, rows[query], piece[query, column], best)


def _improve(
    search: NearestSearch, queries: Floats, rows: Indices, pieces: Indices, best: Nearest
) -> None:
    """Take over what is nearer; `rows` ascend, and may name a query several times."""
    if not len(rows):
        return
    faces = search.face[pieces]
    points = nearest_on(search.triangles, faces, queries[rows])
    offset = points - queries[rows]
    distances = np.sqrt(np.einsum("ij,ij->i", offset, offset))
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    least = np.minimum.reduceat(distances, first)
    is_least = distances == np.repeat(least, np.diff(first, append=len(rows)))
    winner = np.flatnonzero(is_least)
    winner = winner[np.diff(rows[winner], prepend=-1) > 0]
    nearer = distances[winner] < best.distances[rows[winner]]
    won = winner[nearer]
    best.distances[rows[won]] = distances[won]
    best.points[rows[won]] = points[won]
    best.faces[rows[won]] = faces[won]


def _cut(corners: Floats) -> tuple[Floats, Indices]:
    """Cut triangles across their longest edges until they are alike, or there are too many."""
    pieces, face = corners, np.arange(len(corners))
    most = 2 * len(corners) + EXTRA_PIECES
    limit = float(_discs(pieces)[1].max())
    while True:
        radius = _discs(pieces)[1]
        large = radius > limit
        if len(pieces) + np.count_nonzero(large) > most:
            return pieces, face
        if large.any():
            halves = _halves(pieces[large])
            pieces = np.concatenate([pieces[~large], halves])
            face = np.concatenate([face[~large], np.tile(face[large], 2)])
        elif limit <= 1.5 * float(np.median(radius)):
            return pieces, face
        else:
            limit *= 0.7


def _halves(corners: Floats) -> Floats:
    """Both halves of triangles (m, 3, 3), cut from the longest edge to the corner opposite."""
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.einsum("ijk,ijk->ij", edges, edges).argmax(axis=1)
    order = (longest[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _discs(corners: Floats) -> tuple[Floats, Floats]:
    """Centres (m, 3) and radii (m,) of triangles."""
    centres = corners.mean(axis=1)
    offset = corners - centres[:, None]
    return centres, np.sqrt(np.einsum("ijk,ijk->ij", offset, offset).max(axis=1))
