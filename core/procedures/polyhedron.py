"""Convex polyhedra from the planes of their faces: edges and vertices are where planes meet.

So a rounded rim, which touch blurs, has no say in where an edge is (Fung, 1999, 1.4.3.2: "edges and
vertices of these planes can be easily computed from their intersections").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import axes_along
from palpate.core.shapes import Polyhedron

SINGULAR = 1e-6  # Volume of three unit normals below which their planes meet nowhere
ROUNDING = 1e-9  # Of the points' extent: no standard deviation is smaller
TOGETHER = 1e-7  # Of the box: corners nearer than that are one


class Plane(NamedTuple):
    """Where normal @ x = offset; the object lies on the lower side."""

    normal: Floats  # Outward unit normal, (3,)
    offset: float  # m

    def above(self, points: Floats) -> Floats:
        """Distance (n,) of points (n, 3) outside of it, m; negative inside."""
        return np.asarray(points @ self.normal - self.offset)


class PlaneFit(NamedTuple):
    """A plane through the touches of a face."""

    plane: Plane
    rms: float  # Distance of the points, m
    worst: float  # Distance of the touch that is farthest off, its points' mean, m
    normal_error: float  # Standard deviation of the normal's angle, rad


def fit_plane(
    touches: Sequence[Floats], outward: Floats, noise: float, point: float, angle: float
) -> PlaneFit:
    """The plane through touches, (n, 3) each, m, by total least squares with their covariance.

    The points of one touch share the errors of its pose, `point`, m, and `angle`, rad, beside the
    taxels' own `noise`, m: how a touch leans and where it lies count by what each is worth.
    `outward` (3,): the normal's side. Raises ValueError of fewer than 3 points, or on a line.
    """
    places = np.concatenate(touches)
    if len(places) < 3:
        raise ValueError(f"a plane needs 3 points, got {len(places)}")
    means = np.array([one.mean(axis=0) for one in touches])
    counts = np.array([len(one) for one in touches])
    least = (ROUNDING * float(np.ptp(places, axis=0).max())) ** 2
    weights = 1.0 / (point**2 + noise**2 / counts + least)
    middle = weights @ means / weights.sum()
    square = ((means - middle) * weights[:, None]).T @ (means - middle)
    for one, mean in zip(touches, means, strict=True):
        scatter = (one - mean).T @ (one - mean)
        square += scatter / (noise**2 + float(np.trace(scatter)) * angle**2 + least)
    sizes, axes = np.linalg.eigh(square)
    if sizes[1] <= SINGULAR * sizes[2]:
        raise ValueError("the points lie on a line")
    normal = axes[:, 0] if axes[:, 0] @ outward > 0.0 else -axes[:, 0]
    plane = Plane(normal, float(middle @ normal))
    off = plane.above(places)
    error = math.sqrt(1.0 / sizes[1] + 1.0 / sizes[2])
    return PlaneFit(
        plane, float(np.sqrt(np.mean(off**2))), float(np.abs(plane.above(means)).max()), error
    )


class Corners(NamedTuple):
    """Corners of a cell of half-spaces."""

    places: Floats  # (n, 3), m
    faces: tuple[tuple[int, ...], ...]  # Of each plane, counter-clockwise seen from outside


def corners_of(planes: list[Plane], half: float) -> Corners | None:
    """Corners of what all planes leave inside; None if it is not bounded by them, or empty.

    `half`: half the edge of a cube about the origin that is larger than any object, m: a corner
    outside of it is one at infinity. A plane that touches nothing of the rest has no corners.
    """
    normals = np.array([plane.normal for plane in planes])
    offsets = np.array([plane.offset for plane in planes])
    if len(planes) < 4:
        return None
    triples = np.array(list(combinations(range(len(planes)), 3)))
    meets = np.abs(np.linalg.det(normals[triples])) > SINGULAR
    triples = triples[meets]
    places = np.linalg.solve(normals[triples], offsets[triples][..., None])[..., 0]
    above = places @ normals.T - offsets
    places = places[(above <= TOGETHER * half).all(axis=1)]
    if len(places) < 4 or np.abs(places).max() > half or not _is_bounded(normals):
        return None
    places = _merged(places, TOGETHER * half)
    beside = np.abs(places @ normals.T - offsets) <= 10.0 * TOGETHER * half
    faces = (_around(places, on, one) for on, one in zip(beside.T, normals, strict=True))
    return Corners(places, tuple(faces))


def _is_bounded(normals: Floats) -> bool:
    """Whether half-spaces with these outward normals enclose a bounded cell.

    They do if the origin is inside of the normals' convex hull: no direction leaves all of them.
    """
    crossed = np.cross(normals[:, None], normals[None]).reshape(-1, 3)
    lengths = np.linalg.norm(crossed, axis=1)
    ways = crossed[lengths > SINGULAR] / lengths[lengths > SINGULAR, None]
    ways = np.concatenate([ways, -ways])
    return bool(((ways @ normals.T).max(axis=1) > SINGULAR).all())


def _merged(places: Floats, near: float) -> Floats:
    kept: list[Floats] = []
    for place in places:
        if all(np.linalg.norm(place - other) > near for other in kept):
            kept.append(place)
    return np.array(kept)


def _around(places: Floats, on: Floats, normal: Floats) -> tuple[int, ...]:
    """Corners on a face in their order around it; none if it has no area."""
    numbers = np.flatnonzero(on)
    if len(numbers) < 3:
        return ()
    flat = (places[numbers] - places[numbers].mean(axis=0)) @ axes_along(normal)[:, :2]
    return tuple(numbers[np.arctan2(flat[:, 1], flat[:, 0]).argsort()].tolist())


def polyhedron_of(corners: Corners) -> tuple[Polyhedron, list[int]]:
    """The solid with winged edges, and the plane of each face; ValueError if it does not close."""
    planes = [number for number, face in enumerate(corners.faces) if face]
    return Polyhedron(corners.places, [corners.faces[number] for number in planes]), planes
