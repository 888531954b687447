"""One solid out of nine contours of felt points. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.measure.distance import compare, prepare
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.rebuild.surface.surface_mesh import SurfaceMesh
from palpate.core.shapes.superquadric import Superquadric

RADIUS = 0.04


def ball() -> tuple[list[Floats], FeltPoints, Floats]:
    """Nine contours of a ball, what the pad feels around them, and touches of both ends."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centre = np.array([0.0, 0.0, RADIUS])
    contours = []
    for height in np.linspace(0.06, 1.94, 9) * RADIUS:
        rise = height / RADIUS - 1.0
        turn = 2 * np.pi * np.arange(150) / 150
        level = np.sqrt(1.0 - rise**2)
        rim = np.column_stack([level * np.cos(turn), level * np.sin(turn), np.full(150, rise)])
        contours.append(centre + RADIUS * rim)
    touch = np.repeat(np.arange(200, dtype=np.int32), 100)
    felt = FeltPoints(centre + RADIUS * normals, normals, touch)
    return contours, felt, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * RADIUS]])


def rebuilt() -> SurfaceMesh:
    """The ball, as a mesh."""
    contours, felt, tops = ball()
    return reconstruct(contours, patches=felt, tops=tops, method="skin").mesh(2e-5)


def bench_rebuild(benchmark: Any) -> None:
    assert len(benchmark(rebuilt).faces) > 10_000


def bench_compare(benchmark: Any) -> None:
    solid = rebuilt()
    truth = prepare(*Superquadric(np.full(3, RADIUS), np.ones(2)).mesh(6))
    shifted = solid.vertices - [0.0, 0.0, RADIUS]
    found = benchmark(lambda: compare(truth, prepare(shifted, solid.faces)))
    # The facets stand off by the tolerance.
    assert found.chamfer < 2e-4 * RADIUS
