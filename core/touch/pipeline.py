"""A fingertip with the effects of its scene, stage by stage, and what an effect is.

An effect is a description, a frozen dataclass whose numbers have ranges, units and defaults. It is
turned once, for one fingertip, into a `Stage`: a function that changes the touch under way, and the
state in which it begins. Which stage comes before which is fixed by `Phase` and by the catalogue,
never by the order in a file. What a scene does not list is not in the list of stages, so it costs
nothing. The cast, one ray a taxel, and the transducer are what every touch has.
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
from palpate.core.plugins import told_error
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

MOST_COPIES = 100  # Of one frame
StageStates = tuple[Any, ...]  # What stages remember between touches, in the order of the stages
NOTHING: Floats = np.zeros((0, 0))
NOTHING.setflags(write=False)


class Pipeline(NamedTuple):
    """The stages of a touch."""

    finger: Fingertip  # Whose they are
    stages: tuple[Stage, ...]  # In the order in which they act
    names: tuple[str, ...]  # Whose each stage is

    def begin(self) -> StageStates:
        """What the stages remember before the first touch."""
        return tuple(stage.state for stage in self.stages)

    @property
    def noise(self) -> float:
        """Standard deviation of one taxel, as a calibration would find it, m."""
        return math.hypot(*(stage.noise for stage in self.stages), 0.0)

    @property
    def face(self) -> FaceModel:
        """How the pad's face yields beside a contact."""
        faces = [stage.face for stage in self.stages if stage.face is not None]
        return faces[-1] if faces else SPRINGS

    def simulate(self, touch: SimulatedTouch, states: StageStates) -> StageStates:
        """Carry out a touch: fills it in, and gives what the stages remember next.

        Raises ValueError if a stage fails, with its effect's name, or leaves what cannot be.
        """
        following = []
        for stage, name, state in zip(self.stages, self.names, states, strict=True):
            try:
                following.append(stage.apply(touch, state))
            except Exception as error:  # an effect may be anybody's: whose it was must be told
                kind = type(error).__name__
                raise ValueError(f"the effect {name} failed: {kind}: {error}") from error
        shape = (self.finger.pad.rows, self.finger.pad.cols)
        if np.shape(touch.reading) != shape or not np.isfinite(touch.reading).all():
            raise ValueError(f"the effects left a reading that is no finite {shape} image")
        if not touch.previous <= touch.time < math.inf or not 1 <= touch.copies <= MOST_COPIES:
            raise ValueError(
                f"the effects left a touch that ends at {touch.time} s and is sent {touch.copies} "
                f"times; it must not end before {touch.previous} s, nor be sent more than "
                f"{MOST_COPIES} times"
            )
        return tuple(following)


def assemble(finger: Fingertip, effects: Sequence[Effect]) -> Pipeline:
    """The pipeline of a finger with these effects, in the order in which they are given.

    Raises ValueError if an effect cannot be had on this finger, or two take the place of the cast.
    """
    casts = [effect for effect in effects if effect.phase is Phase.CAST]
    if len(casts) > 1:
        names = " and ".join(type(effect).__name__ for effect in casts)
        raise ValueError(f"{names} both say how a taxel sees the surface; list one of them")
    stages = [(one.phase, type(one).__name__, _prepared(one, finger)) for one in effects]
    if not casts:
        stages.append((Phase.CAST, "cast", Stage(lambda touch, _: cast_single_rays(finger, touch))))
    stages.append((Phase.ARM, "transducer", _transduce(finger)))
    stages.sort(key=lambda placed: placed[0])  # stable: within a phase the order stays
    return Pipeline(
        finger, tuple(stage for _, _, stage in stages), tuple(name for _, name, _ in stages)
    )


