"""How exact a cast is: a superquadric against extended precision, facets against their sag."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from palpate.bench.table import Row
from palpate.core import Floats, shapes, split_pose
from tests.studies.effects import touch_goals

SIZE, EXPONENTS = (0.03, 0.025, 0.04), (0.7, 0.9)
MESH_LEVEL = 5  # 20k faces
FRAMES, QUICK_FRAMES = 40, 10


def cast_rows(quick: bool) -> Iterable[Row]:
    """Errors of casts; fewer frames if quick."""
    yield from exactness_rows(QUICK_FRAMES if quick else FRAMES)


def exactness_rows(frames: int) -> Iterable[Row]:
    """Errors of casts, against extended precision and against the sag of facets."""
    exact, radius = shapes.Superquadric(np.array(SIZE), np.array(EXPONENTS)), 0.03
    worst = max(_error_of_cast(exact, *ray) for ray in _rays(frames))
    yield Row("error of a cast at a superquadric", f"{worst:.1e} m", "<= 1e-9 m", worst <= 1e-9)
    mesh = shapes.Superquadric(np.full(3, radius), np.ones(2)).mesh(MESH_LEVEL)
    facets, corners, off = shapes.TriangleShape(*mesh), mesh.vertices[mesh.faces], []
    for origins, direction in _rays(frames):
        ranges = facets.cast(origins, direction, 1.0)
        hit = np.isfinite(ranges)
        points = origins[hit] + ranges[hit, None] * direction
        off.append(float((radius - np.linalg.norm(points, axis=1)).max(initial=0.0)))
    # How far the deepest facet's middle lies under the ball.
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    bound = float(radius - np.abs(np.einsum("ni,ni->n", normal, corners[:, 0])).min())
    name = f"error of a cast at {len(mesh.faces) // 1000}k facets of a ball"
    target = f"<= {1e6 * bound:.2f} um, their sag"
    good = max(off) <= bound + 1e-8  # Embree works in single precision
    yield Row(name, f"{1e6 * max(off):.2f} um", target, good)


def _error_of_cast(shape: shapes.Superquadric, origins: Floats, direction: Floats) -> float:
    """Largest error of a cast, against bisection in extended precision, m."""
    ranges = shape.cast(origins, direction, 1.0)
    hit = np.isfinite(ranges)
    start, along = origins[hit].astype(np.longdouble), direction.astype(np.longdouble)
    middle = ranges[hit].astype(np.longdouble)
    near, far = middle - 1e-7, middle + 1e-7
    # A ray that grazes may have left again 0.1 um farther on: those are left out.
    kept = (_outside(shape, start, along, near) > 0) & (_outside(shape, start, along, far) < 0)
    start, near, far = start[kept], near[kept], far[kept]
    for _ in range(60):
        half = 0.5 * (near + far)
        outside = _outside(shape, start, along, half) > 0
        near, far = np.where(outside, half, near), np.where(outside, far, half)
    return float(np.abs(near - middle[kept]).max(initial=0.0))


def _outside(shape: shapes.Superquadric, start: Any, along: Any, way: Any) -> Any:
    """The inside-outside function less 1, (2.6) without its outer power."""
    e1, e2 = (np.longdouble(e) for e in shape.exponents)
    x, y, z = (np.abs(start + way[:, None] * along) / shape.size.astype(np.longdouble)).T
    return (x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1) - 1


def _rays(count: int) -> Iterable[tuple[Floats, Floats]]:
    """Origins of the rays of a pad at many places, and their direction."""
    axis = (np.arange(16) - 7.5) * 1e-3
    x, y = (side.ravel() for side in np.meshgrid(axis, axis))
    for goal in touch_goals(count):
        _, axes = split_pose(goal.pose)
        face = np.column_stack([x, y, np.zeros_like(x)])
        yield face @ axes.T + goal.pose[:3], axes[:, 2]
