"""What a run has come to so far, gathered from the messages that the launcher hears."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Protocol, TextIO

from palpate.messages.types import (
    Contour,
    GraspContacts,
    LogRecord,
    NodeStatus,
    PlanDone,
    Probe,
    Score,
    ShapeModel,
)

GATHERED = (Contour, GraspContacts, PlanDone, Probe, Score, ShapeModel)
"""Types of the messages that are gathered."""
TRACED = ("closed", "occluded")
"""Endings of a contour that is of use."""


@dataclass(slots=True)
class Progress:
    """Everything worth telling while a run goes on and when it is over."""

    contacts: int = 0
    """Contacts of the closing hand."""
    contours: int = 0
    """Contours traced, those with gaps that the pad cannot reach among them."""
    failed: int = 0
    """Slices of which nothing came."""
    done: PlanDone | None = None
    """Why the exploration was over."""
    touches: int = 0
    """Touches made on contours and probes."""
    robot_time: float = 0.0
    """Robot time of the last of them, s."""
    ready: float | None = None
    """Time from the launch until all nodes were joined, s."""
    reports: list[tuple[float, int]] = field(default_factory=list)
    """Time since the launch, s, and touches made by then, of each contour and probe."""
    wall: float = 0.0
    """Time since the launch began, s."""
    model: ShapeModel | None = None
    """The last model."""
    scores: list[tuple[float, Score]] = field(default_factory=list)
    """Time since the launch, s, and score, in the order heard."""

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


class Display(Protocol):
    """Where progress is shown."""

    def ready(self, nodes: int, seconds: float) -> None:
        """All nodes are up."""

    def show(self, progress: Progress) -> None:
        """Something may have changed."""

    def note(self, record: LogRecord) -> None:
        """A node has something to say."""

    def close(self) -> None:
        """The run is over."""


class Gatherer:
    """A watcher that keeps the progress, writes the log and feeds the display."""

    def __init__(self, nodes: int, display: Display, log: TextIO) -> None:
        self.progress = Progress()
        self._nodes = nodes
        self._display = display
        self._log = log
        self._began = time.monotonic()

    def ready(self, seconds: float) -> None:
        """All nodes are up and joined, this long after the launch began."""
        self.progress.ready = seconds
        self._display.ready(self._nodes, seconds)

    def heard(self, topic: str, message: object) -> None:
        """A message on one of the gathered topics."""
        progress = self.progress
        self._stamp()
        if isinstance(message, (Contour, Probe)):
            if isinstance(message, Contour):
                traced = message.status in TRACED and len(message.points) > 0
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
        elif isinstance(message, ShapeModel):
            progress.model = message
        elif isinstance(message, Score):
            progress.scores.append((progress.wall, message))
        self._display.show(progress)

    def log(self, record: LogRecord) -> None:
        """A node has something to say."""
        self._stamp()
        line = {"wall_s": round(self.progress.wall, 3), **asdict(record)}
        line["robot_time_s"] = line.pop("robot_time")
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()
        self._display.note(record)

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Time has gone by."""
        self._stamp()
        self._display.show(self.progress)

    def _stamp(self) -> None:
        self.progress.wall = time.monotonic() - self._began
