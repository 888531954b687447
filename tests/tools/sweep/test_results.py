from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.tools.sweep import pareto_front, read_sweep
from palpate.tools.sweep.results import (
    FIGURES,
    Row,
    csv_text,
    fronts,
    on_front,
    rows_of,
    sweep_text,
    table_of,
)

from .conftest import RECORD

SMALL = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=30)


def betters(one, other):
    return one != other and one[0] <= other[0] and one[1] <= other[1]


@given(SMALL)
def test_the_front_is_what_nothing_betters(points):
    wanted = [not any(betters(other, one) for other in points) for one in points]
    cost, error = np.reshape(points, (-1, 2)).T
    assert pareto_front(cost, error).tolist() == wanted


def test_equal_points_are_all_on_the_front_and_equal_costs_are_not():
    assert pareto_front([1, 1, 1, 2], [3.0, 3.0, 4.0, 3.0]).tolist() == [True, True, False, False]
    assert pareto_front([], []).tolist() == []


@pytest.mark.parametrize("error", [[1.0, np.nan], [1.0, None], [np.inf, 1.0], [1.0], ["a", "b"]])
def test_what_is_no_finite_number_has_no_place_on_a_front(error):
    with pytest.raises(ValueError, match=r"must be finite numbers|dimensions"):
        pareto_front([1.0, 2.0], error)


def row(number, scene="a", **more):
    record = {**RECORD, "folder": f"runs/{number}", **more}
    return Row(number, {"scene": scene, "planner.planner": "predicted", "seed": number}, record)


def test_each_scene_has_a_front_of_its_own_the_cheapest_first():
    rows = [
        row(1, touches=90),
        row(2, touches=40, rms_m=1e-3),
        row(3, touches=95, rms_m=1e-4),
        row(4, "b", touches=200, rms_m=1e-2),
        row(5, touches=10, rms_m=None),
    ]
    found = {scene: [one.number for one in own] for scene, own in fronts(rows, "touches").items()}
    assert found == {"a": [2, 1], "b": [4]}
    assert on_front(rows, "touches") == {1, 2, 4}


def test_the_table_has_a_row_a_run_in_the_order_of_the_file(write):
    sweep = read_sweep(write("s.yaml", "scene: sphere\nseeds: 3\ngrid: {fingers: [1]}\n"))
    records = {run.mark: RECORD | {"folder": f"runs/{run.name}"} for run in sweep.runs[::-2]}
    table = list(csv.DictReader(io.StringIO(csv_text(rows_of(sweep, records)))))
    assert [one["run"] for one in table] == ["1", "3"]
    assert list(table[0]) == ["run", "scene", "fingers", "seed", *FIGURES]
    assert table[0]["tolerance_met"] == "true"
    assert float(table[0]["rms_m"]) == RECORD["rms_m"]
    assert table[1]["folder"] == f"runs/{sweep.runs[2].name}"
    assert csv_text([]).startswith("run,status,")


def test_a_failed_run_has_empty_figures_and_its_reason():
    nothing = dict.fromkeys(FIGURES)
    failed = row(1, **nothing | {"status": "died", "exit_code": 3, "reason": "a, b"})
    (line,) = csv.DictReader(io.StringIO(csv_text([failed])))
    assert (line["rms_m"], line["exit_code"], line["reason"]) == ("", "3", "a, b")
    assert sweep_text([failed]).splitlines()[1].split() == ["1", "died"]


def test_the_text_tells_what_differs_and_marks_the_front():
    lines = sweep_text([row(1, touches=90), row(2, touches=91, exit_code=1)]).splitlines()
    assert lines[0].split()[:3] == ["run", "seed", "status"]
    assert lines[1].split() == ["*", "1", "1", "done", "0.0200", "0.0500", "90", "300", "4.5"]
    assert lines[2].split()[:3] == ["2", "2", "missed"]


def test_names_are_shortened_where_that_tells_them_apart():
    rows = [
        Row(number, {"planner.tolerance": number, "a.x": number, "b.x": number, "c": 1}, RECORD)
        for number in (1, 2)
    ]
    assert table_of(rows)[0][:4] == ["run", "tolerance", "a.x", "b.x"]
