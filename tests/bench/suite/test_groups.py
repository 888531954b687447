from __future__ import annotations

from typing import Any

import pytest

from palpate.bench.suite.groups import SceneFigures

GOOD: dict[str, Any] = {
    "chamfer_m": 1e-4,
    "size_m": 0.1,
    "sampling_floor_m": 1e-5,
    "contours": 9,
    "touches": 200,
    "touches_per_s": 400.0,
    "gaps": 0,
    "duplicates": 0,
    "watertight": True,
    "genus": 0,
}


def outcome(
    wall: float = 8.0, hashes: frozenset[str] = frozenset({"a"}), **changes: Any
) -> SceneFigures:
    return SceneFigures("vase", {**GOOD, **changes}, wall, hashes)


def test_a_run_that_meets_every_demand_has_no_faults():
    assert (outcome().missed, outcome().holds) == ([], True)
    line = "vase          0.100 %  0.010 %        9     200   400   8.0 s    0"
    assert str(outcome()) == line
    assert str(outcome(wall=20.0)).endswith("  20.0 s    0  MISSED wall")


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"chamfer_m": 3e-4}, "chamfer"),
        ({"contours": 16}, "contours"),
        ({"wall": 15.1}, "wall"),
        ({"touches_per_s": 299.0}, "per s"),
        ({"gaps": 1}, "lost"),
        ({"duplicates": 1, "gaps": 1}, "lost"),
        ({"watertight": False}, "not watertight"),
        ({"genus": 1}, "has handles"),
        ({"hashes": frozenset({"a", "b"})}, "not repeatable"),
    ],
)
def test_each_missed_demand_is_named(changes: dict[str, Any], fault: str):
    assert outcome(**changes).missed == [fault]
