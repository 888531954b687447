"""Run after run with faults until the time is over, each examined when it has ended."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dev.chaos.fault_injection import (
    Fault,
    FaultInjector,
    GraphFacts,
    InjectionLog,
    NodeRecovery,
    draw_faults,
)
from dev.chaos.history import causality_violations, digests, read_history, violations_in
from palpate.launch.processes.registry import (
    FOLDER_PREFIX,
    MESSAGE_LOG_FOLDER,
    remove_stale_folders,
)
from palpate.launch.run_directory import RECORDING, read_summary
from palpate.messages.recording import open_recording
from palpate.nodes.runtime.node import recorded_nodes

FAULTS_PER_RUN = 8  # Of one run, unless one of them ends it
SLOWER, LONGEST = 20.0, 120.0  # Times the undisturbed run, and s more, that one may take
INTERRUPTED = 130
EXIT_GRACE = 5.0  # Processes are gone so soon after their launcher, s
FLOODED_LAUNCH_FILE = """# Another graph with a source beside it that floods the recorder.
include: {included}
nodes:
  flood: {{kind: "dev.chaos.fault_injection:SOURCE"}}
"""


@dataclass(slots=True)
class Tally:
    """What came of all runs so far."""

    seed: int  # Of the first run; the others follow
    runs: int = 0  # Runs with faults
    injected: Counter[str] = field(default_factory=Counter)  # Faults by kind
    phases: Counter[str] = field(default_factory=Counter)  # Faults by phase
    nodes: Counter[str] = field(default_factory=Counter)  # Faults by the node that they hit
    survived: int = 0  # Faults of runs with which nothing was wrong
    lost: int = 0  # Messages that are in no recording
    duplicated: int = 0  # Messages that are in a recording twice
    back: list[NodeRecovery] = field(default_factory=list)  # Nodes that were hit and came back
    # Seeds of runs with which something was wrong, and what.
    failed: list[tuple[int, str]] = field(default_factory=list)

    def add(self, injected: InjectionLog, found: Examination) -> None:
        """Count one run."""
        self.runs += 1
        self.injected.update(fault.kind for fault in injected.faults)
        self.phases.update(fault.phase for fault in injected.faults)
        self.nodes.update(name for fault in injected.faults for name in fault.whom)
        self.survived += 0 if found.wrong else len(injected.faults)
        self.lost += found.lost
        self.duplicated += found.duplicated
        self.back += injected.back

    @property
    def figures(self) -> dict[str, Any]:
        """All of it, for a program."""
        times: dict[str, list[float]] = {"recovery": [], "stopped": []}
        for one in self.back:
            times["stopped" if one.kind == "stop" else "recovery"].append(one.seconds)
        return {
            "seed": self.seed,
            "runs": self.runs,
            "injected": sum(self.injected.values()),
            "survived": self.survived,
            "lost": self.lost,
            "duplicated": self.duplicated,
            **{
                f"{name}_p{round(100 * share)}_s": quantile(of, share)
                for name, of in times.items()
                for share in (0.5, 0.99)
            },
            "kinds": dict(self.injected),
            "phases": dict(self.phases),
            "nodes": dict(self.nodes),
            "back": [one._asdict() for one in self.back],
            "failed": [{"seed": seed, "what": what} for seed, what in self.failed],
        }

    def __str__(self) -> str:
        figures = self.figures
        counts = ("injected", "survived", "lost", "duplicated")
        parts = [f"{name} {figures[name]}" for name in counts]
        for name in ("recovery", "stopped"):
            p50, p99 = figures[f"{name}_p50_s"], figures[f"{name}_p99_s"]
            parts += [] if p50 is None else [f"{name} p50 {p50:.2f} s p99 {p99:.2f} s"]
        return " ".join(parts)


def quantile(times: Sequence[float], share: float) -> float | None:
    """The least of the times that this share of them does not exceed; None without any."""
    return float(np.quantile(times, share, method="inverted_cdf")) if times else None


def run_trials(
    subject: Exploration,
    *,
    seed: int,
    minutes: float,
    kinds: Sequence[str],
    echo: Callable[[str], None],
) -> Tally:
    """Run an exploration undisturbed, then with faults, seed by seed, until the minutes are over.

    Once at least. `echo` takes lines about the progress. ValueError if the first fails.
    """
    work = Path(tempfile.mkdtemp(prefix="chaos-"))
    tally = Tally(seed)
    try:
        before = run_baseline(subject, work / "undisturbed")
        echo(f"undisturbed: {before.seconds:.1f} s, {sum(before.known.counts.values())} messages")
        deadline = time.monotonic() + 60.0 * minutes
        while not tally.runs or time.monotonic() < deadline:
            number = seed + tally.runs
            planned = draw_faults(number, before.known, kinds, FAULTS_PER_RUN)
            _run_trial(subject, before, planned, work / f"seed_{number}", number, tally, echo)
    finally:
        if tally.failed:
            echo(f"what was wrong lies in {work}")
        else:
            shutil.rmtree(work, ignore_errors=True)
    return tally


def run_baseline(subject: Exploration, out: Path) -> Baseline:
    """Run it once; raises ValueError if it comes to no end by itself."""
    code = subject.start(out).wait()
    if code not in (0, 1) or not (out / "summary.json").exists():
        raise ValueError(f"the undisturbed run fails: {stderr_of(out)}")
    summary, messages = read_summary(out), messages_in(out)
    counts = {topic: number for topic, (number, _) in messages.items()}
    graph = recorded_nodes(open_recording(out / RECORDING).graph)
    pairs = {(one.name, edge.publisher) for one in graph for edge in one.inputs}
    known = GraphFacts(tuple(summary["nodes"]), tuple(sorted(pairs)), counts)
    return Baseline(code, summary["mesh_sha256"], messages, float(summary["wall_s"]), known)


def _run_trial(
    subject: Exploration,
    before: Baseline,
    planned: Sequence[Fault],
    out: Path,
    seed: int,
    tally: Tally,
    echo: Callable[[str], None],
) -> None:
    process = subject.start(out, flooded=any(fault.kind == "flood" for fault in planned))
    injector = FaultInjector(process, out, planned)
    try:
        ended = injector.run(time.monotonic() + SLOWER * before.seconds + LONGEST)
    finally:
        if process.poll() is None:
            kill_session(process.pid)
    code = process.wait()
    found = examine_run(subject, before, injector.done, code, out)
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


def examine_run(
    subject: Exploration, before: Baseline, injected: InjectionLog, code: int, out: Path
) -> Examination:
    """Look at all that a run that is over should be, and should not have left."""
    wrong, recording, expected = list(_left_over(injected, out)), out / RECORDING, before.code
    if ended := bool(injected.ended_by) and code != before.code:
        expected = INTERRUPTED if injected.ended_by == "ctrl_c" else -signal.SIGKILL
    if code != expected:
        wrong.append(f"exit code {code} instead of {expected}: {stderr_of(out)}")
    if not recording.exists():
        return Examination((*wrong, *["there is no recording"] * (not ended)), 0, 0)
    history = _judged(recording, whole=not ended)
    wrong += history.wrong
    if ended:
        wrong += _resumed_result(subject, before, recording, out)
        return history._replace(wrong=tuple(wrong))
    wrong += _other_result(before, out)
    found, lost = messages_in(out), history.lost
    for topic, (number, _) in before.messages.items():  # at their ends, which leaves no gap
        lost += max(0, number - found.get(topic, (0, ""))[0])
    return Examination(tuple(wrong), lost, history.duplicated)


def _left_over(injected: InjectionLog, out: Path) -> Iterator[str]:
    if injected.session:
        deadline = time.monotonic() + EXIT_GRACE
        while (living := _processes_of(injected.session)) and time.monotonic() < deadline:
            time.sleep(0.01)
        if living:
            yield f"processes {living} are left"
            kill_session(injected.session)
    if injected.ended_by == "launcher":
        remove_stale_folders(out.parent)  # as the next launch does
    elif (out / MESSAGE_LOG_FOLDER).exists():
        yield "what nodes had published is left in the run directory"
    for folder in out.parent.glob(f"{FOLDER_PREFIX}*"):
        yield f"the private folder {folder} is left"


def kill_session(session: int) -> None:
    """Kill what is left of a run."""
    for pid in _processes_of(session):
        os.kill(pid, signal.SIGKILL)


def _processes_of(session: int) -> list[int]:
    """Processes of a session; one that only waits to be reaped does not count."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(FileNotFoundError, ProcessLookupError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if fields[0] != "Z" and int(fields[3]) == session:
                found.append(int(folder.name))
    return found


