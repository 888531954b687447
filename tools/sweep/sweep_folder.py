"""The folder of a sweep, and its workers: local processes, or those of a dask cluster.

A run is made in a temporary folder and moved when it is complete, so a folder in ``runs/`` is
always finished. A resumed sweep makes the missing runs. Workers receive checked plans, and return a
record of figures, or None if a worker died. A worker reads only the plan, so a cluster needs
palpate but no files of the user; the files of a run return with its record.
"""

from __future__ import annotations

import fcntl
import json
import logging
import math
import os
import shutil
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from msgspec.structs import replace as with_fields

from palpate import __version__
from palpate.launch.files.source_map import InputError
from palpate.launch.launch_source import EXPLORE, prestart_fork_server
from palpate.launch.printing import counted, millimetres
from palpate.launch.processes.fork_server import signals_as_ctrl_c, without_main_module
from palpate.launch.progress import Display
from palpate.launch.run import Plan, perform
from palpate.launch.run_directory import RECORDING, RunDirectory
from palpate.nodes.runtime.node import RECORDER
from palpate.tools.report.page import REPORT, write_report
from palpate.tools.sweep.results import FIGURES, Row, csv_text, page_text, rows_of, sweep_text
from palpate.tools.sweep.sweep_file import Sweep, SweepRun, read_sweep

SWEEPS, ASKED, RUNS, RECORD = Path("sweeps"), "sweep.yaml", "runs", "run.json"
Records = dict[str, Mapping[str, Any]]  # by marks of runs
Record = dict[str, Any]  # figures of `summary.json`, exit code and processor time
CONTEXT = get_context("forkserver")  # its processes ignore Ctrl-C
_one_at_a_time = threading.Lock()


@dataclass(frozen=True, slots=True)
class SweepResult:
    """Results of a sweep so far."""

    folder: Path
    rows: list[Row]  # of finished runs
    left: int  # number of unfinished runs
    kept: int  # number of runs that were finished before

    @property
    def exit_code(self) -> int:
        """0 if every run is done, 1 if one missed its goal or failed, 130 if some are left."""
        return 130 if self.left else int(any(row.record["exit_code"] for row in self.rows))

    @property
    def figures(self) -> dict[str, Any]:
        """Results as JSON values."""
        counts = {"finished": len(self.rows), "left": self.left, "kept": self.kept}
        runs = [{**row.asked, **row.record} for row in self.rows]
        return {"folder": str(self.folder), **counts, "runs": runs}

    @property
    def text(self) -> str:
        """The table, and the path of the page."""
        return "\n".join((sweep_text(self.rows), f"sweep  {self.folder / 'index.html'}"))


def run_sweep(
    sweep: Sweep,
    out: Path | None,
    workers: Workers,
    say: Callable[[str], object],
    max_tries: int = 3,
) -> SweepResult:
    """Make the unfinished runs of a sweep, and write the results of all.

    `out` is a new or empty folder or that of a sweep; default: one in ``sweeps/``. `max_tries`: of
    a run whose worker dies. Ctrl-C ends the sweep; finished runs are kept. Raises InputError if the
    sweep cannot continue; finished runs are kept.
    """
    folder = out or SWEEPS / f"{time.strftime('%Y-%m-%dT%H-%M-%S')}_{sweep.name}"
    stopped: InputError | None = None
    with closing(workers), _alone_in(folder):
        records = _finished_records(folder, sweep)
        kept, total = len(records), len(sweep.runs)
        known = {"asked for twice": sweep.repeated, "finished already": kept}
        remarks = [f"{count} {state}" for state, count in known.items() if count]
        say(", ".join((f"{folder}: {counted(total, 'run')}", *remarks)))
        todo = [run for run in sweep.runs if run.mark not in records]
        began = time.monotonic()
        try:
            with signals_as_ctrl_c():
                for run, record in _made(todo, folder, workers, max_tries):
                    records[run.mark] = record
                    say(_progress(records, run, total, time.monotonic() - began, kept))
        except KeyboardInterrupt:
            say(f"interrupted: {_resumable(len(records), total, folder)}")
        except InputError as error:
            stopped = error
    _remove_unfinished(folder)
    rows = _write_pages(sweep, records, folder)
    if stopped is not None:
        raise InputError(f"{stopped}; {_resumable(len(records), total, folder)}")
    return SweepResult(folder, rows, total - len(records), kept)


def _write_pages(sweep: Sweep, records: Records, folder: Path) -> list[Row]:
    rows, directory = rows_of(sweep, records), RunDirectory(folder, linked=False)
    directory.write_text("table.csv", csv_text(rows))
    directory.write_text("index.html", page_text(sweep.name, rows, folder))
    return rows


def report_sweep(paths: Sequence[Path], out: Path | None = None) -> list[Path]:
    """Write the reports of a sweep, if `paths` is its folder; returns the written files.

    Raises InputError if `out` is not None, which a sweep does not take, or a run cannot be read.
    """
    if len(paths) != 1 or not (paths[0] / ASKED).is_file():
        return []
    if out is not None:
        raise InputError("--out: the page of a sweep stands in its folder; leave it out")
    return write_reports(paths[0])


