"""The progress of a run: gathered from messages, and shown live, as lines or not at all."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np

from palpate.launch.printing import counted
from palpate.messages.types import (
    BoundaryRepresentation,
    ConePose,
    Contour,
    ContourGoal,
    GeneralisedCone,
    GraspContacts,
    LogRecord,
    NodeStatus,
    Openings,
    ParameterEvent,
    PlanDone,
    PlanEstimate,
    Probe,
    ProcedureResult,
    Score,
    ShapeModel,
    Superquadric,
    Turned,
)
from palpate.nodes.runtime.composed import Watcher

if TYPE_CHECKING:
    from rich.console import Group, RenderableType

# What exploratory procedures recover
PROCEDURE_MODELS = (BoundaryRepresentation, ConePose, GeneralisedCone, Openings, Superquadric)
# Types of which the last message is kept, and the field of `Progress` that holds it.
LAST_KEPT: Mapping[type, str] = {
    ContourGoal: "goal",
    PlanDone: "done",
    ProcedureResult: "procedure",
    ShapeModel: "model",
    **dict.fromkeys(PROCEDURE_MODELS, "recovered"),
}
# Types of the messages that are gathered.
GATHERED_TYPES = (
    *LAST_KEPT, Contour, GraspContacts, ParameterEvent, PlanEstimate, Probe, Score, Turned
)  # fmt: skip
TRACED_STATUSES = ("closed", "occluded")  # Endings of a contour that is of use
MODEL_TOPIC = "/model/shape"  # As the planner calls the topic of the models it decides by
TOUCHES_A_LINE = 25  # Without a contour, between two lines of progress
BAR, REDRAWN = 70, 8  # Columns of the bar, and how often it is drawn in a second
LEVELS_SHOWN = frozenset({"warning", "error"})  # That a user sees; the rest is in log.jsonl


@dataclass(slots=True)
class Progress:
    """Everything worth telling while a run goes on and when it is over."""

    contacts: int = 0  # Contacts of the closing hand
    turns: int = 0  # Times that the object was turned over
    contours: int = 0  # Contours traced, those with gaps that the pad cannot reach among them
    failed: int = 0  # Slices of which nothing came
    done: PlanDone | None = None  # Why the exploration was over
    procedure: ProcedureResult | None = None  # What an exploratory procedure found
    recovered: Any = None  # Its model, one of `PROCEDURE_MODELS`
    touches: int = 0  # Touches made on contours and probes
    tolerance: float | None = None  # Error asked for, m
    goal: ContourGoal | None = None  # The contour in hand
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
    traced: bool = False  # Whether the log holds the trace of a node's error
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

    def tell(self, text: str) -> None:
        """Something worth a line is known."""

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
        # What the exploration is expected to cost, in words, by the coarse model
        self.expectation: Callable[[Superquadric], str] = lambda coarse: ""
        self._nodes, self._display, self._log, self._final = nodes, display, log, final
        self._began = time.monotonic()
        # Tolerances that were set while the planner ran, and not yet taken up by it
        self._tolerances: list[ParameterEvent] = []

    def ready(self, seconds: float) -> None:
        """All nodes are up and joined, this long after the launch began."""
        self.progress.ready = seconds
        self._display.ready(self._nodes, seconds)

    def received(self, topic: str, message: object) -> None:
        """A message on one of the gathered topics."""
        progress = self.progress
        self._stamp()
        if type(message) in LAST_KEPT:
            setattr(progress, LAST_KEPT[type(message)], message)
        if isinstance(message, (Contour, Probe, GraspContacts, Turned)):
            progress.robot_time = max(progress.robot_time, message.robot_time)
        if isinstance(
            message, (Probe, Turned)
        ):  # who turns it by hand says so with what is touched
            progress.turns = max(progress.turns, message.placement)
        if isinstance(message, Contour):
            traced = message.status in TRACED_STATUSES and len(message.points) > 0
            progress.contours += traced
            progress.failed += not traced
        if isinstance(message, (Contour, Probe)):
            progress.touches += message.touches
            progress.reports.append((progress.wall, progress.touches))
        elif isinstance(message, GraspContacts):
            progress.contacts += len(message.points)
        elif isinstance(message, ShapeModel):
            progress.made[message.number] = progress.wall
            if message.final:
                self._final(message)
            else:
                self._take_up_tolerance()
        elif isinstance(message, ParameterEvent) and message.topic == MODEL_TOPIC:
            self._tolerances += [message] if message.param == "tolerance" else []
            self._take_up_tolerance()
        elif isinstance(message, Score):
            progress.scores.append((progress.wall, message))
        elif isinstance(message, PlanEstimate):
            progress.estimates.append((progress.wall, message))
        elif isinstance(message, Superquadric) and (told := self.expectation(message)):
            self._display.tell(told)
        self._display.show(progress)

    def _take_up_tolerance(self) -> None:
        """The tolerance that the planner took up with the last model of those it decides by."""
        model, models = self.progress.model, len(self.progress.made)
        decided = models - (model is not None and model.final)
        for event in self._tolerances:
            if event.after < decided:
                self.progress.tolerance = float(event.value)

    def log(self, record: LogRecord) -> None:
        """A node has something to report."""
        self._stamp()
        line = {"wall_s": round(self.progress.wall, 3), **asdict(record)}
        line["robot_time_s"] = line.pop("robot_time")
        self.progress.traced |= record.level == "debug"
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


def open_display(*, quiet: bool, lines: bool = True) -> Display:
    """The display that suits the place where standard error goes.

    `lines`: whether lines are written where nothing can be redrawn, which a terminal and a notebook
    can.
    """
    if quiet:
        return Display()
    if sys.stderr.isatty() or _is_notebook():
        return LiveDisplay()
    return LineDisplay(sys.stderr) if lines else Display()


def _is_notebook() -> bool:
    if "IPython" not in sys.modules:
        return False
    from rich.console import Console

    return Console().is_jupyter


class LineDisplay(Display):
    """One line after each contour, and after so many touches without one; each warning once."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._told = (0, 0)
        self._noted: set[tuple[str, str]] = set()

    def ready(self, nodes: int, seconds: float) -> None:
        """Tell that all nodes are up."""
        self.print(f"ready    {nodes} nodes in {seconds:.1f} s")

    def show(self, progress: Progress) -> None:
        """Tell how far it is if another contour was traced, or many places were touched."""
        now = progress.contours + progress.failed, progress.touches // TOUCHES_A_LINE
        if now != self._told:
            self._told = now
            self.print(f"tracing  {progress_text(progress)}")

    def note(self, record: LogRecord) -> None:
        """Tell a warning, the first time."""
        key = (record.node, record.text)
        if record.level in LEVELS_SHOWN and key not in self._noted:
            self._noted.add(key)
            self.print(f"{record.level[:8]:<9}{record.node}: {record.text}")

    def tell(self, text: str) -> None:
        """Write what is known, in lines."""
        for line in text.splitlines():
            self.print(line)

    def print(self, line: str) -> None:
        """Write one line."""
        print(line, file=self._stream, flush=True)


