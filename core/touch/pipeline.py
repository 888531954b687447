"""A fingertip with the effects of its scene, stage by stage, and what an effect is.

An effect is a description, a frozen dataclass whose numbers have ranges, units and defaults. It is
turned once, for one fingertip, into a `Stage`: a function that changes the current touch, and its
initial state. The order of stages is fixed by `Phase` and by the catalogue, never by the order in a
file. Effects that a scene does not list are no stages, so they cost nothing. Every touch has the
cast, with one ray per taxel, and the transducer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol
from zlib import crc32

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.plugins import describe_error
from palpate.core.poses import Pose
from palpate.core.robot_time import RobotPreset, contact_seconds
from palpate.core.shapes import Shape
from palpate.core.touch.pad import (
    HITS,
    SPRINGS,
    Calibration,
    FaceModel,
    GuardedMove,
    Pad,
    TouchOutcome,
    guarded_move,
)

if TYPE_CHECKING:
    from numpy.random import Generator

MAX_COPIES = 100  # of one frame
StageStates = tuple[Any, ...]  # states of the stages between touches, in their order
NO_IMAGE: Floats = np.zeros((0, 0))
NO_IMAGE.setflags(write=False)


class Pipeline(NamedTuple):
    """The stages of a touch."""

    finger: Fingertip
    stages: tuple[Stage, ...]  # in the order in which they act
    names: tuple[str, ...]  # of the stages' effects

    def begin(self) -> StageStates:
        """Initial states of the stages."""
        return tuple(stage.state for stage in self.stages)

    @property
    def noise(self) -> float:
        """Standard deviation of one taxel, as a calibration measures it [m]."""
        return math.hypot(*(stage.noise for stage in self.stages), 0.0)

    @property
    def face(self) -> FaceModel:
        """How the pad's face yields beside a contact."""
        faces = [stage.face for stage in self.stages if stage.face is not None]
        return faces[-1] if faces else SPRINGS

    def simulate(self, touch: SimulatedTouch, states: StageStates) -> StageStates:
        """Simulate a touch: fill in its fields, and return the next states of the stages.

        Raises ValueError if a stage fails, with its effect's name, or leaves impossible values.
        """
        following = []
        for stage, name, state in zip(self.stages, self.names, states, strict=True):
            try:
                following.append(stage.apply(touch, state))
            except Exception as error:  # a user's effect: the message names it
                kind = type(error).__name__
                raise ValueError(f"the effect {name} failed: {kind}: {error}") from error
        shape = (self.finger.pad.rows, self.finger.pad.cols)
        if np.shape(touch.reading) != shape or not np.isfinite(touch.reading).all():
            raise ValueError(f"the effects left a reading that is no finite {shape} image")
        if not touch.previous <= touch.time < math.inf or not 1 <= touch.copies <= MAX_COPIES:
            raise ValueError(
                f"the effects left a touch that ends at {touch.time} s and is sent {touch.copies} "
                f"times; it must not end before {touch.previous} s, nor be sent more than "
                f"{MAX_COPIES} times"
            )
        return tuple(following)


def assemble(finger: Fingertip, effects: Sequence[Effect]) -> Pipeline:
    """The pipeline of a finger with these effects, ordered by phase and else as listed.

    Raises ValueError if this finger cannot have an effect, or two effects replace the cast.
    """
    casts = [effect for effect in effects if effect.phase is Phase.CAST]
    if len(casts) > 1:
        names = " and ".join(type(effect).__name__ for effect in casts)
        raise ValueError(f"{names} both replace the cast; list only one of them")
    stages = [
        (effect.phase, type(effect).__name__, _prepared(effect, finger)) for effect in effects
    ]
    if not casts:
        stages.append((Phase.CAST, "cast", Stage(lambda touch, _: cast_single_rays(finger, touch))))
    stages.append((Phase.ARM, "transducer", _transduce(finger)))
    stages.sort(key=lambda placed: placed[0])  # stable: the order within a phase is kept
    return Pipeline(
        finger, tuple(stage for _, _, stage in stages), tuple(name for _, name, _ in stages)
    )


def _prepared(effect: Effect, finger: Fingertip) -> Stage:
    name = type(effect).__name__
    try:
        stage = effect.prepare(finger)
    except ValueError:
        raise
    except Exception as error:  # a user's effect: the message names it
        raise ValueError(
            f"the effect {name} cannot be prepared: {describe_error(error)}"
        ) from error
    if not isinstance(stage, Stage):
        raise ValueError(f"the effect {name} prepares a {type(stage).__name__}, not a Stage")
    if not (isinstance(stage.noise, (int, float)) and 0.0 <= stage.noise < math.inf):
        raise ValueError(f"the effect {name} has a noise of {stage.noise!r}; expected metres, >= 0")
    return stage


def cast_single_rays(finger: Fingertip, touch: SimulatedTouch) -> None:
    """Press the pad, with one ray from the middle of each taxel."""
    move = guarded_move(touch.shape, finger.pad, touch.actual, touch.reach, touch.depth)
    record_move(finger, touch, move)


def _transduce(finger: Fingertip) -> Stage:
    """Stage of an ideal array: it reads compression, or pressure over nominal stiffness."""
    stiffness = finger.stiffness
    by_force = finger.calibration.signal == "force"

    def apply(touch: SimulatedTouch, state: None) -> None:
        touch.reading = touch.pressure / stiffness if by_force else touch.compression

    return Stage(apply)