def write_reports(folder: Path) -> list[Path]:
    """Write the reports of the finished runs of a sweep, and its page; returns their paths.

    Raises InputError if the folder has no sweep, or a run cannot be read.
    """
    sweep = read_sweep(folder / ASKED)
    with _alone_in(folder):
        records = _finished_records(folder, sweep)
        written = [folder / str(record["folder"]) / REPORT for record in records.values()]
        for path in written:
            write_report([path.parent], path)
        _write_pages(sweep, records, folder)
    return [*written, folder / "index.html"]


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Make the folder of a sweep if it is missing, and lock it.

    Raises InputError if it cannot be written, has other contents, or a sweep is running there.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / ASKED).is_file():
        raise InputError(f"{folder}: holds no sweep; choose a new or an empty folder, or a sweep's")
    RunDirectory(folder, linked=False).create()
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{folder}: another sweep is at work there") from None
    else:
        yield
    finally:
        os.close(lock)


def _finished_records(folder: Path, sweep: Sweep) -> Records:
    """Records of the finished runs of a sweep; unfinished runs are removed."""
    RunDirectory(folder, linked=False).write_text(ASKED, sweep.text)
    _remove_unfinished(folder)
    wanted, records = {run.mark for run in sweep.runs}, {}
    for path in sorted((folder / RUNS).glob(f"*/{RECORD}")):
        mark = path.parent.name.rpartition("_")[2]
        with suppress(ValueError):
            record = json.loads(path.read_text(encoding="utf-8"))
            is_whole = isinstance(record, dict) and record.keys() >= {*FIGURES}
            if mark in wanted and is_whole and record["exit_code"] in (0, 1):
                records[mark] = record
    return records


def _remove_unfinished(folder: Path) -> None:
    for unfinished in (folder / RUNS).glob(".*"):
        shutil.rmtree(unfinished, ignore_errors=True)  # a worker may still write into it


def _made(
    todo: Iterable[SweepRun], folder: Path, workers: Workers, max_tries: int
) -> Iterator[tuple[SweepRun, Record]]:
    """Runs as they are finished; a run whose worker dies is started again."""
    waiting, started, under_way = deque(todo), Counter[str](), 0
    while waiting or under_way:
        while waiting and under_way < workers.width:
            run = waiting.popleft()
            path = folder / RUNS / run.name
            shutil.rmtree(path, ignore_errors=True)  # a run that failed
            workers.begin(Job(run, run.plan(path), path.with_name(f".{run.name}.{os.getpid()}")))
            under_way, started[run.mark] = under_way + 1, started[run.mark] + 1
        for job, record in workers.finished():
            under_way -= 1
            if record is None and started[job.run.mark] < max_tries:
                shutil.rmtree(job.folder, ignore_errors=True)
                waiting.append(job.run)
            else:
                record = record or failed_record(f"its worker died {max_tries} times")
                yield job.run, _keep(job, record)


def _keep(job: Job, record: Record) -> Record:
    """Write the record of a run into its folder, and move the folder to its place."""
    named = {"folder": f"{RUNS}/{job.run.name}", "palpate": __version__, "asked": job.run.asked}
    kept = {name: record.get(name) for name in FIGURES} | named
    job.folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(kept, indent=2, default=str) + "\n"
    (job.folder / RECORD).write_text(text, encoding="utf-8")
    job.folder.rename(job.folder.with_name(job.run.name))
    return kept


def _progress(records: Records, last: SweepRun, total: int, seconds: float, kept: int) -> str:
    """Progress: finished runs, remaining time, best run, and result of the last one."""
    errors = [some["rms_m"] for some in records.values() if some["rms_m"] is not None]
    best = f"best {millimetres(min(errors))}, " if errors else ""
    left = (total - len(records)) * seconds / (len(records) - kept)
    record = records[last.mark]
    result = f"{record['touches']} touches, rms {millimetres(record['rms_m'] or math.nan)}"
    return f"{len(records)} of {total}, {best}{left:.0f} s left; {last.name}: {result}"


def _resumable(finished: int, total: int, folder: Path) -> str:
    return f"{finished} of {total} runs are finished and kept; palpate sweep {folder} resumes"


class Job(NamedTuple):
    """A run to make."""

    run: SweepRun
    plan: Plan
    folder: Path  # for its files, on the caller's machine


