"""What a procedure goes by and what it yields: a slice, a posture of the pad, a touch command.

Procedures touch, wait and go on: they are written as generators and run as pure functions. A
procedure yields what it wants to touch and is sent what was touched. A generator cannot be a
node's state, for it cannot be copied or compared; so the state keeps what was touched since the
procedure began, and `resume` runs it again over that. Procedures are short, a few touches each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.tracing.slice_arc import SliceArc
from palpate.core.poses import pad_rotation, pose_of
from palpate.core.touch import Pad

JOINED = 2.0 / 15.0  # Points farther apart than this have a gap between them; in widths of the pad
LEAST_JOINED = 1.6  # But points of neighbouring taxels never have; in pitches
# Depth of a plain touch, m: half of the pad. Shallower ones touch less at once: at 1 mm a contour
# takes a fifth more touches, and a band is lower by as much.
TOUCH_DEPTH = 1.5e-3
DEEP_TOUCH_DEPTH = 2.35e-3  # Depth where a plain one does not reach into a hollow, m
MOST_TILT = 1.45  # The pad is tilted no farther than this, rad: at a pole a contour has no heading
Result = TypeVar("Result")


class SliceSpec(NamedTuple):
    """A slice, and the pad that follows it."""

    pad: Pad  # The array
    height: float  # Height of the slice in the slicing frame, m

    @property
    def width(self) -> float:
        """Width of the array, its smaller side, m."""
        return self.pad.pitch * (min(self.pad.rows, self.pad.cols) - 1)

    @property
    def joined(self) -> float:
        """Points that lie no farther apart than this follow each other, m."""
        return max(JOINED * self.width, LEAST_JOINED * self.pad.pitch)


class Posture(NamedTuple):
    """How the pad is held; carried from touch to touch."""

    tilt: float = 0.0  # Elevation of the outward normal that the pad expects, rad
    shift: float = 0.0  # The contour lies this far from the pad's middle along its y axis, m
    depth: float = TOUCH_DEPTH  # Depth of press, m
    # True once a search has found a posture that works: it is then kept for the contour.
    frozen: bool = False
    failed_searches: int = 0  # Searches in a row that found none
    contact: float = math.inf  # Half the length of the arc that a searched posture touched first, m


class TouchCommand(NamedTuple):
    """One touch, in the slicing frame."""

    place: Floats  # Where the contour is expected, (2,), m
    heading: float  # Azimuth of the expected outward normal, rad
    standoff: float  # Distance before the place from which the pad starts, m
    reach: float  # How far past the place it may go, m
    posture: Posture  # How it is held

    def start(self, height: float) -> Floats:
        """Pose (7,) from which the pad moves, for a slice at this height."""
        axes = pad_rotation(self.heading, self.posture.tilt)
        target = np.array([self.place[0], self.place[1], height])
        target = target + self.posture.shift * axes[:, 1]
        return pose_of(target - self.standoff * axes[:, 2], axes)

    @property
    def travel(self) -> float:
        """Longest way of the guarded move, m."""
        return self.standoff + self.reach


@dataclass(frozen=True, slots=True)
class ProcedureResult(Generic[Result]):
    """The end of a procedure."""

    result: Result


def resume(
    start: Callable[[], Procedure[Result]], arcs: Sequence[SliceArc | None]
) -> TouchCommand | ProcedureResult[Result]:
    """The next command of a procedure that has touched all this, or its end."""
    procedure = start()
    try:
        command = next(procedure)
        for one in arcs:
            command = procedure.send(one)
    except StopIteration as end:
        return ProcedureResult(end.value)
    return command


UPRIGHT = Posture()  # How the pad is held before anything is known
Procedure = Generator[TouchCommand, SliceArc | None, Result]
