"""Triangle meshes: areas, normals of faces and corners, topology and solidity, meshes from rings.

A corner's normal is smooth across blunt edges only. Faces at a vertex are weighted by their angles
there, because only these weights give the side of any mesh (Bærentzen and Aanæs, 2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Bools, Floats, Ints, finite_array

if TYPE_CHECKING:
    from palpate.core.geometry.nearest import Nearest

Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSettings:
    """Distinction of a solid's edges from those of a smooth surface's mesh."""

    sharp_angle: float = math.radians(30.0)  # [rad] between faces at an edge of the solid


DEFAULT_MESH = MeshSettings()


class Solidity(NamedTuple):
    """Topology and volume of a mesh."""

    watertight: bool  # each edge has exactly two faces, which pass it in opposite directions
    components: int  # pieces that share no edge
    genus: int | None  # number of handles of all pieces; None unless the mesh is watertight
    volume: float  # [m3] signed, positive with outward normals; about the mean if not watertight


def solidity(vertices: ArrayLike, faces: ArrayLike) -> Solidity:
    """Topology and volume of a mesh.

    `vertices` (n, 3) [m]; `faces` (m, 3): indices of vertices. Raises ValueError as
    `triangle_corners`. The genus is that of Euler's formula, V - E + F = 2 (components - genus). A
    vertex at which two fans of faces touch counts once for each: two balls that touch in a point
    remain two spheres.
    """
    corners = triangle_corners(vertices, faces)
    count = len(np.asarray(vertices))
    rows = checked_faces(faces, count)
    edges = _opposite_edges(rows, count)
    volume = signed_volume(corners - corners.mean(axis=(0, 1)))
    if edges is None:
        return Solidity(False, _components(rows, count), None, volume)
    first, second = edges
    components = _count_groups(len(rows), first // 3, second // 3)
    # Corner 3 f + i starts edge i of face f; its opposite edge ends at the same vertex.
    fans = _count_groups(rows.size, first, second - second % 3 + (second + 1) % 3)
    euler = fans - rows.size // 2 + len(rows)
    return Solidity(True, components, components - euler // 2, volume)


def _opposite_edges(rows: Indices, count: int) -> tuple[Indices, Indices] | None:
    """Directed edges, numbered 3 f + i, and the opposite of each; None if one is missing."""
    start, end = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    forward, backward = start * count + end, end * count + start
    order, reverse = np.argsort(forward), np.argsort(backward)
    keys = forward[order]
    paired = np.array_equal(keys, backward[reverse]) and bool((np.diff(keys) > 0).all())
    if not paired or bool((start == end).any()):
        return None
    return order, reverse


def _components(rows: Indices, count: int) -> int:
    start, end = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(np.diff(key[order]) == 0)
    return _count_groups(len(rows), order[same] // 3, order[same + 1] // 3)


def _count_groups(count: int, first: Indices, second: Indices) -> int:
    return int(linked_groups(count, first, second).max()) + 1


def linked_groups(count: int, first: NDArray[np.integer], second: NDArray[np.integer]) -> Ints:
    """Connected group (count,), numbered from 0, of each of `count` items, from linked pairs."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(first), bool), (first, second)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])


def signed_volume(corners: Floats) -> float:
    """Sum [m3] of the signed tetrahedra of triangles (m, 3, 3) over the origin."""
    a, b, c = corners.transpose(1, 0, 2)
    return float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0


def is_closed(faces: Ints) -> bool:
    """Whether each edge has one face in each direction: no holes, and consistent orientation.

    `faces` (m, 3): indices of vertices. Vertices in the same place with other indices differ.
    """
    rows = faces.astype(np.intp)
    return len(rows) > 0 and _opposite_edges(rows, int(rows.max()) + 1) is not None


def has_paired_edges(faces: Ints) -> bool:
    """Whether each edge of faces (m, 3) belongs to exactly two of them, of any orientation."""
    return len(faces) > 0 and bool((face_edges(faces).counts == 2).all())


class FaceEdges(NamedTuple):
    """The edges of a mesh, each once."""

    ends: Ints  # (e, 2), the lower vertex first, sorted
    numbers: Ints  # (m, 3): edge after each corner of each face
    counts: Ints  # (e,): number of its faces


