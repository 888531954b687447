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

# Types of the models that exploratory procedures recover.
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
TRACED_STATUSES = ("closed", "occluded")  # of a contour that was traced
MODEL_TOPIC = "/model/shape"  # planner's name of the topic of the models by which it decides
SHOWN_LEVELS = frozenset({"warning", "error"})  # all levels are in log.jsonl


@dataclass(slots=True)
class Progress:
    """Counts, times, models and scores of a run; wall times are since the launch [s]."""

    contacts: int = 0  # of the closing hand
    turns: int = 0  # number of times that the object was turned over
    contours: int = 0  # that were traced, some with gaps that the pad cannot reach
    failed_contours: int = 0  # slices that could not be traced
    done: PlanDone | None = None  # why the exploration ended
    procedure: ProcedureResult | None = None  # result of an exploratory procedure
    recovered: Any = None  # its model, one of `PROCEDURE_MODELS`
    touches: int = 0  # of contours and probes
    tolerance: float | None = None  # requested error [m]
    goal: ContourGoal | None = None  # contour that is being traced
    robot_time: float = 0.0  # of the last contour, probe, grasp or turn [s]
    ready: float | None = None  # wall time at which all nodes were joined [s]
    # Wall time [s] and number of touches at each contour and probe.
    reports: list[tuple[float, int]] = field(default_factory=list)
    wall: float = 0.0  # time since the launch [s]
    model: ShapeModel | None = None  # the last one
    # Wall time [s] of each score and estimate, in the order received.
    scores: list[tuple[float, Score]] = field(default_factory=list)
    estimates: list[tuple[float, PlanEstimate]] = field(default_factory=list)
    # Wall time, and processor time of all nodes until then [s].
    compute_times: list[tuple[float, float]] = field(default_factory=list)
    has_trace: bool = False  # whether the log holds the trace of a node's error
    model_times: dict[int, float] = field(default_factory=dict)  # wall time of each model [s]

    @property
    def touches_per_s(self) -> float | None:
        """Touches per second between the first report and the last; None if there is no rate.

        Before the first report the scene is built; after the last one models are measured.
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
        """Processor time of all nodes until a wall time [s]; None if no node has reported any."""
        if not self.compute_times:
            return None
        walls, seconds = np.array(self.compute_times).T
        return float(np.interp(wall, walls, seconds))


class Display:
    """Shows the progress of a run; this base class shows nothing."""

    def ready(self, nodes: int, seconds: float) -> None:
        """All nodes are up."""

    def show(self, progress: Progress) -> None:
        """Show progress that may have changed."""

    def tell(self, text: str) -> None:
        """Show some lines of text."""

    def note(self, record: LogRecord) -> None:
        """Show a log record of a node."""

    def close(self) -> None:
        """End the display with the run."""


class ProgressWatcher(Watcher):
    """Keeps the progress of a run, writes its log and updates its display."""

    def __init__(
        self,
        nodes: int,
        display: Display,
        log: TextIO,
        final: Callable[[ShapeModel], object] = lambda model: None,  # called with the final model
    ) -> None:
        self.progress = Progress()
        # Text on the cost that the exploration is expected to have, by the coarse model.
        self.expectation: Callable[[Superquadric], str] = lambda coarse: ""
        self._nodes, self._display, self._log, self._final = nodes, display, log, final
        self._began = time.monotonic()
        # Changes of the tolerance while the planner runs; it applies them with a later model.
        self._tolerance_events: list[ParameterEvent] = []

    def ready(self, seconds: float) -> None:
        """Record the time since the launch at which all nodes are joined [s]."""
        self.progress.ready = seconds
        self._display.ready(self._nodes, seconds)

    def received(self, topic: str, message: object) -> None:
        """Take up a message on one of the gathered topics."""
        progress = self.progress
        self._stamp()
        if type(message) in LAST_KEPT:
            setattr(progress, LAST_KEPT[type(message)], message)
        if isinstance(message, (Contour, Probe, GraspContacts, Turned)):
            self._count(message)
        elif isinstance(message, ShapeModel):
            progress.model_times[message.number] = progress.wall
            if message.final:
                self._final(message)
            else:
                self._take_up_tolerance()
        elif isinstance(message, ParameterEvent) and message.topic == MODEL_TOPIC:
            self._tolerance_events += [message] if message.param == "tolerance" else []
            self._take_up_tolerance()
        elif isinstance(message, Score):
            progress.scores.append((progress.wall, message))
        elif isinstance(message, PlanEstimate):
            progress.estimates.append((progress.wall, message))
        elif isinstance(message, Superquadric) and (text := self.expectation(message)):
            self._display.tell(text)
        self._display.show(progress)

    def _count(self, message: Contour | Probe | GraspContacts | Turned) -> None:
        """Add a message to the counts, and advance the robot time."""
        progress = self.progress
        progress.robot_time = max(progress.robot_time, message.robot_time)
        if isinstance(message, (Probe, Turned)):  # turns by hand appear in probes alone
            progress.turns = max(progress.turns, message.placement)
        if isinstance(message, Contour):
            is_traced = message.status in TRACED_STATUSES and len(message.points) > 0
            progress.contours += is_traced
            progress.failed_contours += not is_traced
        if isinstance(message, (Contour, Probe)):
            progress.touches += message.touches
            progress.reports.append((progress.wall, progress.touches))
        elif isinstance(message, GraspContacts):
            progress.contacts += len(message.points)

    def _take_up_tolerance(self) -> None:
        """Take up the tolerances that the planner has applied with its models so far."""
        model, n_models = self.progress.model, len(self.progress.model_times)
        n_decided = n_models - (model is not None and model.final)
        for event in self._tolerance_events:
            if event.after < n_decided:
                self.progress.tolerance = float(event.value)

    def log(self, record: LogRecord) -> None:
        """Write a record of a node to the log, and show it."""
        self._stamp()
        line = {"wall_s": round(self.progress.wall, 3), **asdict(record)}
        line["robot_time_s"] = line.pop("robot_time")
        self.progress.has_trace |= record.level == "debug"
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()
        self._display.note(record)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Record the processor time of all nodes, from their last statuses."""
        self._stamp()
        seconds = sum(status.cpu for status in statuses.values())
        if seconds > 0.0:
            self.progress.compute_times.append((self.progress.wall, seconds))
        self._display.show(self.progress)

    def _stamp(self) -> None:
        self.progress.wall = time.monotonic() - self._began


