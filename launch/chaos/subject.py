"""What chaos is put into: one exploration, run undisturbed first, to be compared with."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.launch.chaos.faults import Known
from palpate.launch.chaos.history import digests, read_history
from palpate.launch.run_dir import RECORDING
from palpate.messages.recording.reader import open_recording
from palpate.nodes.recording import recorded_wirings

FLOODED = """# Another graph with a source beside it that floods the recorder.
include: {included}
nodes:
  flood: {{kind: "palpate.launch.chaos.flood:SOURCE"}}
"""


@dataclass(frozen=True, slots=True)
class Subject:
    """An exploration as the command line starts it."""

    file: str
    """The launch file, by path or as a shipped one is called."""
    arguments: tuple[str, ...] = ()
    """Its arguments, ``name:=value``."""
    own: tuple[str, ...] = ()
    """Nodes whose modules are not palpate's own."""

    def start(self, out: Path, *, flooded: bool = False) -> subprocess.Popen[bytes]:
        """Start it in a session of its own; it writes into `out`, all else of it is beside that."""
        file = self.file
        if flooded:
            beside = out.with_suffix(".yaml")
            shipped = Path(self.file)
            included = str(shipped.resolve()) if shipped.is_file() else self.file
            beside.write_text(FLOODED.format(included=json.dumps(included)), encoding="utf-8")
            file = str(beside)
        return _palpate(["launch", file, *self.arguments], out)

    def go_on(self, bag: Path, out: Path) -> subprocess.Popen[bytes]:
        """Go on with what was recorded of it."""
        own = ["--nodes", ",".join(self.own)] if self.own else []
        return _palpate(["replay", str(bag), "--from", "end", *own], out)


@dataclass(frozen=True, slots=True)
class Undisturbed:
    """What the exploration comes to when nothing is done to it."""

    code: int
    """Exit code."""
    mesh: str | None
    """SHA-256 of the mesh; None where there is none."""
    said: Mapping[str, tuple[int, str]]
    """Number and digest of the messages of each topic."""
    seconds: float
    """Wall time of the graph, s."""
    known: Known
    """Its graph."""


def undisturbed(subject: Subject, out: Path) -> Undisturbed:
    """Run it once.

    Raises
    ------
    ValueError
        If it comes to no end by itself.
    """
    code = subject.start(out).wait()
    if code not in (0, 1) or not (out / "summary.json").exists():
        raise ValueError(f"the undisturbed run fails: {words_of(out)}")
    summary = summary_of(out)
    counts = {topic: number for topic, (number, _) in said_in(out).items()}
    graph = recorded_wirings(open_recording(out / RECORDING).graph)
    pairs = {(one.name, heard.publisher) for one in graph for heard in one.inputs}
    known = Known(tuple(summary["nodes"]), tuple(sorted(pairs)), counts)
    said, seconds = said_in(out), float(summary["wall_s"])
    return Undisturbed(code, summary["mesh_sha256"], said, seconds, known)


def said_in(out: Path) -> dict[str, tuple[int, str]]:
    """Number and digest of the messages of each topic that a run directory's recording holds."""
    return digests(read_history(out / RECORDING))


def summary_of(out: Path) -> dict[str, Any]:
    """The figures of a run directory."""
    found: dict[str, Any] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    return found


def words_of(out: Path) -> str:
    """What a run has said on its standard error, in one line."""
    words = _words(out)
    text = words.read_text(encoding="utf-8", errors="replace") if words.exists() else ""
    return " ".join(text.split()) or "it said nothing"


def _palpate(arguments: list[str], out: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "palpate", *arguments, "--out", str(out), "--quiet"]
    out.parent.mkdir(parents=True, exist_ok=True)
    with _words(out).open("wb") as words:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=words,
            stderr=words,
            start_new_session=True,
            env={**os.environ, "XDG_RUNTIME_DIR": str(out.parent)},
        )


def _words(out: Path) -> Path:
    return out.with_suffix(".txt")
