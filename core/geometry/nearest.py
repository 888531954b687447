"""Exact nearest points on a triangle mesh, many at once.

The triangle with the nearest centre gives each query an upper bound. All triangles whose box and
disc are nearer than the bound are then measured. The boxes are sorted along a Morton curve and
joined by fours, up to the root: a search descends one level for all points together. Large
triangles are cut. Not trimesh's search, which needs a compiled extra and is not exact.
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
from palpate.reprs import readable

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Indices = NDArray[np.intp]
N_CHILDREN = 4  # boxes in one box of the next level
SLIVER_HEIGHT = 1e-8  # over length; a lower triangle counts as its edges alone


@dataclass(frozen=True, slots=True, kw_only=True)
class CuttingSettings:
    """Cutting of long triangles for the search, which affects its speed only."""

    max_extra_pieces: int = 50_000  # beyond twice the number of faces; more pieces are not cut
    max_length: float = 2.0  # longest edge over the root of the mean area; smaller cuts more
    length_step: float = 0.7  # factor of the length limit from one round to the next


def point_tree(points: Floats, *, balanced: bool = True) -> cKDTree:
    """Search tree of points (n, k), `balanced` unless used once; scipy is imported only here."""
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=balanced, compact_nodes=balanced)


@readable
class Nearest(NamedTuple):
    """Point of the surface nearest to each query."""

    distances: Floats  # (n,) [m]
    points: Floats  # (n, 3) [m]
    faces: Indices  # (n,): face of each point


@dataclass(frozen=True, slots=True, eq=False)
class NearestSearch:
    """A surface prepared for searches of nearest points."""

    triangles: Triangles
    centres: cKDTree  # of the pieces
    boxes: BoxTree  # around the pieces
    discs: BoundingDiscs  # around the pieces
    face: Indices  # face of each piece


def nearest_search(corners: Floats, settings: CuttingSettings = CuttingSettings()) -> NearestSearch:
    """Prepare triangles (m, 3, 3) for the search."""
    pieces, face = cut_long_triangles(corners, settings)
    # By corners: reducing along an axis of three takes several times as long.
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


def cut_long_triangles(
    corners: Floats, settings: CuttingSettings = CuttingSettings()
) -> tuple[Floats, Indices]:
    """Triangles (p, 3, 3), halved until they are short or too many, and the face of each (p,)."""
    pieces, faces = corners, np.arange(len(corners))
    max_pieces = 2 * len(corners) + settings.max_extra_pieces
    area = float(areas_and_normals(corners)[0].sum())
    length = np.sqrt(_squared_edges(pieces).max(axis=1))
    limit = float(length.max())
    while limit > settings.max_length * math.sqrt(area / len(pieces)):
        long = length > limit
        if len(pieces) + np.count_nonzero(long) > max_pieces:
            break
        if long.any():
            halves = _halves(pieces[long])
            pieces = np.concatenate([pieces[~long], halves])
            faces = np.concatenate([faces[~long], np.tile(faces[long], 2)])
            new = np.sqrt(_squared_edges(halves).max(axis=1))
            length = np.concatenate([length[~long], new])
        else:
            limit *= settings.length_step
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
    """Nearest point of the surface to each query (n, 3); of faces equally near any one is given."""
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
    rows, nearest = rows[is_first], nearer[is_first]
    best.distances[rows] = distances[nearest]
    best.points[rows] = points[nearest]
    best.faces[rows] = faces[nearest]


def _measure(triangles: Triangles, faces: Indices, points: Floats) -> tuple[Floats, Floats]:
    """Distance (n,) of each point from one face, and the face's nearest point (n, 3)."""
    nearest = nearest_on(triangles, faces, points)
    offset = nearest - points
    return np.sqrt(np.einsum("ij,ij->i", offset, offset)), nearest


def nearest_on(triangles: Triangles, faces: Indices, points: Floats) -> Floats:
    """Nearest point (n, 3) of one triangle, by index (n,), to each point (n, 3) [m]."""
    start, edges = triangles.corner[faces], triangles.edges[faces]
    offset = points - start
    s, t = np.einsum("nij,nj->in", triangles.dual[faces], offset)
    inside = (s > 0.0) & (t > 0.0) & (s + t < 1.0)  # a sliver has s = t = 0: no interior
    along = np.stack([s, t], axis=1)
    outside = np.flatnonzero(~inside)
    along[outside] = _along_edges(edges[outside], offset[outside])
    return start + along[:, :1] * edges[:, 0] + along[:, 1:] * edges[:, 1]


def _along_edges(edges: Floats, offset: Floats) -> Floats:
    """Coordinates (n, 2) along u and v of the nearest point on the triangle's edges."""
    u, v = edges[:, 0], edges[:, 1]
    w = v - u
    on_u = _edge_fraction(_dot(offset, u), _dot(u, u))
    on_v = _edge_fraction(_dot(offset, v), _dot(v, v))
    on_w = _edge_fraction(_dot(offset - u, w), _dot(w, w))
    to_u = offset - on_u[:, None] * u  # from differences: products are exact to 1e-8 only
    to_v = offset - on_v[:, None] * v
    to_w = offset - u - on_w[:, None] * w
    best = np.stack([_dot(to_u, to_u), _dot(to_v, to_v), _dot(to_w, to_w)]).argmin(axis=0)
    s = np.choose(best, [on_u, 0.0, 1.0 - on_w])
    return np.stack([s, np.choose(best, [0.0, on_v, on_w])], axis=1)


