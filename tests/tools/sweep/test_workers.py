"""Real explorations of the sphere: two by one process, and the same by others, among deaths."""

from __future__ import annotations

import csv
import multiprocessing
import os
import random
import re
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.launch.files import InputError
from palpate.tools.sweep import ClusterWorkers, LocalWorkers, read_sweep, run_sweep
from palpate.tools.sweep.results import TIMES
from palpate.tools.sweep.sweep_folder import Job, explore_away

PAGE = Path(__file__).parents[3] / "docs" / "sweep.md"
NO_CLUSTER = "dask.distributed is not installed: the extra [sweep]"
MISSED = 1  # Three or four even slices leave much of the object untouched


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    path = tmp_path_factory.mktemp("asked") / "two.yaml"
    (example, *_) = re.findall(r"```yaml\n(.+?)```", PAGE.read_text(), re.DOTALL)
    path.write_text(example)
    return read_sweep(path, record=False)


@pytest.fixture(scope="module")
def by_one(two, tmp_path_factory):
    """The sweep made by one process."""
    folder = tmp_path_factory.mktemp("by_one")
    assert run_sweep(two, folder, LocalWorkers(1), print).exit_code == MISSED
    return folder


def figures(folder: Path) -> list[dict[str, str]]:
    """The table apart from times on this computer, by run."""
    with (folder / "table.csv").open() as file:
        rows = [{key: row[key] for key in row if key not in TIMES} for row in csv.DictReader(file)]
    return sorted(rows, key=lambda row: row["folder"])


def shuffled(sweep):
    """The same runs in another order, and what numbers them left out."""
    runs = list(sweep.runs)
    random.Random(1).shuffle(runs)
    assert runs[0] != sweep.runs[0]
    return replace(sweep, runs=tuple(runs))


def without_numbers(rows):
    return [{key: value for key, value in row.items() if key != "run"} for row in rows]


def test_a_run_leaves_what_palpate_run_leaves(by_one, two):
    names = {path.name for path in (by_one / "runs" / two.runs[0].name).iterdir()}
    assert {"summary.json", "mesh.ply", "launch.yaml", "scene.yaml", "run.json"} <= names
    rows = figures(by_one)
    assert rows[0]["rms_m"] != rows[1]["rms_m"]
    assert all(0.0 < float(row["rms_m"]) < 1e-4 and row["touches"] != "" for row in rows)


@pytest.mark.slow  # among the tenth that .ci/run takes, as the next one: their names decide
@pytest.mark.timeout(300)
def test_two_processes_in_another_order_come_to_the_same_table(by_one, two, tmp_path):
    run_sweep(shuffled(two), tmp_path, LocalWorkers(2), print)
    assert without_numbers(figures(tmp_path)) == without_numbers(figures(by_one))


@pytest.mark.graph
def test_a_process_that_is_killed_gives_its_run_back_and_is_replaced(two, tmp_path):
    workers = LocalWorkers(1)
    job = Job(two.runs[0], two.runs[0].plan(tmp_path / "a"), tmp_path / "a")
    try:
        workers.begin(job)
        (process,) = multiprocessing.active_children()
        process.kill()
        assert list(workers.finished()) == [(job, None)]
        (tmp_path / "file").write_text("")  # where no folder can be
        workers.begin(job._replace(folder=tmp_path / "file" / "b"))
        with pytest.raises(InputError, match="file/b: cannot be written"):
            list(workers.finished())
    finally:
        workers.close()
    assert multiprocessing.active_children() == []


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.graph
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
def test_a_cluster_of_which_a_worker_is_killed_comes_to_the_same_table(by_one, two, tmp_path):
    distributed = pytest.importorskip("distributed", reason=NO_CLUSTER)
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True}
    with distributed.LocalCluster(**options, dashboard_address=None) as cluster:
        workers = ClusterWorkers(cluster.scheduler_address)
        assert workers.width == 4
        begun = []

        def begin(job: Job) -> None:
            ClusterWorkers.begin(workers, job)
            begun.append(job)
            if len(begun) == len(two.runs):
                kill_a_busy_worker(cluster)

        workers.begin = begin  # type: ignore[method-assign]
        done = run_sweep(shuffled(two), tmp_path, workers, print)
    assert done.exit_code == MISSED
    assert without_numbers(figures(tmp_path)) == without_numbers(figures(by_one))
    assert {p.name for p in (tmp_path / "runs").iterdir()} == {run.name for run in two.runs}


def kill_a_busy_worker(cluster) -> None:
    """Wait until a worker explores, and kill its process."""
    ends = time.monotonic() + 30.0
    while time.monotonic() < ends:
        for state in cluster.scheduler.workers.values():
            if state.processing:
                time.sleep(0.5)
                nanny = next(
                    one for one in cluster.workers.values() if one.worker_address == state.address
                )
                os.kill(nanny.pid, signal.SIGKILL)
                return
        time.sleep(0.05)
    raise AssertionError("no worker began to explore")


def test_a_worker_of_a_cluster_hands_back_the_files_of_a_run(two, tmp_path, monkeypatch):
    def perform(plan, **_):
        plan.folder.create()
        plan.folder.write_text("summary.json", plan.folder.path.name)
        raise RuntimeError("it\nbreaks")

    monkeypatch.setattr("palpate.launch.perform", perform)
    record, files = explore_away(two.runs[0].plan(tmp_path / "far"))
    assert record == {"status": "died", "reason": "RuntimeError: it breaks", "exit_code": 3}
    assert files == {"summary.json": b"run"}
    assert list(tmp_path.iterdir()) == []


def test_a_scheduler_that_is_not_there_is_told_in_a_sentence(monkeypatch):
    monkeypatch.setattr("palpate.tools.sweep.sweep_folder.ANSWER_TIME", 1.0)
    wanted = (
        "--scheduler needs dask.distributed .*: pip install 'palpate|no scheduler can be reached"
    )
    with pytest.raises(InputError, match=wanted):
        ClusterWorkers("tcp://127.0.0.1:1")


def test_without_dask_the_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(
        InputError, match=r"needs dask.distributed .*pip install 'palpate\[sweep\]'"
    ):
        ClusterWorkers("tcp://127.0.0.1:1")
