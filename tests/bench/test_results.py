from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate.bench.results import (
    FORM,
    VERSION,
    Results,
    ResultsFile,
    compare_results,
    comparison_lines,
    has_moved,
    read_results,
    this_machine,
)
from palpate.bench.table import Figure, Row, figure_of, measured
from palpate.launch.files import InputError

MACHINE: dict[str, Any] = {
    "cpu": "Abacus 3",
    "cores": 2,
    "python": "3.11.7",
    "numpy": "2.4.6",
    "scipy": "1.17.1",
    "blas": "openblas 0.3",
    "load": 0.5,
}
HEAD: dict[str, Any] = {
    "form": FORM,
    "version": VERSION,
    "palpate": "0.1.0",
    "date": "2026-11-22T10:00:00+00:00",
    "quick": True,
    "machine": MACHINE,
}


def line(name: str, figures: list[Any], target: str = "", group: str = "a/b") -> dict[str, Any]:
    text = {"group": group, "name": name, "value": "as printed", "target": target, "holds": True}
    return {**text, "figures": figures}


def number(value: float | None, unit: str = "", kind: str = "error", **more: Any) -> dict[str, Any]:
    return {"value": value, "unit": unit, "kind": kind, **more}


def results(folder: Path, name: str, *lines: dict[str, Any], **head: Any) -> Results:
    path = folder / name
    path.write_text(json.dumps({**HEAD, **head, "lines": lines}), encoding="utf-8")
    return read_results(path, quick=True)


@pytest.fixture
def both(tmp_path):
    old = results(
        tmp_path,
        "old.json",
        line("error", [number(1.0, "mm")]),
        line("calm error", [number(1.0, "mm")]),
        line("touches", [number(200, kind="count"), number(9, kind="count", name="contours")]),
        line("rate", [number(300.0, "/s", "time")], ">= 250 /s"),
        line("share", [number(0.5)], ">= 0.4"),
        line("gone", [number(1.0)]),
        line("twice", [number(1.0)]),
        line("twice", [number(2.0)]),
        line("elsewhere", [number(1.0)], group="not/measured"),
    )
    new = results(
        tmp_path,
        "new.json",
        line("error", [number(1.05, "mm")]),
        line("calm error", [number(1.015, "mm")]),
        line("touches", [number(200, kind="count"), number(10, kind="count", name="contours")]),
        line("rate", [number(350.0, "/s", "time")], ">= 250 /s"),
        line("share", [number(0.3)], ">= 0.4") | {"holds": False},
        line("fresh", [number(1.0)]),
        line("twice", [number(1.0)]),
        line("twice", [number(2.0)]),
    )
    return old, new


def test_what_moved_beyond_noise_is_named_and_the_rest_counted(both):
    old, new = both
    assert list(comparison_lines(old, new, Path("old.json"))) == [
        "compared with old.json: palpate 0.1.0, 2026-11-22T10:00:00+00:00, Abacus 3, "
        "a load of 0.5 then and 0.5 now",
        "worse   a/b: error: 1 mm -> 1.05 mm (+5.0%)",
        "worse   a/b: share: 0.5 -> 0.3 (-40.0%)  MISSED",
        "better  a/b: rate: 300 /s -> 350 /s (+16.7%)",
        "moved   a/b: touches, contours: 9 -> 10 (+11.1%)",
        "figures: 4 moved beyond noise, 4 did not, 1 are new, 1 are gone",
    ]


@pytest.mark.parametrize("other", [{"cpu": "Abacus 4"}, {"cores": 4}, {"load": 1.6}])
def test_times_of_another_or_a_busy_machine_are_not_compared(both, other):
    old, new = both
    elsewhere = replace(new, machine={**MACHINE, **other})
    moves, counts = compare_results(old, elsewhere)
    assert [one.line.name for one in moves] == ["error", "share", "touches"]
    assert counts["are times of another or of a busy machine, not compared"] == 1
    *_, last = comparison_lines(old, elsewhere, Path("old.json"))
    assert last.endswith(", 1 are times of another or of a busy machine, not compared")


@pytest.mark.parametrize(
    ("old", "new", "moved"),
    [
        (figure_of(100), figure_of(101), True),
        (figure_of(100), figure_of(100), False),
        (figure_of(1.0, "ms"), figure_of(1.09, "ms"), False),
        (figure_of(1.0, "ms"), figure_of(1.2, "ms"), True),
        (figure_of(1.0, "mm"), figure_of(0.97, "mm"), True),
        (figure_of(1.0, "mm"), figure_of(None or float("nan"), "mm"), True),
        (figure_of(float("nan")), figure_of(float("nan")), False),
        (figure_of(1.0, "mm"), figure_of(1.0, "um"), True),
        (figure_of(1e-16, "mm"), figure_of(3e-16, "mm"), False),
        # Repeats say more than the rule, either way.
        (figure_of(1.0, "s", repeats=[0.5, 2.5]), figure_of(1.9, "s", repeats=[1.9, 2.0]), False),
        (
            figure_of(1.0, "s", repeats=[1.0, 1.01]),
            figure_of(1.05, "s", repeats=[1.05, 1.06]),
            True,
        ),
        (figure_of(1.0, "s", repeats=[0.9, 1.1]), figure_of(1.15, "s"), False),
    ],
)
def test_a_figure_moves_beyond_its_repeats_or_else_a_rule(old, new, moved):
    assert has_moved(old, new) is moved


def test_what_was_only_printed_is_not_known_better_than_its_last_digit():
    rough = Figure(value=0.01, kind="error", spread=0.005)
    assert not has_moved(rough, Figure(value=0.02, kind="error", spread=0.005))
    assert has_moved(rough, Figure(value=0.03, kind="error", spread=0.005))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("not JSON", "holds no results of palpate dev bench: JSON is malformed"),
        ("[]", "holds no results of palpate dev bench"),
        (json.dumps({"form": "other"}), "holds no results of palpate dev bench"),
        (json.dumps({**HEAD, "version": 9}), "holds results of version 9; this palpate reads"),
        (json.dumps({"form": FORM, "version": VERSION}), "holds no results of palpate dev bench"),
        (json.dumps({**HEAD, "quick": False}), "was measured without --quick; measure as it was"),
    ],
)
def test_a_file_that_cannot_be_compared_with_is_refused_in_one_sentence(tmp_path, text, words):
    path = tmp_path / "old.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_results(path, quick=True)
    assert str(caught.value).startswith(f"{path}: {words}")
    assert "\n" not in str(caught.value)


def test_results_are_in_the_file_after_each_group(tmp_path):
    path = tmp_path / "new.json"
    file = ResultsFile(path, quick=True)
    file.add("a/b", [measured("a/b", Row("touches", "200"))], "")
    file.add("a/c", [], "RuntimeError: died")
    found = read_results(path, quick=True)
    assert found == file.results
    assert found.failed == {"a/c": "RuntimeError: died"}
    assert [one.figures[0].value for one in found.lines] == [200]
    assert compare_results(found, found)[1]["did not"] == 1


def test_the_machine_is_described():
    found = this_machine()
    assert {"cpu", "cores", "python", "numpy", "scipy", "blas", "load"} == set(found)
    assert all(value for key, value in found.items() if key != "load")