def face_edges(faces: Ints) -> FaceEdges:
    """The edges of faces (m, 3) of any orientation."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    # One number for each pair: rows of two are sorted ten times slower.
    pairs = ends[:, 0].astype(np.int64) * (int(faces.max(initial=0)) + 1) + ends[:, 1]
    _, first, inverse, counts = np.unique(
        pairs, return_index=True, return_inverse=True, return_counts=True
    )
    numbers: Ints = inverse.reshape(-1, 3).astype(np.int32)
    return FaceEdges(ends[first], numbers, counts.astype(np.int32))


def is_inside_out(vertices: Floats, faces: Ints) -> bool:
    """Whether the normals of faces (m, 3) of vertices (n, 3) [m] point inwards, about the mean."""
    return signed_volume((vertices - vertices.mean(axis=0))[faces]) < 0.0


def triangle_corners(vertices: ArrayLike, faces: ArrayLike) -> Floats:
    """Corners (m, 3, 3) of each face: face, corner, coordinate.

    `vertices` (n, 3) [m]. `faces` (m, 3): indices of vertices. Raises ValueError if a vertex is not
    finite, or as `checked_faces`.
    """
    places = finite_array("vertices", vertices, (None, 3))
    return places[checked_faces(faces, len(places))]


def checked_faces(faces: ArrayLike, vertices: int) -> Indices:
    """Faces (m, 3) as indices of vertices; ValueError if there is none, or one is out of range."""
    rows = np.asarray(faces)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows) or rows.dtype.kind not in "iu":
        raise ValueError(
            f"faces must be integers of shape (any, 3) with at least one row, "
            f"got {rows.dtype} of shape {rows.shape}"
        )
    low, high = int(rows.min()), int(rows.max())
    if low < 0 or high >= vertices:
        raise ValueError(
            f"faces must name vertices from 0 to {vertices - 1}, got {low if low < 0 else high}"
        )
    return rows.astype(np.intp)


def areas_and_normals(corners: Floats) -> tuple[Floats, Floats]:
    """Areas (m,) and unit normals (m, 3) of triangles; a triangle without area has normal 0."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.sqrt(np.einsum("ij,ij->i", cross, cross))
    return 0.5 * length, cross / np.where(length > 0.0, length, 1.0)[:, None]


def axes_across(directions: Floats) -> Floats:
    """Two unit vectors (..., 2, 3) perpendicular to unit vectors (..., 3) and to each other."""
    first = np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=-1)])
    first /= np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), np.finfo(float).tiny)
    return np.stack([first, np.cross(directions, first)], axis=-2)


def close_rings(bottom: Floats, rings: Floats, top: Floats) -> tuple[Floats, Ints]:
    """Watertight mesh of genus 0 from two poles and the rings between them.

    `bottom` and `top` (3,): the poles [m]. `rings` (m, n, 3): upwards, each counter-clockwise seen
    from above. Returns vertices (m n + 2, 3) [m] and faces (2 m n, 3), as `join_rings`.
    """
    count, size = rings.shape[:2]
    vertices = np.concatenate([bottom[None], rings.reshape(-1, 3), top[None]])
    return vertices, join_rings(np.full(count, size))


def join_rings(sizes: Ints) -> Ints:
    """Faces of a closed surface from two poles and the rings between them.

    `sizes` (m,): points of each ring, upwards; rings begin at the same azimuth and run
    counter-clockwise seen from above; ValueError is raised unless neighbours have as many, half or
    twice as many. Returns (f, 3), counter-clockwise seen from outside; vertex 0 is the lower pole,
    followed by the rings and the upper pole.
    """
    counts = [int(size) for size in sizes]
    if min(counts, default=0) < 3:
        raise ValueError(f"sizes must be at least one ring of 3 points, got {counts}")
    firsts = [1, *(1 + np.cumsum(counts)).tolist()]
    here, following = _ring(firsts[0], counts[0])
    strips = [np.column_stack([np.zeros_like(here), following, here])]
    for ring in range(len(counts) - 1):
        strips.append(_strip(firsts[ring], counts[ring], firsts[ring + 1], counts[ring + 1]))
    here, following = _ring(firsts[-2], counts[-1])
    strips.append(np.column_stack([np.full_like(here, firsts[-1]), here, following]))
    return np.concatenate(strips).astype(np.int32)


