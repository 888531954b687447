"""Exact nearest points on a triangle mesh, many at once.

The triangle with the nearest centre gives each query an upper bound. Every triangle whose box
begins nearer than that, and whose disc does too, is then measured. The boxes are sorted along a
Morton curve; each four of them get a box about them, up to the root: a search descends one level
for all points together. Large triangles are cut up. Own code: trimesh's needs a compiled extra, and
is not exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.geometry.boxes import morton_order
from palpate.core.geometry.meshes import areas_and_normals

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Indices = NDArray[np.intp]
SLIVER_HEIGHT = 1e-8  # Over length, below which a triangle counts as its edges alone
CHILDREN = 4
BLOCK = 4096  # Points that descend together
MOST_PAIRS = 1 << 20  # Pairs of point and box that are held at once, unless a single point has more
SLIVER_AREA = 1e-6  # Over squared radius, below which a normal is mostly rounding
SLACK = 1e-13  # Of the squared distance to the centre: what rounding may take from the bound
EXTRA_PIECES = 50_000  # Pieces that may be cut beyond twice the number of faces
COMPACT = 2.0  # Longest edge over the root of the mean area at which a piece is left whole
NEXT_LIMIT = 0.7  # Each round cuts what is longer than this share of the round before


def point_tree(points: Floats, *, balanced: bool = True) -> cKDTree:
    """Points (n, k) to be searched, `balanced` unless once; scipy is imported for those who do."""
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=balanced, compact_nodes=balanced)


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
    # By corners: to reduce along an axis of three takes several times as long.
    a, b, c = pieces.transpose(1, 0, 2)
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    discs = BoundingDiscs.about(pieces)
    return NearestSearch(
        triangles=Triangles.of(corners),
        centres=point_tree(discs.centres, balanced=False),
        boxes=BoxTree.about(low, high),
        discs=discs,
        face=face,
    )


def cut_long_triangles(corners: Floats) -> tuple[Floats, Indices]:
    """Triangles (p, 3, 3), cut until they are short, or too many; from which each was cut."""
    pieces, faces = corners, np.arange(len(corners))
    most = 2 * len(corners) + EXTRA_PIECES
    area = float(areas_and_normals(corners)[0].sum())
    length = np.sqrt(_squared_edges(pieces).max(axis=1))
    limit = float(length.max())
    while limit > COMPACT * math.sqrt(area / len(pieces)):
        long = length > limit
        if len(pieces) + np.count_nonzero(long) > most:
            break
        if long.any():
            halves = _halves(pieces[long])
            pieces = np.concatenate([pieces[~long], halves])
            faces = np.concatenate([faces[~long], np.tile(faces[long], 2)])
            new = np.sqrt(_squared_edges(halves).max(axis=1))
            length = np.concatenate([length[~long], new])
        else:
            limit *= NEXT_LIMIT
    return pieces, faces


def _halves(corners: Floats) -> Floats:
    order = (_squared_edges(corners).argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _squared_edges(corners: Floats) -> Floats:
    """Squared length (m, 3) of the edge that begins at each corner."""
    edges = corners[:, [1, 2, 0]] - corners
    return np.asarray(np.einsum("ijk,ijk->ij", edges, edges))


def nearest_points(search: NearestSearch, queries: Floats) -> Nearest:
    """Nearest point of the surface to each query (n, 3); of faces equally near any one is named."""
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


def nearest_on(triangles: Triangles, faces: Indices, points: Floats) -> Floats:
    """Nearest point (n, 3) of one triangle, by number (n,), to each point (n, 3), m."""
    start, edges = triangles.corner[faces], triangles.edges[faces]
    offset = points - start
    s, t = np.einsum("nij,nj->in", triangles.dual[faces], offset)
    inside = (s > 0.0) & (t > 0.0) & (s + t < 1.0)  # A sliver has s = t = 0: no interior
    along = np.stack([s, t], axis=1)
    outside = np.flatnonzero(~inside)
    along[outside] = _along_edges(edges[outside], offset[outside])
    return start + along[:, :1] * edges[:, 0] + along[:, 1:] * edges[:, 1]


def _along_edges(edges: Floats, offset: Floats) -> Floats:
    """Coordinates (n, 2) along u and v of the nearest point of the triangle's outline."""
    u, v = edges[:, 0], edges[:, 1]
    w = v - u
    on_u = _share(_dot(offset, u), _dot(u, u))
    on_v = _share(_dot(offset, v), _dot(v, v))
    on_w = _share(_dot(offset - u, w), _dot(w, w))
    to_u = offset - on_u[:, None] * u  # From differences: products are right to 1e-8 only
    to_v = offset - on_v[:, None] * v
    to_w = offset - u - on_w[:, None] * w
    best = np.stack([_dot(to_u, to_u), _dot(to_v, to_v), _dot(to_w, to_w)]).argmin(axis=0)
    s = np.choose(best, [on_u, 0.0, 1.0 - on_w])
    return np.stack([s, np.choose(best, [0.0, on_v, on_w])], axis=1)


