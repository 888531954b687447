from __future__ import annotations

from typing import Any

import pytest

from palpate.bench.suite import verb
from palpate.tools.cli import command_line as cli


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["explore", "--only", "whale"], "there is no group 'whale'; there are tracing"),
        (["bus", "--only", "whole"], "there is no group 'whole'; there are losses, hops,"),
        (["explore", "--figures", "x"], "--figures belongs to curvature, shapes, rebuild"),
    ],
)
def test_options_of_another_bench_are_refused_in_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
):
    assert cli.run(["bench", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_one_group_of_any_bench_can_be_had_as_json(monkeypatch: pytest.MonkeyPatch):
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


def test_the_figures_of_a_bench_are_drawn_first(monkeypatch: pytest.MonkeyPatch):
    drawn: list[str] = []
    monkeypatch.setattr(verb, "named", lambda place: lambda folder: drawn.append((place, folder)))
    monkeypatch.setattr(verb, "run_groups", lambda *_, **__: 0)
    assert cli.run(["bench", "rebuild", "--figures", "x"]) == 0
    assert drawn == [(place, "x") for place in verb.FIGURES["rebuild"]]
