"""How long a call takes."""

from __future__ import annotations

import time
from collections.abc import Callable


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
