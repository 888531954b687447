from __future__ import annotations

import json
from collections.abc import Iterator, Sequence

import pytest

from palpate.bench import table
from palpate.bench.suite import BENCHES
from palpate.bench.table import (
    Figure,
    Measured,
    Row,
    at_least,
    at_most,
    figure,
    figure_of,
    in_turns,
    named,
    printed_figures,
    run_groups,
)
from palpate.launch.files import InputError

told: list[bool] = []


def good(quick: bool) -> Iterator[Row | str]:
    told.append(quick)
    yield "a heading"
    yield Row("one", "1")


def bad(quick: bool) -> Iterator[Row]:
    yield at_most("two", 2.0, 1.0, ".1f", " us")


def failing(quick: bool) -> Iterator[Row]:
    yield Row("three", "3")
    raise RuntimeError("the peer died")


def misused(quick: bool) -> Iterator[Row]:
    raise InputError("run: is no run")
    yield


GROUPS = {"good": f"{__name__}:good", "bad": f"{__name__}:bad"}


@pytest.fixture(autouse=True)
def here(monkeypatch):
    """Groups of this file are found whatever name it was imported by."""
    monkeypatch.setattr(table, "named", lambda place: globals()[place.rpartition(":")[2]])


def test_a_missed_demand_is_printed_and_told_by_the_exit_code_if_that_is_strict():
    lines: list[str] = []
    assert run_groups(GROUPS, quick=True, strict=True, echo=lambda line: None) == 1
    assert run_groups(GROUPS, quick=True, echo=lines.append) == 0
    assert [line.split()[0] for line in lines] == ["--", "a", "one", "--", "two"]
    assert lines[-1].endswith("2.0 us  <= 1 us   MISSED")
    assert told[-1] is True


def test_a_group_by_itself_is_printed_alone_as_text_or_as_json():
    lines: list[str] = []
    only = {"good": GROUPS["good"]}
    assert run_groups(only, quick=False, echo=lines.append) == 0
    assert told[-1] is False
    assert lines == ["a heading", str(Row("one", "1"))]
    assert run_groups(only, quick=False, as_json=True, echo=lines.append) == 0
    found = json.loads(lines[-1])
    assert [one["value"] for one in found.pop("figures")] == [1]
    wanted = {"group": "good", "name": "one", "value": "1", "target": "", "holds": True}
    assert found == wanted


def test_a_group_that_fails_is_told_and_is_not_the_end_of_the_others():
    lines: list[str] = []
    kept: dict[str, tuple[list[str], str]] = {}

    def keep(group: str, found: Sequence[Measured], failure: str) -> None:
        kept[group] = [one.name for one in found], failure

    groups = {"failing": failing, "good": good}
    assert run_groups(groups, quick=True, echo=lines.append, keep=keep) == 1
    assert lines[2].split() == ["failing:", "FAILED", "RuntimeError:", "the", "peer", "died"]
    assert kept == {
        "failing": (["three"], "RuntimeError: the peer died"),
        "good": (["one"], ""),
    }
    run_groups({"failing": failing}, quick=True, as_json=True, echo=lines.append)
    assert json.loads(lines[-1])["name"] == "failing: FAILED"
    with pytest.raises(InputError, match="is no run"):
        run_groups({"misused": misused}, quick=True, echo=lines.append)


def test_a_row_has_its_number_and_else_those_of_its_text():
    assert at_most("a", 0.12345, 1.0, ".1f", " us").figures == (figure_of(0.12345, "us"),)
    assert at_least("a", 0.95, 0.9, ".1%").figures[0].value == pytest.approx(95.0)
    assert figure("a", 3.0, kind="time").figures[0].kind == "time"
    assert Row("a", "2 of 3 closed").figures == (figure_of(2), figure_of(3))


@pytest.mark.parametrize(
    ("text", "values", "kinds", "spreads"),
    [
        ("11, 242", [11, 242], ["count", "count"], [0, 0]),
        ("0.14 x, 0.039 mm", [0.14, 0.039], ["error", "error"], [0.005, 0.0005]),
        ("1,234 us", [1234], ["time"], [0.5]),
        ("4.0e-17 m", [4e-17], ["error"], [0.5e-18]),
        ("-1.5%, 2e3 /s", [-1.5, 2000], ["error", "time"], [0.05, 500]),
        ("v1 not installed", [], [], []),
    ],
)
def test_printed_numbers_are_as_exact_as_their_last_digit(text, values, kinds, spreads):
    found = printed_figures(text)
    assert [one.value for one in found] == values
    assert [one.kind for one in found] == kinds
    assert [one.spread for one in found] == pytest.approx(spreads)


def test_repeats_give_a_spread_and_what_is_not_finite_has_no_value():
    one = figure_of(2.0, " ms", repeats=[1.0, 2.0, 4.0], name="wall")
    wanted = Figure(value=2.0, unit="ms", kind="time", spread=1.5, repeated=True, name="wall")
    assert one == wanted
    assert figure_of(float("nan"), "mm").value is None
    assert not figure_of(2.0, repeats=[1.0]).repeated


def test_a_line_without_a_demand_ends_with_its_value():
    assert str(Row("cost", "3 us")).endswith("3 us")


@pytest.mark.parametrize(
    ("row", "target", "holds"),
    [
        (at_most("a", 2.0, 2.0), "<= 2", True),
        (at_most("a", 2.1, 2.0), "<= 2", False),
        (at_least("a", 0.95, 0.95, ".1%"), ">= 95%", True),
        (at_least("a", 0.94, 0.95, ".1%"), ">= 95%", False),
        (at_least("a", float("nan"), 0.0), ">= 0", False),
    ],
)
def test_a_demand_is_met_up_to_its_bound(row, target, holds):
    assert (row.target, row.holds) == (target, holds)


def test_what_is_compared_is_called_in_turns():
    order: list[str] = []

    def call(name: str) -> float:
        order.append(name)
        return float(len(order))

    assert in_turns({"a": lambda: call("a"), "b": lambda: call("b")}, 2) == {
        "a": [1.0, 3.0],
        "b": [2.0, 4.0],
    }


def test_every_group_is_where_the_table_says():
    for one in BENCHES.values():
        for place in one.groups.values():
            assert callable(named(f"palpate.bench.{place}"))