def _strip(low: int, below: int, high: int, above: int) -> Ints:
    if below == above:
        (a, b), (d, c) = _ring(low, below), _ring(high, above)
        halves = [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    elif below == 2 * above:
        halves = _halved(low, high, above)
    elif above == 2 * below:
        halves = [strip[:, ::-1] for strip in _halved(high, low, below)]
    else:
        raise ValueError(
            f"sizes of neighbours must be equal, half or twice, got {below} and {above}"
        )
    return np.stack(halves, axis=1).reshape(-1, 3)


def _halved(fine: int, coarse: int, count: int) -> list[Ints]:
    first, middle = _ring(fine, 2 * count)
    a, b, c = first[::2], middle[::2], middle[1::2]
    d, e = _ring(coarse, count)
    return [np.column_stack([a, b, d]), np.column_stack([b, e, d]), np.column_stack([b, c, e])]


def _ring(first: int, size: int) -> tuple[Ints, Ints]:
    here = np.arange(size, dtype=np.int32)
    return first + here, first + (here + 1) % size


def are_outside(
    vertices: Floats, faces: Ints, points: Floats, nearest: Nearest, on_edge: float = 1e-9
) -> Bools:
    """Whether points (n, 3) lie outside a closed mesh, or on it.

    By the normal at the nearest point: that of the face, the sum of two along an edge, and the sum
    over all faces at a vertex, weighted by angle. `on_edge`: barycentric coordinate below which the
    nearest point is on the opposite edge. Bærentzen and Aanæs, *Signed distance computation using
    the angle weighted pseudonormal*, 2005.
    """
    corners = vertices[faces]
    normals = areas_and_normals(corners)[1]
    shares = _barycentric(corners[nearest.faces], normals[nearest.faces], nearest.points)
    on = shares > on_edge
    count = on.sum(axis=1)
    across = normals[nearest.faces]
    at_vertex, at_edge = np.flatnonzero(count <= 1), np.flatnonzero(count == 2)
    if len(at_vertex):
        sums = corner_normals(vertices, faces, math.inf)
        across[at_vertex] = sums[nearest.faces[at_vertex], shares[at_vertex].argmax(axis=1)]
    if len(at_edge):
        begin = (np.argmin(on[at_edge], axis=1) + 1) % 3  # the edge opposite the missing corner
        across[at_edge] += normals[face_neighbours(faces)[nearest.faces[at_edge], begin]]
    return np.asarray(np.einsum("ni,ni->n", points - nearest.points, across) >= 0.0)


def normals_at(corners: Floats, of_corners: Floats, nearest: Nearest) -> Floats:
    """Unit normals (n, 3) at points of a mesh, interpolated between the corners of their faces.

    `corners`, `of_corners` (m, 3, 3): places [m], and unit normals as of `corner_normals`.
    """
    near = corners[nearest.faces]
    shares = _barycentric(near, areas_and_normals(near)[1], nearest.points)
    shares = np.clip(shares, 0.0, 1.0)
    has_area = shares.sum(axis=1, keepdims=True) > 0.0
    shares = np.where(has_area, shares, 1.0)
    sums = np.einsum("nj,njk->nk", shares, of_corners[nearest.faces])
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(sums / np.where(length > 0.0, length, 1.0))


def _barycentric(corners: Floats, normals: Floats, points: Floats) -> Floats:
    following = np.roll(corners, -1, axis=1) - points[:, None]
    beyond = np.roll(corners, -2, axis=1) - points[:, None]
    areas = np.einsum("ijk,ik->ij", np.cross(following, beyond), normals)
    total = areas.sum(axis=1, keepdims=True)
    return np.asarray(areas / np.where(total > 0.0, total, 1.0))


def facet_sag(vertices: Floats, faces: Ints) -> float:
    """Mean distance [m] between a mesh and the smooth surface with its corners' normals.

    A linear triangle misses a curved one by half the sum over its edges e of l_i l_j II(e, e), with
    the barycentric coordinates l of the edge's ends; their product is 1/12 on average. The turn of
    the normal along an edge gives II(e, e).
    """
    corners = vertices[faces]
    normals = corner_normals(vertices, faces)
    edges = np.roll(corners, -1, axis=1) - corners
    turned = np.roll(normals, -1, axis=1) - normals
    sag = np.abs(np.einsum("mij,mij->m", turned, edges)) / 24.0
    areas = areas_and_normals(corners)[0]
    total = float(areas.sum())
    return float(areas @ sag) / total if total > 0.0 else 0.0


def corner_normals(
    vertices: Floats, faces: Ints, sharp_angle: float = DEFAULT_MESH.sharp_angle
) -> Floats:
    """Unit normals (m, 3, 3) at corners of faces, not averaged across sharp edges.

    `sharp_angle`: between the faces at a sharp edge, at least [rad].
    """
    corners = vertices[faces]
    normals = areas_and_normals(corners)[1]
    over = face_neighbours(faces)
    blunt = np.einsum("mi,mji->mj", normals, normals[over]) > math.cos(min(sharp_angle, math.pi))
    face, edge = np.nonzero(blunt & (over != np.arange(len(faces))[:, None]))
    other = over[face, edge]
    links = []
    for corner in (edge, (edge + 1) % 3):
        there = (faces[other] == faces[face, corner][:, None]).argmax(axis=1)
        links.append((3 * face + corner, 3 * other + there))
    first, second = (np.concatenate(part) for part in zip(*links, strict=True))
    group = linked_groups(faces.size, first, second)
    weighted = (corner_angles(corners)[:, :, None] * normals[:, None]).reshape(-1, 3)
    sums = np.stack([np.bincount(group, column) for column in weighted.T], axis=-1)
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    units = sums / np.where(length > 0.0, length, 1.0)
    return units[group].reshape(-1, 3, 3)


def face_neighbours(faces: Ints) -> Ints:
    """Neighbour across the edge that begins at each corner, (m, 3); the face itself without one."""
    begin = faces.astype(np.int64)
    end = np.roll(begin, -1, axis=1)
    count = int(begin.max()) + 1
    keys, opposite = (begin * count + end).ravel(), (end * count + begin).ravel()
    order = np.argsort(keys, kind="stable")
    match = order[np.minimum(np.searchsorted(keys[order], opposite), len(keys) - 1)]
    over = np.where(keys[match] == opposite, match, np.arange(len(keys))) // 3
    return over.reshape(faces.shape).astype(np.int32)


def corner_angles(corners: Floats) -> Floats:
    """Angles (m, 3) [rad] of triangles (m, 3, 3) at their corners."""
    ahead, back = (np.roll(corners, -step, axis=1) - corners for step in (1, 2))
    sine = np.linalg.norm(np.cross(ahead, back), axis=2)
    return np.asarray(np.arctan2(sine, np.einsum("ijk,ijk->ij", ahead, back)))
