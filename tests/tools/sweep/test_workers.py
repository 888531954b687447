"""Who makes the runs of a sweep: processes, a cluster; and the verbs sweep and report."""

import csv
import json
import multiprocessing
import shutil
from pathlib import Path

import pytest

from palpate.launch.files.source_map import InputError
from palpate.tools.sweep.sweep_file import read_sweep
from palpate.tools.sweep.sweep_folder import ClusterWorkers, LocalWorkers, run_sweep
from tests.tools.sweep.workers import RECORD, Workers

# Few slices of a ball make a solid quickly, which misses the tolerance.
TWO = "scene: sphere\ngrid: {planner.planner: [uniform], planner.settings.count: [3, 4]}\n"


@pytest.fixture
def two(write):
    return read_sweep(write("two.yaml", TWO), record=False)


def figures(folder):
    """The table apart from times on this computer."""
    with (folder / "table.csv").open() as file:
        rows = [{k: v for k, v in row.items() if k[-2:] != "_s"} for row in csv.DictReader(file)]
    return sorted(rows, key=lambda row: row["folder"])


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_processes_of_which_one_is_killed_make_the_same_table(two, tmp_path):
    first, second = tmp_path / "one", tmp_path / "other"
    assert run_sweep(two, first, LocalWorkers(1), print).exit_code == 1
    workers, begin = LocalWorkers(2), LocalWorkers.begin

    def begin_and_kill(job):
        begin(workers, job)
        if job.run is two.runs[0] and not killed:
            killed.append(multiprocessing.active_children()[0])
            killed[0].kill()

    killed: list[multiprocessing.Process] = []
    workers.begin = begin_and_kill
    run_sweep(two, second, workers, print)
    assert killed and figures(first) == figures(second)
    names = {path.name for path in (second / "runs" / two.runs[0].name).iterdir()}
    assert {"summary.json", "launch.yaml", "scene.yaml", "run.json"} <= names


@pytest.mark.graph
def test_killed_process_gives_its_run_back(two, tmp_path):
    noting = Workers(lambda _: RECORD)
    run_sweep(two, tmp_path / "noted", noting, print)
    job = noting.begun[0]._replace(folder=tmp_path / "a")
    workers = LocalWorkers(1)
    try:
        workers.begin(job)
        (process,) = multiprocessing.active_children()
        process.kill()
        assert [*workers.finished()] == [(job, None)]
        (tmp_path / "file").write_text("")  # where no folder can be
        workers.begin(job._replace(folder=tmp_path / "file" / "b"))
        with pytest.raises(InputError, match="file/b: cannot be written"):
            list(workers.finished())
    finally:
        workers.close()
    assert multiprocessing.active_children() == []


@pytest.mark.slow
@pytest.mark.graph
@pytest.mark.timeout(300)
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
def test_cluster_makes_the_table_of_one_process(two, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra [sweep]")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster:
        workers = ClusterWorkers(cluster.scheduler_address)
        assert workers.width == 4
        run_sweep(two, tmp_path / "other", workers, print)
    run_sweep(two, tmp_path / "one", LocalWorkers(1), print)
    assert figures(tmp_path / "one") == figures(tmp_path / "other")


def test_missing_scheduler_is_refused_in_one_sentence(monkeypatch):
    wanted = "--scheduler needs dask.distributed .*pip install 'palpate|no scheduler can be reached"
    with pytest.raises(InputError, match=wanted):
        ClusterWorkers("tcp://127.0.0.1:1", timeout=0.2)
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"needs dask.distributed .*'palpate\[sweep\]'"):
        ClusterWorkers("tcp://127.0.0.1:1")


@pytest.fixture
def swept(monkeypatch, tmp_path, two):
    """What `palpate sweep` asks for, of which nothing is explored."""
    calls = []

    def run(asked, out, workers, say):
        calls.append((asked, out, workers.width))
        say("1 of 1")
        noting = Workers(lambda _: RECORD | {"exit_code": 1})
        return run_sweep(asked, tmp_path / "there", noting, lambda _: None)

    monkeypatch.setattr("palpate.tools.sweep.sweep_folder.run_sweep", run)
    return calls


def test_sweep_command_prints_its_result_or_refuses(swept, write, call, refusal, tmp_path):
    file = write("sweep.yaml", "scene: sphere\nseeds: 2\n")
    code, out, err = call("sweep --workers 3", file)
    assert (code, err) == (1, "1 of 1\n")
    assert out.splitlines()[-1] == f"sweep  {tmp_path}/there/index.html"
    ((asked, out, width),) = swept
    assert (asked.name, len(asked.runs), out, width) == ("sweep", 2, None, 3)
    code, out, err = call("sweep --json --quiet", file)
    assert json.loads(out)["runs"][0]["scene"] == "sphere" and err == ""
    call("sweep", tmp_path)  # a folder stands for its file
    assert swept.pop()[1] == tmp_path
    swept.clear()
    for more, words in (
        ("--workers 2 --scheduler tcp://a:1", "--workers and --scheduler exclude each"),
        ("--out x", "so do --out and a folder"),
        ("--workers 0", "0 is not in the range"),
    ):
        assert words in refusal(f"sweep {more}", tmp_path) and swept == []


@pytest.mark.slow
def test_reports_of_a_sweep_are_linked_from_its_page(run_folder, two, here, call):
    def finish(number):
        job = workers.begun[number]
        shutil.copytree(run_folder, job.folder, dirs_exist_ok=True)
        (job.folder / "topics.mcap").unlink()  # it takes long to draw
        return RECORD

    workers = Workers(finish, by_place=True)
    run_sweep(two, Path("out"), workers, lambda _: None)
    *written, page = call("report out").out.splitlines()
    assert page == "out/index.html: written" and len(written) == 2
    text = Path("out/index.html").read_text()
    for place in (one.removesuffix(": written") for one in written):
        assert Path(place).is_file() and f'href="{place.removeprefix("out/")}"' in text
    assert call("report out -o x.html").code == 2
