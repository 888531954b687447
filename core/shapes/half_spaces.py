"""Half-spaces: the box about an intersection, where planes meet, where a solid is deepest."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from palpate.core.arrays import Floats, finite_array

PARALLEL = 1e-9  # Three unit normals span less than this volume: they meet in no point
ROUNDING = 1e-9  # A weight this far below 0 is 0
GRID = 17  # Points along each axis of the first look
NEAR_GRID = 5
ROUNDS = 40
SHRINKAGE = 0.7  # Of the box that is looked at next
CONCURRENT = 1e-9


class HalfSpace:
    """The points p with normal p <= offset.

    `normal` (3,): outward normal of any length but 0. `offset`: distance of the plane from the
    origin along the normal, m. Raises ValueError if a number is not finite, or the normal 0.
    """

    def __init__(self, normal: Floats, offset: float):
        normal = finite_array("normal", normal, (3,))
        largest = float(np.abs(normal).max())
        if not largest > 0.0:
            raise ValueError("normal must have a length, got [0, 0, 0]")
        normal = normal / largest  # so that no square overflows, or is lost
        self.normal: Floats = normal / np.linalg.norm(normal)
        self.offset = float(finite_array("offset", offset, ()))

    def enclosure(self) -> Floats:
        """The box about it, (2, 3), infinite but for one side at most, m."""
        return polytope_box(self.normal[None], np.array([self.offset]))

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distance from the plane, negative inside, and its slope."""
        return points @ self.normal - self.offset, directions @ self.normal

    def spans(self, origins: Floats, direction: Floats) -> Floats:
        """Where parallel rays are inside: see `spans`. A ray in the plane is inside."""
        height, rate = origins @ self.normal - self.offset, float(direction @ self.normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            way = -height / rate
        inside = height <= 0.0
        begin = np.where(inside, -np.inf, way if rate < 0.0 else np.inf)
        return np.stack([begin, np.where(inside & (rate > 0.0), way, np.inf)], axis=1)[:, None]

    def complement(self) -> HalfSpace:
        """All that lies before the plane."""
        return HalfSpace(-self.normal, -self.offset)


def polytope_box(normals: Floats, offsets: Floats) -> Floats:
    """Smallest upright box about the points p with normals p <= offsets.

    Returns (2, 3), infinite where there is no bound. By the duality of linear programming, the
    largest coordinate is the least bound that any three of the half-spaces, or fewer, give
    together: a combination of their normals with weights that are not negative is the axis, and
    that of their offsets is the bound.
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
    """Least bound in each direction that any `size` half-spaces give together, (6,)."""
    chosen = np.array(list(itertools.combinations(range(len(normals)), size)), np.int32)
    some = normals[chosen]  # (m, size, 3)
    gram = some @ some.transpose(0, 2, 1)
    apart = np.linalg.det(gram) > PARALLEL**2
    some, chosen, gram = some[apart], chosen[apart], gram[apart]
    weights = np.linalg.solve(gram, some @ axes.T)  # (m, size, 6)
    reached = np.abs(some.transpose(0, 2, 1) @ weights - axes.T).max(axis=1) < ROUNDING
    holds = reached & (weights >= -ROUNDING).all(axis=1)
    bound = np.einsum("ms,msa->ma", offsets[chosen], np.maximum(weights, 0.0))
    return np.asarray(np.where(holds, bound, np.inf).min(axis=0, initial=np.inf))


def deepest_point(
    level: Callable[[Floats], Floats], box: Floats, planes: Floats
) -> tuple[Floats, float]:
    """Point at which a function is least, and its value there.

    A grid, then ever smaller boxes about the best point. Powers below 1 are least in corners of the
    planes' arrangement, which are looked at as they are.
    """
    points = np.concatenate([_grid(box, GRID), _plane_vertices(planes)])
    points = points[((points >= box[0]) & (points <= box[1])).all(axis=1)]
    best, least = _best(level, points, box.mean(axis=0), np.inf)
    half = np.ptp(box, axis=0) / (GRID - 1)
    for _ in range(ROUNDS):
        near = np.clip(_grid(np.stack([best - half, best + half]), NEAR_GRID), *box)
        best, least = _best(level, near, best, least)
        half = SHRINKAGE * half
    return best, least


def _grid(box: Floats, count: int) -> Floats:
    axes = np.linspace(box[0], box[1], count).T
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _plane_vertices(planes: Floats) -> Floats:
    three = np.array(list(itertools.combinations(range(len(planes)), 3)))
    unit = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    matrices = unit[three]
    meet = np.abs(np.linalg.det(matrices[:, :, :3])) > PARALLEL
    return np.linalg.solve(matrices[meet, :, :3], -matrices[meet, :, 3:])[:, :, 0]


def _best(
    level: Callable[[Floats], Floats], points: Floats, best: Floats, least: float
) -> tuple[Floats, float]:
    values = level(points)
    lowest = int(values.argmin())
    return (points[lowest], float(values[lowest])) if values[lowest] < least else (best, least)


def are_concurrent(planes: Floats) -> bool:
    """Whether all planes (n, 4) go through one point."""
    scaled = planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    point = np.linalg.lstsq(scaled[:, :3], -scaled[:, 3], rcond=None)[0]
    missed = np.abs(scaled[:, :3] @ point + scaled[:, 3])
    # Compared with the strips' widths, which are 1 / |(a, b, c)|.
    return bool((missed * np.linalg.norm(planes[:, :3], axis=1) < CONCURRENT).all())
