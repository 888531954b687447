from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

from palpate.bench import table
from palpate.bench.suite.groups import BENCHES, FIGURES
from palpate.bench.table import Row, at_least, at_most, best_seconds, in_turns, named, run_groups

told: list[bool] = []


def good(quick: bool) -> Iterator[Row | str]:
    told.append(quick)
    yield "a heading"
    yield Row("one", "1")


def bad(quick: bool) -> Iterator[Row]:
    yield at_most("two", 2.0, 1.0, ".1f", " us")


GROUPS = {"good": f"{__name__}:good", "bad": f"{__name__}:bad"}


@pytest.fixture(autouse=True)
def here(monkeypatch):
    """Groups of this file are found whatever name it was imported by."""
    monkeypatch.setattr(table, "named", lambda place: globals()[place.rpartition(":")[2]])


def test_a_missed_demand_is_printed_and_told_by_the_exit_code():
    lines: list[str] = []
    assert run_groups(GROUPS, quick=True, echo=lines.append) == 1
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
    wanted = {"group": "good", "name": "one", "value": "1", "target": "", "holds": True}
    assert json.loads(lines[-1]) == wanted


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


def test_the_best_of_some_rounds_counts():
    clock = iter([0.0, 3.0, 10.0, 11.0, 20.0, 22.0])
    assert best_seconds(lambda: None, 3, lambda: next(clock)) == 1.0


def test_every_group_and_figure_is_where_the_table_says():
    places = [place for groups in BENCHES.values() for place in groups.values()]
    for place in [*places, *(one for some in FIGURES.values() for one in some)]:
        assert callable(named(place))
