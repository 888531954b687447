"""Goals of the hand and of the fingers, as values."""

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

    pose: Pose  # motion from the first pose to the requested one, world frame


class TraceSlice(NamedTuple):
    """Work of a finger: a contour around the object."""

    centre: Floats  # (2,) [m] where its middle is expected, slicing frame
    radius: float  # [m] distance from the middle at which the pad starts
    gap: float  # [m] stretch that may stay untouched between two touches
    max_touches: int  # after which it is given up, even if the budget allows more
    reason: str  # in words


class TouchEnd(NamedTuple):
    """Work of a finger: one touch of an end of the object."""

    end: probing.End
    command: probing.ProbeCommand  # slicing frame


class SingleTouch(NamedTuple):
    """Work of a finger: one touch of the surface of the known solid."""

    touch: planners.Touch
    retries: int = 0  # how often it began inside and was repeated from farther off


Work = TraceSlice | TouchEnd | SingleTouch


class Task(NamedTuple):
    """Goal: a piece of work for one finger."""

    number: int  # contours and touches are numbered in one series
    finger: int  # its number, from 1
    start: float  # [s] robot time of the decision
    height: float  # [m] slicing frame
    max_touches: float  # largest number of touches
    not_after: float  # [s] robot time by which it must have ended
    work: Work


class MakeModel(NamedTuple):
    """Goal: fit a model to all contacts so far."""


class Done(NamedTuple):
    """Goal: end with a final model of all contacts."""

    reason: str


Goal = CloseHand | TurnObject | Task | MakeModel | Done
