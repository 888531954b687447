"""A fingertip with the effects of its scene: stages in their order, and nothing else.

What a scene does not list is not in the list of stages, so it costs nothing. The cast, one ray
a taxel, and the transducer are what every touch has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.core.robot_time import contact_seconds
from palpate.core.touch.effect import Effect, Fingertip, Phase, SimulatedTouch, Stage
from palpate.core.touch.pad import HITS, SPRINGS, FaceModel, GuardedMove, guarded_move

MOST_COPIES = 100  # Of one frame
# What each stage remembers between touches, in the order of the stages.
StageStates = tuple[Any, ...]


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
        said = [stage.face for stage in self.stages if stage.face is not None]
        return said[-1] if said else SPRINGS

    def simulate(self, touch: SimulatedTouch, states: StageStates) -> StageStates:
        """Carry out a touch: fills it in, and gives what the stages remember next.

        Raises ValueError if a stage fails, with its effect's name, or leaves what cannot be.
        """
        following = []
        for stage, name, state in zip(self.stages, self.names, states, strict=True):
            try:
                following.append(stage.apply(touch, state))
            except Exception as error:  # an effect may be anybody's: whose it was must be said
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
    stages = [
        (effect.phase, type(effect).__name__, _prepared(effect, finger)) for effect in effects
    ]
    if not casts:
        stages.append((Phase.CAST, "cast", _cast(finger)))
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
    except Exception as error:  # an effect may be anybody's: whose it was must be said
        kind = type(error).__name__
        raise ValueError(f"the effect {name} cannot be prepared: {kind}: {error}") from error
    if not isinstance(stage, Stage):
        raise ValueError(f"the effect {name} prepares a {type(stage).__name__}, not a Stage")
    if not (isinstance(stage.noise, (int, float)) and 0.0 <= stage.noise < math.inf):
        raise ValueError(f"the effect {name} has a noise of {stage.noise!r}; expected metres, >= 0")
    return stage


def _cast(finger: Fingertip) -> Stage:
    def apply(touch: SimulatedTouch, state: None) -> None:
        cast_single_rays(finger, touch)

    return Stage(apply)


def cast_single_rays(finger: Fingertip, touch: SimulatedTouch) -> None:
    """Press the pad, seeing the surface at the middle of each taxel."""
    record_move(
        finger, touch, guarded_move(touch.shape, finger.pad, touch.actual, touch.reach, touch.depth)
    )


def _transduce(finger: Fingertip) -> Stage:
    """An ideal array reads compression, or the pressure by the stiffness of its data sheet."""
    stiffness = finger.stiffness
    by_force = finger.calibration.signal == "force"

    def apply(touch: SimulatedTouch, state: None) -> None:
        touch.reading = touch.pressure / stiffness if by_force else touch.compression

    return Stage(apply)


def record_move(finger: Fingertip, touch: SimulatedTouch, end: GuardedMove) -> None:
    """Write down how a guarded move ended: poses, times, compression and pressure.

    The arm believes to have gone as far as it went, from where it believed to start. Each
    taxel is a spring of its own (Winkler): the pressure is (1.2) for each area.
    """
    touch.outcome, touch.advance = end.outcome, end.advance
    touch.believed = advanced_pose(touch.believed, end.advance)
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


def advanced_pose(pose: np.ndarray, way: float) -> np.ndarray:
    """A pose moved along its own z axis."""
    x, y, z, w = pose[3:].tolist()
    axis = (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y))
    moved = pose.copy()
    moved[:3] += np.multiply(axis, way)
    return moved
