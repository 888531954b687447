"""Messages of nodes about themselves, and all message types by name."""

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
    # Activity of the node; rebuilding after a restart
    state: Literal["starting", "rebuilding", "running", "ending"]
    messages: Count  # Messages handled so far
    sent: Count  # Messages published so far
    gaps: Count  # Number of missing messages
    duplicates: Count  # Number of repeated messages, which are dropped
    p50: Annotated[float, Unit("us")]  # Median time of a handler
    p99: Annotated[float, Unit("us")]  # 99 % quantile of the time of a handler
    cpu: Seconds  # Processor time used
    # Processor time by step of its work; the rest is starting, receiving and sending
    steps: dict[str, float] = field(default_factory=dict)


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LogRecord:
    """One line for the log. On ``/log``."""

    node: str  # Name of the node
    level: Literal["debug", "info", "warning", "error"]  # Severity
    text: str  # The event, in one sentence
    robot_time: Seconds  # Robot time at which it happened; 0 if none


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ParameterEvent:
    """A parameter was set while the node ran. On ``/filter/parameter_events`` and the like."""

    param: str  # Name of the parameter
    value: str  # New value, in JSON
    topic: str  # Node's name of an input: the parameter was set between two messages of it
    after: Count  # Number of messages of this input that the node had handled before


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
# Latched types of which all messages are needed
ALL_KEPT = frozenset({motion.Contour, motion.Probe, ParameterEvent})
# Types of latched topics, whose earlier messages late subscribers need; of types that are not in
# `ALL_KEPT`, only the last message
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