def explore_into(plan: Plan, folder: Path) -> Record:
    """Perform a run in this process into another folder than planned.

    Raises InputError if the folder cannot be written, or its disk is too full for a recording;
    other failures give a record with the reason.
    """
    path = str(folder / RECORDING)
    wirings = tuple(
        replace(node, params=with_fields(node.params, path=path))
        if node.module == RECORDER
        else node
        for node in plan.wirings
    )
    moved = replace(plan, folder=RunDirectory(folder, linked=False), wirings=wirings)
    began = time.thread_time()
    try:
        done = perform(moved, composed=True, display=Display())
    except InputError:
        raise
    except Exception as error:  # a failed run must not end the others
        return failed_record(f"{type(error).__name__}: {error}")
    cpu = done.summary["compute_s"] or time.thread_time() - began
    return {**done.summary, "exit_code": done.exit_code, "compute_s": cpu}


def failed_record(reason: str) -> Record:
    """Record of a failed run."""
    return {"status": "died", "reason": " ".join(reason.split()), "exit_code": 3}


class LocalWorkers:
    """Local processes, a new one for each run, forked from a server with all imports."""

    def __init__(self, count: int) -> None:
        self.width = count  # number of runs at a time
        prestart_fork_server(EXPLORE)
        self._busy: dict[connection.Connection, tuple[BaseProcess, Job]] = {}

    def begin(self, job: Job) -> None:
        """Start a run."""
        ours, theirs = CONTEXT.Pipe(duplex=False)
        arguments = (
            theirs,
            job.plan,
            job.folder.absolute(),
        )  # the process starts in another folder
        process = CONTEXT.Process(target=_explore_for, args=arguments, daemon=True)
        with without_main_module():
            process.start()
        theirs.close()  # so that the pipe ends with the process
        self._busy[ours] = process, job

    def finished(self) -> Iterator[tuple[Job, Record | None]]:
        """Wait for runs to finish; raises InputError if no further run can be made."""
        for pipe in connection.wait(list(self._busy)):
            assert isinstance(pipe, connection.Connection)
            process, job = self._busy.pop(pipe)
            result = None
            with pipe, suppress(EOFError, OSError):
                result = pipe.recv()
            process.join()
            if isinstance(result, InputError):
                raise result
            yield job, result

    def close(self) -> None:
        """End the processes; unfinished runs are lost."""
        for process, _ in self._busy.values():
            process.kill()
            process.join()


def _explore_for(pipe: connection.Connection, plan: Plan, folder: Path) -> None:
    """Make a run and send its record."""
    try:
        result: Record | InputError = explore_into(plan, folder)
    except InputError as error:
        result = error
    with suppress(OSError):
        pipe.send(result)


class ClusterWorkers:
    """A dask cluster by the address of its scheduler, which repeats a run whose worker dies.

    Raises InputError if dask.distributed is not installed, or no scheduler answers within the
    `timeout` [s].
    """

    def __init__(self, address: str, timeout: float = 10.0) -> None:
        self._where = f"--scheduler {address}"
        try:
            from distributed import Client

            for name in ("distributed", "distributed.client"):  # errors are reported as InputError
                logging.getLogger(name).setLevel(logging.CRITICAL)
            self._client = Client(address, timeout=timeout)
        except ImportError as error:
            needs = f"--scheduler needs dask.distributed ({error})"
            raise InputError(f"{needs}: pip install 'palpate[sweep]'") from None
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{self._where}: no scheduler can be reached: {error}") from None
        self.width = max(1, 2 * sum(self._client.nthreads().values()))
        self._busy: dict[Any, Job] = {}

    def begin(self, job: Job) -> None:
        """Start a run."""
        self._busy[self._client.submit(explore_away, job.plan, pure=False)] = job

    def finished(self) -> Iterator[tuple[Job, Record | None]]:
        """Wait for runs to finish, and write their files."""
        from distributed import wait

        for future in self._answer(lambda: wait([*self._busy], return_when="FIRST_COMPLETED").done):
            job, result = self._busy.pop(future), self._answer(future.result)
            record, files = result or (None, {})
            job.folder.mkdir(parents=True, exist_ok=True)
            for name, content in files.items():
                (job.folder / name).write_bytes(content)
            yield job, record

    def _answer(self, ask: Callable[[], Any]) -> Any:
        """An answer of the cluster; None if the workers of a run died repeatedly."""
        from distributed import CancelledError, KilledWorker

        try:
            return ask()
        except KilledWorker:
            return None
        except (Exception, CancelledError) as error:  # any failure of the cluster
            text = f"{type(error).__name__}: {str(error).partition('. ')[0]}"
            raise InputError(f"{self._where}: the cluster has failed: {text}") from None

    def close(self) -> None:
        """Leave the cluster."""
        self._client.cancel(list(self._busy))
        self._client.close()


def explore_away(plan: Plan) -> tuple[Record, Mapping[str, bytes]]:
    """Perform a run on another machine; returns its record, and its files by name.

    Raises InputError as `explore_into`. Threads of a worker take turns.
    """
    with _one_at_a_time, tempfile.TemporaryDirectory(prefix="palpate-sweep-") as parent:
        folder = Path(parent) / "run"
        record = explore_into(plan, folder)
        return record, {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


Workers: TypeAlias = LocalWorkers | ClusterWorkers
