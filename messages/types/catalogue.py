"""What nodes publish about themselves, and every message type by its name."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, is_dataclass
from typing import Annotated, Literal

from palpate.messages.fields import Count, Seconds, Unit
from palpate.messages.types import model, motion, procedure, touch, world
from palpate.reprs import readable


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NodeStatus:
    """A node's counters. On ``/node/status``."""

    node: str  # Name of the node
    # What the node is doing; rebuilding after it was started again
    state: Literal["starting", "rebuilding", "running", "ending"]
    messages: Count  # Messages handled so far
    sent: Count  # Messages published so far
    gaps: Count  # Messages that are missing
    duplicates: Count  # Messages that came twice and were dropped
    p50: Annotated[float, Unit("us")]  # Median time of a handler
    p99: Annotated[float, Unit("us")]  # 99 % quantile of the time of a handler
    cpu: Seconds  # Processor time used
    # Of that, by step of its work; the rest is starting, receiving and sending
    steps: dict[str, float] = field(default_factory=dict)


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LogRecord:
    """One line for the log. On ``/log``."""

    node: str  # Name of the node
    level: Literal["debug", "info", "warning", "error"]  # How much it matters
    text: str  # What happened, in one sentence
    robot_time: Seconds  # Robot time at which it happened; 0 if none


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ParameterEvent:
    """A parameter was set while the node ran. On ``/filter/parameter_events`` and the like."""

    param: str  # Name of the parameter
    value: str  # What it was set to, in JSON
    topic: str  # The input, as the node calls it, between two of whose messages that was done
    after: Count  # Messages of this input that the node had handled by then


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Clock:
    """The time of a recording that is played. On ``/clock``."""

    time: Seconds  # Time since the recording's first message


_SUBJECTS = (model, motion, procedure, touch, world, sys.modules[__name__])
TYPES: dict[str, type] = dict(
    sorted(
        (name, cls)
        for subject in _SUBJECTS
        for name, cls in vars(subject).items()
        if isinstance(cls, type) and is_dataclass(cls) and cls.__module__ == subject.__name__
        if cls is not touch.TouchHeader  # by itself on no topic
    )
)
# Latched types whose every message counts
ALL_KEPT = frozenset({motion.Contour, motion.Probe, ParameterEvent})
# Types of latched topics: whoever comes late needs what was published before; of those
# that are not in `ALL_KEPT`, the last message
LATCHED = ALL_KEPT | {
    model.ShapeModel,
    model.Superquadric,
    procedure.BoundaryRepresentation,
    procedure.ConePose,
    procedure.GeneralisedCone,
    procedure.Openings,
    procedure.ProcedureResult,
    world.SensorInfo,
    world.SpaceMap,
    world.Truth,
    world.World,
}
