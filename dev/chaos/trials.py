"""Runs with faults until the time is over; each is examined when it has ended."""

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

INTERRUPTED = 130  # Exit code after SIGINT
FLOODED_LAUNCH_FILE = """# Another graph, and a source that floods the recorder.
include: {included}
nodes:
  flood: {{kind: "dev.chaos.fault_injection:SOURCE"}}
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSettings:
    """Faults of a run, and how long it may take."""

    faults_per_run: int = 8  # unless one fault ends the run
    max_slowdown: float = 20.0  # elapsed time of a run / of the run without faults
    extra_time: float = 120.0  # [s] added to that limit
    exit_grace: float = 5.0  # [s] after the end of the launcher, until all processes have ended


@dataclass(slots=True)
class Tally:
    """Counts over all runs so far."""

    seed: int  # Of the first run; those of the next ones follow
    runs: int = 0  # Number of runs with faults
    injected: Counter[str] = field(default_factory=Counter)  # Faults by kind
    phases: Counter[str] = field(default_factory=Counter)  # Faults by phase
    nodes: Counter[str] = field(default_factory=Counter)  # Faults by node
    survived: int = 0  # Faults of runs without a problem
    lost: int = 0  # Messages that are missing in recordings
    duplicated: int = 0  # Messages that are recorded twice
    recoveries: list[NodeRecovery] = field(default_factory=list)
    failed: list[tuple[int, str]] = field(default_factory=list)  # Seeds and problems of runs

    def add(self, log: InjectionLog, examination: Examination) -> None:
        """Count one run."""
        self.runs += 1
        self.injected.update(fault.kind for fault in log.faults)
        self.phases.update(fault.phase for fault in log.faults)
        self.nodes.update(name for fault in log.faults for name in fault.nodes)
        self.survived += 0 if examination.problems else len(log.faults)
        self.lost += examination.lost
        self.duplicated += examination.duplicated
        self.recoveries += log.recoveries

    @property
    def figures(self) -> dict[str, Any]:
        """All counts and times, for JSON."""
        times: dict[str, list[float]] = {"recovery": [], "stopped": []}
        for recovery in self.recoveries:
            name = "stopped" if recovery.kind == "stop" else "recovery"
            times[name].append(recovery.seconds)
        return {
            "seed": self.seed,
            "runs": self.runs,
            "injected": sum(self.injected.values()),
            "survived": self.survived,
            "lost": self.lost,
            "duplicated": self.duplicated,
            **{
                f"{name}_p{round(100 * share)}_s": quantile(seconds, share)
                for name, seconds in times.items()
                for share in (0.5, 0.99)
            },
            "kinds": dict(self.injected),
            "phases": dict(self.phases),
            "nodes": dict(self.nodes),
            "recoveries": [recovery._asdict() for recovery in self.recoveries],
            "failed": [{"seed": seed, "problem": problem} for seed, problem in self.failed],
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
    """The smallest of the times that a share of them does not exceed; None without times."""
    return float(np.quantile(times, share, method="inverted_cdf")) if times else None


def run_trials(
    subject: Exploration,
    *,
    seed: int,
    minutes: float,
    kinds: Sequence[str],
    echo: Callable[[str], None],
    settings: TrialSettings = TrialSettings(),
) -> Tally:
    """Run an exploration without faults, then with faults, seed by seed, until the time is over.

    There is at least one run with faults. `echo` receives lines about the progress. Raises
    ValueError if the run without faults fails.
    """
    work = Path(tempfile.mkdtemp(prefix="chaos-"))
    tally = Tally(seed)
    try:
        baseline = run_baseline(subject, work / "undisturbed")
        n_messages = sum(baseline.facts.counts.values())
        echo(f"undisturbed: {baseline.seconds:.1f} s, {n_messages} messages")
        deadline = time.monotonic() + 60.0 * minutes
        while not tally.runs or time.monotonic() < deadline:
            number = seed + tally.runs
            faults = draw_faults(number, baseline.facts, kinds, settings.faults_per_run)
            out = work / f"seed_{number}"
            log, examination = _run_trial(subject, baseline, faults, out, settings)
            tally.add(log, examination)
            echo(f"seed {number}: {len(log.faults)} of {len(faults)} faults; {tally}")
            _report(number, log, examination, out, tally, echo)
    finally:
        if tally.failed:
            echo(f"the failed runs are in {work}")
        else:
            shutil.rmtree(work, ignore_errors=True)
    return tally


def run_baseline(subject: Exploration, out: Path) -> Baseline:
    """Run an exploration without faults; raises ValueError if it fails."""
    code = subject.start(out).wait()
    if code not in (0, 1) or not (out / "summary.json").exists():
        raise ValueError(f"the undisturbed run fails: {stderr_of(out)}")
    summary, messages = read_summary(out), messages_in(out)
    counts = {topic: number for topic, (number, _) in messages.items()}
    graph = recorded_nodes(open_recording(out / RECORDING).graph)
    pairs = {(node.name, edge.publisher) for node in graph for edge in node.inputs}
    facts = GraphFacts(tuple(summary["nodes"]), tuple(sorted(pairs)), counts)
    return Baseline(code, summary["mesh_sha256"], messages, float(summary["wall_s"]), facts)


def _run_trial(
    subject: Exploration,
    baseline: Baseline,
    faults: Sequence[Fault],
    out: Path,
    settings: TrialSettings,
) -> tuple[InjectionLog, Examination]:
    """Run an exploration with faults, and examine the result."""
    process = subject.start(out, is_flooded=any(fault.kind == "flood" for fault in faults))
    injector = FaultInjector(process, out, faults)
    limit = settings.max_slowdown * baseline.seconds + settings.extra_time
    try:
        has_ended = injector.run(time.monotonic() + limit)
    finally:
        if process.poll() is None:
            kill_session(process.pid)
    code = process.wait()
    examination = examine_run(subject, baseline, injector.log, code, out, settings)
    if not has_ended:
        problems = ("it did not end", *examination.problems)
        examination = examination._replace(problems=problems)
    return injector.log, examination


def _report(
    seed: int,
    log: InjectionLog,
    examination: Examination,
    out: Path,
    tally: Tally,
    echo: Callable[[str], None],
) -> None:
    """Report a run that failed; remove the folder of one that survived."""
    if not examination.problems:
        shutil.rmtree(out, ignore_errors=True)
        return
    tally.failed += [(seed, problem) for problem in examination.problems]
    for text in [*map(str, log.faults), *examination.problems]:
        echo(f"  {text}")


def examine_run(
    subject: Exploration,
    baseline: Baseline,
    log: InjectionLog,
    code: int,
    out: Path,
    settings: TrialSettings = TrialSettings(),
) -> Examination:
    """Examine the exit code, the result and the remains of a run that has ended."""
    problems, recording = list(_remains(log, out, settings.exit_grace)), out / RECORDING
    expected = baseline.code
    if was_ended := bool(log.ended_by) and code != baseline.code:
        expected = INTERRUPTED if log.ended_by == "ctrl_c" else -signal.SIGKILL
    if code != expected:
        problems.append(f"exit code {code} instead of {expected}: {stderr_of(out)}")
    if not recording.exists():
        return Examination((*problems, *["there is no recording"] * (not was_ended)), 0, 0)
    history = _examine_recording(recording, is_whole=not was_ended)
    problems += history.problems
    if was_ended:
        problems += _resume_problems(subject, baseline, recording, out)
        return history._replace(problems=tuple(problems))
    problems += _result_problems(baseline, out)
    messages, lost = messages_in(out), history.lost
    for topic, (number, _) in baseline.messages.items():  # missing at the end, without a gap
        lost += max(0, number - messages.get(topic, (0, ""))[0])
    return Examination(tuple(problems), lost, history.duplicated)


def _remains(log: InjectionLog, out: Path, exit_grace: float) -> Iterator[str]:
    """Processes and folders that a run leaves behind."""
    if log.session:
        deadline = time.monotonic() + exit_grace
        while (living := _processes_of(log.session)) and time.monotonic() < deadline:
            time.sleep(0.01)
        if living:
            yield f"processes {living} still run"
            kill_session(log.session)
    if log.ended_by == "launcher":
        remove_stale_folders(out.parent)  # as the next launch does
    elif (out / MESSAGE_LOG_FOLDER).exists():
        yield "the nodes' message logs remain in the run directory"
    for folder in out.parent.glob(f"{FOLDER_PREFIX}*"):
        yield f"the private folder {folder} remains"


def kill_session(session: int) -> None:
    """Kill all processes of a session."""
    for pid in _processes_of(session):
        os.kill(pid, signal.SIGKILL)


def _processes_of(session: int) -> list[int]:
    """Processes of a session without zombies."""
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(FileNotFoundError, ProcessLookupError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if fields[0] != "Z" and int(fields[3]) == session:
                pids.append(int(folder.name))
    return pids


def _examine_recording(recording: Path, *, is_whole: bool) -> Examination:
    history = read_history(recording)
    violations = [*violations_in(history), *causality_violations(history, is_whole=is_whole)]
    problems = [f"{violation.law}: {violation.text}" for violation in violations]
    if is_whole and not history.is_closed:
        problems.append("the recording is not closed")
    laws = Counter(violation.law for violation in violations)
    return Examination(tuple(problems), laws["gap"], laws["twice"])


def _resume_problems(
    subject: Exploration, baseline: Baseline, recording: Path, out: Path
) -> Iterator[str]:
    """Problems of resuming a run from its recording to the end."""
    try:
        open_recording(recording)
    except ValueError as error:
        yield f"the recording cannot be read: {error}"
        return
    resumed = out / "again"
    code = subject.resume(recording, resumed).wait()
    if code != baseline.code:
        yield f"resuming ends with exit code {code}: {stderr_of(resumed)}"
    else:
        yield from (f"resumed, {text}" for text in _result_problems(baseline, resumed))


def stderr_of(out: Path) -> str:
    """Standard error of a run, in one line."""
    words = out.with_suffix(".txt")
    text = words.read_text(encoding="utf-8", errors="replace") if words.exists() else ""
    return " ".join(text.split()) or "it printed nothing"


def _result_problems(baseline: Baseline, out: Path) -> Iterator[str]:
    """Differences of the result from that of the run without faults."""
    mesh = read_summary(out)["mesh_sha256"]
    if mesh != baseline.mesh:
        yield f"the mesh is {mesh} instead of {baseline.mesh}"
    messages = messages_in(out)
    for topic, digest in baseline.messages.items():
        if messages.get(topic) != digest:
            yield f"{topic} differs from the run without faults"


def messages_in(out: Path) -> dict[str, tuple[int, str]]:
    """Number and digest of the messages of each topic in a run directory's recording."""
    return digests(read_history(out / RECORDING))