def _judged(recording: Path, *, whole: bool) -> Examination:
    history = read_history(recording)
    found = [*violations_in(history), *causality_violations(history, whole=whole)]
    wrong = [f"{one.law}: {one.text}" for one in found]
    if whole and not history.closed:
        wrong.append("the recording was not closed")
    lost = sum(one.law == "gap" for one in found)
    return Examination(tuple(wrong), lost, sum(one.law == "twice" for one in found))


def _resumed_result(
    subject: Exploration, before: Baseline, recording: Path, out: Path
) -> Iterator[str]:
    """What is wrong with going on from what was recorded, to the end."""
    try:
        open_recording(recording)
    except ValueError as error:
        yield f"the recording cannot be read: {error}"
        return
    again = out / "again"
    code = subject.go_on(recording, again).wait()
    if code != before.code:
        yield f"going on ends with exit code {code}: {stderr_of(again)}"
    else:
        yield from (f"gone on, {text}" for text in _other_result(before, again))


def stderr_of(out: Path) -> str:
    """What a run has printed on its standard error, in one line."""
    words = out.with_suffix(".txt")
    text = words.read_text(encoding="utf-8", errors="replace") if words.exists() else ""
    return " ".join(text.split()) or "it printed nothing"


def _other_result(before: Baseline, out: Path) -> Iterator[str]:
    """In what the result is not that of the undisturbed run."""
    mesh = read_summary(out)["mesh_sha256"]
    if mesh != before.mesh:
        yield f"the mesh is {mesh} instead of {before.mesh}"
    found = messages_in(out)
    for topic, digest in before.messages.items():
        if found.get(topic) != digest:
            yield f"{topic} is not what it is undisturbed"


