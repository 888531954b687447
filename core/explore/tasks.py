"""What hand and fingers are told to do, as values."""

from __future__ import annotations

from typing import NamedTuple

from palpate.core.arrays import Floats
from palpate.core.explore import grasp, planners, probing
from palpate.core.poses import Pose


class CloseHand(NamedTuple):
    """Goal: close the hand."""

    pose: Pose
    hand: grasp.Hand


class TurnObject(NamedTuple):
    """Goal: set the object down on another side."""

    pose: Pose  # that it shall have in the world, from how it lay at first


class TraceSlice(NamedTuple):
    """Work of a finger: a contour around the object."""

    centre: Floats  # where its middle is expected, slicing frame, (2,) [m]
    radius: float  # the pad approaches from so far outside [m]
    gap: float  # stretch that may stay untouched between two touches [m]
    max_touches: int  # it is given up after so many, whatever may be spent
    reason: str


class TouchEnd(NamedTuple):
    """Work of a finger: one touch of an end of the object."""

    end: probing.End
    command: probing.ProbeCommand  # slicing frame


class SingleTouch(NamedTuple):
    """Work of a finger: one touch of the surface of the solid as it is known."""

    touch: planners.Touch
    retries: int = 0  # times that it began inside and was begun anew from farther off


Work = TraceSlice | TouchEnd | SingleTouch


class Task(NamedTuple):
    """Goal: what one finger is to do."""

    number: int  # contours and touches share one series
    finger: int
    start: float  # robot time of the decision [s]
    height: float  # slicing frame [m]
    max_touches: float  # that it may take
    not_after: float  # robot time by which it must have ended [s]
    work: Work


class MakeModel(NamedTuple):
    """Goal: fit a model to all that is known."""


class Done(NamedTuple):
    """Goal: end with a final model of all that is known."""

    reason: str


Goal = CloseHand | TurnObject | Task | MakeModel | Done
