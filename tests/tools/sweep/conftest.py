"""Sweeps without explorations: records are made up, and whoever asks for a run has it at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest

from palpate.tools.sweep.sweep_folder import Job, Record

RECORD: Record = {
    "status": "finished",
    "exit_code": 0,
    "tolerance_met": True,
    "chamfer_m": 1e-5,
    "rms_m": 2e-5,
    "p95_m": 3e-5,
    "hausdorff_m": 4e-5,
    "rms_bound_95_m": 5e-5,
    "largest_untouched_m": 2e-3,
    "sampling_floor_m": 5e-6,
    "size_m": 0.08,
    "contours": 5,
    "touches": 90,
    "robot_time_s": 300.5,
    "compute_s": 4.5,
    "wall_s": 5.5,
    "reason": "done; the final solid was compared with the true one",
}


class FakeWorkers:
    """Answers each run, latest first, by a function of how many it has answered."""

    width = 3

    def __init__(self, answer: Callable[[int], Record | BaseException | None]) -> None:
        self.answer, self.begun, self.answered, self.closed = answer, list[Job](), 0, False
        self.waiting: list[Job] = []

    def begin(self, job: Job) -> None:
        self.begun.append(job)
        self.waiting.append(job)
        job.folder.mkdir(parents=True)
        (job.folder / "half.txt").write_text("half")

    def finished(self) -> Iterable[tuple[Job, Record | None]]:
        job, found = self.waiting.pop(), self.answer(self.answered)
        self.answered += 1
        if isinstance(found, BaseException):
            raise found
        return [(job, found)]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def fake() -> Any:
    """Workers that answer with records of growing errors, unless told otherwise."""

    def make(answer: Callable[[int], Any] | None = None) -> FakeWorkers:
        return FakeWorkers(answer or (lambda number: RECORD | {"rms_m": 1e-5 * (1 + number)}))

    return make
