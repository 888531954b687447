from __future__ import annotations

import csv
import json

import pytest

from palpate.launch.files import InputError
from palpate.tools.sweep import choose_sweep_folder, read_sweep, run_sweep

from .conftest import RECORD

FOUR = "scene: sphere\nseeds: 2\ngrid: {planner.tolerance: [1.0e-3, 0.5e-3]}\n"


@pytest.fixture
def four(write):
    return read_sweep(write("four.yaml", FOUR))


def table(folder):
    with (folder / "table.csv").open() as file:
        return list(csv.DictReader(file))


def test_every_run_has_a_folder_and_a_row(four, fake, tmp_path):
    said = []
    done = run_sweep(four, tmp_path / "out", workers := fake(), said.append)
    assert (done.exit_code, done.left, done.kept, workers.closed) == (0, 0, 0, True)
    assert [row["folder"] for row in table(tmp_path / "out")] == [
        f"runs/{run.name}" for run in four.runs
    ]
    for run in four.runs:
        record = json.loads((tmp_path / "out" / "runs" / run.name / "run.json").read_text())
        assert record["asked"] == run.asked
        assert record["palpate"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("sweep.yaml", "runs", "table.csv", "index.html")
    }
    assert said[0] == f"{tmp_path / 'out'}: 4 runs"
    assert said[-1].startswith("4 of 4, best 0.010 mm, 0 s left; sphere_tolerance")
    assert done.figures["finished"] == 4
    assert done.text.endswith("index.html")


def test_what_is_finished_is_not_run_again_and_the_table_is_the_same(four, fake, tmp_path):
    run_sweep(four, tmp_path, fake(), print)
    before = (tmp_path / "table.csv").read_text(), (tmp_path / "index.html").read_text()
    again = run_sweep(four, tmp_path, workers := fake(), print)
    assert (again.kept, workers.begun) == (4, [])
    assert ((tmp_path / "table.csv").read_text(), (tmp_path / "index.html").read_text()) == before


def test_ctrl_c_keeps_what_is_finished_and_half_a_run_is_begun_again(four, fake, tmp_path):
    said = []
    stopped = fake(lambda number: KeyboardInterrupt() if number == 2 else RECORD)
    done = run_sweep(four, tmp_path, stopped, said.append)
    assert (done.exit_code, done.left, stopped.closed) == (130, 2, True)
    told = f"interrupted: 2 of 4 runs are finished and kept; palpate sweep --resume {tmp_path}"
    assert said[-1].startswith(told)
    assert len(table(tmp_path)) == 2
    (tmp_path / "runs" / ".half").mkdir()  # of a sweep that was killed
    done = run_sweep(four, tmp_path, workers := fake(), print)
    assert (done.exit_code, len(workers.begun)) == (0, 2)
    assert len(list((tmp_path / "runs").iterdir())) == 4


def test_another_file_keeps_the_runs_that_still_occur(four, fake, tmp_path, write):
    run_sweep(four, tmp_path, fake(), print)
    more = "scene: sphere\nlist: [{planner.tolerance: 0.5e-3}, {planner.tolerance: 0.4e-3}]\n"
    said = []
    run_sweep(read_sweep(write("more.yaml", more)), tmp_path, workers := fake(), said.append)
    assert said[0] == f"{tmp_path}: 2 runs, 1 finished already"
    assert len(workers.begun) == 1
    assert len(table(tmp_path)) == 2
    assert len(list((tmp_path / "runs").iterdir())) == 5
    assert (tmp_path / "sweep.yaml").read_text() == more


def test_a_run_whose_worker_dies_is_begun_again(four, fake, tmp_path):
    workers = fake(lambda number: None if number in (0, 1) else RECORD)
    assert run_sweep(four, tmp_path, workers, print).exit_code == 0
    assert len(workers.begun) == 6


def test_a_run_that_kills_every_worker_is_a_row_and_is_tried_again_later(four, fake, tmp_path):
    done = run_sweep(four, tmp_path, fake(lambda _: None), print)
    assert done.exit_code == 1
    assert {row["reason"] for row in table(tmp_path)} == {"its worker died 3 times"}
    assert run_sweep(four, tmp_path, fake(), print).kept == 0


def test_a_missed_goal_is_told_by_the_exit_code_and_kept(four, fake, tmp_path):
    done = run_sweep(four, tmp_path, fake(lambda n: RECORD | {"exit_code": int(n == 1)}), print)
    assert done.exit_code == 1
    assert run_sweep(four, tmp_path, fake(), print).kept == 4


def test_where_nothing_can_go_on_the_sentence_says_what_is_kept(four, fake, tmp_path):
    lost = fake(lambda number: InputError("the disk is full") if number else RECORD)
    with pytest.raises(InputError, match=r"the disk is full; 1 of 4 runs are finished and kept"):
        run_sweep(four, tmp_path, lost, print)
    assert len(table(tmp_path)) == 1


def test_a_damaged_record_is_no_finished_run(four, fake, tmp_path):
    run_sweep(four, tmp_path, fake(), print)
    next((tmp_path / "runs").glob("*/run.json")).write_text("{")
    assert run_sweep(four, tmp_path, fake(), print).kept == 3


def test_a_folder_of_something_else_is_refused(tmp_path, write):
    write("mine.txt", "mine")
    with pytest.raises(InputError, match="holds no sweep; choose a new folder"):
        choose_sweep_folder("s", tmp_path)
    assert choose_sweep_folder("s", tmp_path / "new") == tmp_path / "new"
    assert choose_sweep_folder("s", None).name.endswith("_s")