def _prepared(effect: Effect, finger: Fingertip) -> Stage:
    name = type(effect).__name__
    try:
        stage = effect.prepare(finger)
    except ValueError:
        raise
    except Exception as error:  # an effect may be anybody's: whose it was must be told
        raise ValueError(f"the effect {name} cannot be prepared: {told_error(error)}") from error
    if not isinstance(stage, Stage):
        raise ValueError(f"the effect {name} prepares a {type(stage).__name__}, not a Stage")
    if not (isinstance(stage.noise, (int, float)) and 0.0 <= stage.noise < math.inf):
        raise ValueError(f"the effect {name} has a noise of {stage.noise!r}; expected metres, >= 0")
    return stage


def cast_single_rays(finger: Fingertip, touch: SimulatedTouch) -> None:
    """Press the pad, seeing the surface at the middle of each taxel."""
    move = guarded_move(touch.shape, finger.pad, touch.actual, touch.reach, touch.depth)
    record_move(finger, touch, move)


def _transduce(finger: Fingertip) -> Stage:
    """An ideal array reads compression, or the pressure by the stiffness of its data sheet."""
    stiffness = finger.stiffness
    by_force = finger.calibration.signal == "force"

    def apply(touch: SimulatedTouch, state: None) -> None:
        touch.reading = touch.pressure / stiffness if by_force else touch.compression

    return Stage(apply)


def record_move(finger: Fingertip, touch: SimulatedTouch, end: GuardedMove) -> None:
    """Write down how a guarded move ended: poses, times, compression and pressure.

    The arm believes to have gone as far as it went, from where it believed to start. Each taxel is
    a spring of its own (Winkler): the pressure is (1.2) for each area.
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
    noise: float = 0.0  # What it adds to the deviation of one taxel, as a calibration finds it, m
    face: FaceModel | None = None  # How the pad's face yields beside a contact; None: as it was


class Effect(Protocol):
    """A description of an effect."""

    phase: ClassVar[Phase]  # When it acts

    def prepare(self, finger: Fingertip) -> Stage:
        """The stage for one finger; ValueError if this finger cannot have the effect."""


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


@dataclass(slots=True, eq=False)
class SimulatedTouch:
    """One touch, as far as it has come. Stages write into it, one after the other.

    Arrays are replaced, never written into: they may be shared.
    """

    shape: Shape  # What may be met
    number: int  # Counts the finger's touches from 0; chooses the random draws
    # Pose in which the arm believes the pad to be: first where the move starts, then where it
    # ended.
    believed: Pose
    actual: Pose  # In which the pad is
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
    # gap, -inf where there is nothing. Then the pad's compression, m, the pressure on it, N/m2, and
    # the compression that the array reports, m.
    indentation: Floats = field(default_factory=lambda: NOTHING)
    compression: Floats = field(default_factory=lambda: NOTHING)
    pressure: Floats = field(default_factory=lambda: NOTHING)
    reading: Floats = field(default_factory=lambda: NOTHING)
    copies: int = 1  # How often its frame is sent


class KeyedRandom:
    """Random numbers of the effect `name` on a finger, told apart by the number of the touch.

    Philox is a counter-based generator: the numbers of a touch follow from (seed, fingertip,
    effect, number of the touch) and from nothing that happened before. So no effect can shift
    another's draws, a state never hides in a generator, and any touch can be drawn again by itself.
    Salmon, Moraes, Dror and Shaw, *Parallel random numbers: as easy as 1, 2, 3*, 2011.
    """

    def __init__(self, finger: Fingertip, name: str):
        from numpy.random import Generator, Philox, SeedSequence  # 17 ms: only effects draw

        key = SeedSequence(finger.seed, spawn_key=(finger.number, crc32(name.encode())))
        self._philox = Philox(key=key.generate_state(2, np.uint64))
        self._generator = Generator(self._philox)
        self._state = self._philox.state

    def once(self) -> Generator:
        """For what is drawn once, when the finger is made; valid until the next call."""
        return self._at(0)

    def of_touch(self, number: int) -> Generator:
        """For the touch of this number; valid until the next call."""
        return self._at(number + 1)

    def _at(self, position: int) -> Generator:
        state = self._state
        state["state"]["counter"][:] = (0, 0, 0, position)
        state["buffer_pos"], state["has_uint32"], state["uinteger"] = 4, 0, 0
        self._philox.state = state
        return self._generator
