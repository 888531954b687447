"""Who makes the runs of a sweep: processes on this machine, or the workers of a dask cluster.

Either is given plans that have passed every check, and gives back a record of figures; None for a
run whose worker died. A worker reads nothing but the plan, so that a cluster needs palpate and no
file of the user's; there the files that a run leaves come back with its record.
"""

from __future__ import annotations

import logging
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing import connection, get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from msgspec.structs import replace as with_fields

from palpate import launch
from palpate.launch.files import InputError
from palpate.launch.processes import without_main_module
from palpate.nodes.runtime import RECORDER
from palpate.tools.sweep.sweep_file import SweepRun

ANSWER_TIME = 10.0  # Time in which a scheduler must have answered, s
Record = dict[str, Any]  # The figures of `summary.json`, exit code and processor time
CONTEXT = get_context("forkserver")  # Ctrl-C is blocked in what is forked
_one_at_a_time = threading.Lock()


class Job(NamedTuple):
    """A run to be made."""

    run: SweepRun
    plan: launch.Plan
    folder: Path  # Where its files are to be, at the caller's


def explore_into(plan: launch.Plan, folder: Path) -> Record:
    """Perform a run in this process into another folder than planned.

    Raises InputError if the folder cannot be written, or its disk is too full for a recording;
    whatever else fails is a record that says so.
    """
    path = str(folder / launch.RECORDING)
    wirings = tuple(
        replace(one, params=with_fields(one.params, path=path)) if one.module == RECORDER else one
        for one in plan.wirings
    )
    moved = replace(plan, folder=launch.RunDirectory(folder, linked=False), wirings=wirings)
    began = time.thread_time()
    try:
        done = launch.perform(moved, composed=True, display=launch.Display())
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
        launch.prestart_fork_server(launch.EXPLORE)
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


def _explore_for(pipe: connection.Connection, plan: launch.Plan, folder: Path) -> None:
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
            raise InputError(
                f"--scheduler needs dask.distributed ({error}): pip install 'palpate[sweep]'"
            ) from None
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


def explore_away(plan: launch.Plan) -> tuple[Record, Mapping[str, bytes]]:
    """Perform a run on another machine: its record, and the files that it left, by name.

    Raises InputError as `explore_into`. Threads of one worker wait for each other.
    """
    with _one_at_a_time, tempfile.TemporaryDirectory(prefix="palpate-sweep-") as folder:
        place = Path(folder) / "run"
        record = explore_into(plan, place)
        return record, {path.name: path.read_bytes() for path in sorted(place.iterdir())}


Workers: TypeAlias = LocalWorkers | ClusterWorkers
