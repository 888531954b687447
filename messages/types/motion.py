"""Goals of fingers and hand, and their results: contours, probes, grasps, turns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from palpate.messages.fields import (
    Count,
    Curvatures,
    Direction,
    Directions,
    FingerNumbers,
    Lengths,
    Metres,
    MoveParts,
    PlanarPoint,
    Points,
    Pose,
    Seconds,
    Vector,
)
from palpate.messages.types.touch import FrameFault, Outcome
from palpate.reprs import readable

# How tracing ended, in order: the loop is closed; it has gaps, or the pad reaches none of it; the
# object ends below the slice; the trace is stuck; it went around too far without closing; the
# budget is spent; there was no contact
ContourStatus = Literal["closed", "occluded", "pole", "stuck", "overrun", "budget", "no_contact"]
# The pad bridged a stretch without contact in it, or missed the surface there
GapReason = Literal["bridged", "missed"]


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ContourGoal:
    """A slice to trace. Planner to tracer on ``/contour/goal``."""

    id: Count  # Number of the goal; contours and probes share one series
    finger: Count  # The finger that is to trace it
    frame: Pose  # Slicing frame in the world; the slice is normal to its z axis
    height: Metres  # Height of the slice along the frame's z axis
    centre: PlanarPoint  # Where the object's axis is expected to meet the slice, slicing frame
    radius: Metres  # Approach from this distance to the centre
    # Stretch of the contour that may stay untouched between two touches
    gap: Metres = 0.0
    not_before: Seconds  # Robot time of the decision
    # Maximum number of touches; null: no limit
    most_touches: Count | None = None
    # Robot time at which the last touch must have ended; null: no limit
    not_after: Seconds | None = None
    reason: str = ""  # Reason for this height, in words


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Contour:
    """One traced contour. Latched, all kept, on ``/contour/traced``."""

    id: Count  # Number of the goal
    finger: Count  # The finger that traced it
    frame: Pose  # Slicing frame in the world
    height: Metres  # Height of the slice along the frame's z axis
    # Contact points in their order, world frame, counter-clockwise about the frame's z axis
    points: Points
    normals: Directions  # Outward unit normals at the points
    # Normal curvature across the contour at the points; convex is positive; 0 at edges
    curvature: Curvatures
    # Lowest height along the frame's z axis of the continuous contact below each point
    contact_low: Lengths
    contact_high: Lengths  # Highest height of the continuous contact above it
    status: ContourStatus  # How tracing ended
    gap_starts: Points  # Last points before the stretches that could not be touched, world frame
    gap_ends: Points  # First points after them
    gap_reasons: tuple[GapReason, ...]  # Reasons for the gaps
    touches: Count  # Touches made
    fault: FrameFault = "none"  # Fault of the sensor, if it ended the contour
    robot_time: Seconds  # Robot time of the last touch


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ProbeGoal:
    """A single touch off the contours: a pole, a cap. Planner to tracer on ``/probe/goal``."""

    id: Count  # Number of the goal; contours and probes share one series
    finger: Count  # The finger that is to touch
    # Number of turns of the object before it; the pose is in the world at that time
    placement: Count = 0
    pose: Pose  # Start pose of the pad
    reach: Metres  # Longest path along the pad's z axis
    not_before: Seconds  # Robot time of the decision
    # Robot time at which it must have ended; null: no limit
    not_after: Seconds | None = None


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Probe:
    """The result of a single touch, or of the frames of one goal of a driver.

    Latched, all kept, on ``/probe/traced``.
    """

    id: Count  # Number of the goal
    finger: Count  # The finger that touched
    placement: Count = 0  # How often the object had been turned over before it
    outcome: Outcome  # How the guarded move ended
    point: Vector  # Deepest point touched, world frame; the end of the reach after a miss
    # Outward normal at the middle of the contact, or the pad's own if it could not be touched
    normal: Direction
    touches: Count  # Touches made; 0 if it could not have ended in time
    # Fault of the sensor: then the contact is unknown, and the touch counts as a miss
    fault: FrameFault = "none"
    robot_time: Seconds  # Robot time of the last touch


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TouchGoal:
    """One guarded move. Tracer to simulator on ``/finger/goal``."""

    goal: Count  # Number of the contour or probe that the touch belongs to
    touch: Count  # Counts up by one within the goal
    finger: Count  # The finger that is to move
    placement: Count = 0  # How often the object has been turned over before it
    pose: Pose  # Start pose of the pad: it moves along its z axis
    reach: Metres  # Longest path to first contact
    depth: Metres  # Press until the deepest compression is this
    direction: Direction  # Direction across the contour, world frame
    not_before: Seconds  # Robot time before which the move must not start


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FingerClock:
    """Robot time of a finger. Tracer to planner on ``/finger/clock``, if there are several."""

    finger: Count  # The finger
    robot_time: Seconds  # Robot time of its last touch


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspGoal:
    """A requested closing of the hand. On ``/hand/goal``."""

    number: Count  # Counts up by one
    placement: Count = 0  # How often the object has been turned over before it
    pose: Pose  # Pose of the hand: its fingers close towards its z axis, its palm moves along it
    fingers: Count  # Fingers beside the palm
    opening: Metres  # Distance of the fingertips and of the palm from the middle of the open hand
    reach: Metres  # Longest path of a finger
    # Fast advance of each finger, the palm last, before it closes slowly; empty: none
    advanced: Lengths = field(default_factory=lambda: np.zeros(0))
    not_before: Seconds  # Robot time of the decision


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspContacts:
    """Contacts of the fingers of the hand. On ``/hand/contacts``."""

    number: Count  # Number of the goal
    placement: Count = 0  # How often the object had been turned over before it
    points: Points  # Contact points, world frame
    normals: Directions  # Outward unit normals at the contacts
    fingers: FingerNumbers  # The finger of each contact, from 0; the palm is the last
    missed: Count  # Fingers that closed without a usable contact
    blocked: Count  # Fingers that did not close, because the platform or the object blocked them
    # Parts of the hand's move: the approach is the longest one of its fingers
    move: MoveParts
    robot_time: Seconds  # Robot time when the hand had opened again


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TurnGoal:
    """The object shall be set down on another side. Planner to simulator on ``/hand/turn``."""

    placement: Count  # Number of this turn, from 1
    # Requested pose of the object in the world; the object's own frame is that of the world at
    # first

    pose: Pose
    not_before: Seconds  # Robot time of the decision


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Turned:
    """The object was set down on another side; its pose is not known. On ``/hand/turned``."""

    placement: Count  # Number of turns so far
    move: MoveParts  # Parts of the hand's move
    robot_time: Seconds  # Robot time when the hand had opened again
