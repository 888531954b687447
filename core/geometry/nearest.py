"""Exact nearest points on a triangle mesh, for many queries at once.

The triangle with the nearest centre gives each query an upper bound. Every triangle whose box
begins nearer than that, and whose disc does too, is then measured. Own code: trimesh's
needs a compiled extra, and is not exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats
from palpate.core.geometry.bounding_volumes import BoundingDiscs, BoxTree, cut_long_triangles

Indices = NDArray[np.intp]
# Height over length below which a triangle counts as its edges alone: it is off by no more than
# this share of its length, which is what rounding would cost its inside.
SLIVER_HEIGHT = 1e-8


class Nearest(NamedTuple):
    """Where the surface is nearest to each query."""

    distances: Floats  # (n,), m
    points: Floats  # (n, 3), m
    faces: Indices  # (n,): the face on which each point lies


@dataclass(frozen=True, slots=True, eq=False)
class NearestSearch:
    """A surface, ready to be asked for its nearest points."""

    triangles: Triangles
    centres: cKDTree  # Over the centres of the pieces
    boxes: BoxTree  # About the pieces
    discs: BoundingDiscs  # About the pieces
    face: Indices  # The face that each piece was cut from


def nearest_search(corners: Floats) -> NearestSearch:
    """Prepare triangles (m, 3, 3) for the search."""
    pieces, face = cut_long_triangles(corners)
    return NearestSearch(
        triangles=Triangles.of(corners),
        centres=cKDTree(pieces.mean(axis=1), balanced_tree=False, compact_nodes=False),
        boxes=BoxTree.about(pieces.min(axis=1), pieces.max(axis=1)),
        discs=BoundingDiscs.about(pieces),
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


def nearest_on(triangles: Triangles, faces: NDArray[np.intp], points: Floats) -> Floats:
    """Nearest point of one triangle to each point.

    `triangles`: the surface. `faces` (n,): the triangle that each point is asked about. `points`
    (n, 3), m. Returns (n, 3), m.
    """
    start = triangles.corner[faces]
    edges = triangles.edges[faces]
    offset = points - start
    s, t = np.einsum("nij,nj->in", triangles.dual[faces], offset)
    # A sliver has s = t = 0 everywhere, which is no interior.
    inside = (s > 0.0) & (t > 0.0) & (s + t < 1.0)
    along = np.stack([s, t], axis=1)
    outside = np.flatnonzero(~inside)
    along[outside] = _along_edges(edges[outside], offset[outside])
    result: Floats = start + along[:, :1] * edges[:, 0] + along[:, 1:] * edges[:, 1]
    return result


def _along_edges(edges: Floats, offset: Floats) -> Floats:
    """Coordinates (n, 2) along u and v of the nearest point of the triangle's outline."""
    u, v = edges[:, 0], edges[:, 1]
    w = v - u
    on_u = _share(_dot(offset, u), _dot(u, u))
    on_v = _share(_dot(offset, v), _dot(v, v))
    on_w = _share(_dot(offset - u, w), _dot(w, w))
    # Distances from differences of points: from products they would be right to 1e-8 only.
    to_u = offset - on_u[:, None] * u
    to_v = offset - on_v[:, None] * v
    to_w = offset - u - on_w[:, None] * w
    best = np.stack([_dot(to_u, to_u), _dot(to_v, to_v), _dot(to_w, to_w)]).argmin(axis=0)
    s = np.choose(best, [on_u, 0.0, 1.0 - on_w])
    t = np.choose(best, [0.0, on_v, on_w])
    return np.stack([s, t], axis=1)


def _share(numerator: Floats, square: Floats) -> Floats:
    """Where along an edge, from 0 to 1; 0 on an edge without length."""
    long = square > 0.0
    return np.where(long, np.clip(numerator / np.where(long, square, 1.0), 0.0, 1.0), 0.0)


def _dot(one: Floats, other: Floats) -> Floats:
    result: Floats = np.einsum("ij,ij->i", one, other)
    return result


class Triangles(NamedTuple):
    """Triangles, with what every question about them needs."""

    corner: Floats  # (m, 3): the first corner, m
    edges: Floats  # (m, 2, 3): from the first corner to the second and to the third, m
    dual: Floats  # (m, 2, 3): what gives the two coordinates along the edges, 1/m; 0 for a sliver

    @classmethod
    def of(cls, corners: Floats) -> Self:
        """From the corners (m, 3, 3)."""
        u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(u, v)
        square = np.einsum("ij,ij->i", normal, normal)
        longest = np.maximum(np.einsum("ij,ij->i", u, u), np.einsum("ij,ij->i", v, v))
        flat = square <= (SLIVER_HEIGHT * longest) ** 2
        scale = np.where(flat, 0.0, 1.0 / np.where(flat, 1.0, square))[:, None]
        # Rows dual to u and v: p = s u + t v has s = p.(v x n)/n.n and t = p.(n x u)/n.n.
        dual = np.stack([np.cross(v, normal) * scale, np.cross(normal, u) * scale], axis=1)
        return cls(corners[:, 0].copy(), np.stack([u, v], axis=1), dual)
