"""Damaged input: how much of it is accepted and refused, how long that takes, and what is amiss."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from palpate.launch.bench_row import Row
from palpate.launch.damage.guarded import Tally, tally
from palpate.launch.damage.kinds import KINDS
from palpate.launch.damage.trial import SECONDS

COUNTS: Mapping[str, int] = {
    "messages": 100_000,
    "recordings": 2_000,
    "meshes": 2_000,
    "scenes": 500,
    "solids": 2_000,
}
"""Inputs of each kind."""
QUICK: Mapping[str, int] = {
    "messages": 2_000,
    "recordings": 50,
    "meshes": 100,
    "scenes": 50,
    "solids": 50,
}
MOST_MEMORY = 64.0
"""Beyond what a process has before the trials, MB."""
SHOWN = 5
"""Most defects of a kind that are told, each with the number by which it can be repeated."""


def damage(quick: bool) -> Iterator[Row]:
    """Rows for every kind of input."""
    for name, count in (QUICK if quick else COUNTS).items():
        yield from rows_of(name, count, tally(KINDS[name], count))


def rows_of(name: str, count: int, found: Tally) -> Iterator[Row]:
    """Rows for what came of so many inputs of a kind."""
    said = f"{found.accepted}, {found.refused}"
    yield Row(f"{count:,} damaged {name}: accepted, refused", said, "", True)
    defects = found.defects
    yield Row(f"damaged {name}: other errors", str(len(defects)), "0", not defects)
    for defect in defects[:SHOWN]:
        yield Row(f"  {defect}", "", "", True)
    slowest = f"{1e3 * found.slowest:.0f} ms"
    yield Row(f"damaged {name}: slowest", slowest, "<= 1 s", found.slowest <= SECONDS)
    memory = f"{found.memory:.0f} MB"
    yield Row(f"damaged {name}: memory", memory, "<= 64 MB", found.memory <= MOST_MEMORY)
