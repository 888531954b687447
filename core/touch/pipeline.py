"""A finger with the effects of its scene: stages in their order, and nothing else.

What a scene does not list is not in the list of stages, so it costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from palpate.core.touch.cast import one_ray_each
from palpate.core.touch.effect import Effect, Place, Stage
from palpate.core.touch.pad import SPRINGS, Face
from palpate.core.touch.touch import Finger, Touch

States = tuple[Any, ...]
"""What each stage remembers between touches, in the order of the stages."""


class Pipeline(NamedTuple):
    """The stages of a touch."""

    finger: Finger
    """Whose they are."""
    stages: tuple[Stage, ...]
    """In the order in which they act."""

    def begin(self) -> States:
        """What the stages remember before the first touch."""
        return tuple(stage.state for stage in self.stages)

    @property
    def noise(self) -> float:
        """Standard deviation of one taxel, as a calibration would find it, m."""
        return math.hypot(*(stage.noise for stage in self.stages), 0.0)

    @property
    def face(self) -> Face:
        """How the pad's face yields beside a contact."""
        said = [stage.face for stage in self.stages if stage.face is not None]
        return said[-1] if said else SPRINGS

    def feel(self, touch: Touch, states: States) -> States:
        """Carry out a touch: fills it in, and gives what the stages remember next."""
        return tuple(
            stage.act(touch, state) for stage, state in zip(self.stages, states, strict=True)
        )


def assemble(finger: Finger, effects: Sequence[Effect]) -> Pipeline:
    """The pipeline of a finger with these effects, in the order in which they are given.

    Raises
    ------
    ValueError
        If an effect cannot be had on this finger, or two take the place of the cast.
    """
    casts = [effect for effect in effects if effect.place is Place.CAST]
    if len(casts) > 1:
        names = " and ".join(type(effect).__name__ for effect in casts)
        raise ValueError(f"{names} both say how a taxel sees the surface; list one of them")
    stages = [(effect.place, effect.prepare(finger)) for effect in effects]
    if not casts:
        stages.append((Place.CAST, _cast(finger)))
    stages.append((Place.ARM, _transduce(finger)))
    stages.sort(key=lambda placed: placed[0])  # stable: within a place the order stays
    return Pipeline(finger, tuple(stage for _, stage in stages))


def _cast(finger: Finger) -> Stage:
    def act(touch: Touch, state: None) -> None:
        one_ray_each(finger, touch)

    return Stage(act)


def _transduce(finger: Finger) -> Stage:
    """An ideal array reads compression, or the pressure by the stiffness of its data sheet."""
    stiffness = finger.stiffness
    by_force = finger.calibration.signal == "force"

    def act(touch: Touch, state: None) -> None:
        touch.reading = touch.pressure / stiffness if by_force else touch.compression

    return Stage(act)
