"""What studies add to a table of figures: a demand from below, and the least time of a call."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from palpate.bench.table import Row, at_most, figure


def at_least(
    name: str, value: float, least: float, form: str = ".2f", unit: str = "", **more: Any
) -> Row:
    """A figure that may not be smaller than this; `form` is the value's."""
    target = at_most(name, value, least, form, unit).target.replace("<=", ">=")
    return figure(name, value, form, unit, target, **more)._replace(holds=value >= least)


def best_seconds(
    call: Callable[[], object], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """The least time of some rounds: what a busy computer adds is not the call's."""
    times = []
    for _ in range(rounds):
        began = clock()
        call()
        times.append(clock() - began)
    return min(times)
