"""Convex polyhedra from the planes of their faces: edges and vertices are where planes meet.

So a rounded rim, which touch blurs, does not move an edge (Fung, 1999, 1.4.3.2: "edges and vertices
of these planes can be easily computed from their intersections").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import axes_along
from palpate.core.shapes import Polyhedron

MIN_DETERMINANT = 1e-6  # of three unit normals: below it their planes have no common point
MIN_RELATIVE_SIGMA = 1e-9  # fraction of the points' extent: no standard deviation is smaller
MERGE_DISTANCE = 1e-7  # fraction of the box: nearer corners are one


class Plane(NamedTuple):
    """Where normal @ x = offset; the object lies on the lower side."""

    normal: Floats  # outward unit normal, (3,)
    offset: float  # [m]

    def above(self, points: Floats) -> Floats:
        """Distance (n,) of points (n, 3) from the plane [m]; negative inside the object."""
        return np.asarray(points @ self.normal - self.offset)


class PlaneFit(NamedTuple):
    """A plane through the touches of a face."""

    plane: Plane
    rms: float  # [m] distance of the points
    worst: float  # [m] largest distance of a touch, that is of the mean of its points
    normal_error: float  # [rad] standard deviation of the normal's angle


def fit_plane(
    touches: Sequence[Floats],
    outward: Floats,
    noise: float,
    point_error: float,
    angle_error: float,
) -> PlaneFit:
    """The plane through touches, (n, 3) each [m], by total least squares with their covariance.

    The points of one touch share the errors of its pose, `point_error` [m] and `angle_error`
    [rad], beside the taxels' own `noise` [m]: so the tilt and the position of a touch have weights
    of their own. `outward` (3,): the normal's side. Raises ValueError if there are fewer than 3
    points, or they lie on a line.
    """
    points = np.concatenate(touches)
    if len(points) < 3:
        raise ValueError(f"a plane needs 3 points, got {len(points)}")
    means = np.array([touch.mean(axis=0) for touch in touches])
    counts = np.array([len(touch) for touch in touches])
    min_variance = (MIN_RELATIVE_SIGMA * float(np.ptp(points, axis=0).max())) ** 2
    weights = 1.0 / (point_error**2 + noise**2 / counts + min_variance)
    middle = weights @ means / weights.sum()
    square = ((means - middle) * weights[:, None]).T @ (means - middle)
    for touch, mean in zip(touches, means, strict=True):
        scatter = (touch - mean).T @ (touch - mean)
        square += scatter / (noise**2 + float(np.trace(scatter)) * angle_error**2 + min_variance)
    sizes, axes = np.linalg.eigh(square)
    if sizes[1] <= MIN_DETERMINANT * sizes[2]:
        raise ValueError("the points lie on a line")
    normal = axes[:, 0] if axes[:, 0] @ outward > 0.0 else -axes[:, 0]
    plane = Plane(normal, float(middle @ normal))
    rms = float(np.sqrt(np.mean(plane.above(points) ** 2)))
    worst = float(np.abs(plane.above(means)).max())
    return PlaneFit(plane, rms, worst, math.sqrt(1.0 / sizes[1] + 1.0 / sizes[2]))


class Corners(NamedTuple):
    """Corners of a cell of half-spaces."""

    places: Floats  # (n, 3) [m]
    faces: tuple[tuple[int, ...], ...]  # of each plane, counter-clockwise seen from outside


def corners_of(planes: list[Plane], half: float) -> Corners | None:
    """Corners of the cell inside all planes; None if it is not bounded, or empty.

    `half`: half the edge of a cube about the origin that is larger than any object [m]; a corner
    outside of it counts as infinitely far. A plane that does not meet the cell has no corners.
    """
    normals = np.array([plane.normal for plane in planes])
    offsets = np.array([plane.offset for plane in planes])
    if len(planes) < 4:
        return None
    triples = np.array(list(combinations(range(len(planes)), 3)))
    triples = triples[np.abs(np.linalg.det(normals[triples])) > MIN_DETERMINANT]
    places = np.linalg.solve(normals[triples], offsets[triples][..., None])[..., 0]
    above = places @ normals.T - offsets
    places = places[(above <= MERGE_DISTANCE * half).all(axis=1)]
    if len(places) < 4 or np.abs(places).max() > half or not _is_bounded(normals):
        return None
    places = _merged(places, MERGE_DISTANCE * half)
    is_on = np.abs(places @ normals.T - offsets) <= 10.0 * MERGE_DISTANCE * half
    faces = (_ring(places, on, normal) for on, normal in zip(is_on.T, normals, strict=True))
    return Corners(places, tuple(faces))


def _is_bounded(normals: Floats) -> bool:
    """Whether half-spaces with these outward normals enclose a bounded cell.

    They do if the origin is inside the normals' convex hull: no direction is free of all of them.
    """
    crossed = np.cross(normals[:, None], normals[None]).reshape(-1, 3)
    lengths = np.linalg.norm(crossed, axis=1)
    is_long = lengths > MIN_DETERMINANT
    directions = crossed[is_long] / lengths[is_long, None]
    directions = np.concatenate([directions, -directions])
    return bool(((directions @ normals.T).max(axis=1) > MIN_DETERMINANT).all())


def _merged(places: Floats, distance: float) -> Floats:
    """Places (n, 3) without those within a distance of an earlier one."""
    kept: list[Floats] = []
    for place in places:
        if all(np.linalg.norm(place - other) > distance for other in kept):
            kept.append(place)
    return np.array(kept)


def _ring(places: Floats, is_on: Bools, normal: Floats) -> tuple[int, ...]:
    """Corners on a face in their order around it; none if it has no area."""
    numbers = np.flatnonzero(is_on)
    if len(numbers) < 3:
        return ()
    flat = (places[numbers] - places[numbers].mean(axis=0)) @ axes_along(normal)[:, :2]
    return tuple(numbers[np.arctan2(flat[:, 1], flat[:, 0]).argsort()].tolist())


def polyhedron_of(corners: Corners) -> tuple[Polyhedron, list[int]]:
    """The solid with winged edges, and each face's plane; ValueError if it does not close."""
    planes = [number for number, face in enumerate(corners.faces) if face]
    return Polyhedron(corners.places, [corners.faces[number] for number in planes]), planes
