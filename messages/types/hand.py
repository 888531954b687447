"""Grasp by containment: several fingers close on the object at once."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.messages.quantity import Count, Directions, Metres, Points, Pose, Seconds


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspGoal:
    """A pose of the hand from which it shall close. On ``/hand/goal``."""

    number: Count
    """Counts up by one."""
    pose: Pose
    """Pose of the hand: it closes about its z axis."""
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
    missed: Count
    """Fingers that closed on nothing."""
    robot_time: Seconds
    """Robot time when the hand had opened again."""
