from __future__ import annotations

import pytest

from palpate.bench.table import Row, print_groups


@pytest.mark.parametrize(("holds", "code"), [(True, 0), (False, 1)])
def test_a_missed_demand_is_said_and_told_by_the_exit_code(holds: bool, code: int) -> None:
    row = Row("something", "3 us", "<= 2 us", holds)
    lines: list[str] = []

    assert print_groups([lambda _: [row], lambda _: []], quick=True, echo=lines.append) == code
    assert ("MISSED" in lines[0]) != holds


def test_groups_are_told_whether_to_be_quick() -> None:
    told: list[bool] = []

    def group(quick: bool) -> list[Row]:
        told.append(quick)
        return []

    print_groups([group], quick=True, echo=print)
    print_groups([group], quick=False, echo=print)

    assert told == [True, False]


def test_a_line_without_a_demand_ends_with_its_value() -> None:
    assert str(Row("cost", "3 us", "", True)).endswith("3 us")
