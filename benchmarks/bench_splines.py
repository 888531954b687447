"""Deformation, inversion and the search for folds. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from palpate.core.splines.basis import clamped_basis
from palpate.core.splines.folds import fold_report
from palpate.core.splines.invert import invert
from palpate.core.splines.lattice import box_lattice

POINTS = np.random.default_rng(0).random((10_000, 3))
PLAIN = box_lattice(np.zeros(3), np.ones(3), (7, 7, 9))
NOISE = 0.02 * np.random.default_rng(1).normal(size=PLAIN.control.shape)
BENT = PLAIN.with_control(PLAIN.control + NOISE)


def bench_basis(benchmark: Any) -> None:
    assert benchmark(clamped_basis(27).nonzero, POINTS[:, 0], 1).values.shape == (2, 10_000, 4)


@pytest.mark.parametrize("count", [200, 10_000])
def bench_deform(benchmark: Any, count: int) -> None:
    assert len(benchmark(BENT.deform, POINTS[:count])) == count


@pytest.mark.parametrize("count", [200, 10_000])
def bench_deform_with_jacobian(benchmark: Any, count: int) -> None:
    assert len(benchmark(BENT.deform_with_jacobian, POINTS[:count])[1]) == count


@pytest.mark.parametrize("method", ["auto", "thesis"])
def bench_invert(benchmark: Any, method: Any) -> None:
    moved = BENT.deform(POINTS)
    assert benchmark(invert, BENT.volume, moved, method=method).converged.all()


def bench_folds(benchmark: Any) -> None:
    assert benchmark(fold_report, BENT).verdict == "sound"
