"""Tensor products of B-splines at scattered places, against scipy's, by turns."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from scipy.interpolate import NdBSpline

from palpate.bench.table import Row, at_most, figure, in_turns
from palpate.core.arrays import Floats
from palpate.core.splines import Basis, clamped_basis, evaluate_scattered

COUNTS, DEGREE = (12, 16, 20), 3  # Functions along each axis of a control lattice
N_PLACES, N_QUICK_PLACES = 50_000, 20_000
N_TURNS = 7
N_THREADS = 2
VALUE = ((0, 0, 0),)
SLOPES = (*VALUE, (1, 0, 0), (0, 1, 0), (0, 0, 1))
MAX_RATIO = 1.1  # Processor time over scipy's: the checks of the arguments are ours


def spline_rows(quick: bool) -> Iterator[Row]:
    """Processor time of values, and of values with all slopes, and its ratio to scipy's."""
    rng = np.random.default_rng(0)
    bases = [clamped_basis(count, DEGREE) for count in COUNTS]
    control = rng.normal(size=(*COUNTS, 3))
    places = rng.random((N_QUICK_PLACES if quick else N_PLACES, 3))
    knots = tuple(basis.knots for basis in bases)

    def of_scipy(orders: tuple[tuple[int, ...], ...]) -> list[Floats]:
        spline = NdBSpline(knots, control, DEGREE)
        return [spline(places, nu=order) for order in orders]

    yield from _parallel_rows(bases, control, places)
    for name, orders in (("values", VALUE), ("values and slopes", SLOPES)):
        calls = {
            "palpate": partial(
                _seconds, partial(evaluate_scattered, bases, control, places, orders)
            ),
            "scipy": partial(_seconds, partial(of_scipy, orders)),
        }
        found = {who: min(each) for who, each in in_turns(calls, N_TURNS).items()}
        each = 1e6 * found["palpate"] / len(places)
        yield figure(f"{name} at {len(places)} scattered places, each", each, ".2f", " us")
        ratio = found["palpate"] / found["scipy"]
        yield at_most(f"{name}, over scipy's", ratio, MAX_RATIO, kind="time")


def _parallel_rows(bases: list[Basis], control: Floats, places: Floats) -> Iterator[Row]:
    """Time on the clock with the places shared among threads, over that of one: 6.1 wishes so."""
    with ThreadPoolExecutor(N_THREADS) as pool:

        def shared() -> None:
            parts = np.array_split(places, N_THREADS)
            list(pool.map(lambda one: evaluate_scattered(bases, control, one, SLOPES), parts))

        calls: dict[str, Callable[[], float]] = {
            "one": partial(_wall, lambda: evaluate_scattered(bases, control, places, SLOPES)),
            "several": partial(_wall, shared),
        }
        found = {who: min(each) for who, each in in_turns(calls, N_TURNS).items()}
    ratio = found["several"] / found["one"]
    yield figure(f"values and slopes by {N_THREADS} threads, over one", ratio, kind="time")


def _wall(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def _seconds(call: Callable[[], object]) -> float:
    began = time.thread_time()
    call()
    return time.thread_time() - began
