from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from palpate.launch.bag.decoded import open_source, stems
from palpate.launch.bag.export_csv import write_csv

Rows = list[dict[str, str]]


@pytest.fixture
def folder(explored: Path, tmp_path: Path) -> Path:
    write_csv(open_source(explored), tmp_path / "tables")
    return tmp_path / "tables"


def rows(path: Path) -> Rows:
    csv.field_size_limit(1 << 24)
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_each_topic_has_a_table_with_a_row_for_each_message(folder: Path) -> None:
    names = {path.name: len(rows(path)) for path in folder.glob("*.csv")}

    assert names == {
        "contour_traced.csv": 2,
        "log.csv": 1,
        "model_shape.csv": 2,
        "plan_done.csv": 1,
        "score.csv": 1,
        "touch_info.csv": 1,
        "touch_patch.csv": 1,
        "touch_raw.csv": 3,
        "truth.csv": 1,
    }


def test_a_row_begins_with_number_and_times(folder: Path) -> None:
    found = rows(folder / "touch_raw.csv")

    assert list(found[0])[:4] == ["seq", "sent_s", "robot_time", "goal"]
    assert [row["seq"] for row in found] == ["0", "1", "2"]
    # The first message of the recording was the truth, the second the sensor: 7 ms apart.
    assert [row["sent_s"] for row in found] == ["0.014000000", "0.021000000", "0.028000000"]
    assert [float(row["robot_time"]) for row in found] == [0.0, 0.5, 1.0]


def test_an_array_of_one_shape_has_a_column_for_each_element(folder: Path) -> None:
    row = rows(folder / "touch_raw.csv")[1]

    assert [float(row[f"pose.{i}"]) for i in range(7)] == [0.011, 0.02, 0.03, 0, 0, 0, 1]
    values = [float(row[f"array.{i}.{j}"]) for i in range(2) for j in range(3)]
    assert values == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert "array" not in row and "array.2.0" not in row


def test_an_array_whose_shape_varies_and_a_list_are_json(folder: Path) -> None:
    one, other = rows(folder / "contour_traced.csv")

    assert json.loads(one["points"]) == [[0.0, 0.0, 0.0]]
    assert json.loads(other["points"]) == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]
    assert (one["gap_whys"], other["gap_whys"]) == ("[]", '["missed"]')
    assert json.loads(rows(folder / "model_shape.csv")[1]["dropped_why"])[1] == 'Lücke, "offen"'


def test_a_table_has_a_column_for_each_name_that_occurs(folder: Path) -> None:
    one, other = rows(folder / "model_shape.csv")
    names = ("health.condition", "health.fallbacks", "health.folds")

    assert [one[name] for name in names] == ["3.5", "0.0", ""]
    assert [other[name] for name in names] == ["1.5", "", "2.0"]


def test_truth_is_one_nothing_is_empty_and_texts_are_whole(folder: Path) -> None:
    (done,) = rows(folder / "plan_done.csv")
    (patch,) = rows(folder / "touch_patch.csv")
    (log,) = rows(folder / "log.csv")

    assert (done["within"], done["bound"], done["reason"]) == ("1", "", "within, all of it")
    assert [patch[f"mask.0.{j}"] for j in range(3)] == ["0", "1", "1"]
    assert patch["umbilic"] == "0"
    assert log["text"] == "a, b\n=c"


def test_an_array_too_large_for_columns_is_json(
    explored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.launch.bag.export_csv.MOST_COLUMNS", 6)
    write_csv(open_source(explored, ["/touch/raw"]), tmp_path / "tables")

    row = rows(tmp_path / "tables" / "touch_raw.csv")[0]

    assert json.loads(row["pose"])[:3] == [0.01, 0.02, 0.03]
    assert float(row["array.1.2"]) == 5.0


def test_the_units_lie_beside_the_tables(folder: Path) -> None:
    units = json.loads((folder / "units.json").read_text())

    assert units["touch_raw.csv"] == {
        "sent_s": "s",
        "direction": "1",
        "pose": "m, 1",
        "array": "s or N",
        "move": "s, m, rad, m, m",
        "robot_time": "s",
    }
    assert units["plan_done.csv"]["bound"] == "m"
    assert units.keys() == {path.name for path in folder.glob("*.csv")}


def test_topics_that_are_not_wanted_are_left_out(explored: Path, tmp_path: Path) -> None:
    written = write_csv(open_source(explored, ["/score", "/log"]), tmp_path / "tables")

    assert sorted(written) == ["log.csv", "score.csv", "units.json"]
    assert rows(tmp_path / "tables" / "score.csv")[0]["sent_s"] == "0.070000000"


def test_names_of_files_are_harmless_and_differ() -> None:
    topics = ["/touch/raw", "/touch_raw", "/../../etc/passwd", "/", "/" + "x" * 300]

    found = stems(topics)

    assert list(found.values()) == ["touch_raw", "touch_raw_2", "______etc_passwd", "_", "x" * 100]
