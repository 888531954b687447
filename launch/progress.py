"""The progress of a run: gathered from messages, and shown live, as lines or not at all."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from palpate.messages.types import BoundaryRepresentation, ConePose, Contour, GeneralisedCone
from palpate.messages.types import GraspContacts, LogRecord, NodeStatus, Openings, PlanDone
from palpate.messages.types import PlanEstimate, Probe, ProcedureResult, Score, ShapeModel
from palpate.messages.types import Superquadric
from palpate.nodes.runtime import Watcher

if TYPE_CHECKING:
    from rich.status import Status

# What exploratory procedures recover
PROCEDURE_MODELS = (BoundaryRepresentation, ConePose, GeneralisedCone, Openings, Superquadric)
# Types of the messages that are gathered.
GATHERED_TYPES = (
    *PROCEDURE_MODELS,
    Contour,
    GraspContacts,
    PlanDone,
    PlanEstimate,
    Probe,
    ProcedureResult,
    Score,
    ShapeModel,
)
TRACED_STATUSES = ("closed", "occluded")  # Endings of a contour that is of use
LEVELS_SHOWN = frozenset({"warning", "error"})  # That a user sees; the rest is in log.jsonl


@dataclass(slots=True)
class Progress:
    """Everything worth telling while a run goes on and when it is over."""

    contacts: int = 0  # Contacts of the closing hand
    contours: int = 0  # Contours traced, those with gaps that the pad cannot reach among them
    failed: int = 0  # Slices of which nothing came
    done: PlanDone | None = None  # Why the exploration was over
    procedure: ProcedureResult | None = None  # What an exploratory procedure found
    recovered: Any = None  # Its model, one of `PROCEDURE_MODELS`
    touches: int = 0  # Touches made on contours and probes
    robot_time: float = 0.0  # Robot time of the last of them, s
    ready: float | None = None  # Time from the launch until all nodes were joined, s
    # Time since the launch, s, and touches made by then, of each contour and probe.
    reports: list[tuple[float, int]] = field(default_factory=list)
    wall: float = 0.0  # Time since the launch began, s
    model: ShapeModel | None = None  # The last model
    # Time since the launch, s, and score, in the order received.
    scores: list[tuple[float, Score]] = field(default_factory=list)
    # The same of estimates, and of the processor time that all nodes have told of, s.
    estimates: list[tuple[float, PlanEstimate]] = field(default_factory=list)
    spent: list[tuple[float, float]] = field(default_factory=list)
    made: dict[int, float] = field(default_factory=dict)  # When each model was received, s

    @property
    def touches_per_s(self) -> float | None:
        """Touches per second between the first report and the last.

        Before, the scene is built; after, models are measured.
        """
        if len(self.reports) < 2:
            return None
        (began, before), (ended, after) = self.reports[0], self.reports[-1]
        return (after - before) / (ended - began) if ended > began else None

    @property
    def score(self) -> Score | None:
        """The last score."""
        return self.scores[-1][1] if self.scores else None

    @property
    def estimate(self) -> PlanEstimate | None:
        """The last estimate."""
        return self.estimates[-1][1] if self.estimates else None

    def compute_at(self, wall: float) -> float | None:
        """Processor time of all nodes until a time since the launch, s; None if none was told."""
        if not self.spent:
            return None
        walls, seconds = np.array(self.spent).T
        return float(np.interp(wall, walls, seconds))


class Display:
    """Where progress is shown; of itself it shows nothing."""

    def ready(self, nodes: int, seconds: float) -> None:
        """All nodes are up."""

    def show(self, progress: Progress) -> None:
        """Something may have changed."""

    def note(self, record: LogRecord) -> None:
        """A node has something to report."""

    def close(self) -> None:
        """The run is over."""


class ProgressWatcher(Watcher):
    """A watcher that keeps the progress, writes the log and feeds the display."""

    def __init__(
        self,
        nodes: int,
        display: Display,
        log: TextIO,
        final: Callable[[ShapeModel], object] = lambda model: None,  # Told of the final model
    ) -> None:
        self.progress = Progress()
        self._nodes, self._display, self._log, self._final = nodes, display, log, final
        self._began = time.monotonic()

    def ready(self, seconds: float) -> None:
        """All nodes are up and joined, this long after the launch began."""
        self.progress.ready = seconds
        self._display.ready(self._nodes, seconds)

    def received(self, topic: str, message: object) -> None:
        """A message on one of the gathered topics."""
        progress = self.progress
        self._stamp()
        if isinstance(message, (Contour, Probe)):
            if isinstance(message, Contour):
                traced = message.status in TRACED_STATUSES and len(message.points) > 0
                progress.contours += traced
                progress.failed += not traced
            progress.touches += message.touches
            progress.robot_time = max(progress.robot_time, message.robot_time)
            progress.reports.append((progress.wall, progress.touches))
        elif isinstance(message, GraspContacts):
            progress.contacts += len(message.points)
            progress.robot_time = max(progress.robot_time, message.robot_time)
        elif isinstance(message, PlanDone):
            progress.done = message
        elif isinstance(message, ProcedureResult):
            progress.procedure = message
        elif isinstance(message, PROCEDURE_MODELS):
            progress.recovered = message
        elif isinstance(message, ShapeModel):
            progress.model = message
            progress.made[message.number] = progress.wall
            if message.final:
                self._final(message)
        elif isinstance(message, Score):
            progress.scores.append((progress.wall, message))
        elif isinstance(message, PlanEstimate):
            progress.estimates.append((progress.wall, message))
        self._display.show(progress)

    def log(self, record: LogRecord) -> None:
        """A node has something to report."""
        self._stamp()
        line = {"wall_s": round(self.progress.wall, 3), **asdict(record)}
        line["robot_time_s"] = line.pop("robot_time")
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()
        self._display.note(record)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Time has gone by."""
        self._stamp()
        spent = sum(one.cpu for one in statuses.values())
        if spent > 0.0:
            self.progress.spent.append((self.progress.wall, spent))
        self._display.show(self.progress)

    def _stamp(self) -> None:
        self.progress.wall = time.monotonic() - self._began


