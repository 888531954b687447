"""Tessellations: nearly even meshes of the sphere, and closed meshes of any implicit solid.

Marching tetrahedra: a grid's cells are each cut into six tetrahedra around a common diagonal (Kuhn,
1960), so that neighbouring cells agree on their common face. A tetrahedron has no ambiguous case:
the surface has no hole, and each of its edges has two faces. Vertices are roots of the function on
the tetrahedra's edges. Not scikit-image's marching cubes, which interpolates them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.shapes.protocol import Mesh

MAX_LEVEL = 8  # of an icosphere, with 1.3 million faces
Longs = NDArray[np.int64]
InsideOut = Callable[[Floats, Floats], tuple[Floats, Floats]]  # as `ImplicitShape.inside_out`
# Places (n,), one for each function, to values and slopes (n,).
EdgeFunction = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, slots=True, kw_only=True)
class IsosurfaceSettings:
    """Grid of an isosurface, and the precision of its vertices."""

    min_cells: int = 16  # along the longest side
    # Fractions by which the box grows below and above: no plane of symmetry is one of the grid.
    margins: tuple[float, float] = (0.0231, 0.0257)
    root_tolerance: float = 1e-12  # fraction of a cell's edge


@cache
def icosphere(level: int) -> tuple[Floats, Ints]:
    """Icosahedron, its faces split in four `level` times, on the unit sphere; read-only.

    Returns `directions` (10 * 4**level + 2, 3): unit vectors; `faces` (20 * 4**level, 3):
    counter-clockwise from outside. Raises ValueError if `level` is not between 0 and 8.
    """
    if not 0 <= level <= MAX_LEVEL:
        raise ValueError(f"level must be between 0 and {MAX_LEVEL}, got {level}")
    directions, faces = _split(*icosphere(level - 1)) if level else _icosahedron()
    directions.setflags(write=False)
    faces.setflags(write=False)
    return directions, faces


def _icosahedron() -> tuple[Floats, Ints]:
    latitude = math.atan(0.5)
    azimuth = np.arange(5) * (2 * math.pi / 5)
    ring = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * math.cos(latitude)
    turned = azimuth + math.pi / 5
    lower = np.column_stack([np.cos(turned), np.sin(turned)]) * math.cos(latitude)
    height = np.full((5, 1), math.sin(latitude))
    directions = np.concatenate(
        [[[0, 0, 1]], np.hstack([ring, height]), np.hstack([lower, -height]), [[0, 0, -1]]]
    )
    i = np.arange(5)
    after = (i + 1) % 5
    up, low = 1 + i, 6 + i
    up_after, low_after = 1 + after, 6 + after
    faces = np.concatenate(
        [
            np.column_stack([np.zeros(5, int), up, up_after]),
            np.column_stack([up, low, up_after]),
            np.column_stack([low, low_after, up_after]),
            np.column_stack([low, np.full(5, 11), low_after]),
        ]
    )
    return directions, faces.astype(np.int32)


def _split(directions: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Each face split into four; the midpoint of an edge is shared by its two faces."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    # One number for each pair: sorting pairs takes several times as long.
    numbers = edges[:, 0].astype(np.int64) * len(directions) + edges[:, 1]
    unique, which = np.unique(numbers, return_inverse=True)
    first, last = np.divmod(unique, len(directions))
    middle = directions[first] + directions[last]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (which.reshape(-1, 3) + len(directions)).T
    a, b, c = faces.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    split = np.stack([np.column_stack(corner) for corner in corners], axis=1)
    return np.concatenate([directions, middle]), split.reshape(-1, 3).astype(np.int32)


def isosurface(
    inside_out: InsideOut,
    box: Floats,
    level: int,
    settings: IsosurfaceSettings = IsosurfaceSettings(),
) -> Mesh:
    """The surface on which a function is 0, negative inside.

    `box` (2, 3): contains the solid [m]; it is cut into 2^level cells along its longest side, at
    least 16. The mesh is closed and outward; parts thinner than a cell may be missing.
    """
    cells, widening = max(2**level, settings.min_cells), 1.0 + sum(settings.margins)
    extent = box[1] - box[0]
    low = box[0] - settings.margins[0] * extent
    edge = float(extent.max()) * widening / cells
    shape = np.ceil(extent * widening / edge - 1e-9).astype(int) + 1
    axes = [low[axis] + edge * np.arange(shape[axis]) for axis in range(3)]
    lines, faces = _cut(*_crossed(_inside(inside_out, axes)))
    ends = np.column_stack(np.unravel_index(lines.ravel(), shape)).reshape(-1, 2, 3)
    first, last = low + edge * ends[:, 0], low + edge * ends[:, 1]  # inside, outside
    edges, count = first - last, len(first)

    def along(share: Floats) -> tuple[Floats, Floats]:
        return inside_out(last + share[:, None] * edges, edges)

    share = bracketed_roots(along, np.zeros(count), np.ones(count), settings.root_tolerance)
    return Mesh(last + share[:, None] * edges, faces)


def grid_surface(values: Floats, *, level_bottom: bool = False) -> Mesh:
    """The surface on which values (a, b, c) on an even grid are 0, negative inside.

    Vertices are in steps of the grid, interpolated. It is closed if no border node is inside; with
    `level_bottom` nodes of the lowest layer may be: it is closed along that layer, exactly.
    """
    if level_bottom:
        values = np.concatenate([np.full_like(values[..., :1], np.inf), values], axis=2)
    lines, faces = _cut(*_crossed(values < 0.0))
    flat = values.ravel()[lines]
    with np.errstate(invalid="ignore"):
        share = flat[:, 0] / (flat[:, 0] - flat[:, 1])  # 0 before an infinite one
    first, last = (np.column_stack(np.unravel_index(nodes, values.shape)) for nodes in lines.T)
    vertices = first + share[:, None] * (last - first)
    if not level_bottom:
        return Mesh(vertices, faces)
    vertices[:, 2] -= 1.0
    # All edges down from a node of the lowest layer end in the same vertex.
    own = np.where(np.isinf(flat[:, 1]), lines[:, 0], -1 - np.arange(len(lines)))
    _, first_of, merged = np.unique(own, return_index=True, return_inverse=True)
    joined = merged[faces].astype(np.int32)
    whole = (joined != np.roll(joined, 1, axis=1)).all(axis=1)
    return Mesh(vertices[first_of], joined[whole])


def _crossed(inside: Bools) -> tuple[Longs, Bools]:
    """Tetrahedra that the surface may cross: nodes (n, 4), and which of these are inside."""
    counts = np.array(inside.shape)
    corners = [inside[tuple(slice(o, n - 1 + o) for o, n in zip(offset, counts, strict=True))]
               for offset in itertools.product((0, 1), repeat=3)]  # fmt: skip
    some_inside, all_inside = np.logical_or.reduce(corners), np.logical_and.reduce(corners)
    cells = np.column_stack(np.nonzero(some_inside & ~all_inside))
    strides = np.array([counts[1] * counts[2], counts[2], 1])
    tetrahedra: Longs = ((cells @ strides)[:, None, None] + _kuhn() @ strides).reshape(-1, 4)
    return tetrahedra, inside.ravel()[tetrahedra]


def _kuhn() -> Ints:
    """Corners (6, 4, 3) of the six tetrahedra of a unit cube, with equal orientation."""
    tetrahedra = []
    for order in itertools.permutations(range(3)):
        corners = np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        odd = np.linalg.det(corners[1:].astype(float)) < 0.0
        tetrahedra.append(corners[[0, 2, 1, 3]] if odd else corners)
    return np.array(tetrahedra)


def _inside(inside_out: InsideOut, axes: list[Floats]) -> Bools:
    y, z = np.meshgrid(axes[1], axes[2], indexing="ij")
    layer = np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()])
    still = np.zeros_like(layer)
    inside = np.zeros((len(axes[0]), *y.shape), bool)
    for i, x in enumerate(axes[0]):
        layer[:, 0] = x
        inside[i] = (inside_out(layer, still)[0] <= 0.0).reshape(y.shape)
    return inside


def _cut(tetrahedra: Longs, inside: Bools) -> tuple[Longs, Ints]:
    """Edges (m, 2) that the surface crosses, the inner node first, and triangles between them."""
    pattern = inside @ np.array([1, 2, 4, 8])
    pieces = []
    for mask in range(1, 15):
        nodes = tetrahedra[pattern == mask]
        pieces += [nodes[:, triangle] for triangle in _triangles(mask)]
    ends = np.concatenate(pieces).reshape(-1, 2)  # three edges for each triangle
    count = int(tetrahedra.max(initial=0)) + 1
    keys, corners = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    return np.column_stack([keys // count, keys % count]), corners.reshape(-1, 3).astype(np.int32)


def _triangles(mask: int) -> list[Ints]:
    """Edges (3, 2) of each triangle that cuts off the corners in `mask`, seen from outside."""
    own = [corner for corner in range(4) if mask >> corner & 1]
    other = [corner for corner in range(4) if not mask >> corner & 1]
    if sum(a > b for a, b in itertools.combinations([*own, *other], 2)) % 2:  # an odd order
        pair = own if len(own) > 1 else other
        pair[:2] = pair[1::-1]
    if len(own) == 2:
        (i, j), (k, m) = own, other
        rings = [[(i, k), (i, m), (j, m)], [(i, k), (j, m), (j, k)]]
    else:
        rings = [[(i, o) for i in own for o in other]]
    return [np.array(ring) for ring in rings]


def bracketed_roots(
    function: EdgeFunction,
    outside: Floats,
    inside: Floats,
    tolerance: float,
    *,
    max_steps: int = 100,
    newton_steps: int = 12,
) -> Floats:
    """A root (n,) of each function between a place where it is positive and one where it is not.

    After `newton_steps` intervals are halved: a kink or a flat part prevents convergence.
    """
    outside, inside = outside.copy(), inside.copy()
    places = 0.5 * (outside + inside)
    for step in range(max_steps):
        value, slope = function(places)
        positive = value > 0.0
        outside, inside = np.where(positive, places, outside), np.where(positive, inside, places)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            newton = places - value / slope
        is_bracketed = (newton - outside) * (newton - inside) <= 0.0
        if step >= newton_steps:
            is_bracketed = np.zeros_like(is_bracketed)
        after = np.where(is_bracketed, newton, 0.5 * (outside + inside))
        near = np.abs(after - places) <= tolerance
        places = np.where(is_bracketed | ~near, after, inside)
        if near.all():
            break
    return places
