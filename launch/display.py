"""How progress looks: a live line on a terminal, plain lines elsewhere, or nothing."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, TextIO

from palpate.launch.progress import Display, Progress
from palpate.messages.types import LogRecord

if TYPE_CHECKING:
    from rich.status import Status

LEVELS_SHOWN = frozenset({"warning", "error"})
"""Levels of the log that a user sees; the rest is in log.jsonl."""


def open_display(*, quiet: bool) -> Display:
    """The display that suits the place where standard error goes."""
    if quiet:
        return Silence()
    return Live() if sys.stderr.isatty() else Lines(sys.stderr)


def progress_text(progress: Progress) -> str:
    """Progress in one line of at most 70 columns."""
    if not progress.touches:
        return f"{progress.contacts} contacts of the hand  {progress.wall:.0f} s"
    parts = [f"{progress.contours} contours", f"{progress.touches} touches"]
    if progress.touches_per_s is not None:
        parts.append(f"{progress.touches_per_s:.0f}/s")
    score = progress.score
    if score is not None:
        share = 100.0 * score.chamfer / score.size
        parts.append(f"error {1000.0 * score.chamfer:.2f} mm ({share:.2f} %)")
    parts.append(f"{progress.wall:.0f} s")
    return "  ".join(parts)


class Silence:
    """Shows nothing."""

    def ready(self, nodes: int, seconds: float) -> None:
        """Show nothing."""

    def show(self, progress: Progress) -> None:
        """Show nothing."""

    def note(self, record: LogRecord) -> None:
        """Show nothing."""

    def close(self) -> None:
        """Show nothing."""


class Lines:
    """One line whenever a model has been scored, and each warning once."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._scored = 0
        self._noted: set[tuple[str, str]] = set()

    def ready(self, nodes: int, seconds: float) -> None:
        """Say that all nodes are up."""
        self.print(f"ready    {nodes} nodes in {seconds:.1f} s")

    def show(self, progress: Progress) -> None:
        """Say how far it is if there is a new score."""
        if len(progress.scores) > self._scored:
            self._scored = len(progress.scores)
            self.print(f"tracing  {progress_text(progress)}")

    def note(self, record: LogRecord) -> None:
        """Say a warning, the first time."""
        key = (record.node, record.text)
        if record.level in LEVELS_SHOWN and key not in self._noted:
            self._noted.add(key)
            self.print(f"{record.level[:8]:<9}{record.node}: {record.text}")

    def close(self) -> None:
        """Nothing is left open."""

    def print(self, line: str) -> None:
        """Write one line."""
        print(line, file=self._stream, flush=True)


class Live(Lines):
    """A line that changes in place, above it what stays."""

    def __init__(self) -> None:
        from rich.console import Console

        super().__init__(sys.stderr)
        self._console = Console(stderr=True, highlight=False, markup=False)
        self._status: Status | None = None

    def show(self, progress: Progress) -> None:
        """Draw the line anew."""
        text = f"tracing  {progress_text(progress)}"
        if self._status is None:
            self._status = self._console.status(text)
            self._status.start()
        self._status.update(text)

    def close(self) -> None:
        """Take the line away."""
        if self._status is not None:
            self._status.stop()
            self._status = None

    def print(self, line: str) -> None:
        """Write one line above the live one."""
        self._console.print(line)