class LiveDisplay(LineDisplay):
    """A bar towards the tolerance and the contour in hand, which change in place, and warnings."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.live import Live

        super().__init__(sys.stderr)
        self._console = Console(stderr=True, highlight=False, markup=False)
        self._live = Live(console=self._console, transient=True, refresh_per_second=REDRAWN)
        self._running = False

    def show(self, progress: Progress) -> None:
        """Draw it anew."""
        if not self._running:
            self._running = True
            self._live.start()
        self._live.update(_panel(progress))

    def close(self) -> None:
        """Take it away."""
        if self._running:
            self._live.stop()
            self._running = False

    def print(self, line: str) -> None:
        """Write one line above what changes."""
        self._console.print(line)


def _panel(progress: Progress) -> Group:
    """How far it is, the bar, and what is done now and why."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.progress_bar import ProgressBar
    from rich.text import Text

    shown: list[RenderableType] = [Text(progress_text(progress), no_wrap=True)]
    if progress.tolerance is not None:
        bar = ProgressBar(total=1.0, completed=progress_share(progress), width=BAR)
        shown.append(Padding(bar, 0))
    if progress.goal is not None and progress.done is None:
        height, reason = 1e3 * progress.goal.height, progress.goal.reason
        told = f"contour at {height:.0f} mm" + (f": {reason}" if reason else "")
        shown.append(Text(told, no_wrap=True, overflow="ellipsis"))
    return Group(*shown)


def progress_share(progress: Progress) -> float:
    """How far the error bound has come from its first value towards the tolerance, 0 to 1.

    By powers of ten: the way from 2 to 1 mm counts as that from 0.4 to 0.2 mm.
    """
    bounds = [one.rms_bound_95 for _, one in progress.estimates if one.rms_bound_95]
    if not bounds or progress.tolerance is None:
        return 0.0
    way, left = (math.log(one / progress.tolerance) for one in (max(bounds), bounds[-1]))
    return 1.0 if left <= 0.0 else 1.0 - left / way


def progress_text(progress: Progress) -> str:
    """Progress in one line of at most 71 columns."""
    if not progress.touches:
        return f"{progress.contacts} contacts of the hand  {progress.wall:.0f} s"
    parts = [counted(progress.contours, "contour")] if progress.contours or progress.failed else []
    parts.append(counted(progress.touches, "touch", "touches"))
    estimate, score, asked = progress.estimate, progress.score, progress.tolerance
    if estimate is not None and estimate.rms_bound_95 is not None and asked is not None:
        parts.append(f"bound {1e3 * estimate.rms_bound_95:.3f} of {1e3 * asked:.3g} mm")
    if score is not None:
        parts.append(f"true {1e3 * score.rms:.3f} mm")
    return "  ".join([*parts, f"{progress.wall:.0f} s"])