def _edge_fraction(numerator: Floats, square: Floats) -> Floats:
    """Place along an edge, from 0 to 1; 0 on an edge without length."""
    long = square > 0.0
    return np.where(long, np.clip(numerator / np.where(long, square, 1.0), 0.0, 1.0), 0.0)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", a, b))


class Triangles(NamedTuple):
    """Triangles with precomputed vectors."""

    corner: Floats  # (m, 3) [m]: the first corner
    edges: Floats  # (m, 2, 3) [m]: from the first corner to the second and to the third
    dual: Floats  # (m, 2, 3) [1/m]: dual to the edges; 0 for a sliver

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


def are_slivers(corners: Floats) -> Bools:
    """Whether triangles (m, 3, 3) have no area: their height is up to 1e-8 of the longest edge."""
    longest = _squared_edges(corners).max(axis=1)
    return np.asarray(2.0 * areas_and_normals(corners)[0] <= SLIVER_HEIGHT * longest)


@dataclass(frozen=True, slots=True, eq=False)
class BoxTree:
    """Boxes around items, boxes around four of those, and so on."""

    # Centres and half extents (n, 3, 4) [m] of the boxes of each level, four of one parent
    # together; the root's children come last.
    levels: tuple[tuple[Floats, Floats], ...]
    order: Indices  # item in each box of the first level

    @classmethod
    def about(cls, low: Floats, high: Floats) -> Self:
        """From the smallest and largest coordinates (n, 3) of each item."""
        order = morton_order(0.5 * (low + high))
        low, high = low[order], high[order]
        levels = [_padded(low, high)]
        while len(low) > N_CHILDREN:
            first = np.arange(0, len(low), N_CHILDREN)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
            levels.append(_padded(low, high))
        return cls(tuple(levels), order)

    def within(
        self, points: Floats, reach: Floats, *, block: int = 4096, max_pairs: int = 1 << 20
    ) -> Iterator[tuple[Indices, Indices]]:
        """Items whose boxes are nearer to a point than its reach.

        `points` (n, 3) [m]. `reach` (n,) [m]. `block`: points that descend together. `max_pairs`:
        of point and box in memory, unless a single point has more. Yields `point`, `item` (p,): all
        such pairs, by ascending point; all pairs of a point are in one result.
        """
        square = reach * reach
        blocks = np.split(np.arange(len(points)), range(block, len(points), block))[::-1]
        while blocks:
            rows = blocks.pop()
            pairs = self._descend(points, square, rows, max_pairs)
            if pairs is None:
                half = len(rows) // 2
                blocks += [rows[half:], rows[:half]]
            else:
                yield pairs

    def _descend(
        self, points: Floats, square: Floats, rows: Indices, max_pairs: int
    ) -> tuple[Indices, Indices] | None:
        """Pairs of the points in some rows; None if they are too many."""
        point, box = rows, np.zeros(len(rows), np.intp)
        for centre, half in reversed(self.levels):
            if len(point) * N_CHILDREN > max_pairs and len(rows) > 1:
                return None
            gap = points[point][:, :, None] - centre[box]
            np.abs(gap, out=gap)
            gap -= half[box]
            np.maximum(gap, 0.0, out=gap)
            near = np.einsum("ijk,ijk->ik", gap, gap) < square[point, None]
            parent, child = np.nonzero(near)
            point, box = point[parent], box[parent] * N_CHILDREN + child
        return point, self.order[box]


def _padded(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Centres and half extents by fours, (n, 3, 4), padded with empty boxes."""
    missing = -len(low) % N_CHILDREN
    centre = np.concatenate([0.5 * (low + high), np.zeros((missing, 3))])
    half = np.concatenate([0.5 * (high - low), np.full((missing, 3), -np.inf)])
    fours = (-1, N_CHILDREN, 3)
    centre, half = (np.swapaxes(a.reshape(fours), 1, 2).copy() for a in (centre, half))
    return centre, half


class BoundingDiscs(NamedTuple):
    """The disc around the centre of each triangle, in its plane, that contains it."""

    centres: Floats  # (n, 3) [m]
    normals: Floats  # (n, 3), unit; 0 for a sliver, whose disc becomes a ball
    radii: Floats  # (n,) [m]

    @classmethod
    def about(cls, corners: Floats, min_area: float = 1e-6) -> Self:
        """From the corners (n, 3, 3) of triangles.

        `min_area`: over the squared radius; the normals of smaller ones are mostly rounding.
        """
        centres = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0
        offset = corners - centres[:, None]
        square = np.einsum("ijk,ijk->ij", offset, offset).max(axis=1)
        areas, normals = areas_and_normals(corners)
        normals[areas <= min_area * square] = 0.0
        return cls(centres, normals, np.sqrt(square))

    def within(
        self, discs: Indices, points: Floats, reach: Floats, rounding: float = 1e-13
    ) -> Bools:
        """Whether each disc (n,) may be within the reach (n,) of a point (n, 3).

        `rounding`: of the squared distance, relative to that of the centre.
        """
        offset = points - self.centres[discs]
        height = np.einsum("ij,ij->i", offset, self.normals[discs])
        square = np.einsum("ij,ij->i", offset, offset)
        beside = np.sqrt(np.maximum(square - height * height, 0.0)) - self.radii[discs]
        beside = np.maximum(beside, 0.0)
        return np.asarray(height * height + beside * beside <= reach * reach + rounding * square)