def record_move(finger: Fingertip, touch: SimulatedTouch, end: GuardedMove) -> None:
    """Store the end of a guarded move in the touch: poses, times, compression and pressure.

    The arm's believed pose advances by the true distance. Each taxel is an independent spring
    (Winkler): the pressure is (1.2) per area.
    """
    touch.outcome, touch.advance = end.outcome, end.advance
    touch.believed = touch.believed.advanced(end.advance)
    touch.actual = end.pose
    touch.indentation, touch.compression = end.indentation, end.compression
    touch.pressure = finger.stiffness * end.compression
    robot = finger.robot
    touch.time = touch.begun + contact_seconds(robot, end.advance)
    met = end.outcome in HITS
    touch.loading = float(end.compression.max()) / robot.approach if met else 0.0
    touch.dwell = robot.dwell if met else 0.0
    before = end.advance / robot.approach - touch.loading
    touch.rest = touch.begun - touch.previous + before + robot.overhead


class Phase(IntEnum):
    """Step between command and frame at which an effect changes a touch."""

    AIM = 1  # before the move: changes ``actual``, the true start of the pad
    CAST = 2  # the move itself: replaces `palpate.core.touch.cast_single_rays`
    PAD = 3  # mechanics: changes ``compression`` and ``pressure``
    ARM = 4  # after the move: changes ``believed``, the pad's end by the arm's sensors
    ECHO = 5  # transduction: changes ``reading``
    SIGNAL = 6  # electronics: changes ``reading``
    LINK = 7  # transport: changes ``time`` and ``copies``


class Stage(NamedTuple):
    """One stage, ready for one finger."""

    # Takes the touch, which it changes, and the stage's state; returns the next state. It has no
    # other side effects or inputs.
    apply: Callable[[SimulatedTouch, Any], Any]
    state: Any = None  # initial; None for a stage without memory
    noise: float = 0.0  # [m] that it adds to one taxel, standard deviation as a calibration has it
    face: FaceModel | None = None  # of the pad; None: unchanged


class Effect(Protocol):
    """A description of an effect."""

    phase: ClassVar[Phase]

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; ValueError if this finger cannot have the effect."""


@dataclass(frozen=True, slots=True, eq=False)
class Fingertip:
    """The fingertip, which all stages of a touch can read."""

    pad: Pad
    calibration: Calibration  # nominal, of the data sheet
    robot: RobotPreset  # speeds and delays of its motion
    number: int = 1  # from 1
    seed: int = 0  # of the run

    @property
    def stiffness(self) -> float:
        """Pressure per compression [N/m3] (Winkler)."""
        return self.calibration.taxel_stiffness / self.pad.pitch**2


@dataclass(slots=True, eq=False)
class SimulatedTouch:
    """One touch in progress. The stages write into it, one after the other.

    Arrays are replaced, never written into: they may be shared.
    """

    shape: Shape  # that the pad may meet
    number: int  # counts the finger's touches from 0; selects the random draws
    believed: Pose  # of the pad by the arm's sensors: at the start, later at the end of the move
    actual: Pose  # of the pad
    reach: float  # [m] longest distance to first contact
    depth: float  # [m] compression at which the move stops
    begun: float  # [s] robot time at the start of the move
    previous: float  # [s] robot time at the end of the touch before; 0 at first

    outcome: TouchOutcome = "miss"
    advance: float = 0.0  # [m] distance travelled
    time: float = 0.0  # [s] robot time at the end of the touch
    rest: float = 0.0  # [s] from the last touch to contact
    loading: float = 0.0  # [s] from contact to the end of the move
    dwell: float = 0.0  # [s] from the end of the move to the frame

    # Depth of the rigid surface in the undeformed pad, (rows, cols) [m]: negative over a gap, -inf
    # where there is no surface.
    indentation: Floats = field(default_factory=lambda: NO_IMAGE)
    compression: Floats = field(default_factory=lambda: NO_IMAGE)  # of the pad [m]
    pressure: Floats = field(default_factory=lambda: NO_IMAGE)  # on the pad [N/m2]
    reading: Floats = field(default_factory=lambda: NO_IMAGE)  # compression by the array [m]
    copies: int = 1  # of the frame that are sent


class KeyedRandom:
    """Random numbers of the effect `name` on a finger, one stream for each touch.

    Philox is a counter-based generator: the numbers of a touch follow from (seed, fingertip,
    effect, number of the touch) alone. So no effect shifts another's draws, generators have no
    hidden state, and the draws of any touch can be repeated. Salmon, Moraes, Dror and Shaw,
    *Parallel random numbers: as easy as 1, 2, 3*, 2011.
    """

    def __init__(self, finger: Fingertip, name: str):
        from numpy.random import Generator, Philox, SeedSequence  # 17 ms: only effects draw

        key = SeedSequence(finger.seed, spawn_key=(finger.number, crc32(name.encode())))
        self._philox = Philox(key=key.generate_state(2, np.uint64))
        self._generator = Generator(self._philox)
        self._state = self._philox.state

    def once(self) -> Generator:
        """Generator for values drawn once per finger; valid until the next call."""
        return self._at(0)

    def of_touch(self, number: int) -> Generator:
        """Generator for the touch of this number; valid until the next call."""
        return self._at(number + 1)

    def _at(self, position: int) -> Generator:
        state = self._state
        state["state"]["counter"][:] = (0, 0, 0, position)
        state["buffer_pos"], state["has_uint32"], state["uinteger"] = 4, 0, 0
        self._philox.state = state
        return self._generator
