"""Half-spaces: the box around an intersection, common points of planes, a solid's deepest point."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, finite_array

MIN_DETERMINANT = 1e-9  # of three unit normals; planes with less have no common point
ROUNDING = 1e-9  # of weights


@dataclass(frozen=True, slots=True, kw_only=True)
class DeepestPointSettings:
    """Search for a function's least value: a grid, then shrinking grids around the best point."""

    n_grid: int = 17  # points along each axis
    n_near: int = 5  # points along each axis of the later grids
    n_rounds: int = 40
    shrinkage: float = 0.7  # factor of the grid's size from round to round


class HalfSpace:
    """The points p with normal p <= offset.

    `normal` (3,): outward normal of any length except 0. `offset`: distance of the plane from the
    origin along the normal [m]. Raises ValueError if a number is not finite, or the normal 0.
    """

    def __init__(self, normal: Floats, offset: float):
        normal = finite_array("normal", normal, (3,))
        largest = float(np.abs(normal).max())
        if not largest > 0.0:
            raise ValueError("normal must have a length, got [0, 0, 0]")
        normal = normal / largest  # so that no square overflows or underflows
        self.normal: Floats = normal / np.linalg.norm(normal)
        self.offset = float(finite_array("offset", offset, ()))

    def enclosure(self) -> Floats:
        """Its box, (2, 3) [m], infinite except for at most one side."""
        return polytope_box(self.normal[None], np.array([self.offset]))

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distance from the plane, negative inside, and its slope."""
        return points @ self.normal - self.offset, directions @ self.normal

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Spans of parallel rays inside: see `CsgSolid.spans`. A ray in the plane is inside."""
        height, rate = origins @ self.normal - self.offset, float(direction @ self.normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -height / rate
        inside = height <= 0.0
        begin = np.where(inside, -np.inf, crossing if rate < 0.0 else np.inf)
        return np.stack([begin, np.where(inside & (rate > 0.0), crossing, np.inf)], axis=1)[:, None]

    def complement(self) -> HalfSpace:
        """The half-space on the other side of the plane."""
        return HalfSpace(-self.normal, -self.offset)


def polytope_box(normals: Floats, offsets: Floats) -> Floats:
    """Smallest upright box around the points p with normals p <= offsets.

    Returns (2, 3), infinite where there is no bound. By the duality of linear programming, the
    largest coordinate is the least bound by up to three half-spaces: a combination of their normals
    with non-negative weights is the axis, and that of their offsets is the bound.
    """
    length = np.linalg.norm(normals, axis=1)
    normals, offsets = normals / length[:, None], offsets / length
    axes = np.concatenate([-np.eye(3), np.eye(3)])
    reach = np.full(6, np.inf)
    for size in (1, 2, 3):
        if len(normals) >= size:
            reach = np.minimum(reach, _bounds(normals, offsets, axes, size))
    return np.stack([-reach[:3], reach[3:]])


def _bounds(normals: Floats, offsets: Floats, axes: Floats, size: int) -> Floats:
    """Least bound (6,) in each direction by any `size` half-spaces."""
    chosen = np.array(list(itertools.combinations(range(len(normals)), size)), np.int32)
    some = normals[chosen]  # (m, size, 3)
    gram = some @ some.transpose(0, 2, 1)
    apart = np.linalg.det(gram) > MIN_DETERMINANT**2
    some, chosen, gram = some[apart], chosen[apart], gram[apart]
    weights = np.linalg.solve(gram, some @ axes.T)  # (m, size, 6)
    reached = np.abs(some.transpose(0, 2, 1) @ weights - axes.T).max(axis=1) < ROUNDING
    holds = reached & (weights >= -ROUNDING).all(axis=1)
    bound = np.einsum("ms,msa->ma", offsets[chosen], np.maximum(weights, 0.0))
    return np.asarray(np.where(holds, bound, np.inf).min(axis=0, initial=np.inf))


def deepest_point(
    level: Callable[[Floats], Floats],
    box: Floats,
    planes: Floats,
    settings: DeepestPointSettings = DeepestPointSettings(),
) -> tuple[Floats, float]:
    """Point at which a function is least, and its value there.

    Powers below 1 are least in the common points of three planes, which are tried too.
    """
    points = np.concatenate([_grid(box, settings.n_grid), _plane_vertices(planes)])
    points = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
    best, least = _best(level, points, box.mean(axis=0), np.inf)
    half = np.ptp(box, axis=0) / (settings.n_grid - 1)
    for _ in range(settings.n_rounds):
        near = np.clip(_grid(np.stack([best - half, best + half]), settings.n_near), *box)
        best, least = _best(level, near, best, least)
        half = settings.shrinkage * half
    return best, least


def _grid(box: Floats, count: int) -> Floats:
    axes = np.linspace(box[0], box[1], count).T
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _plane_vertices(planes: Floats) -> Floats:
    three = np.array(list(itertools.combinations(range(len(planes)), 3)))
    unit = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    matrices = unit[three]
    meet = np.abs(np.linalg.det(matrices[:, :, :3])) > MIN_DETERMINANT
    return np.linalg.solve(matrices[meet, :, :3], -matrices[meet, :, 3:])[:, :, 0]


def _best(
    level: Callable[[Floats], Floats], points: Floats, best: Floats, least: float
) -> tuple[Floats, float]:
    values = level(points)
    lowest = int(values.argmin())
    return (points[lowest], float(values[lowest])) if values[lowest] < least else (best, least)


def are_concurrent(planes: Floats, tolerance: float = 1e-9) -> bool:
    """Whether all planes (n, 4) pass through one point.

    `tolerance`: over the widths of the planes' strips, 1 / |(a, b, c)|.
    """
    scaled = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    point = np.linalg.lstsq(scaled[:, :3], -scaled[:, 3], rcond=None)[0]
    missed = np.abs(scaled[:, :3] @ point + scaled[:, 3])
    return bool((missed * np.linalg.norm(planes[:, :3], axis=1) < tolerance).all())
