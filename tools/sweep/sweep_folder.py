"""The folder of a sweep, and who makes its runs: processes here, or the workers of a dask cluster.

A run is made beside its place and moved there once it is whole, so that a folder in ``runs/`` is
either finished or not there. Whoever takes the sweep up again makes what is not there. Workers are
given plans that have passed every check, and give back a record of figures; None for a run whose
worker died. A worker reads nothing but the plan, so that a cluster needs palpate and no file of the
user's; there the files that a run leaves come back with its record.
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
from palpate.launch.run_directory import (
    RECORDING,
    RunDirectory,
    RunDirectory as launch_RunDirectory,
)
from palpate.nodes.runtime.node import RECORDER
from palpate.tools.report.page import REPORT, write_report
from palpate.tools.sweep.results import FIGURES, Row, csv_text, page_text, rows_of, sweep_text
from palpate.tools.sweep.sweep_file import Sweep, SweepRun, read_sweep

SWEEPS, ASKED, RUNS, RECORD = Path("sweeps"), "sweep.yaml", "runs", "run.json"
TRIES = 3  # Times that a run is begun whose worker dies
Records = dict[str, Mapping[str, Any]]  # By the marks of the runs
ANSWER_TIME = 10.0  # Time in which a scheduler must have answered, s
Record = dict[str, Any]  # The figures of `summary.json`, exit code and processor time
CONTEXT = get_context("forkserver")  # Ctrl-C is blocked in what is forked
_one_at_a_time = threading.Lock()


@dataclass(frozen=True, slots=True)
class SweepResult:
    """What has come of a sweep so far."""

    folder: Path
    rows: list[Row]  # Of finished runs
    left: int  # Runs that are not finished
    kept: int  # Runs that were finished before

    @property
    def exit_code(self) -> int:
        """0 if every run is done, 1 if one missed its goal or failed, 130 if some are left."""
        return 130 if self.left else int(any(row.record["exit_code"] for row in self.rows))

    @property
    def figures(self) -> dict[str, Any]:
        """All of it, for programs."""
        counts = {"finished": len(self.rows), "left": self.left, "kept": self.kept}
        runs = [{**row.asked, **row.record} for row in self.rows]
        return {"folder": str(self.folder), **counts, "runs": runs}

    @property
    def text(self) -> str:
        """The table, and where all of it lies."""
        return "\n".join((sweep_text(self.rows), f"sweep  {self.folder / 'index.html'}"))


def run_sweep(
    sweep: Sweep, out: Path | None, workers: Workers, say: Callable[[str], object]
) -> SweepResult:
    """Make the runs of a sweep that are not finished yet, and write what all came to.

    `out` is a new or empty folder or that of a sweep; one in ``sweeps/`` if left out. Ctrl-C ends
    it with what is finished. Raises InputError if it cannot go on; what is finished is kept.
    """
    folder = out or SWEEPS / f"{time.strftime('%Y-%m-%dT%H-%M-%S')}_{sweep.name}"
    stopped: InputError | None = None
    with closing(workers), _alone_in(folder):
        records = _take_up(folder, sweep)
        kept, total = len(records), len(sweep.runs)
        known = {"asked for twice": sweep.repeated, "finished already": kept}
        told = [f"{count} {what}" for what, count in known.items() if count]
        say(", ".join((f"{folder}: {counted(total, 'run')}", *told)))
        todo = [run for run in sweep.runs if run.mark not in records]
        began = time.monotonic()
        try:
            with signals_as_ctrl_c():
                for run, record in _made(todo, folder, workers):
                    records[run.mark] = record
                    say(_progress(records, run, total, time.monotonic() - began, kept))
        except KeyboardInterrupt:
            say(f"interrupted: {_resumable(len(records), total, folder)}")
        except InputError as error:
            stopped = error
    _sweep_out(folder)
    rows = _write_pages(sweep, records, folder)
    if stopped is not None:
        raise InputError(f"{stopped}; {_resumable(len(records), total, folder)}")
    return SweepResult(folder, rows, total - len(records), kept)


def _write_pages(sweep: Sweep, records: Records, folder: Path) -> list[Row]:
    rows, place = rows_of(sweep, records), RunDirectory(folder, linked=False)
    place.write_text("table.csv", csv_text(rows))
    place.write_text("index.html", page_text(sweep.name, rows, folder))
    return rows


def report_sweep(paths: Sequence[Path], out: Path | None = None) -> list[Path]:
    """Write the reports of a sweep, if `paths` is the folder of one; returns what was written.

    Raises InputError if `out` is given, which a sweep does not take, or a run cannot be read.
    """
    if len(paths) != 1 or not (paths[0] / ASKED).is_file():
        return []
    if out is not None:
        raise InputError("--out: the page of a sweep stands in its folder; leave it out")
    return write_reports(paths[0])


def write_reports(folder: Path) -> list[Path]:
    """Write the report of each finished run of a sweep, and its page anew; returns their paths.

    Raises InputError if the folder holds no sweep, or a run cannot be read.
    """
    sweep = read_sweep(folder / ASKED)
    with _alone_in(folder):
        records = _take_up(folder, sweep)
        written = [folder / str(one["folder"]) / REPORT for one in records.values()]
        for path in written:
            write_report([path.parent], path)
        _write_pages(sweep, records, folder)
    return [*written, folder / "index.html"]


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Make the folder, or take one of a sweep, and keep others from working there.

    Raises InputError if it cannot be written, holds something else, or a sweep is at work there.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / ASKED).is_file():
        raise InputError(f"{folder}: holds no sweep; choose a new or an empty folder, or a sweep's")
    RunDirectory(folder, linked=False).create()
    place = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise InputError(f"{folder}: another sweep is at work there") from None
    else:
        yield
    finally:
        os.close(place)


def _take_up(folder: Path, sweep: Sweep) -> Records:
    """Find what is finished of this sweep; half a run is cleared away."""
    RunDirectory(folder, linked=False).write_text(ASKED, sweep.text)
    _sweep_out(folder)
    wanted, found = {run.mark for run in sweep.runs}, {}
    for path in sorted((folder / RUNS).glob(f"*/{RECORD}")):
        mark = path.parent.name.rpartition("_")[2]
        with suppress(ValueError):
            record = json.loads(path.read_text(encoding="utf-8"))
            whole = isinstance(record, dict) and record.keys() >= {*FIGURES}
            if mark in wanted and whole and record["exit_code"] in (0, 1):
                found[mark] = record
    return found


def _sweep_out(folder: Path) -> None:
    for half in (folder / RUNS).glob(".*"):
        shutil.rmtree(half, ignore_errors=True)  # whoever was killed may have a worker left


def _made(
    todo: Iterable[SweepRun], folder: Path, workers: Workers
) -> Iterator[tuple[SweepRun, Record]]:
    """Runs as they are finished; one whose worker dies is begun again."""
    waiting, begun, under_way = deque(todo), Counter[str](), 0
    while waiting or under_way:
        while waiting and under_way < workers.width:
            run = waiting.popleft()
            place = folder / RUNS / run.name
            shutil.rmtree(place, ignore_errors=True)  # a run that failed
            workers.begin(Job(run, run.plan(place), place.with_name(f".{run.name}.{os.getpid()}")))
            under_way, begun[run.mark] = under_way + 1, begun[run.mark] + 1
        for job, record in workers.finished():
            under_way -= 1
            if record is None and begun[job.run.mark] < TRIES:
                shutil.rmtree(job.folder, ignore_errors=True)
                waiting.append(job.run)
            else:
                record = record or failed_record(f"its worker died {TRIES} times")
                yield job.run, _keep(job, record)


def _keep(job: Job, record: Record) -> Record:
    """Move a run's folder to its place, with a file of what belongs into the table."""
    named = {"folder": f"{RUNS}/{job.run.name}", "palpate": __version__, "asked": job.run.asked}
    kept = {name: record.get(name) for name in FIGURES} | named
    job.folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(kept, indent=2, default=str) + "\n"
    (job.folder / RECORD).write_text(text, encoding="utf-8")
    job.folder.rename(job.folder.with_name(job.run.name))
    return kept


