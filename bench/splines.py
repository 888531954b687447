"""Tensor products of B-splines at scattered points, measured in turns with scipy's."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import NdBSpline

from palpate.bench.table import Row, at_most, figure, in_turns
from palpate.core.arrays import Floats
from palpate.core.splines import Basis, clamped_basis, evaluate_scattered

# Orders of derivatives along each axis.
VALUE_ORDERS = ((0, 0, 0),)
SLOPE_ORDERS = (*VALUE_ORDERS, (1, 0, 0), (0, 1, 0), (0, 0, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class SplineSettings:
    """Size of the splines, and what is demanded."""

    counts: tuple[int, ...] = (12, 16, 20)  # functions along each axis of a control lattice
    degree: int = 3
    n_points: int = 50_000  # scattered, at which they are evaluated
    n_turns: int = 7  # measurements of each time
    n_threads: int = 2  # that share the points in one of the rows
    max_ratio: float = 1.1  # processor time / scipy's; scipy does not check the points


QUICK_SPLINES = SplineSettings(n_points=20_000)


def spline_rows(quick: bool) -> Iterator[Row]:
    """Processor time of values with and without slopes, over scipy's; fewer points if quick."""
    settings = QUICK_SPLINES if quick else SplineSettings()
    rng = np.random.default_rng(0)
    bases = [clamped_basis(count, settings.degree) for count in settings.counts]
    control = rng.normal(size=(*settings.counts, 3))
    points = rng.random((settings.n_points, 3))
    knots = tuple(basis.knots for basis in bases)

    def of_scipy(orders: tuple[tuple[int, ...], ...]) -> list[Floats]:
        spline = NdBSpline(knots, control, settings.degree)
        return [spline(points, nu=order) for order in orders]

    yield from _parallel_rows(bases, control, points, settings)
    for name, orders in (("values", VALUE_ORDERS), ("values and slopes", SLOPE_ORDERS)):
        calls = {
            "palpate": partial(
                _processor_time, partial(evaluate_scattered, bases, control, points, orders)
            ),
            "scipy": partial(_processor_time, partial(of_scipy, orders)),
        }
        times = in_turns(calls, settings.n_turns)
        cost = 1e6 * min(times["palpate"]) / len(points)
        yield figure(f"{name} at {len(points)} scattered places, each", cost, ".2f", " us")
        ratio = min(times["palpate"]) / min(times["scipy"])
        yield at_most(f"{name}, over scipy's", ratio, settings.max_ratio, kind="time")


def _parallel_rows(
    bases: list[Basis], control: Floats, points: Floats, settings: SplineSettings
) -> Iterator[Row]:
    """Elapsed time with points shared among threads / with one thread, as thesis 6.1 proposes."""
    n_threads = settings.n_threads
    with ThreadPoolExecutor(n_threads) as pool:

        def shared() -> None:
            parts = np.array_split(points, n_threads)
            list(
                pool.map(lambda part: evaluate_scattered(bases, control, part, SLOPE_ORDERS), parts)
            )

        calls: dict[str, Callable[[], float]] = {
            "one": partial(
                _elapsed_time, lambda: evaluate_scattered(bases, control, points, SLOPE_ORDERS)
            ),
            "several": partial(_elapsed_time, shared),
        }
        times = in_turns(calls, settings.n_turns)
    ratio = min(times["several"]) / min(times["one"])
    yield figure(f"values and slopes by {n_threads} threads, over one", ratio, kind="time")


def _elapsed_time(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _processor_time(call: Callable[[], object]) -> float:
    start = time.thread_time()
    call()
    return time.thread_time() - start
