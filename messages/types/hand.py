"""Grasp by containment: several fingers close on the object at once."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.messages.quantity import (
    Count,
    Directions,
    Fingers,
    Metres,
    Move,
    Points,
    Pose,
    Seconds,
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspGoal:
    """A pose of the hand from which it shall close. On ``/hand/goal``."""

    number: Count
    """Counts up by one."""
    pose: Pose
    """Pose of the hand: its fingers close about its z axis, its palm moves along it."""
    fingers: Count
    """Fingers beside the palm."""
    opening: Metres
    """Distance of the fingertips and of the palm from the middle of the open hand."""
    reach: Metres
    """Longest way of a finger."""
    not_before: Seconds
    """Robot time of the decision."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspContacts:
    """Where the fingers met the object. On ``/hand/contacts``."""

    number: Count
    """Number of the goal."""
    points: Points
    """Contact points, world frame."""
    normals: Directions
    """Outward unit normals at the contacts."""
    fingers: Fingers
    """The finger of each contact, from 0; the palm is the last."""
    missed: Count
    """Fingers that closed on nothing, or on what they could not tell."""
    blocked: Count
    """Fingers that did not close, for the platform or the object was in their way."""
    move: Move
    """What the hand's way was made of: the approach is that of the finger that went farthest."""
    robot_time: Seconds
    """Robot time when the hand had opened again."""