def _progress(records: Records, last: SweepRun, total: int, seconds: float, kept: int) -> str:
    """How far it is, how long it takes, the best run, and what came of the last one."""
    errors = [one["rms_m"] for one in records.values() if one["rms_m"] is not None]
    best = f"best {millimetres(min(errors))}, " if errors else ""
    left = (total - len(records)) * seconds / (len(records) - kept)
    record = records[last.mark]
    came = f"{record['touches']} touches, rms {millimetres(record['rms_m'] or math.nan)}"
    return f"{len(records)} of {total}, {best}{left:.0f} s left; {last.name}: {came}"


def _resumable(finished: int, total: int, folder: Path) -> str:
    return f"{finished} of {total} runs are finished and kept; palpate sweep {folder} goes on"


class Job(NamedTuple):
    """A run to be made."""

    run: SweepRun
    plan: Plan
    folder: Path  # Where its files are to be, at the caller's


def explore_into(plan: Plan, folder: Path) -> Record:
    """Perform a run in this process into another folder than planned.

    Raises InputError if the folder cannot be written, or its disk is too full for a recording;
    whatever else fails is a record that says so.
    """
    path = str(folder / RECORDING)
    wirings = tuple(
        replace(one, params=with_fields(one.params, path=path)) if one.module == RECORDER else one
        for one in plan.wirings
    )
    moved = replace(plan, folder=launch_RunDirectory(folder, linked=False), wirings=wirings)
    began = time.thread_time()
    try:
        done = perform(moved, composed=True, display=Display())
    except InputError:
        raise
    except Exception as error:  # one run must not end all others
        return failed_record(f"{type(error).__name__}: {error}")
    cpu = done.summary["compute_s"] or time.thread_time() - began
    return {**done.summary, "exit_code": done.exit_code, "compute_s": cpu}