def messages_in(out: Path) -> dict[str, tuple[int, str]]:
    """Number and digest of the messages of each topic that a run directory's recording holds."""
    return digests(read_history(out / RECORDING))


class Examination(NamedTuple):
    """What was found after one run."""

    wrong: tuple[str, ...]  # What should not be so; nothing if the run survived
    lost: int  # Messages that are not in the recording
    duplicated: int  # Messages that are there more than once


@dataclass(frozen=True, slots=True)
class Exploration:
    """An exploration as the command line starts it."""

    file: str  # The launch file, by path or as a shipped one is called
    arguments: tuple[str, ...] = ()  # Its arguments, ``name:=value``
    own: tuple[str, ...] = ()  # Nodes whose modules are not palpate's own

    def start(self, out: Path, *, flooded: bool = False) -> subprocess.Popen[bytes]:
        """Start it in a session of its own; it writes into `out`, all else of it is beside that."""
        file = self.file
        if flooded:
            shipped, file = Path(self.file), str(out.with_suffix(".yaml"))
            included = json.dumps(str(shipped.resolve()) if shipped.is_file() else self.file)
            Path(file).write_text(FLOODED_LAUNCH_FILE.format(included=included), encoding="utf-8")
        return _start_palpate(["launch", file, *self.arguments], out)

    def go_on(self, bag: Path, out: Path) -> subprocess.Popen[bytes]:
        """Go on with what was recorded of it."""
        own = ["--nodes", ",".join(self.own)] if self.own else []
        return _start_palpate(["replay", str(bag), "--from", "end", *own], out)


def _start_palpate(arguments: list[str], out: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", "-m", "palpate", *arguments, "--out", str(out), "--quiet"]
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.with_suffix(".txt").open("wb") as words:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=words,
            stderr=words,
            start_new_session=True,
            env={**os.environ, "XDG_RUNTIME_DIR": str(out.parent)},
        )


@dataclass(frozen=True, slots=True)
class Baseline:
    """What the exploration comes to when nothing is done to it."""

    code: int  # Exit code
    mesh: str | None  # SHA-256 of the mesh; None where there is none
    messages: Mapping[str, tuple[int, str]]  # Number and digest of the messages of each topic
    seconds: float  # Wall time of the graph, s
    known: GraphFacts  # Its graph
