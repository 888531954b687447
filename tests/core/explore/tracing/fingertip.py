"""A simulated fingertip that traces contours as plain calls, and scripted touches without one."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore import tracing
from palpate.core.explore.tracing import SliceArc, TouchCommand, Trace, after_touch, next_command
from palpate.core.shapes import Shape
from palpate.core.touch import DEFAULT_CONTACT, HITS, Pad, fit_patch, guarded_move

FLAT = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DOMED = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=1.0 / 0.015, saturation=0.8)
WIDTH = 0.015  # Of both arrays [m]
BACK_OFF = 14e-3  # Farther start of a touch that would begin inside [m]
Answer = Callable[[TouchCommand], SliceArc | None]
Stepped = tuple[Trace, TouchCommand | tracing.TraceStatus]


@dataclass
class Run:
    """A traced contour with everything that was commanded and touched."""

    trace: Trace
    status: tracing.TraceStatus | None = None
    commands: list[TouchCommand] = field(default_factory=list)
    arcs: list[SliceArc | None] = field(default_factory=list)

    @property
    def points(self) -> Floats:
        return self.trace.path.points


def goal(height=0.0, radius=0.1, most_touches=150) -> tracing.TraceGoal:
    return tracing.TraceGoal(height, np.zeros(2), radius, most_touches)


def follow(pad: Pad, wanted: tracing.TraceGoal, answer: Answer) -> Run:
    """A contour to its end; each command is answered with an arc, or None for a miss."""
    run = Run(Trace(wanted))
    while True:
        run.trace, command = next_command(pad, run.trace)
        if not isinstance(command, TouchCommand):
            run.status = command
            return run
        assert run.trace.touches < wanted.most_touches
        run.commands.append(command)
        run.arcs.append(answer(command))
        run.trace = after_touch(run.trace, run.arcs[-1])


def press(shape: Shape, pad: Pad, height: float) -> Answer:
    """Touches of a shape, from farther away if one would begin inside."""

    def answer(command: TouchCommand) -> SliceArc | None:
        depth = command.posture.depth
        end = guarded_move(shape, pad, command.start(height), command.travel, depth)
        if end.outcome == "inside":
            command = command._replace(standoff=command.standoff + BACK_OFF)
            end = guarded_move(shape, pad, command.start(height), command.travel, depth)
        if end.outcome not in HITS:
            return None
        touched = end.compression > DEFAULT_CONTACT.min_compression
        surface = pad.surface(end.compression, touched)
        jet = fit_patch(pad, surface, touched, np.array([0.0, 1.0, 0.0]), 0.0).jet
        return tracing.arc_in_slice(pad, end.pose, surface, touched, jet, height)

    return answer


def scripted(pad: Pad, *arcs: SliceArc | None) -> Stepped:
    """The trace and the command after these answers."""
    trace, command = next_command(pad, Trace(goal()))
    for arc in arcs:
        assert isinstance(command, TouchCommand), command
        trace, command = next_command(pad, after_touch(trace, arc))
    return trace, command


def repeated(
    pad: Pad, *arcs: SliceArc | None, answer: SliceArc | None, most: int = 60, first: bool = False
) -> tuple[list[TouchCommand], Trace, TouchCommand | tracing.TraceStatus]:
    """All further commands if each is answered with the same: to the end, or to the first arc."""
    trace, command = scripted(pad, *arcs)
    commands = []
    while isinstance(command, TouchCommand) and len(commands) < most:
        if first and trace.path is not None:
            break
        commands.append(command)
        trace, command = next_command(pad, after_touch(trace, answer))
    return commands, trace, command


def arc_of(points: Floats, normals: Floats, **changes: Any) -> SliceArc:
    """A touch that measured these points (n, 2 or 3) of slice 0, and nothing beside them."""
    points, normals = (np.pad(one, ((0, 0), (0, 3 - one.shape[1]))) for one in (points, normals))
    zero = np.zeros(len(points))
    first = points[0] if len(points) else np.zeros(3)
    arc = SliceArc(points, normals, zero, zero, zero, 0.0, first, first, 5, 5)
    return arc._replace(**changes)


def circle(radius: float, begin: float, end: float, count: int = 13) -> SliceArc:
    """A stretch of a circle about the origin, counter-clockwise."""
    azimuth = np.linspace(begin, end, count)
    outward = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    return arc_of(radius * outward, outward)


def wall(*places: float, x: float = 0.03) -> SliceArc:
    """Points along y of a wall that faces along x."""
    points = np.array([[x, place] for place in places])
    return arc_of(points, np.tile([1.0, 0.0], (len(points), 1)))


def missed(*, above: int = 0, below: int = 9, slope: float = 0.0, rise: float = 0.0) -> SliceArc:
    """A touch beside the slice, `rise` above it [m], with numbers of taxels above and below."""
    nearest, none = np.array([0.03, 0.0, rise]), np.zeros((0, 3))
    arc = arc_of(none, none, slope=slope, nearest=nearest)
    return arc._replace(pad=nearest, above=above, below=below)


def azimuths(points: Floats) -> Floats:
    return np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
