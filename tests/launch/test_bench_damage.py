from __future__ import annotations

import pytest

from palpate.launch.bench_damage import COUNTS, QUICK, rows_of
from palpate.launch.damage.guarded import Tally
from palpate.launch.damage.kinds import KINDS


def test_every_kind_is_counted_fully_and_quickly() -> None:
    assert set(COUNTS) == set(QUICK) == set(KINDS)
    assert all(QUICK[name] < COUNTS[name] for name in QUICK)


def test_what_holds_is_told_in_four_rows() -> None:
    rows = list(rows_of("meshes", 2000, Tally(200, 1800, [], 0.25, 7, 12.4, 8)))

    assert all(row.holds for row in rows)
    assert [row.value for row in rows] == ["200, 1800", "0", "250 ms", "12 MB"]
    assert rows[0].name == "2,000 damaged meshes: accepted, refused"


@pytest.mark.parametrize(
    ("found", "missed"),
    [
        (Tally(1, 1, ["meshes 3: KeyError: 'x'"]), "damaged meshes: other errors"),
        (Tally(1, 1, [], 1.01), "damaged meshes: slowest"),
        (Tally(1, 1, [], 0.1, 2, 64.1), "damaged meshes: memory"),
    ],
)
def test_each_missed_demand_is_named(found: Tally, missed: str) -> None:
    rows = list(rows_of("meshes", 2, found))

    assert [row.name for row in rows if not row.holds] == [missed]


def test_a_defect_is_told_with_its_number() -> None:
    defects = [f"meshes {i}: KeyError: 'x'" for i in range(9)]
    rows = list(rows_of("meshes", 20, Tally(1, 1, defects)))

    assert [row.name for row in rows if row.name.startswith("  ")] == [
        f"  {one}" for one in defects[:5]
    ]
