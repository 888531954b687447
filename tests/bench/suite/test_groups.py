from __future__ import annotations

from typing import Any

import pytest

from palpate.bench.suite.groups import SceneFigures, missed_by_scene

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


def test_a_run_that_meets_every_demand_has_no_faults() -> None:
    assert missed_by_scene(outcome()) == []


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
def test_each_missed_demand_is_named(changes: dict[str, Any], fault: str) -> None:
    assert missed_by_scene(outcome(**changes)) == [fault]