def failed_record(reason: str) -> Record:
    """Of a run that came to nothing."""
    return {"status": "died", "reason": " ".join(reason.split()), "exit_code": 3}


class LocalWorkers:
    """Processes on this machine, a fresh one for each run, forked where all is imported."""

    def __init__(self, count: int) -> None:
        self.width = count  # So many runs at a time keep all busy
        prestart_fork_server(EXPLORE)
        self._busy: dict[connection.Connection, tuple[BaseProcess, Job]] = {}

    def begin(self, job: Job) -> None:
        """Have a run made."""
        ours, theirs = CONTEXT.Pipe(duplex=False)
        arguments = (theirs, job.plan, job.folder.absolute())  # it starts in another folder
        process = CONTEXT.Process(target=_explore_for, args=arguments, daemon=True)
        with without_main_module():
            process.start()
        theirs.close()  # so that the end of the process is the end of the pipe
        self._busy[ours] = process, job

    def finished(self) -> Iterator[tuple[Job, Record | None]]:
        """Wait for a run, or several; InputError if no further one can be made."""
        for pipe in connection.wait(list(self._busy)):
            assert isinstance(pipe, connection.Connection)
            process, job = self._busy.pop(pipe)
            found = None
            with pipe, suppress(EOFError, OSError):
                found = pipe.recv()
            process.join()
            if isinstance(found, InputError):
                raise found
            yield job, found

    def close(self) -> None:
        """End the processes; runs that are under way are given up."""
        for process, _ in self._busy.values():
            process.kill()
            process.join()


def _explore_for(pipe: connection.Connection, plan: Plan, folder: Path) -> None:
    """Make a run and hand its record over."""
    try:
        found: Record | InputError = explore_into(plan, folder)
    except InputError as error:
        found = error
    with suppress(OSError):
        pipe.send(found)


class ClusterWorkers:
    """A dask cluster, by its scheduler's address; it makes a run again when its worker dies.

    Raises InputError if dask.distributed is not installed, or nobody answers there.
    """

    def __init__(self, address: str) -> None:
        self._where = f"--scheduler {address}"
        try:
            from distributed import Client

            for name in ("distributed", "distributed.client"):  # we say it in a sentence
                logging.getLogger(name).setLevel(logging.CRITICAL)
            self._client = Client(address, timeout=ANSWER_TIME)
        except ImportError as error:
            needs = f"--scheduler needs dask.distributed ({error})"
            raise InputError(f"{needs}: pip install 'palpate[sweep]'") from None
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{self._where}: no scheduler can be reached: {error}") from None
        self.width = max(1, 2 * sum(self._client.nthreads().values()))
        self._busy: dict[Any, Job] = {}

    def begin(self, job: Job) -> None:
        """Have a run made."""
        self._busy[self._client.submit(explore_away, job.plan, pure=False)] = job

    def finished(self) -> Iterator[tuple[Job, Record | None]]:
        """Wait for a run, or several, and write what they left."""
        from distributed import wait

        for future in self._answer(lambda: wait([*self._busy], return_when="FIRST_COMPLETED").done):
            job, found = self._busy.pop(future), self._answer(future.result)
            record, files = found or (None, {})
            job.folder.mkdir(parents=True, exist_ok=True)
            for name, content in files.items():
                (job.folder / name).write_bytes(content)
            yield job, record

    def _answer(self, ask: Callable[[], Any]) -> Any:
        """What the cluster says; None if the workers of a run died again and again."""
        from distributed import CancelledError, KilledWorker

        try:
            return ask()
        except KilledWorker:
            return None
        except (Exception, CancelledError) as error:  # whatever a cluster can break by
            text = f"{type(error).__name__}: {str(error).partition('. ')[0]}"
            raise InputError(f"{self._where}: the cluster does not go on: {text}") from None

    def close(self) -> None:
        """Leave the cluster."""
        self._client.cancel(list(self._busy))
        self._client.close()


def explore_away(plan: Plan) -> tuple[Record, Mapping[str, bytes]]:
    """Perform a run on another machine: its record, and the files that it left, by name.

    Raises InputError as `explore_into`. Threads of one worker wait for each other.
    """
    with _one_at_a_time, tempfile.TemporaryDirectory(prefix="palpate-sweep-") as folder:
        place = Path(folder) / "run"
        record = explore_into(plan, place)
        return record, {path.name: path.read_bytes() for path in sorted(place.iterdir())}


Workers: TypeAlias = LocalWorkers | ClusterWorkers
