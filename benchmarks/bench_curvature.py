"""Filters, jets and curvature of one frame. Run with ``./go test benchmarks``."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.filters import adaptive_wiener, median_filter
from palpate.core.touch.impulses import robust_clean
from palpate.core.touch.jet_design import design_of
from palpate.core.touch.jet_fit import fit_jet, fit_robust_jet
from palpate.core.touch.pad import Pad

PAD = Pad(rows=16, cols=16, pitch=0.001, thickness=0.003, dome=0.0, saturation=0.8)
X, Y = PAD.grid()
NOISE = 10e-6
RNG = np.random.default_rng(0)
HEIGHT = 0.5 * (X**2 + Y**2) / 0.04 + NOISE * RNG.normal(size=X.shape)
IMAGE = 2.2e-3 - HEIGHT
STRUCK = np.where(RNG.random(X.shape) < 0.08, 2.4e-3, IMAGE)
ROOF = 0.5 * np.abs(X + 0.2 * Y) + NOISE * RNG.normal(size=X.shape)
ALL = np.ones((16, 16), bool)
PART = np.hypot(X, Y) < 6e-3
ACROSS = np.array([0.0, 1.0, 0.0])


def bench_robust_clean_of_a_clean_frame(benchmark: Any) -> None:
    assert not benchmark(robust_clean, PAD, IMAGE, 5e-5, NOISE).impulses.any()


def bench_robust_clean_of_a_frame_with_impulses(benchmark: Any) -> None:
    assert benchmark(robust_clean, PAD, STRUCK, 5e-5, NOISE).impulses.any()


def bench_wiener(benchmark: Any) -> None:
    benchmark(adaptive_wiener, IMAGE, NOISE**2)


def bench_median(benchmark: Any) -> None:
    benchmark(median_filter, IMAGE)


def bench_jet_of_a_full_pad(benchmark: Any) -> None:
    assert benchmark(fit_jet, PAD, HEIGHT, ALL).derivatives.shape == (5,)


def bench_jet_of_a_contact_not_met_before(benchmark: Any) -> None:
    def fresh() -> None:
        design_of.cache_clear()
        fit_jet(PAD, HEIGHT, PART)

    benchmark(fresh)


def bench_robust_jet(benchmark: Any) -> None:
    assert benchmark(fit_robust_jet, PAD, HEIGHT, ALL, NOISE) is not None


def bench_patch_of_a_full_pad(benchmark: Any) -> None:
    assert benchmark(feel_patch, PAD, HEIGHT, ALL, ACROSS, NOISE).kind == "smooth"


def bench_patch_of_a_contact_not_met_before(benchmark: Any) -> None:
    def fresh() -> str:
        design_of.cache_clear()
        return feel_patch(PAD, HEIGHT, PART, ACROSS, NOISE).kind

    assert benchmark(fresh) == "smooth"


def bench_patch_of_an_edge(benchmark: Any) -> None:
    assert benchmark(feel_patch, PAD, ROOF, ALL, ACROSS, NOISE).kind == "edge"
