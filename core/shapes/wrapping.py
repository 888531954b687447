"""The outer surface of any triangles, as seen by rays from far away, as one closed mesh.

Meshes that bound no solid still have an outside. Parallel rays from all directions meet it first,
whatever the orientation of its faces; where both sides of a face are seen, through a hole, the
majority of rays decides which is outside. The normals at the hits are the gradient of a function
that is 1 inside and 0 outside, which is the solution of Poisson's equation on an even grid
(Kazhdan, Bolitho and Hoppe, *Poisson surface reconstruction*, 2006); holes and hidden parts are
closed smoothly. The surface at the level of the hits is moved onto the triangles where they are
near.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.geometry import (
    areas_and_normals,
    axes_across,
    nearest_points,
    nearest_search,
    self_intersection,
)
from palpate.core.shapes.mending import arrays_of, as_manifold
from palpate.core.shapes.tessellations import grid_surface
from palpate.core.shapes.triangle_meshes import HAS_EMBREE, Embree, ZBuffer


@dataclass(frozen=True, slots=True)
class WrapSettings:
    """Resolution of the outer surface; a scan takes some 3 s with 80 voxels."""

    n_voxels: int = 80  # along the largest extent
    margin: int = 10  # voxels around the mesh, in which the function may fall off
    n_directions: int = 32  # of the rays, evenly around
    smoothing: float = 1.0  # [voxels] standard deviation of the Gaussian over the hits
    max_projection: float = 1.5  # [voxels] vertices farther from all triangles are not moved
    near_hit: float = 2.5  # [voxels] surface farther than this from all hits closes a hole
    min_part: float = 0.02  # of the largest part's volume; smaller parts are not counted
    max_closed_share: float = 0.25  # of the surface, that may close holes; more is refused
    max_retreats: int = 5  # rounds in which vertices of faces that cross are moved back
    n_offsets: int = 20_000  # hits whose distances from the surface are averaged
    simplification: float = 0.01  # [voxels] by which the surface may move for fewer faces


class WrappedMesh(NamedTuple):
    """A closed surface around triangles."""

    vertices: Floats  # (n, 3) [m]
    faces: Ints  # (m, 3), outward
    resolution: float  # [m] edge of a voxel; thinner parts may be lost
    offset: float  # [m] root mean square distance of the hits from the surface
    closed_share: float  # of the surface, that closes holes or was not seen
    n_left_out: int  # other parts, without those smaller than `WrapSettings.min_part`


def wrap_mesh(
    vertices: Floats, faces: Ints, settings: WrapSettings = WrapSettings()
) -> WrappedMesh:
    """The outside of triangles (m, 3) of vertices (n, 3) [m], as a closed surface of any genus.

    Raises ValueError, whose message continues the mesh's name, if nothing is enclosed.
    """
    faces = faces[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]]
    used, corners = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], corners.reshape(-1, 3).astype(np.int32)
    grid = _grid_around(vertices, settings)
    step = grid.step
    places, normals = _outer_hits(vertices, faces, step, settings)
    kept = _outward(grid, places, normals, settings.smoothing)
    places, normals = places[kept], normals[kept]
    values = _indicator(grid, places, normals, settings.smoothing)
    values, n_left_out = _largest_part(values, settings.min_part)
    mesh = grid_surface(values)
    if not len(mesh.faces):
        raise ValueError("bounds no solid: nothing lies behind its faces")
    surface = grid.low + step * mesh.vertices
    closed = _closed_share(surface[mesh.faces], places, settings.near_hit * step)
    if closed > settings.max_closed_share:
        raise ValueError(
            f"bounds no solid: {closed:.0%} of its outside would be a guess, and no more than "
            f"{settings.max_closed_share:.0%} may be; close it in a mesh editor"
        )
    moved = _moved_onto(surface, vertices[faces], settings.max_projection * step)
    outer = mesh.faces
    simple = _simplified(moved, outer, settings.simplification * step)
    if simple is not None:
        moved, outer = simple
    else:
        moved = without_crossings(surface, moved, outer, settings.max_retreats)
    thinned = places[:: max(1, len(places) // settings.n_offsets)]
    offsets = nearest_points(nearest_search(moved[outer]), thinned).distances
    offset = float(np.sqrt(np.mean(offsets**2)))
    return WrappedMesh(moved, outer, step, offset, closed, n_left_out)


def _grid_around(vertices: Floats, settings: WrapSettings) -> _Grid:
    """An even grid that contains the vertices (n, 3) [m], with a margin."""
    step = float(np.ptp(vertices, axis=0).max()) / settings.n_voxels
    counts = np.ceil(np.ptp(vertices, axis=0) / step).astype(int) + 2 * settings.margin + 1
    shape = tuple(int(scipy.fft.next_fast_len(int(count), real=True)) for count in counts)
    return _Grid(vertices.min(axis=0) - settings.margin * step, step, shape)


def _closed_share(corners: Floats, places: Floats, near: float) -> float:
    """Fraction of triangles (m, 3, 3), by area, farther than `near` from all hits."""
    areas = areas_and_normals(corners)[0]
    tree = scipy.spatial.cKDTree(places)
    far = np.isinf(tree.query(corners.mean(axis=1), distance_upper_bound=near)[0])
    return float(areas[far].sum() / areas.sum())


def _outer_hits(
    vertices: Floats, faces: Ints, step: float, settings: WrapSettings
) -> tuple[Floats, Floats]:
    """First hits (k, 3) of parallel rays on the triangles, and normals there towards the rays."""
    rays = Embree(vertices, faces) if HAS_EMBREE else ZBuffer(vertices, faces)
    units = areas_and_normals(vertices[faces])[1]
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    reach = 0.5 * float(np.linalg.norm(np.ptp(vertices, axis=0))) + 2.0 * step
    across = np.arange(-reach, reach, step) + 0.25 * step
    plane = np.stack(np.meshgrid(across, across, indexing="ij"), axis=-1).reshape(-1, 2)
    places, normals = [], []
    for direction in _directions(settings.n_directions):
        origins = middle - 2.0 * reach * direction + plane @ axes_across(direction)
        hits = rays.first_hits(origins, direction)
        met = np.flatnonzero(hits.faces >= 0)
        facing = units[hits.faces[met]]
        towards = np.where((facing @ direction > 0.0)[:, None], -facing, facing)
        places.append(origins[met] + hits.ranges[met, None] * direction)
        normals.append(towards)
    return np.concatenate(places), np.concatenate(normals)


def _directions(count: int) -> Floats:
    """Unit directions (n, 3) spread evenly, along a spiral."""
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - height**2)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), height])


class _Grid(NamedTuple):
    low: Floats
    step: float
    shape: tuple[int, ...]

    def nearest(self, places: Floats) -> tuple[Ints, ...]:
        """Indices along each axis of the nodes nearest to places (k, 3)."""
        at = np.round((places - self.low) / self.step).astype(np.int32)
        return tuple(at.T)

    def summed(self, places: Floats, values: Floats | None = None) -> Floats:
        """Values (k,), or ones, summed over the places nearest to each node."""
        flat = np.ravel_multi_index(self.nearest(places), self.shape)
        sums = np.bincount(flat, values, int(np.prod(self.shape)))
        return np.asarray(sums.reshape(self.shape), np.float64)

    def field(self, places: Floats, vectors: Floats, smoothing: float) -> list[Floats]:
        """Vectors (k, 3) summed and smoothed, one array for each axis."""
        return [
            scipy.ndimage.gaussian_filter(self.summed(places, vectors[:, axis]), smoothing)
            for axis in range(3)
        ]


def _outward(grid: _Grid, places: Floats, normals: Floats, smoothing: float) -> Bools:
    """Hits (k,) on the side of their faces that most rays nearby see."""
    at = grid.nearest(places)
    mean = np.stack([axis[at] for axis in grid.field(places, normals, smoothing)], axis=1)
    return np.asarray((mean * normals).sum(axis=1) > 0.0)


def _indicator(grid: _Grid, places: Floats, normals: Floats, smoothing: float) -> Floats:
    """A function on the grid, negative inside and 0 at the hits."""
    density = scipy.ndimage.gaussian_filter(grid.summed(places), smoothing)
    density *= np.sqrt(2.0 * np.pi) * smoothing  # hits per area of a voxel's face
    at = grid.nearest(places)
    areas = 1.0 / np.maximum(density[at], 1e-6)
    field = grid.field(places, areas[:, None] * normals, smoothing)
    waves = np.meshgrid(
        *(2.0 * np.pi * np.fft.fftfreq(count) for count in grid.shape[:2]),
        2.0 * np.pi * np.fft.rfftfreq(grid.shape[2]),
        indexing="ij",
        sparse=True,
    )
    squares = waves[0] ** 2 + waves[1] ** 2 + waves[2] ** 2
    squares[0, 0, 0] = 1.0
    divergence = sum(
        1j * wave * scipy.fft.rfftn(part) for wave, part in zip(waves, field, strict=True)
    )
    values = -scipy.fft.irfftn(divergence / squares, grid.shape)
    return np.asarray(values - np.average(values[at], weights=areas))


def _largest_part(values: Floats, min_part: float) -> tuple[Floats, int]:
    """The function with the largest part alone, without hollows; number of other large parts."""
    border = np.ones(values.shape, np.bool_)
    border[1:-1, 1:-1, 1:-1] = False
    inside = scipy.ndimage.binary_fill_holes((values < 0.0) & ~border)
    parts, _ = scipy.ndimage.label(inside)
    counts = np.bincount(parts.ravel())
    counts[0] = 0
    largest = int(counts.argmax())
    kept = (parts == largest) & (counts[largest] > 0)
    smaller = np.delete(counts, largest)
    n_left_out = int((smaller >= min_part * counts[largest]).sum())
    return np.where(kept, np.minimum(values, -1e-6), np.maximum(values, 1e-6)), n_left_out


def _moved_onto(surface: Floats, corners: Floats, reach: float) -> Floats:
    """Vertices (n, 3) moved onto triangles (m, 3, 3) that lie within a reach [m] of them."""
    nearest = nearest_points(nearest_search(corners), surface)
    return np.where((nearest.distances < reach)[:, None], nearest.points, surface)


def _simplified(vertices: Floats, faces: Ints, tolerance: float) -> tuple[Floats, Ints] | None:
    """The surface with fewer faces, within a tolerance [m]; None if it would cross itself."""
    solid = as_manifold(vertices, faces)
    if solid is None:
        return None
    places, fewer = arrays_of(solid.simplify(tolerance))
    return None if self_intersection(places, fewer).count else (places, fewer)


def without_crossings(places: Floats, moved: Floats, faces: Ints, max_rounds: int) -> Floats:
    """Moved vertices (n, 3), reset to their old places where faces (m, 3) would cross."""
    tested = faces
    for _ in range(max_rounds):
        crossed = np.unique(tested[self_intersection(moved, tested).faces])
        if not len(crossed):
            return moved
        moved[crossed] = places[crossed]
        tested = faces[_may_cross(moved, faces, crossed)]
    return places


def _may_cross(vertices: Floats, faces: Ints, changed: Ints) -> Bools:
    """Whether faces (m, 3) may cross a face of the changed vertices (k,).

    A face that crosses another has a corner within twice the longest edge of each of its corners.
    """
    corners = vertices[faces]
    longest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
    tree = scipy.spatial.cKDTree(vertices[changed])
    near = np.isfinite(tree.query(vertices, distance_upper_bound=2.0 * longest)[0])
    return np.asarray(near[faces].any(axis=1))
