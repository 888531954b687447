"""One solid out of nine contours of felt points. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core.measure.distance import compare, prepare
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.felt_solid import Evidence, FeltContour, rebuild
from palpate.core.shapes.superquadric import Superquadric

RADIUS = 0.04


def ball() -> Evidence:
    """Nine contours of a ball, and what the pad feels around them."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    on_top = normals[:, 2] > 0.97
    centre = np.array([0.0, 0.0, RADIUS])
    contours = []
    for height in np.linspace(0.06, 1.94, 9) * RADIUS:
        rise = height / RADIUS - 1.0
        turn = 2 * np.pi * np.arange(150) / 150
        level = np.sqrt(1.0 - rise**2)
        rim = np.column_stack([level * np.cos(turn), level * np.sin(turn), np.full(150, rise)])
        contours.append(FeltContour(height, centre + RADIUS * rim))
    return Evidence(
        contours=tuple(contours),
        side=FeltPoints(centre + RADIUS * normals, normals),
        cap=FeltPoints(centre + RADIUS * normals[on_top], normals[on_top]),
        platform=0.0,
    )


def bench_rebuild(benchmark: Any) -> None:
    assert len(benchmark(rebuild, ball()).faces) > 10_000


def bench_compare(benchmark: Any) -> None:
    solid = rebuild(ball())
    truth = prepare(*Superquadric(np.full(3, RADIUS), np.ones(2)).mesh(6))
    shifted = solid.vertices - [0.0, 0.0, RADIUS]
    found = benchmark(lambda: compare(truth, prepare(shifted, solid.faces)))
    # The facets of 160 columns stand off by 1 - cos(pi / 160) of the radius.
    assert found.chamfer < 2e-4 * RADIUS
