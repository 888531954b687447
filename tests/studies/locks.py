"""What the lock of the message bus between machines costs a hop."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from palpate.bench.table import Row, at_most, in_turns
from palpate.launch import free_endpoints
from palpate.messages.bus import make_key
from tests.studies.hops import CORES, LAPS, bare_hop

MOST_LOCKED = 1.3


def lock_rows(quick: bool, turns: int = 15) -> Iterator[Row]:
    """A hop over TCP with the lock and without it; fewer laps if quick."""
    laps = 500 if quick else LAPS
    with tempfile.TemporaryDirectory(prefix="palpate-") as folder:
        key = Path(folder) / "graph.key"
        make_key(key)
        for core, where in CORES:
            calls = {one: partial(_hop, laps, core, one) for one in ("", str(key))}
            plain, locked = (min(found) for found in in_turns(calls, turns).values())
            yield Row(f"one hop over tcp, bare sockets, {where}", f"{plain:.1f} us")
            yield Row(f"the same, locked, {where}", f"{locked:.1f} us")
            yield at_most(f"locked over plain, {where}", locked / plain, MOST_LOCKED, kind="time")


def _hop(laps: int, core: int, key: str) -> float:
    there, back = free_endpoints("127.0.0.1", ("there", "back")).values()
    return bare_hop(there, back, laps, core=core, key=key)
