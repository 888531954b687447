"""``palpate bench``: groups are callable, options are checked, results are compared."""

import json
from dataclasses import replace
from itertools import islice

import pytest

from palpate.bench import suite
from palpate.bench.results import comparison_lines, read_results
from palpate.bench.table import Row, at_most, figure, run_groups
from palpate.tools.cli.command_line import run

GROUPS = [(name, group) for name, bench in suite.BENCHES.items() for group in bench.groups]
CHEAP = [("speed", "touches"), ("speed", "splines"), ("speed", "messages"), ("effects", "effects")]


@pytest.mark.parametrize(("name", "group"), GROUPS)
def test_each_group_is_callable(name, group):
    place = suite.chosen_groups(name, group, {})[f"{name}/{group}"]
    assert callable(suite.named(place))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "group"), CHEAP)
def test_cheap_group_yields_figures(name, group):
    place = suite.chosen_groups(name, group, {})[f"{name}/{group}"]
    lines = list(islice(suite.named(place)(True), 2))
    assert any(getattr(line, "figures", ()) for line in lines)


@pytest.mark.parametrize(("arguments", "message"), [
    (["speeed"], "there is no bench 'speeed'; did you mean 'speed'?"),
    (["speed", "--only", "scene"], "there are touches, messages, splines, scenes, runs"),
    (["effects", "--cost", "robot"], "--cost: nothing that is measured here takes it"),
    (["speed", "--compare", "absent.json"], "absent.json"),
])  # fmt: skip
def test_wrong_arguments_are_refused(arguments, message, capsys):
    assert run(["bench", *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["--list"], ["--help"]])
def test_list_and_help_name_all_benches(arguments, capsys):
    assert run(["bench", *arguments]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in suite.BENCHES)


def rows(quick: bool):
    yield figure("time of a hop", 5.0, unit=" ms", repeats=(4.9, 5.1))
    yield at_most("error", 0.3, 0.2, unit=" mm")
    yield Row("count", "7")


def failing(quick: bool):
    yield figure("before the fault", 1.0)
    raise ValueError("the peer is missing")


def measure(tmp_path, monkeypatch, *options: str) -> tuple[int, dict]:
    monkeypatch.setattr(suite, "BENCHES", {"speed": suite.Bench("", {"a": "x:y"})})
    monkeypatch.setattr(suite, "chosen_groups", lambda *_: {"speed/a": rows})
    out = tmp_path / "results.json"
    code = run(["bench", "speed", "--out", str(out), *options])
    return code, json.loads(out.read_text())


def test_missed_demand_is_error_only_if_strict_but_a_fault_always(tmp_path, monkeypatch, capsys):
    code, results = measure(tmp_path, monkeypatch)
    assert code == 0 and "MISSED" in capsys.readouterr().out
    assert [line["holds"] for line in results["lines"]] == [True, False, True]
    assert run_groups({"a": rows}, quick=True, strict=True) == 1
    assert run_groups({"a": failing, "b": rows}, quick=True) == 1  # the others are measured
    printed = capsys.readouterr().out
    assert "the peer is missing" in printed and "time of a hop" in printed


@pytest.mark.parametrize(("new", "has_changed"), [
    (figure("time of a hop", 9.0, unit=" ms", repeats=(8.9, 9.1)), True),
    (figure("time of a hop", 5.15, unit=" ms", repeats=(5.05, 5.25)), False),
    (Row("count", "8"), True),
    (at_most("error", 0.305, 0.2, unit=" mm"), False),
    (at_most("error", 0.36, 0.2, unit=" mm"), True),
])  # fmt: skip
def test_only_changes_beyond_noise_are_listed(tmp_path, monkeypatch, new, has_changed):
    measure(tmp_path, monkeypatch)
    path = tmp_path / "results.json"
    old = read_results(path, quick=False)
    old = replace(old, machine={**old.machine, "load": 0.0})  # so that times are compared
    values = {"value": new.value, "figures": tuple(new.figures)}
    lines = (replace(line, **values) if line.name == new.name else line for line in old.lines)
    now = replace(old, lines=tuple(lines))
    assert (new.name in "\n".join(comparison_lines(old, now, path))) == has_changed


@pytest.mark.parametrize("text", ["", "{}", '{"form": "another", "version": 1}', "[1, 2"])
def test_files_of_another_form_are_refused(tmp_path, capsys, text):
    path = tmp_path / "old.json"
    path.write_text(text)
    assert run(["bench", "speed", "--compare", str(path)]) == 2
    assert str(path) in capsys.readouterr().err
