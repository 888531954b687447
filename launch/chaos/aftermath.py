"""What is looked at when a run is over: its result, its history, and what it has left behind."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from palpate.launch.chaos.causes import uncaused
from palpate.launch.chaos.history import breaches, read_history
from palpate.launch.chaos.injector import Injected
from palpate.launch.chaos.subject import (
    Subject,
    Undisturbed,
    said_in,
    summary_of,
    words_of,
)
from palpate.launch.processes.register import PREFIX, sweep
from palpate.launch.run_dir import RECORDING
from palpate.messages.recording.reader import open_recording

INTERRUPTED = 130
GONE = 5.0
"""Processes are gone so soon after their launcher, s."""


class Found(NamedTuple):
    """What was found after one run."""

    wrong: tuple[str, ...]
    """What should not be so; nothing if the run survived."""
    lost: int
    """Messages that are not in the recording."""
    duplicated: int
    """Messages that are there more than once."""


def look(subject: Subject, before: Undisturbed, injected: Injected, code: int, out: Path) -> Found:
    """Look at all that a run that is over should be, and should not have left."""
    wrong = list(_left_over(injected, out))
    recording = out / RECORDING
    if injected.ended_by and code != before.code:
        expected = INTERRUPTED if injected.ended_by == "ctrl_c" else -signal.SIGKILL
        if code != expected:
            wrong.append(f"exit code {code} instead of {expected}: {words_of(out)}")
        if not recording.exists():
            return Found(tuple(wrong), 0, 0)
        history = _judged(recording, whole=False)
        wrong += history.wrong
        wrong += _gone_on(subject, before, recording, out)
        return Found(tuple(wrong), history.lost, history.duplicated)
    if code != before.code:
        wrong.append(f"exit code {code} instead of {before.code}: {words_of(out)}")
    if not recording.exists():
        return Found((*wrong, "there is no recording"), 0, 0)
    history = _judged(recording, whole=True)
    wrong += [*history.wrong, *_other_result(before, out)]
    return Found(tuple(wrong), history.lost + _lost(before.said, out), history.duplicated)


def end_session(session: int) -> None:
    """Kill what is left of a run."""
    for pid in _living(session):
        os.kill(pid, signal.SIGKILL)


def _left_over(injected: Injected, out: Path) -> Iterator[str]:
    if injected.session:
        deadline = time.monotonic() + GONE
        while (living := _living(injected.session)) and time.monotonic() < deadline:
            time.sleep(0.01)
        if living:
            yield f"processes {living} are left"
            end_session(injected.session)
    if injected.ended_by == "launcher":
        sweep(out.parent)  # as the next launch does
    elif (out / ".said").exists():
        yield "what nodes had said is left in the run directory"
    for folder in out.parent.glob(f"{PREFIX}*"):
        yield f"the private folder {folder} is left"


def _judged(recording: Path, *, whole: bool) -> Found:
    history = read_history(recording)
    found = [*breaches(history), *uncaused(history, whole=whole)]
    wrong = [f"{one.law}: {one.text}" for one in found]
    if whole and not history.closed:
        wrong.append("the recording was not closed")
    lost = sum(one.law == "gap" for one in found)
    return Found(tuple(wrong), lost, sum(one.law == "twice" for one in found))


def _other_result(before: Undisturbed, out: Path) -> Iterator[str]:
    """In what the result is not that of the undisturbed run."""
    mesh = summary_of(out)["mesh_sha256"]
    if mesh != before.mesh:
        yield f"the mesh is {mesh} instead of {before.mesh}"
    said = said_in(out)
    for topic, (number, digest) in before.said.items():
        if said.get(topic) != (number, digest):
            yield f"{topic} is not what it is undisturbed"


def _lost(before: Mapping[str, tuple[int, str]], out: Path) -> int:
    """Messages at the ends of topics, which leave no gap."""
    said = said_in(out)
    return sum(
        max(0, number - said.get(topic, (0, ""))[0]) for topic, (number, _) in before.items()
    )


def _gone_on(subject: Subject, before: Undisturbed, recording: Path, out: Path) -> Iterator[str]:
    """What is wrong with going on from what was recorded, to the end."""
    try:
        open_recording(recording)
    except ValueError as error:
        yield f"the recording cannot be read: {error}"
        return
    again = out / "again"
    code = subject.go_on(recording, again).wait()
    if code != before.code:
        yield f"going on ends with exit code {code}: {words_of(again)}"
    else:
        yield from (f"gone on, {text}" for text in _other_result(before, again))


def _living(session: int) -> list[int]:
    """Processes of a session; one that only waits to be buried does not count."""
    found = []
    for folder in Path("/proc").iterdir():
        if not folder.name.isdecimal():
            continue
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        if fields[0] != "Z" and int(fields[3]) == session:
            found.append(int(folder.name))
    return found