def open_display(*, quiet: bool) -> Display:
    """The display that suits the place where standard error goes."""
    if quiet:
        return Display()
    return LiveDisplay() if sys.stderr.isatty() else LineDisplay(sys.stderr)


class LineDisplay(Display):
    """One line whenever a model has been scored, and each warning once."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._scored = 0
        self._noted: set[tuple[str, str]] = set()

    def ready(self, nodes: int, seconds: float) -> None:
        """Tell that all nodes are up."""
        self.print(f"ready    {nodes} nodes in {seconds:.1f} s")

    def show(self, progress: Progress) -> None:
        """Tell how far it is if there is a new score."""
        if len(progress.scores) > self._scored:
            self._scored = len(progress.scores)
            self.print(f"tracing  {progress_text(progress)}")

    def note(self, record: LogRecord) -> None:
        """Tell a warning, the first time."""
        key = (record.node, record.text)
        if record.level in LEVELS_SHOWN and key not in self._noted:
            self._noted.add(key)
            self.print(f"{record.level[:8]:<9}{record.node}: {record.text}")

    def print(self, line: str) -> None:
        """Write one line."""
        print(line, file=self._stream, flush=True)


class LiveDisplay(LineDisplay):
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


def progress_text(progress: Progress) -> str:
    """Progress in one line of at most 70 columns."""
    if not progress.touches:
        return f"{progress.contacts} contacts of the hand  {progress.wall:.0f} s"
    parts = [f"{progress.contours} contours"] if progress.contours or progress.failed else []
    parts.append(f"{progress.touches} touches")
    if progress.touches_per_s is not None:
        parts.append(f"{progress.touches_per_s:.0f}/s")
    score = progress.score
    if score is not None:
        share = 100.0 * score.chamfer / score.size
        parts.append(f"error {1000.0 * score.chamfer:.3f} mm ({share:.3f} %)")
    parts.append(f"{progress.wall:.0f} s")
    return "  ".join(parts)
