"""Which places lie inside an object, estimated coarsely from touched points and swept free space.

The gradient of a function that is 1 inside and 0 outside consists of the surface's inward normals:
the function is the solution of a Poisson equation that is screened at the touched points (Kazhdan
and Hoppe, *Screened Poisson surface reconstruction*, 2013), on an even grid, by conjugate gradients
preconditioned by a Fourier transform. We depart from them: points are weighted by the area they
stand for, so that areas that were touched often do not outweigh others; voxels that a finger has
swept are held outside, as an inequality, because a penalty on all of them would bend the surface
where it is right; and voxels in the hull of all points that no finger has swept are pulled inside,
weakly. Points are mirrored at the platform: so walls continue straight through it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from palpate.core.arrays import Bools, Floats
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class CoarseSettings:
    """The screened Poisson equation of the coarse solid, and how it is solved."""

    padding: int = 7  # [voxels] of grid around all points, where the function falls to 0
    screening: float = 0.5  # weight of the points' values over their normals'; larger is closer
    # Weight of a pull to 1 in the hull, to 0 outside; it acts over 1 / root, about 12 voxels.
    hull_weight: float = 0.0064
    max_hull_points: int = 3000  # used for the hull; more change it by less than a voxel
    free_weight: float = 0.5  # weight of pulled voxels: swept ones inside, and the grid's border
    free_margin: float = 0.08  # least depth of swept voxels' values below the surface's level
    free_target: float = 0.15  # depth below that level to which other swept voxels are pulled
    free_rounds: int = 4  # solutions, each with swept voxels pulled that are still inside
    max_wrong_voxels: int = 5  # newly wrong swept voxels, below which the rounds end
    max_steps: int = 60  # of conjugate gradients
    max_residual: float = 3e-3  # fraction of the right-hand side, at which they stop
    min_part: int = 27  # [voxels] smaller parts are left out
    smoothing: float = 0.7  # [voxels] Gaussian of the distances, which smooths steps of the grid


STEEP = 1e-9  # Upward part of the normal of a plane, up to which the plane counts as upright


@readable
class CoarseSolid(NamedTuple):
    """Signed distances on an even grid, negative inside."""

    low: Floats  # Place of the first voxel, (3,), m
    step: float  # Edge of a voxel, m
    distances: Floats  # (a, b, c), m

    def at(self, places: Floats) -> Floats:
        """Interpolated at places (k, 3), (k,), m."""
        grid = ((places - self.low) / self.step).T
        return np.asarray(
            scipy.ndimage.map_coordinates(self.distances, grid, order=1, mode="nearest")
        )


def coarse_solid(
    points: Floats,
    normals: Floats,
    free: Floats,
    *,
    step: float,
    spread: float,
    most_area: float,
    platform: float | None,
    settings: CoarseSettings = CoarseSettings(),
) -> CoarseSolid:
    """The coarse solid of touched points (n, 3) with normals (n, 3) [m].

    `free` (k, 3): places that a finger has swept [m]. `step`: edge of a voxel [m]. `spread`:
    standard deviation of the kernel by which points share area [m]. `most_area`: largest area of
    one point [m^2]. `platform`: height on which the object stands [m], None if it is held.
    """
    if platform is not None:
        points, normals = _mirrored(points, normals, platform)
        below = free * np.array([1.0, 1.0, -1.0]) + np.array([0.0, 0.0, 2.0 * platform])
        free = np.concatenate([free, below])
    margin = settings.padding * step
    low = points.min(axis=0) - margin
    extent = points.max(axis=0) + margin - low
    shape = [
        scipy.fft.next_fast_len(int(np.ceil(length / step)) + 1, real=True) for length in extent
    ]
    if platform is not None:  # the platform is a plane of the grid
        low[2] = platform - step * round((platform - low[2]) / step)
    grid = _Grid(low, step, tuple(shape))
    chi, level = _screened(grid, points, normals, grid.mask(free), spread, most_area, settings)
    inside = scipy.ndimage.binary_fill_holes(chi > level)
    parts, _ = scipy.ndimage.label(inside)
    counts = np.bincount(parts.ravel())
    counts[0] = settings.min_part
    inside &= counts[parts] >= settings.min_part
    distances = scipy.ndimage.distance_transform_edt(
        ~inside
    ) - scipy.ndimage.distance_transform_edt(inside)
    distances = scipy.ndimage.gaussian_filter(
        np.where(inside, distances + 0.5, distances - 0.5), settings.smoothing
    )
    return CoarseSolid(low, step, distances * step)


def _mirrored(points: Floats, normals: Floats, platform: float) -> tuple[Floats, Floats]:
    flip = np.array([1.0, 1.0, -1.0])
    image = points * flip + np.array([0.0, 0.0, 2.0 * platform])
    return np.concatenate([points, image]), np.concatenate([normals, normals * flip])


@readable
class _Grid(NamedTuple):
    low: Floats
    step: float
    shape: tuple[int, ...]

    def mask(self, places: Floats) -> Bools:
        """The voxels that hold one of the places (k, 3)."""
        mask = np.zeros(self.shape, np.bool_)
        at = np.round((places - self.low) / self.step).astype(int)
        at = at[((at >= 0) & (at < self.shape)).all(axis=1)]
        mask[tuple(at.T)] = True
        return mask

    def splat(self, places: Floats) -> scipy.sparse.csr_matrix:
        """Trilinear weights, (places, voxels)."""
        at = (places - self.low) / self.step
        first = np.floor(at).astype(np.int64)
        share = at - first
        columns, weights = [], []
        for corner in np.ndindex(2, 2, 2):
            weights.append(np.prod(np.where(corner, share, 1.0 - share), axis=1))
            node = np.clip(first + corner, 0, np.array(self.shape) - 1)
            columns.append(np.ravel_multi_index(tuple(node.T), self.shape))
        rows = np.tile(np.arange(len(places)), 8)
        pairs = rows, np.concatenate(columns)
        return scipy.sparse.csr_matrix(
            (np.concatenate(weights), pairs), shape=(len(places), int(np.prod(self.shape)))
        )


def _screened(
    grid: _Grid,
    points: Floats,
    normals: Floats,
    free: Bools,
    spread: float,
    most_area: float,
    settings: CoarseSettings,
) -> tuple[Floats, float]:
    """The function on the grid, and its value at the surface. Lengths are in voxels from here."""
    splat, step = grid.splat(points), grid.step
    width = spread / step
    sums = np.asarray(splat.sum(axis=0)).reshape(grid.shape)
    density = (
        scipy.ndimage.gaussian_filter(sums, width, mode="constant") * np.sqrt(2.0 * np.pi) * width
    )
    areas = 1.0 / np.maximum(splat @ density.ravel(), 1e-6)
    areas = np.minimum(areas, most_area / step**2)
    waves = np.meshgrid(
        *(2.0 * np.pi * np.fft.fftfreq(count) for count in grid.shape[:2]),
        2.0 * np.pi * np.fft.rfftfreq(grid.shape[2]),
        indexing="ij",
        sparse=True,
    )
    squares = waves[0] ** 2 + waves[1] ** 2 + waves[2] ** 2
    fields = (
        scipy.fft.rfftn((splat.T @ (areas * normals[:, axis])).reshape(grid.shape))
        for axis in range(3)
    )
    divergence = sum(1j * wave * field for wave, field in zip(waves, fields, strict=True))
    right = scipy.fft.irfftn(divergence * np.exp(-0.5 * squares), grid.shape)
    screen = (splat.T @ (settings.screening * areas)).reshape(grid.shape)
    right, diagonal = right + 0.5 * screen, screen + settings.hull_weight
    hull = _in_hull(grid, points, settings.max_hull_points)
    right = right + settings.hull_weight * (hull & ~free)
    border = np.ones(grid.shape, np.bool_)
    border[1:-1, 1:-1, 1:-1] = False
    system = _System(squares, diagonal, right, splat, areas)
    return _outside_of_free(system, border, free, grid.shape, settings)


def _in_hull(grid: _Grid, points: Floats, max_points: int) -> Bools:
    try:
        planes = scipy.spatial.ConvexHull(points[:: max(1, len(points) // max_points)]).equations
    except scipy.spatial.QhullError:  # all in one plane
        return np.zeros(grid.shape, np.bool_)
    x, y, z = (low + grid.step * np.arange(n) for low, n in zip(grid.low, grid.shape, strict=True))
    a, b, c, d = planes.T
    up, down = c > STEEP, c < -STEEP
    held = np.zeros(grid.shape, np.bool_)
    # In each column of voxels, the hull lies below planes that face up and over those facing down.
    for row, here in enumerate(x):
        level = (a * here + d)[:, None] + b[:, None] * y
        high = (-level[up] / c[up, None]).min(axis=0)
        low = (-level[down] / c[down, None]).max(axis=0)
        beside = (level[~up & ~down] <= 0.0).all(axis=0)
        held[row] = (z >= low[:, None]) & (z <= high[:, None]) & beside[:, None]
    return held


@readable
class _System(NamedTuple):
    squares: Floats  # Of the wave numbers
    diagonal: Floats
    right: Floats
    splat: scipy.sparse.csr_matrix
    areas: Floats

    def level(self, chi: Floats) -> float:
        return float(np.average(self.splat @ chi.ravel(), weights=self.areas))


def _outside_of_free(
    system: _System, active: Bools, free: Bools, shape: tuple[int, ...], settings: CoarseSettings
) -> tuple[Floats, float]:
    """The function, below its level in `free` voxels, and that level; it pulls wrong ones only."""
    chi, target = None, np.zeros(shape)
    for turn in range(settings.free_rounds):
        diagonal = system.diagonal + settings.free_weight * active
        right = system.right + settings.free_weight * active * target
        chi = _conjugate_gradients(system.squares, diagonal, right, chi, settings)
        level = system.level(chi)
        wrong = free & (chi > level - settings.free_margin) & ~active
        if turn == settings.free_rounds - 1 or wrong.sum() < settings.max_wrong_voxels:
            break
        target = np.where(wrong, level - settings.free_target, target)
        active = active | wrong
    assert chi is not None
    return chi, level


def _conjugate_gradients(
    squares: Floats,
    diagonal: Floats,
    right: Floats,
    start: Floats | None,
    settings: CoarseSettings,
) -> Floats:
    shape = right.shape
    mean = float(diagonal.mean()) + 1e-9

    def solve(residual: Floats) -> Floats:
        return np.asarray(scipy.fft.irfftn(scipy.fft.rfftn(residual) / (squares + mean), shape))

    def apply(values: Floats) -> Floats:
        return np.asarray(
            scipy.fft.irfftn(squares * scipy.fft.rfftn(values), shape) + diagonal * values
        )

    chi = solve(right) if start is None else start
    residual = right - apply(chi)
    enough = settings.max_residual * float(np.linalg.norm(right))
    turned = solve(residual)
    direction, product = turned, float((residual * turned).sum())
    for _ in range(settings.max_steps):
        if float(np.linalg.norm(residual)) <= enough:
            break
        image = apply(direction)
        length = product / float((direction * image).sum())
        chi, residual = chi + length * direction, residual - length * image
        turned = solve(residual)
        product, before = float((residual * turned).sum()), product
        direction = turned + product / before * direction
    return chi
