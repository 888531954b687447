"""Run after run with faults, until the time is over, and one line that says what came of it."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.launch.chaos.aftermath import Found, end_session, look
from palpate.launch.chaos.faults import Fault, draw
from palpate.launch.chaos.injector import Back, Injected, Injector
from palpate.launch.chaos.subject import Subject, Undisturbed, undisturbed

FAULTS = 8
"""Of one run, unless one of them ends it."""
SLOWER, LONGEST = 20.0, 120.0
"""A run may take so many times as long as the undisturbed one, and so many s more."""


@dataclass(slots=True)
class Tally:
    """What came of all runs so far."""

    seed: int
    """Of the first run; the others follow."""
    runs: int = 0
    """Runs with faults."""
    injected: Counter[str] = field(default_factory=Counter)
    """Faults by kind."""
    phases: Counter[str] = field(default_factory=Counter)
    """Faults by phase."""
    nodes: Counter[str] = field(default_factory=Counter)
    """Faults by the node that they hit."""
    survived: int = 0
    """Faults of runs with which nothing was wrong."""
    lost: int = 0
    """Messages that are in no recording."""
    duplicated: int = 0
    """Messages that are in a recording twice."""
    back: list[Back] = field(default_factory=list)
    """Nodes that were hit and came back."""
    failed: list[tuple[int, str]] = field(default_factory=list)
    """Seeds of runs with which something was wrong, and what."""

    def add(self, injected: Injected, found: Found) -> None:
        """Count one run."""
        self.runs += 1
        self.injected.update(fault.kind for fault in injected.faults)
        self.phases.update(fault.moment.phase for fault in injected.faults)
        self.nodes.update(name for fault in injected.faults for name in fault.whom)
        self.survived += 0 if found.wrong else len(injected.faults)
        self.lost += found.lost
        self.duplicated += found.duplicated
        self.back += injected.back

    @property
    def figures(self) -> dict[str, Any]:
        """All of it, for a program."""
        return {
            "seed": self.seed,
            "runs": self.runs,
            "injected": sum(self.injected.values()),
            "survived": self.survived,
            "lost": self.lost,
            "duplicated": self.duplicated,
            "recovery_p50_s": quantile(self._killed, 0.5),
            "recovery_p99_s": quantile(self._killed, 0.99),
            "stopped_p50_s": quantile(self._stopped, 0.5),
            "stopped_p99_s": quantile(self._stopped, 0.99),
            "kinds": dict(self.injected),
            "phases": dict(self.phases),
            "nodes": dict(self.nodes),
            "back": [one._asdict() for one in self.back],
            "failed": [{"seed": seed, "what": what} for seed, what in self.failed],
        }

    def __str__(self) -> str:
        text = (
            f"injected {sum(self.injected.values())} survived {self.survived} "
            f"lost {self.lost} duplicated {self.duplicated}"
        )
        for name, times in (("recovery", self._killed), ("stopped", self._stopped)):
            if times:
                text += (
                    f" {name} p50 {quantile(times, 0.5):.2f} s p99 {quantile(times, 0.99):.2f} s"
                )
        return text

    @property
    def _killed(self) -> list[float]:
        return [one.seconds for one in self.back if one.kind != "stop"]

    @property
    def _stopped(self) -> list[float]:
        return [one.seconds for one in self.back if one.kind == "stop"]


def quantile(times: Sequence[float], share: float) -> float | None:
    """The least of the times that this share of them does not exceed; None without any."""
    ordered = sorted(times)
    return ordered[max(0, -int(-share * len(ordered) // 1) - 1)] if ordered else None


def campaign(
    subject: Subject,
    *,
    seed: int,
    minutes: float,
    kinds: Sequence[str],
    echo: Callable[[str], None],
    faults: int = FAULTS,
) -> Tally:
    """Run an exploration undisturbed, and then with faults until the time is over, but once.

    Parameters
    ----------
    subject : Subject
        What is explored.
    seed : int
        Of the first run; each further one has the next.
    minutes : float
        No run is begun later than this.
    kinds : sequence of str
        Faults that may be put in.
    echo : callable
        Takes lines about the progress.
    faults : int
        Most faults of one run.

    Raises
    ------
    ValueError
        If the undisturbed run fails.
    """
    work = Path(tempfile.mkdtemp(prefix="chaos-"))
    tally = Tally(seed)
    try:
        before = undisturbed(subject, work / "undisturbed")
        echo(f"undisturbed: {before.seconds:.1f} s, {sum(before.known.counts.values())} messages")
        deadline = time.monotonic() + 60.0 * minutes
        while not tally.runs or time.monotonic() < deadline:
            number = seed + tally.runs
            planned = draw(number, before.known, kinds, faults)
            _one(subject, before, planned, work / f"seed_{number}", number, tally, echo)
    finally:
        if tally.failed:
            echo(f"what was wrong lies in {work}")
        else:
            shutil.rmtree(work, ignore_errors=True)
    return tally


def _one(
    subject: Subject,
    before: Undisturbed,
    planned: Sequence[Fault],
    out: Path,
    seed: int,
    tally: Tally,
    echo: Callable[[str], None],
) -> None:
    flooded = any(fault.kind == "flood" for fault in planned)
    process = subject.start(out, flooded=flooded)
    injector = Injector(process, out, planned)
    try:
        ended = injector.run(time.monotonic() + SLOWER * before.seconds + LONGEST)
    finally:
        if process.poll() is None:
            end_session(process.pid)
    code = process.wait()
    found = look(subject, before, injector.done, code, out)
    if not ended:
        found = found._replace(wrong=("it came to no end", *found.wrong))
    tally.add(injector.done, found)
    echo(f"seed {seed}: {len(injector.done.faults)} of {len(planned)} faults; {tally}")
    if found.wrong:
        tally.failed += [(seed, text) for text in found.wrong]
        for text in [*map(str, injector.done.faults), *found.wrong]:
            echo(f"  {text}")
    else:
        shutil.rmtree(out, ignore_errors=True)