class Examination(NamedTuple):
    """Result of the examination of a run."""

    problems: tuple[str, ...]  # Empty if the run survived
    lost: int  # Messages that are missing in the recording
    duplicated: int  # Messages that are recorded more than once


@dataclass(frozen=True, slots=True)
class Exploration:
    """An exploration as the command line starts it."""

    file: str  # Path of the launch file, or name of a shipped one
    arguments: tuple[str, ...] = ()  # ``name:=value``
    own: tuple[str, ...] = ()  # Nodes whose modules are the user's, not palpate's

    def start(self, out: Path, *, is_flooded: bool = False) -> subprocess.Popen[bytes]:
        """Start it in a session of its own; it writes into `out` and into the parent of that."""
        file = self.file
        if is_flooded:
            shipped, file = Path(self.file), str(out.with_suffix(".yaml"))
            included = json.dumps(str(shipped.resolve()) if shipped.is_file() else self.file)
            Path(file).write_text(FLOODED_LAUNCH_FILE.format(included=included), encoding="utf-8")
        return _start_palpate(["launch", file, *self.arguments], out)

    def resume(self, bag: Path, out: Path) -> subprocess.Popen[bytes]:
        """Resume it from its recording."""
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
    """Result of the exploration without faults."""

    code: int  # Exit code
    mesh: str | None  # SHA-256 of the mesh; None without a mesh
    messages: Mapping[str, tuple[int, str]]  # Number and digest of the messages of each topic
    seconds: float  # Elapsed time of the graph
    facts: GraphFacts
