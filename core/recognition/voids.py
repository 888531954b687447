"""What a solid lacks of its convex hull: holes through it, pockets, cavities.

The hull's cells that the solid has not are joined to pockets; layers as thin as a noisy surface
leaves are none. Cells are counted along columns: a triangle that a column passes upwards or
downwards is entered once, so that any closed mesh has an inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import signed_volume, solidity
from palpate.core.poses import principal_axes

# Of the hull's volume: a smaller pocket is none, a larger one surely is.
LEAST_POCKET, SURE_POCKET = 0.004, 0.012


class Voids(NamedTuple):
    """What a solid lacks of its convex hull."""

    holes: int  # Handles: holes through it
    share: float  # Of the hull's volume that the solid does not fill
    pockets: Floats  # Volumes of connected voids, holes among them, the largest first, (n,), m3
    certain: float  # Number of pockets, those of doubtful size as less than one


def find_voids(vertices: Floats, faces: Ints, hull: tuple[Floats, Ints]) -> Voids:
    """Holes, and pockets in the convex hull, of a closed mesh.

    `vertices` (n, 3), m; `faces` (m, 3), counter-clockwise seen from outside; `hull`: see
    `convex_hull`. Raises ValueError unless the mesh is closed and has a volume.
    """
    found = solidity(vertices, faces)
    if found.genus is None or not found.volume > 0.0:
        raise ValueError("the surface must be closed, and its normals must point outwards")
    full = signed_volume(hull[0][hull[1]] - vertices.mean(axis=0))
    pockets = _pockets(vertices, faces, hull)
    pockets = pockets[pockets > LEAST_POCKET * full]
    sure = (pockets / full - LEAST_POCKET) / (SURE_POCKET - LEAST_POCKET)
    lacking = max(1.0 - found.volume / full, 0.0)
    return Voids(found.genus, lacking, pockets, float(np.minimum(sure, 1.0).sum()))


def convex_hull(vertices: Floats) -> tuple[Floats, Ints]:
    """Vertices (k, 3) and outward triangles of the hull of points (n, 3); ValueError if flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError):
        why = "the surface must enclose a volume, but its points lie in a plane"
        raise ValueError(why) from None
    kept, rows = np.unique(hull.simplices, return_inverse=True)
    rows, places = rows.reshape(-1, 3), vertices[kept]
    corners = places[rows]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("mi,mi->m", normals, hull.equations[:, :3]) < 0.0
    return places, np.where(inwards[:, None], rows[:, ::-1], rows).astype(np.int32)


def _pockets(vertices: Floats, faces: Ints, hull: tuple[Floats, Ints]) -> Floats:
    """Volumes of connected parts of the hull that the solid lacks, the largest first, (n,), m3."""
    from scipy.ndimage import binary_opening, label

    axes = principal_axes(hull[0] - hull[0].mean(axis=0))
    inner, outer = vertices @ axes, hull[0] @ axes
    low = outer.min(axis=0)
    cell = float(np.ptp(outer, axis=0).max()) / 56  # Cells along the longest side
    low, shape = low - cell, np.ceil(np.ptp(outer, axis=0) / cell).astype(int) + 2
    empty = _filled(outer[hull[1]], low, cell, shape) & ~_filled(inner[faces], low, cell, shape)
    labels, count = label(binary_opening(empty))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    return np.asarray(cell**3 * np.sort(sizes)[::-1])


def _filled(corners: Floats, low: Floats, cell: float, shape: Ints) -> Bools:
    """Cells of a grid whose middles lie inside triangles (m, 3, 3) of a closed surface."""
    places = (corners - low) / cell
    aside = np.array([0.5137, 0.4853])  # Of a cell: no column meets an edge of a regular mesh
    first = np.ceil(places[:, :, :2].min(axis=1) - aside).astype(int)
    counts = np.floor(places[:, :, :2].max(axis=1) - aside).astype(int) - first + 1
    many = counts.prod(axis=1)
    face = np.repeat(np.arange(len(many)), many)
    at = np.arange(len(face)) - np.repeat(np.cumsum(many) - many, many)
    column = first[face] + np.stack([at // counts[face, 1], at % counts[face, 1]], axis=1)
    a, b, c = (places[face, i] - [*aside, 0.0] - np.pad(column, ((0, 0), (0, 1))) for i in range(3))
    weights = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    hit = (weights > 0.0).all(axis=1) | (weights < 0.0).all(axis=1)
    weights, column = weights[hit], column[hit]
    depth = np.stack([a[:, 2], b[:, 2], c[:, 2]], axis=1)[hit]
    total = weights.sum(axis=1)
    height = (weights * depth).sum(axis=1) / total
    level = np.clip(np.ceil(height - 0.5).astype(int), 0, shape[2] - 1)
    entered = np.zeros(shape, int)
    # The first cell whose middle is above: a triangle that faces down lets the column in.
    np.add.at(entered, (column[:, 0], column[:, 1], level), np.where(total < 0.0, 1, -1))
    return np.asarray(np.cumsum(entered, axis=2) > 0)


def _cross(one: Floats, other: Floats) -> Floats:
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
