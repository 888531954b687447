"""What the lock between machines costs: bare hops over tcp, with and without CURVE."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from palpate.launch.bench_bare import bare_hop
from palpate.launch.bench_row import Row
from palpate.launch.hosts.addresses import free_endpoints
from palpate.messages.bus.curve import make_key

LIMIT = 1.3


def curve_rows(laps: int = 2000, turns: int = 15) -> Iterator[Row]:
    """Rows of the table; the two are measured in turn, so that both meet the same load."""
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        key = Path(folder) / "graph.key"
        make_key(key)
        for core, where in ((0, "one core"), (-1, "free cores")):
            plain, locked = [], []
            for _ in range(turns):
                plain.append(_hop(laps, core, ""))
                locked.append(_hop(laps, core, str(key)))
            ratio = min(locked) / min(plain)
            yield Row(f"one hop over tcp, bare sockets, {where}", f"{min(plain):.1f} us", "", True)
            yield Row(f"the same, locked, {where}", f"{min(locked):.1f} us", "", True)
            yield Row(
                f"locked over plain, {where}", f"{ratio:.2f}", f"<= {LIMIT:g}", ratio <= LIMIT
            )


def _hop(laps: int, core: int, key: str) -> float:
    ends = free_endpoints("127.0.0.1", ("there", "back"))
    return bare_hop(ends["there"], ends["back"], laps, core=core, key=key)
