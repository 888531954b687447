from __future__ import annotations

import csv
import json

import pytest

from palpate.launch.files import InputError
from palpate.tools.sweep import read_sweep, run_sweep

from .conftest import RECORD

FOUR = "scene: sphere\nseeds: 2\ngrid: {planner.tolerance: [1.0e-3, 0.5e-3]}\n"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


@pytest.fixture
def four(write):
    return read_sweep(write("four.yaml", FOUR))


def table(folder):
    with (folder / "table.csv").open() as file:
        return list(csv.DictReader(file))


def test_every_run_has_a_folder_and_a_row(four, fake, out):
    said = []
    done = run_sweep(four, out, workers := fake(), said.append)
    assert (done.exit_code, done.left, done.kept, workers.closed) == (0, 0, 0, True)
    assert [row["folder"] for row in table(out)] == [f"runs/{run.name}" for run in four.runs]
    for run in four.runs:
        record = json.loads((out / "runs" / run.name / "run.json").read_text())
        assert record["asked"] == run.asked
        assert record["palpate"]
    assert {path.name for path in out.iterdir()} == {
        *("sweep.yaml", "runs", "table.csv", "index.html")
    }
    assert said[0] == f"{out}: 4 runs"
    assert said[-1].startswith("4 of 4, best 0.010 mm, 0 s left; sphere_tolerance")
    assert done.figures["finished"] == 4
    assert done.text.endswith("index.html")


def test_what_is_finished_is_not_run_again_and_the_table_is_the_same(four, fake, out):
    run_sweep(four, out, fake(), print)
    before = (out / "table.csv").read_text(), (out / "index.html").read_text()
    again = run_sweep(four, out, workers := fake(), print)
    assert (again.kept, workers.begun) == (4, [])
    assert ((out / "table.csv").read_text(), (out / "index.html").read_text()) == before


def test_ctrl_c_keeps_what_is_finished_and_half_a_run_is_begun_again(four, fake, out):
    said = []
    stopped = fake(lambda number: KeyboardInterrupt() if number == 2 else RECORD)
    done = run_sweep(four, out, stopped, said.append)
    assert (done.exit_code, done.left, stopped.closed) == (130, 2, True)
    told = f"interrupted: 2 of 4 runs are finished and kept; palpate sweep {out}"
    assert said[-1].startswith(told)
    assert len(table(out)) == 2
    (out / "runs" / ".half").mkdir()  # of a sweep that was killed
    done = run_sweep(four, out, workers := fake(), print)
    assert (done.exit_code, len(workers.begun)) == (0, 2)
    assert len(list((out / "runs").iterdir())) == 4


def test_another_file_keeps_the_runs_that_still_occur(four, fake, out, write):
    run_sweep(four, out, fake(), print)
    more = "scene: sphere\nlist: [{planner.tolerance: 0.5e-3}, {planner.tolerance: 0.4e-3}]\n"
    said = []
    run_sweep(read_sweep(write("more.yaml", more)), out, workers := fake(), said.append)
    assert said[0] == f"{out}: 2 runs, 1 finished already"
    assert len(workers.begun) == 1
    assert len(table(out)) == 2
    assert len(list((out / "runs").iterdir())) == 5
    assert (out / "sweep.yaml").read_text() == more


def test_a_run_whose_worker_dies_is_begun_again(four, fake, out):
    workers = fake(lambda number: None if number in (0, 1) else RECORD)
    assert run_sweep(four, out, workers, print).exit_code == 0
    assert len(workers.begun) == 6


def test_a_run_that_kills_every_worker_is_a_row_and_is_tried_again_later(four, fake, out):
    done = run_sweep(four, out, fake(lambda _: None), print)
    assert done.exit_code == 1
    assert {row["reason"] for row in table(out)} == {"its worker died 3 times"}
    assert run_sweep(four, out, fake(), print).kept == 0


def test_a_missed_goal_is_told_by_the_exit_code_and_kept(four, fake, out):
    done = run_sweep(four, out, fake(lambda n: RECORD | {"exit_code": int(n == 1)}), print)
    assert done.exit_code == 1
    assert run_sweep(four, out, fake(), print).kept == 4


def test_where_nothing_can_go_on_the_sentence_says_what_is_kept(four, fake, out):
    lost = fake(lambda number: InputError("the disk is full") if number else RECORD)
    with pytest.raises(InputError, match=r"the disk is full; 1 of 4 runs are finished and kept"):
        run_sweep(four, out, lost, print)
    assert len(table(out)) == 1


@pytest.mark.parametrize("text", ["{", "[]", '{"exit_code": 0}', "\xff"])
def test_a_damaged_record_is_no_finished_run(four, fake, out, text):
    run_sweep(four, out, fake(), print)
    next((out / "runs").glob("*/run.json")).write_text(text, encoding="latin-1")
    assert run_sweep(four, out, fake(), print).kept == 3


def test_two_sweeps_do_not_work_in_one_folder(four, fake, out):
    def second(number):
        with pytest.raises(InputError, match="out: another sweep is at work there"):
            run_sweep(four, out, fake(), print)
        return RECORD

    assert run_sweep(four, out, fake(second), print).exit_code == 0


def test_a_folder_of_something_else_is_refused(four, fake, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="full: holds no sweep; choose a new or an empty folder"):
        run_sweep(four, tmp_path / "full", workers := fake(), print)
    assert workers.closed
    with pytest.raises(InputError, match=r"mine\.txt: cannot be written"):
        run_sweep(four, tmp_path / "full" / "mine.txt", fake(), print)


def test_without_a_folder_it_is_a_new_one_by_time_and_name(four, fake, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = run_sweep(four, None, fake(), print).folder
    assert folder.parent.name == "sweeps" and folder.name.endswith("_four")
