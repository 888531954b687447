from __future__ import annotations

from typing import Any

import pytest

from palpate.bench.suite import groups as verb
from palpate.bench.suite.groups import SceneFigures
from palpate.tools.cli import command_line as cli

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
def test_each_missed_demand_is_named(changes, fault):
    assert outcome(**changes).missed == [fault]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["explore", "--only", "whale"], "there is no group 'whale'; there are tracing"),
        (["bus", "--only", "whole"], "there is no group 'whole'; there are losses, hops,"),
        (["explore", "--figures", "x"], "--figures belongs to curvature, shapes, rebuild"),
    ],
)
def test_options_of_another_bench_are_refused_in_one_sentence(capsys, arguments, words):
    assert cli.run(["bench", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_one_group_of_any_bench_can_be_had_as_json(monkeypatch):
    asked: list[Any] = []

    def run(groups: Any, **how: Any) -> int:
        asked.append((groups, how["quick"], how["as_json"]))
        return 1

    monkeypatch.setattr(verb, "run_groups", run)
    for what in ("explore", "shapes"):
        only = next(iter(verb.BENCHES[what]))
        assert cli.run(["bench", what, "--quick", "--only", only, "--json"]) == 1
        assert asked.pop() == ({only: verb.BENCHES[what][only]}, True, True)
    assert cli.run(["bench"]) == 1
    assert asked.pop() == (verb.BENCHES["scenes"], False, False)


def test_the_figures_of_a_bench_are_drawn_first(monkeypatch):
    drawn: list[str] = []
    monkeypatch.setattr(verb, "named", lambda place: lambda folder: drawn.append((place, folder)))
    monkeypatch.setattr(verb, "run_groups", lambda *_, **__: 0)
    assert cli.run(["bench", "rebuild", "--figures", "x"]) == 0
    assert drawn == [(place, "x") for place in verb.FIGURES["rebuild"]]
