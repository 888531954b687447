"""Triangle meshes: corners, areas, normals, whether one bounds a solid; meshes between rings."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.core.arrays import Floats, Ints, finite_array

Indices = NDArray[np.intp]


class Solidity(NamedTuple):
    """What kind of surface a mesh is."""

    # True if every edge has exactly two faces, which pass it in opposite directions.
    watertight: bool
    components: int  # Pieces that share no edge
    genus: int | None  # Handles of all pieces together; None unless the mesh is watertight
    # Signed volume, m3: positive if the normals point outwards. It depends on the origin unless the
    # mesh is watertight.
    volume: float


def solidity(vertices: ArrayLike, faces: ArrayLike) -> Solidity:
    """Examine a mesh.

    `vertices` (n, 3): m. Vertices that no face names are ignored. `faces` (m, 3): rows of
    `vertices`. Raises ValueError if a vertex is not finite, or a face names a vertex that is not
    there.

    The genus is that of Euler's formula, V - E + F = 2 (components - genus). A vertex at which
    two fans of faces touch counts once for each, so that two solids that touch in a point
    remain two spheres.
    """
    corners = triangle_corners(vertices, faces)
    count = len(np.asarray(vertices))
    rows = checked_faces(faces, count)
    first, second = _opposite_edges(rows, count)
    watertight = first is not None and second is not None
    volume = signed_volume(corners - corners.mean(axis=(0, 1)))
    if first is None or second is None:
        return Solidity(False, _components(rows, count), None, volume)
    components = _count_groups(len(rows), first // 3, second // 3)
    # Corner 3 f + i starts edge i of face f; its opposite edge ends at the same vertex.
    fans = _count_groups(rows.size, first, _next_corner(second))
    euler = fans - rows.size // 2 + len(rows)
    return Solidity(watertight, components, components - euler // 2, volume)


def _opposite_edges(rows: Indices, count: int) -> tuple[Indices | None, Indices | None]:
    """Directed edges, numbered 3 f + i, and the opposite of each; None if one has none."""
    start, end = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    forward, backward = start * count + end, end * count + start
    order, reverse = np.argsort(forward), np.argsort(backward)
    keys = forward[order]
    paired = np.array_equal(keys, backward[reverse]) and bool((np.diff(keys) > 0).all())
    if not paired or bool((start == end).any()):
        return None, None
    return order, reverse


def _components(rows: Indices, count: int) -> int:
    """Groups of faces that share edges, however they pass them."""
    start, end = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    key = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(np.diff(key[order]) == 0)
    return _count_groups(len(rows), order[same] // 3, order[same + 1] // 3)


def _count_groups(count: int, one: Indices, other: Indices) -> int:
    """Connected groups among `count` things, given linked pairs.

    Each thing takes the lowest label among its neighbours' groups, and labels are followed to
    their end, until nothing changes: a few rounds, whatever the shape of the groups.
    """
    label = np.arange(count)
    while True:
        low = np.minimum(label[one], label[other])
        before = label.copy()
        np.minimum.at(label, before[one], low)
        np.minimum.at(label, before[other], low)
        while not np.array_equal(label, label[label]):
            label = label[label]
        if np.array_equal(label, before):
            return int(np.count_nonzero(label == np.arange(count)))


def _next_corner(edges: Indices) -> Indices:
    """The corner at which each directed edge ends."""
    return edges - edges % 3 + (edges + 1) % 3


def signed_volume(corners: Floats) -> float:
    """Sum of the signed tetrahedra of triangles (m, 3, 3) over the origin, m3."""
    a, b, c = corners.transpose(1, 0, 2)
    return float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0


def is_closed(faces: Ints) -> bool:
    """Whether each edge is walked once each way: no holes, and all faces turned alike.

    `faces` (m, 3): corners, by number. Corners that only lie in the same place are not the same.
    """
    begin = faces.ravel().astype(np.int64)
    end = faces[:, [1, 2, 0]].ravel().astype(np.int64)
    count = int(faces.max(initial=-1)) + 1
    there, back = np.sort(begin * count + end), np.sort(end * count + begin)
    return len(there) > 0 and bool((np.diff(there) > 0).all()) and np.array_equal(there, back)


def is_inside_out(vertices: Floats, faces: Ints) -> bool:
    """Whether the faces, seen from the mesh's middle, look inwards more than outwards.

    `vertices` (n, 3), m. `faces` (m, 3): corners, by number.
    """
    return signed_volume((vertices - vertices.mean(axis=0))[faces]) < 0.0


def triangle_corners(vertices: ArrayLike, faces: ArrayLike) -> Floats:
    """Corners of each face.

    `vertices` (n, 3), m. `faces` (m, 3): rows of `vertices`. Returns (m, 3, 3), face, corner,
    coordinate. Raises ValueError if a vertex is not finite, there is no face, or a face names a
    vertex that is not there.
    """
    places = finite_array("vertices", vertices, (None, 3))
    return places[checked_faces(faces, len(places))]


def checked_faces(
    faces: ArrayLike, vertices: int
) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Faces (m, 3), all of whose corners are among this many vertices.

    Raises ValueError if there is no face, or a face names a vertex that is not there.
    """
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


def close_rings(bottom: Floats, rings: Floats, top: Floats) -> tuple[Floats, Ints]:
    """Watertight mesh of genus 0 from two poles and the rings between them.

    `bottom` and `top` (3,): the poles, m. `rings` (m, n, 3): from the bottom to the top; each
    counter-clockwise seen from above. Returns `vertices` (m n + 2, 3): m. `faces` (2 m n, 3):
    counter-clockwise seen from outside.
    """
    count, size = rings.shape[:2]
    vertices = np.concatenate([bottom[None], rings.reshape(-1, 3), top[None]])
    here = 1 + np.arange(size)
    following = 1 + (np.arange(size) + 1) % size
    lower = (size * np.arange(count - 1))[:, None]
    a, b = lower + here, lower + following
    c, d = a + size, b + size
    side = np.stack([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)], axis=2)
    last = size * (count - 1)
    below = np.column_stack([np.zeros(size, int), following, here])
    above = np.column_stack([np.full(size, len(vertices) - 1), last + here, last + following])
    faces = np.concatenate([below, side.reshape(-1, 3), above])
    return vertices, faces.astype(np.int32)


def join_rings(sizes: Ints) -> Ints:
    """Faces of a closed surface from two poles and the rings between them.

    `sizes` (m,): points of each ring, from the bottom to the top. They begin at the same turn and
    run counter-clockwise seen from above; neighbours have as many, half or twice as many. Returns
    (f, 3), counter-clockwise seen from outside. Vertex 0 is the lower pole, then come the rings in
    order, then the upper pole. Raises ValueError if there is no ring, one has fewer than 3 points,
    or neighbours have other sizes.
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
    """Faces between the ring that begins at `low` and the one over it."""
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
    """Three faces to each point of the coarse ring, which lies over the fine one."""
    first, middle = _ring(fine, 2 * count)
    a, b, c = first[::2], middle[::2], middle[1::2]
    d, e = _ring(coarse, count)
    return [np.column_stack([a, b, d]), np.column_stack([b, e, d]), np.column_stack([b, c, e])]


def _ring(first: int, size: int) -> tuple[Ints, Ints]:
    """Numbers of a ring's points, and of those that follow them."""
    here = np.arange(size, dtype=np.int32)
    return first + here, first + (here + 1) % size