def open_display(*, quiet: bool, lines: bool = True) -> Display:
    """A display on standard error: redrawn in a terminal or notebook, elsewhere lines of text.

    `quiet`: show nothing. `lines`: whether lines are written where nothing can be redrawn.
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
    """One line after each contour, and after `touches_per_line` touches; each warning once."""

    def __init__(self, stream: TextIO, touches_per_line: int = 25) -> None:
        self._stream, self._touches_per_line = stream, touches_per_line
        self._last_counts = (0, 0)
        self._noted: set[tuple[str, str]] = set()

    def ready(self, nodes: int, seconds: float) -> None:
        """Print the number of nodes and the time until all are joined [s]."""
        self.print(f"ready    {nodes} nodes in {seconds:.1f} s")

    def show(self, progress: Progress) -> None:
        """Print the progress after another contour, or after `touches_per_line` touches."""
        contours = progress.contours + progress.failed_contours
        counts = contours, progress.touches // self._touches_per_line
        if counts != self._last_counts:
            self._last_counts = counts
            self.print(f"tracing  {progress_text(progress)}")

    def note(self, record: LogRecord) -> None:
        """Print a warning or an error, the first time."""
        key = (record.node, record.text)
        if record.level in SHOWN_LEVELS and key not in self._noted:
            self._noted.add(key)
            self.print(f"{record.level[:8]:<9}{record.node}: {record.text}")

    def tell(self, text: str) -> None:
        """Print some lines of text."""
        for line in text.splitlines():
            self.print(line)

    def print(self, line: str) -> None:
        """Print one line."""
        print(line, file=self._stream, flush=True)


class LiveDisplay(LineDisplay):
    """A bar towards the tolerance and the current contour, redrawn in place, and warnings.

    `bar_width` is in columns; `refresh_rate` is in redraws per second.
    """

    def __init__(self, bar_width: int = 70, refresh_rate: float = 8) -> None:
        from rich.console import Console
        from rich.live import Live

        super().__init__(sys.stderr)
        self._console = Console(stderr=True, highlight=False, markup=False)
        self._live = Live(console=self._console, transient=True, refresh_per_second=refresh_rate)
        self._bar_width, self._running = bar_width, False

    def show(self, progress: Progress) -> None:
        """Redraw the progress."""
        if not self._running:
            self._running = True
            self._live.start()
        self._live.update(_panel(progress, self._bar_width))

    def close(self) -> None:
        """Remove the display."""
        if self._running:
            self._live.stop()
            self._running = False

    def print(self, line: str) -> None:
        """Print one line above the redrawn part."""
        self._console.print(line)


def _panel(progress: Progress, bar_width: int) -> Group:
    """The progress in words, the bar, and the current contour with its reason."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.progress_bar import ProgressBar
    from rich.text import Text

    shown: list[RenderableType] = [Text(progress_text(progress), no_wrap=True)]
    if progress.tolerance is not None:
        bar = ProgressBar(total=1.0, completed=progress_share(progress), width=bar_width)
        shown.append(Padding(bar, 0))
    if progress.goal is not None and progress.done is None:
        height, reason = 1e3 * progress.goal.height, progress.goal.reason
        text = f"contour at {height:.0f} mm" + (f": {reason}" if reason else "")
        shown.append(Text(text, no_wrap=True, overflow="ellipsis"))
    return Group(*shown)


def progress_share(progress: Progress) -> float:
    """Fraction of the way of the error bound from its largest value to the tolerance, 0 to 1.

    It is logarithmic: from 2 to 1 mm is as much as from 0.4 to 0.2 mm.
    """
    bounds = [item.rms_bound_95 for _, item in progress.estimates if item.rms_bound_95]
    if not bounds or progress.tolerance is None:
        return 0.0
    whole, rest = (math.log(bound / progress.tolerance) for bound in (max(bounds), bounds[-1]))
    return 1.0 if rest <= 0.0 else 1.0 - rest / whole


def progress_text(progress: Progress) -> str:
    """Progress in one line of at most 71 columns."""
    if not progress.touches:
        return f"{progress.contacts} contacts of the hand  {progress.wall:.0f} s"
    contours = progress.contours + progress.failed_contours
    parts = [counted(progress.contours, "contour")] if contours else []
    parts.append(counted(progress.touches, "touch", "touches"))
    estimate, score, tolerance = progress.estimate, progress.score, progress.tolerance
    if estimate is not None and estimate.rms_bound_95 is not None and tolerance is not None:
        parts.append(f"bound {1e3 * estimate.rms_bound_95:.3f} of {1e3 * tolerance:.3g} mm")
    if score is not None:
        parts.append(f"true {1e3 * score.rms:.3f} mm")
    return "  ".join([*parts, f"{progress.wall:.0f} s"])
