"""What an effect is: a stage of a simulated touch that exists only if a scene lists it.

An effect is a description, a frozen dataclass whose numbers have ranges, units and defaults. It
is turned once, for one fingertip, into a `Stage`: a function that changes the touch under way,
and the state in which it begins. Which stage comes before which is fixed by `Phase` and by the
catalogue, never by the order in a file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.robot_time import RobotPreset
from palpate.core.shapes import Shape
from palpate.core.touch.pad import Calibration, FaceModel, Pad, TouchOutcome

_NOTHING: Floats = np.zeros((0, 0))
_NOTHING.setflags(write=False)


class Phase(IntEnum):
    """Where on its way from command to frame an effect changes a touch."""

    AIM = 1  # Before the move: changes ``actual``, where the pad really starts
    CAST = 2  # The move itself: takes the place of `palpate.core.touch.cast_single_rays`
    PAD = 3  # Mechanics: changes ``compression`` and ``pressure``
    ARM = 4  # After the move: changes ``believed``, where the arm believes the pad to have stopped
    ECHO = 5  # Transduction: changes ``reading``
    SIGNAL = 6  # Electronics: changes ``reading``
    LINK = 7  # Transport: changes ``time`` and ``copies``


class Stage(NamedTuple):
    """One stage, ready for one finger."""

    # Takes the touch, which it changes, and the stage's state; gives its next state. Pure
    # otherwise: the same touch and state give the same again.
    apply: Callable[[SimulatedTouch, Any], Any]
    state: Any = None  # The state in which the finger begins; None if there is nothing to remember
    # What it adds to the standard deviation of one taxel, as a calibration would find it, m.
    noise: float = 0.0
    # How it lets the pad's face yield beside a contact; None if it leaves that as it was.
    face: FaceModel | None = None


class Effect(Protocol):
    """A description of an effect."""

    phase: ClassVar[Phase]  # When it acts

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger.

        Raises ValueError if this finger cannot have the effect.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Fingertip:
    """The fingertip: what every stage of a touch may know, and none may change."""

    pad: Pad  # Array and pad
    calibration: Calibration  # What the array's signal means; nominal, as a data sheet has it
    robot: RobotPreset  # How fast it is moved
    number: int = 1  # From 1
    seed: int = 0  # The run's seed

    @property
    def stiffness(self) -> float:
        """Pressure for each metre of compression, N/m3 (Winkler)."""
        return self.calibration.taxel_stiffness / self.pad.pitch**2


def _nothing() -> Floats:
    return _NOTHING


@dataclass(slots=True, eq=False)
class SimulatedTouch:
    """One touch, as far as it has come. Stages write into it, one after the other.

    Arrays are replaced, never written into: they may be shared.
    """

    shape: Shape  # What may be met
    number: int  # Counts the finger's touches from 0; chooses the random draws
    # Pose in which the arm believes the pad to be, (7,): first where the move starts, then where it
    # ended.
    believed: Floats
    actual: Floats  # Pose in which the pad is, (7,)
    reach: float  # Longest way to first contact, m
    depth: float  # Compression at which the move stops, m
    begun: float  # Robot time at which the move starts, s
    previous: float  # Robot time at the end of the touch before, s; 0 at first

    outcome: TouchOutcome = "miss"  # How the move ended
    advance: float = 0.0  # Way travelled, m
    time: float = 0.0  # Robot time at the end of the touch, s
    rest: float = 0.0  # How long the pad was free before it met the surface, s
    loading: float = 0.0  # How long it was being pressed until the move stopped, s
    dwell: float = 0.0  # How long it then stayed until the frame was taken, s

    # How far the rigid surface would enter the undeformed pad, (rows, cols), m: negative over a
    # gap, -inf where there is nothing.
    indentation: Floats = field(default_factory=_nothing)
    compression: Floats = field(default_factory=_nothing)  # Compression of the pad, (rows, cols), m
    pressure: Floats = field(default_factory=_nothing)  # Pressure on the pad, (rows, cols), N/m2
    # Compression that the array reports, (rows, cols), m.
    reading: Floats = field(default_factory=_nothing)
    copies: int = 1  # How often its frame is sent
