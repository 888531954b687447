"""What an effect is: a stage of a touch that exists only if a scene lists it.

An effect is a description, a frozen dataclass whose numbers have ranges, units and defaults.
It is turned once, for one finger, into a `Stage`: a function that changes the touch under
way, and the state in which it begins. Which stage comes before which is fixed by `Place` and
by the catalogue, never by the order in a file.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, Protocol

from palpate.core.touch.pad import Face
from palpate.core.touch.touch import Finger, Touch


class Place(IntEnum):
    """Where on its way from command to frame an effect changes a touch."""

    AIM = 1
    """Before the move: changes ``actual``, where the pad really starts."""
    CAST = 2
    """The move itself: takes the place of `palpate.core.touch.cast.one_ray_each`."""
    PAD = 3
    """Mechanics: changes ``compression`` and ``pressure``."""
    ARM = 4
    """After the move: changes ``believed``, where the arm believes the pad to have stopped."""
    ECHO = 5
    """Transduction: changes ``reading``."""
    SIGNAL = 6
    """Electronics: changes ``reading``."""
    LINK = 7
    """Transport: changes ``time`` and ``copies``."""


class Stage(NamedTuple):
    """One stage, ready for one finger."""

    act: Callable[[Touch, Any], Any]
    """Takes the touch, which it changes, and the stage's state; gives its next state. Pure
    otherwise: the same touch and state give the same again."""
    state: Any = None
    """The state in which the finger begins; None if there is nothing to remember."""
    noise: float = 0.0
    """What it adds to the standard deviation of one taxel, as a calibration would find it, m."""
    face: Face | None = None
    """How it lets the pad's face yield beside a contact; None if it leaves that as it was."""


class Effect(Protocol):
    """A description of an effect."""

    place: ClassVar[Place]
    """Where it acts."""

    def prepare(self, finger: Finger) -> Stage:
        """The stage for one finger.

        Raises
        ------
        ValueError
            If this finger cannot have the effect.
        """
