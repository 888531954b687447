"""The models beside the superquadric: what a cast costs, and how exactly it ends."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from palpate.core.shapes.boolean import BooleanShape
from palpate.core.shapes.boolean_tree import difference
from palpate.core.shapes.dent import Dent
from palpate.core.shapes.generalised_cylinder import GeneralisedCylinder
from palpate.core.shapes.half_space import HalfSpace
from palpate.core.shapes.hyperquadric import Hyperquadric
from palpate.core.shapes.polyhedron import Polyhedron
from palpate.core.shapes.protocol import ImplicitShape
from palpate.core.shapes.section import SplineSection, SuperellipseSection
from palpate.core.shapes.superquadric import Superquadric
from palpate.launch.bench_row import Row

Floats = NDArray[np.float64]

RAYS = 256
"""As many as a sensor has taxels."""
SIZE = np.array([0.035, 0.03, 0.045])
AXES = np.column_stack([np.diag(1.0 / SIZE), np.zeros(3)])
MOST_RATIO = 40.0
"""Of a superquadric's cast."""
MOST_ERROR = 1e-12
"""m."""
GRAZING = 0.05
"""Rays along which the function falls less than this share of the steepest say little."""
FAR = 0.15
"""Rays start this far before the solid, m."""


def model_rows(quick: bool) -> Iterable[Row]:
    """For each model the cost of a cast against a superquadric's, its error, and what it passed.

    Parameters
    ----------
    quick : bool
        4 directions instead of 24.
    """
    directions = _directions(4 if quick else 24)
    base = Superquadric(SIZE, np.array([0.5, 0.8]))
    unit = _seconds(base, directions)
    yield Row("cast at a superquadric, 256 rays", f"{1e6 * unit:.0f} us", "", True)
    for name, shape in _models().items():
        ratio = _seconds(shape, directions) / unit
        target = f"<= {MOST_RATIO:g}"
        yield Row(f"cast at {name}", f"{ratio:.1f} x", target, ratio <= MOST_RATIO)
        error, passed = _error(shape, directions)
        holds = error <= MOST_ERROR
        yield Row(f"error of a cast at {name}", f"{error:.1e} m", f"<= {MOST_ERROR:g} m", holds)
        yield Row(f"rays that pass a part of {name}", str(passed), "0", passed == 0)


def _models() -> Mapping[str, ImplicitShape]:
    dent = Dent(
        0.6, np.array([[45.0, 0, 0, -1.6], [0, 55.0, 0, 0], [0, 0, 45.0, 0]]), np.full(3, 2.0)
    )
    ball = Superquadric(np.full(3, 0.035), np.ones(2))
    drill = GeneralisedCylinder(
        SuperellipseSection(np.full(2, 0.012), 1.0), np.array([0.0, 0.1]), np.ones(2)
    )
    lobes = SplineSection(np.array([0.03, 0.02, 0.03, 0.02, 0.03, 0.02]))
    heights, scales = np.array([0.0, 0.02, 0.05, 0.07]), np.array([0.9, 1.1, 0.6, 0.7])
    return {
        "a hyperquadric": Hyperquadric(AXES, np.full(3, 4.0)),
        "a hyperquadric of powers below 1": Hyperquadric(AXES, np.full(3, 0.6)),
        "a dented hyperquadric": Hyperquadric(AXES, np.full(3, 4.0), (dent,)),
        "a lobed generalised cylinder": GeneralisedCylinder(lobes, heights, scales, smooth=True),
        "a drilled half ball": BooleanShape(
            difference(ball, drill, HalfSpace(np.array([0.0, 0.0, 1.0]), -0.005))
        ),
        "a polyhedron": _Faces(_octahedron()),
    }


class _Faces:
    """A convex polyhedron with the function that it lacks: distance from its farthest plane."""

    def __init__(self, base: Polyhedron):
        self._base = base
        a, b, c = base.mesh(0).vertices[base.mesh(0).faces].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        self._normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        self._offsets = (self._normals * a).sum(axis=1)
        self.cast, self.mesh, self.bounds = base.cast, base.mesh, base.bounds

    def enclosure(self) -> Floats:
        return self._base.bounds()

    def inside_out(self, points: Floats, directions: Floats) -> tuple[Floats, Floats]:
        heights = points @ self._normals.T - self._offsets
        farthest = heights.argmax(axis=1)
        slope = (self._normals[farthest] * directions).sum(axis=1)
        return heights[np.arange(len(points)), farthest], slope


def _octahedron() -> Polyhedron:
    corners = np.concatenate([np.diag(SIZE), -np.diag(SIZE)])
    upper = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]]
    return Polyhedron(corners, [*upper, *([face[1], face[0], 5] for face in upper)])


def _directions(count: int) -> Floats:
    found = np.random.default_rng(0).normal(size=(count, 3))
    result: Floats = found / np.linalg.norm(found, axis=1, keepdims=True)
    return result


def _origins(shape: ImplicitShape, direction: Floats) -> Floats:
    """Starts of parallel rays that cover the shape as a pad does."""
    low, high = shape.enclosure()
    places = np.random.default_rng(1).uniform(low, high, (RAYS, 3))
    result: Floats = places - FAR * direction
    return result


def _seconds(shape: ImplicitShape, directions: Floats) -> float:
    """Mean time of a cast; for each direction the best of three."""
    best = []
    for direction in directions:
        origins, took = _origins(shape, direction), []
        for _ in range(3):
            began = time.perf_counter()
            shape.cast(origins, direction, 1.0)
            took.append(time.perf_counter() - began)
        best.append(min(took))
    return float(np.mean(best))


def _error(shape: ImplicitShape, directions: Floats) -> tuple[float, int]:
    """Largest way from where a ray ended to the surface, m, and rays that passed a part of it."""
    worst, passed = 0.0, 0
    for direction in directions:
        origins = _origins(shape, direction)
        ranges = shape.cast(origins, direction, 1.0)
        met = np.isfinite(ranges)
        ends = origins[met] + ranges[met, None] * direction
        value, slope = shape.inside_out(ends, np.broadcast_to(direction, ends.shape))
        clear = slope < -GRAZING * np.abs(slope).max(initial=0.0)
        worst = max(worst, float(np.abs(value[clear] / slope[clear]).max(initial=0.0)))
        passed += _passed(shape, origins, direction, np.where(met, ranges, 2 * FAR))
    return worst, passed


def _passed(shape: ImplicitShape, origins: Floats, direction: Floats, ends: Floats) -> int:
    """Rays that are inside at one of some places before their ends."""
    share = np.linspace(0.0, 1.0 - 1e-6, 200)
    places = origins[:, None] + (share * ends[:, None])[..., None] * direction
    flat = places.reshape(-1, 3)
    value = shape.inside_out(flat, np.zeros_like(flat))[0].reshape(len(origins), -1)
    return int(np.count_nonzero((value < -1e-9).any(axis=1)))
