"""Superquadrics from points, one fit of each kind. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.rebuild.recovery.normal_distance import Warps, distances_alone, normal_distances
from palpate.core.rebuild.recovery.recover import recover
from palpate.launch.bench_shapes_recovery import BOTH, OUTLIERS, RIGID, Kind, draw, slope_row

KINDS = {"rigid": RIGID, "outliers": OUTLIERS, "tapered and bent": BOTH}


@pytest.mark.parametrize("name", KINDS)
def bench_recovery(benchmark: Any, name: str) -> None:
    kind: Kind = KINDS[name]
    points = draw(kind, np.random.default_rng(0)).points
    options = {"taper": kind.taper, "bend": kind.bend, "outliers": kind.outliers > 0.0}
    assert benchmark(recover, points, **options).fitted


def solids() -> tuple[Floats, Floats, Floats, Warps]:
    """Six solids with all 15 parameters, and 60 points."""
    rng, warps = np.random.default_rng(0), Warps(taper=True, bend=True)
    parameters = rng.uniform(-0.3, 0.3, (6, warps.total))
    parameters[:, 3:5] = rng.uniform(0.3, 1.7, (6, 2))
    return parameters, rng.normal(size=(60, 3)), np.broadcast_to(np.eye(3), (6, 3, 3)), warps


def bench_distances(benchmark: Any) -> None:
    assert np.isfinite(benchmark(distances_alone, *solids())).all()


def bench_distances_and_jacobian(benchmark: Any) -> None:
    assert np.isfinite(benchmark(normal_distances, *solids())[1]).all()


def bench_the_jacobian_costs_a_fifth_of_differences_at_most(benchmark: Any) -> None:
    row = benchmark.pedantic(slope_row, rounds=1)
    print(row)
    assert row.name
