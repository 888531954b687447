from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from palpate.bench import suite as verb
from palpate.bench.table import Row
from palpate.tools.cli import command_line as cli


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["procedures", "--only", "whale"], "there is no group 'whale'; there are procedures"),
        (["speed", "--only", "whole"], "there is no group 'whole'; there are touches"),
        (["all", "--only", "whole"], "there is no group 'whole'; there are speed/touches, "),
        (["procedures", "--out", "no/where.json"], "no/where.json: cannot be written: there is no"),
        (["procedures", "--compare", "nothing.json"], "nothing.json: the results cannot be read"),
        (["procedures", "--against", "older"], "--against belongs to speed"),
        (["speed", "--only", "scenes", "--against", "no/where"], "must be a checkout of palpate"),
    ],
)
def test_options_of_another_bench_are_refused_in_one_sentence(capsys, arguments, words):
    assert cli.run(["dev", "bench", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_one_group_of_any_bench_can_be_had_as_json(monkeypatch):
    asked: list[Any] = []

    def run(groups: Any, **how: Any) -> int:
        asked.append((groups, how["quick"], how["as_json"], how["strict"]))
        return 1

    monkeypatch.setattr(verb, "run_groups", run)
    for what in ("procedures", "speed"):
        only, place = next(iter(verb.BENCHES[what].groups.items()))
        wanted = {f"{what}/{only}": f"palpate.bench.{place}"}
        for bench, group in ((what, only), ("all", f"{what}/{only}")):
            assert cli.run(["dev", "bench", bench, "--quick", "--only", group, "--json"]) == 1
            assert asked.pop() == (wanted, True, True, False)
    assert cli.run(["dev", "bench", "--strict"]) == 1
    places = verb.BENCHES["speed"].groups.items()
    wanted = {f"speed/{name}": f"palpate.bench.{place}" for name, place in places}
    assert asked.pop() == (wanted, False, False, True)


def test_all_is_every_group_of_every_bench(monkeypatch):
    asked: list[Any] = []
    monkeypatch.setattr(verb, "run_groups", lambda groups, **_: asked.extend(groups) or 0)
    assert cli.run(["dev", "bench", "all"]) == 0
    assert len(asked) == sum(len(one.groups) for one in verb.BENCHES.values())


def test_results_are_written_and_compared_with(monkeypatch, tmp_path, capsys):
    touches = [100]

    def rows(quick: bool) -> Iterator[Row]:
        yield Row("touches", str(touches[0]))

    bench = verb.Bench("two figures", {"one": ""})
    monkeypatch.setattr(verb, "BENCHES", {"procedures": bench})
    monkeypatch.setattr(verb, "_chosen", lambda *_: {"procedures/one": rows})
    out = tmp_path / "new.json"
    assert cli.run(["dev", "bench", "procedures", "--out", str(out)]) == 0
    assert cli.run(["dev", "bench", "procedures", "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
    touches[0] = 99
    assert cli.run(["dev", "bench", "procedures", "--compare", str(out)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[-2:] == [
        "moved   procedures/one: touches: 100 -> 99 (-1.0%)",
        "figures: 1 moved beyond noise",
    ]


def test_the_help_names_every_bench(capsys):
    assert cli.run(["dev", "bench", "--help"]) == 0
    told = capsys.readouterr().out
    for name, one in verb.BENCHES.items():
        assert f"  {name:<10} {one.told[:30]}" in told
