"""The difference of a solid and its convex hull: holes through it, pockets, cavities.

Cells of the hull outside of the solid are joined to pockets, without the thin layers that a noisy
surface leaves. The inside of any closed mesh is solid along columns of cells, at whose crossings
with triangles a counter goes up or down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import signed_volume, solidity
from palpate.core.poses import principal_axes


@dataclass(frozen=True, slots=True, kw_only=True)
class VoidSettings:
    """When a void in the convex hull counts as a pocket."""

    min_pocket: float = 0.004  # fraction of the hull's volume; a smaller void is no pocket
    sure_pocket: float = 0.012  # fraction of the hull's volume; a larger void counts fully
    n_cells: int = 56  # along the longest side of the hull


DEFAULT_VOIDS = VoidSettings()


class Voids(NamedTuple):
    """The difference of a solid and its convex hull."""

    holes: int  # through it: handles of its surface
    share: float  # fraction of the hull's volume that the solid does not fill
    pockets: Floats  # volumes of connected voids, also of holes, the largest first, (n,) [m3]
    certain: float  # number of pockets; each of doubtful size counts less than 1


def find_voids(
    vertices: Floats,
    faces: Ints,
    hull: tuple[Floats, Ints],
    settings: VoidSettings = DEFAULT_VOIDS,
) -> Voids:
    """Holes, and pockets in the convex hull, of a closed mesh.

    `vertices` (n, 3) [m]; `faces` (m, 3), counter-clockwise seen from outside; `hull`: see
    `convex_hull`. Raises ValueError unless the mesh is closed and has a volume.
    """
    solid = solidity(vertices, faces)
    if solid.genus is None or not solid.volume > 0.0:
        raise ValueError("the surface must be closed, and its normals must point outwards")
    full = signed_volume(hull[0][hull[1]] - vertices.mean(axis=0))
    least, sure = settings.min_pocket, settings.sure_pocket
    pockets = _pockets(vertices, faces, hull, settings.n_cells)
    pockets = pockets[pockets > least * full]
    certainty = (pockets / full - least) / (sure - least)
    share = max(1.0 - solid.volume / full, 0.0)
    return Voids(solid.genus, share, pockets, float(np.minimum(certainty, 1.0).sum()))


def convex_hull(vertices: Floats) -> tuple[Floats, Ints]:
    """Vertices (k, 3) and outward triangles of the hull of points (n, 3); ValueError if flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(vertices)
    except (QhullError, ValueError):
        raise ValueError(
            "the surface must enclose a volume, but its points lie in a plane"
        ) from None
    kept, rows = np.unique(hull.simplices, return_inverse=True)
    rows, places = rows.reshape(-1, 3), vertices[kept]
    corners = places[rows]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = np.einsum("mi,mi->m", normals, hull.equations[:, :3]) < 0.0
    return places, np.where(inwards[:, None], rows[:, ::-1], rows).astype(np.int32)


def _pockets(vertices: Floats, faces: Ints, hull: tuple[Floats, Ints], n_cells: int) -> Floats:
    """Volumes of connected parts of the hull outside of the solid, the largest first, (n,) [m3]."""
    from scipy.ndimage import binary_opening, label

    axes = principal_axes(hull[0] - hull[0].mean(axis=0))
    inner, outer = vertices @ axes, hull[0] @ axes
    low = outer.min(axis=0)
    cell = float(np.ptp(outer, axis=0).max()) / n_cells
    low, shape = low - cell, np.ceil(np.ptp(outer, axis=0) / cell).astype(int) + 2
    in_hull = _inner_cells(outer[hull[1]], low, cell, shape)
    empty = in_hull & ~_inner_cells(inner[faces], low, cell, shape)
    labels, count = label(binary_opening(empty))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    return np.asarray(cell**3 * np.sort(sizes)[::-1])


def _inner_cells(corners: Floats, low: Floats, cell: float, shape: Ints) -> Bools:
    """Cells of a grid whose middles lie inside triangles (m, 3, 3) of a closed surface."""
    places = (corners - low) / cell
    aside = np.array([0.5137, 0.4853])  # [cells]: no column meets an edge of a regular mesh
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
    # The first cell whose middle is above; at a triangle that faces down the column enters.
    np.add.at(entered, (column[:, 0], column[:, 1], level), np.where(total < 0.0, 1, -1))
    return np.asarray(np.cumsum(entered, axis=2) > 0)


def _cross(u: Floats, v: Floats) -> Floats:
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
