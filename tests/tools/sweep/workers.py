"""Workers that answer at once for the runs of a sweep."""

RECORD = {
    "status": "finished", "exit_code": 0, "tolerance_met": True, "chamfer_m": 1e-5, "rms_m": 2e-5,
    "p95_m": 3e-5, "hausdorff_m": 4e-5, "rms_bound_95_m": 5e-5, "largest_untouched_m": 2e-3,
    "sampling_floor_m": 5e-6, "size_m": 0.08, "contours": 5, "touches": 90, "robot_time_s": 300.5,
    "compute_s": 4.5, "wall_s": 5.5, "reason": "done; it was compared with the true one",
}  # fmt: skip


class Workers:
    """Answers each run, latest first, by a function of its place in the sweep, or of its count."""

    width = 3

    def __init__(self, answer, by_place=False):
        self.answer, self.by_place = answer, by_place
        self.begun, self.waiting, self.answered, self.closed = [], [], 0, False

    def begin(self, job):
        self.begun.append(job)
        self.waiting.append((len(self.begun) - 1, job))
        job.folder.mkdir(parents=True)
        (job.folder / "half.txt").write_text("half")

    def finished(self):
        place, job = self.waiting.pop()
        record = self.answer(place if self.by_place else self.answered)
        self.answered += 1
        if isinstance(record, BaseException):
            raise record
        return [(job, record)]

    def close(self):
        self.closed = True