def _share(numerator: Floats, square: Floats) -> Floats:
    """Where along an edge, from 0 to 1; 0 on an edge without length."""
    long = square > 0.0
    return np.where(long, np.clip(numerator / np.where(long, square, 1.0), 0.0, 1.0), 0.0)


def _dot(one: Floats, other: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", one, other))


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


@dataclass(frozen=True, slots=True, eq=False)
class BoxTree:
    """Boxes about things, boxes about four of those, and so on."""

    # Centres and half extents (n, 3, 4) of the boxes of each level, four of one parent together, m;
    # the root's children come last.
    levels: tuple[tuple[Floats, Floats], ...]
    order: Indices  # The thing in each box of the first level

    @classmethod
    def about(cls, low: Floats, high: Floats) -> Self:
        """From the smallest and largest coordinates (n, 3) of each thing."""
        order = morton_order(0.5 * (low + high))
        low, high = low[order], high[order]
        levels = [_padded(low, high)]
        while len(low) > CHILDREN:
            first = np.arange(0, len(low), CHILDREN)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
            levels.append(_padded(low, high))
        return cls(tuple(levels), order)

    def within(self, points: Floats, reach: Floats) -> Iterator[tuple[Indices, Indices]]:
        """Things whose boxes begin nearer to a point than its reach.

        `points` (n, 3), m. `reach` (n,), m. Yields `point`, `thing` (p,): all such pairs, by
        ascending point; all pairs of a point come together.
        """
        square = reach * reach
        blocks = np.split(np.arange(len(points)), range(BLOCK, len(points), BLOCK))[::-1]
        while blocks:
            rows = blocks.pop()
            pairs = self._descend(points, square, rows)
            if pairs is None:
                half = len(rows) // 2
                blocks += [rows[half:], rows[:half]]
            else:
                yield pairs

    def _descend(
        self, points: Floats, square: Floats, rows: Indices
    ) -> tuple[Indices, Indices] | None:
        """Pairs of the points in these rows; None if they are too many to be held."""
        point, box = rows, np.zeros(len(rows), np.intp)
        for centre, half in reversed(self.levels):
            if len(point) * CHILDREN > MOST_PAIRS and len(rows) > 1:
                return None
            gap = points[point][:, :, None] - centre[box]
            np.abs(gap, out=gap)
            gap -= half[box]
            np.maximum(gap, 0.0, out=gap)
            near = np.einsum("ijk,ijk->ik", gap, gap) < square[point, None]
            parent, child = np.nonzero(near)
            point, box = point[parent], box[parent] * CHILDREN + child
        return point, self.order[box]


def _padded(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Centres and half extents by fours, (n, 3, 4), filled up with boxes that nothing reaches."""
    missing = -len(low) % CHILDREN
    centre = np.concatenate([0.5 * (low + high), np.zeros((missing, 3))])
    half = np.concatenate([0.5 * (high - low), np.full((missing, 3), -np.inf)])
    fours = (-1, CHILDREN, 3)
    centre, half = (np.swapaxes(a.reshape(fours), 1, 2).copy() for a in (centre, half))
    return centre, half


class BoundingDiscs(NamedTuple):
    """The disc about the centre of each triangle, in its plane, that holds it."""

    centres: Floats  # (n, 3), m
    normals: Floats  # (n, 3), unit; 0 for a sliver, whose disc becomes a ball
    radii: Floats  # (n,), m

    @classmethod
    def about(cls, corners: Floats) -> Self:
        """From the corners (n, 3, 3) of triangles."""
        centres = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0
        offset = corners - centres[:, None]
        square = np.einsum("ijk,ijk->ij", offset, offset).max(axis=1)
        areas, normals = areas_and_normals(corners)
        normals[areas <= SLIVER_AREA * square] = 0.0
        return cls(centres, normals, np.sqrt(square))

    def within(self, discs: Indices, points: Floats, reach: Floats) -> Bools:
        """Whether each disc (n,) may come within the reach (n,) of a point (n, 3)."""
        offset = points - self.centres[discs]
        height = np.einsum("ij,ij->i", offset, self.normals[discs])
        square = np.einsum("ij,ij->i", offset, offset)
        beside = np.sqrt(np.maximum(square - height * height, 0.0)) - self.radii[discs]
        beside = np.maximum(beside, 0.0)
        return np.asarray(height * height + beside * beside <= reach * reach + SLACK * square)
