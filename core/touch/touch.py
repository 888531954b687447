"""One touch on its way from command to frame, and the finger that makes it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.measure.robot_time import Preset
from palpate.core.shapes.protocol import Shape
from palpate.core.touch.calibration import Calibration
from palpate.core.touch.pad import Outcome, Pad


def _nothing() -> Floats:
    return _NOTHING


_NOTHING: Floats = np.zeros((0, 0))
_NOTHING.setflags(write=False)


@dataclass(frozen=True, slots=True, eq=False)
class Finger:
    """The fingertip: what every stage of a touch may know, and none may change."""

    pad: Pad
    """Array and pad."""
    calibration: Calibration
    """What the array's signal means; nominal, as a data sheet has it."""
    robot: Preset
    """How fast it is moved."""
    number: int = 1
    """From 1."""
    seed: int = 0
    """The run's seed."""

    @property
    def stiffness(self) -> float:
        """Pressure for each metre of compression, N/m3 (Winkler)."""
        return self.calibration.taxel_stiffness / self.pad.pitch**2


@dataclass(slots=True, eq=False)
class Touch:
    """One touch, as far as it has come. Stages write into it, one after the other.

    Arrays are replaced, never written into: they may be shared.
    """

    shape: Shape
    """What may be met."""
    number: int
    """Counts the finger's touches from 0; chooses the random draws."""
    believed: Floats
    """Pose in which the arm believes the pad to be, (7,): first where the move starts, then
    where it ended."""
    actual: Floats
    """Pose in which the pad is, (7,)."""
    reach: float
    """Longest way to first contact, m."""
    depth: float
    """Compression at which the move stops, m."""
    begun: float
    """Robot time at which the move starts, s."""
    previous: float
    """Robot time at the end of the touch before, s; 0 at first."""

    outcome: Outcome = "miss"
    """How the move ended."""
    advance: float = 0.0
    """Way travelled, m."""
    time: float = 0.0
    """Robot time at the end of the touch, s."""
    rest: float = 0.0
    """How long the pad was free before it met the surface, s."""
    loading: float = 0.0
    """How long it was being pressed until the move stopped, s."""
    dwell: float = 0.0
    """How long it then stayed until the frame was taken, s."""

    indentation: Floats = field(default_factory=_nothing)
    """How far the rigid surface would enter the undeformed pad, (rows, cols), m: negative
    over a gap, -inf where there is nothing."""
    compression: Floats = field(default_factory=_nothing)
    """Compression of the pad, (rows, cols), m."""
    pressure: Floats = field(default_factory=_nothing)
    """Pressure on the pad, (rows, cols), N/m2."""
    reading: Floats = field(default_factory=_nothing)
    """Compression that the array reports, (rows, cols), m."""
    copies: int = 1
    """How often its frame is sent."""
