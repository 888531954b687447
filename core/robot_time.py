"""Robot time of one guarded move, and of recorded moves for any robot.

A recording stores the distances and turns of each touch, from which its time was computed. So the
accuracy of one run can be plotted against the time of any robot. The presets are assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, finite_array, not_negative, positive
from palpate.core.poses import Pose, rotation_angle

N_COLUMNS = 5  # of a row of moves
LIFTED = -1.0  # stands for the distance along the surface after a move through the air


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPreset:
    """Speeds and delays of an arm.

    Raises ValueError if a speed or the acceleration is not positive, or a duration is negative.
    """

    speed: float  # [m/s] of free travel
    acceleration: float  # [m/s2] of free travel
    turning: float  # [rad/s] of reorientation
    approach: float  # [m/s] towards the surface
    retract: float  # [m/s] away from the surface
    dwell: float  # [s] rest in contact
    overhead: float  # [s] of each of the two commands of a touch

    def __post_init__(self) -> None:
        units = {"acceleration": "m/s2", "turning": "rad/s", "dwell": "s", "overhead": "s"}
        for field in fields(self):
            value, unit = getattr(self, field.name), units.get(field.name, "m/s")
            (not_negative if unit == "s" else positive)(field.name, value, unit)

    @property
    def array(self) -> Floats:
        """The fields in their order, (7,), as in messages."""
        return np.array([getattr(self, field.name) for field in fields(self)])

    @classmethod
    def of_array(cls, values: Floats) -> RobotPreset:
        """The preset with these fields, (7,)."""
        return cls(**dict(zip((field.name for field in fields(cls)), values.tolist(), strict=True)))


def move_between(before: Pose | None, pose: Pose) -> tuple[float, float]:
    """Distance [m] and turn [rad] from one pose to another; 0 without a pose before."""
    if before is None:
        return 0.0, 0.0
    travel = float(np.linalg.norm(pose.position - before.position))
    return travel, rotation_angle(before.axes, pose.axes)


def longest_seconds(
    preset: RobotPreset, travel: float, turn: float, reach: float, max_depth: float = 5e-3
) -> float:
    """Upper bound of a touch's robot time [s].

    `travel` [m] and `turn` [rad] as of `free_seconds`. `reach`: distance to contact [m];
    `max_depth`: beyond it [m].
    """
    return free_seconds(preset, travel, turn) + contact_seconds(preset, reach + max_depth)


def free_seconds(preset: RobotPreset, travel: float, turn: float) -> float:
    """Robot time from one start pose to the next, travelling and turning together.

    `travel`: distance from the last start pose to this one [m]. `turn`: angle between both [rad].
    Raises ValueError if one is negative or not finite.
    """
    distance = not_negative("travel", travel, "m")
    turning = not_negative("turn", turn, "rad") / preset.turning
    return max(float(_travel_durations(preset, np.array(distance))), turning)


def contact_seconds(preset: RobotPreset, approach: float) -> float:
    """Robot time [s] of a move to the surface and back: approach, rest, retreat, two commands.

    `approach`: distance from the start pose to the end of the touch [m], the same as of the
    retreat. Raises ValueError if it is negative or not finite.
    """
    not_negative("approach", approach, "m")
    there_and_back = approach / preset.approach + approach / preset.retract
    return there_and_back + preset.dwell + 2.0 * preset.overhead


class MoveGeometry(NamedTuple):
    """Geometry of moves in the order in which they were made."""

    wait: Floats  # time without motion, for a decision or a message, (n,) [s]
    travel: Floats  # from the last start pose to this one, (n,) [m]
    turn: Floats  # between both, (n,) [rad]
    approach: Floats  # from start pose to end of the move, and back, (n,) [m]
    # From the last contact to this one, where the finger could have slid, (n,) [m]; `LIFTED` where
    # one of the two was none, or they belong to different goals.
    along: Floats

    @classmethod
    def of_rows(cls, rows: ArrayLike) -> MoveGeometry:
        """Moves from rows of (wait, travel, turn, approach, along), as in messages.

        Raises ValueError if they are no finite (n, 5) array, or a length, angle or time is
        negative.
        """
        table = finite_array("moves", rows, (None, N_COLUMNS))
        if (table[:, :4] < 0.0).any():
            worst = float(table[:, :4].min())
            raise ValueError(f"moves must not be negative but for `along`, got {worst:g}")
        return cls(*table.T)


class MoveDurations(NamedTuple):
    """Durations of the parts of each move, (n,) each [s]."""

    wait: Floats  # without motion
    travel: Floats  # to the start pose, or along the surface
    approach: Floats  # to the surface
    dwell: Floats  # rest in contact, and the commands
    retract: Floats  # away from the surface

    def total(self) -> Floats:
        """Duration of each move, (n,) [s]."""
        return np.asarray(sum(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class SlidingPreset:
    """An arm that stays on the surface between two touches of one goal.

    Raises ValueError if a speed or the time of a frame is not positive.
    """

    arm: RobotPreset  # for all other motion
    speed: float  # [m/s] along the surface
    frame: float  # [s] for each frame while sliding

    def __post_init__(self) -> None:
        positive("speed", self.speed, "m/s")
        positive("frame", self.frame, "s")


def move_durations(moves: MoveGeometry, robot: RobotPreset | SlidingPreset) -> MoveDurations:
    """Durations of moves by a robot; for the recording's own preset they sum to its robot times."""
    if isinstance(robot, SlidingPreset):
        return _slid(moves, robot)
    return MoveDurations(
        moves.wait,
        np.maximum(_travel_durations(robot, moves.travel), moves.turn / robot.turning),
        moves.approach / robot.approach,
        np.full(len(moves.wait), robot.dwell + 2.0 * robot.overhead),
        moves.approach / robot.retract,
    )


def _slid(moves: MoveGeometry, robot: SlidingPreset) -> MoveDurations:
    """Durations of an arm that slides: no retreat, approach and rest between joined touches."""
    lifted, slid = move_durations(moves, robot.arm), moves.along >= 0.0
    sliding = moves.along / robot.speed
    followed = np.append(slid[1:], False)
    # The retreat is that of the contact where sliding began.
    began = np.maximum.accumulate(np.where(slid, 0, np.arange(len(slid))))
    return MoveDurations(
        lifted.wait,
        np.where(slid, np.maximum(sliding, moves.turn / robot.arm.turning), lifted.travel),
        np.where(slid, 0.0, lifted.approach),
        np.where(slid, robot.frame, lifted.dwell),
        np.where(followed, 0.0, lifted.retract[began]),
    )


def _travel_durations(preset: RobotPreset, distances: Floats) -> Floats:
    """Durations (n,) [s] from rest to rest: the speed is a trapezoid, or a triangle if short."""
    ramp = preset.speed / preset.acceleration
    short = 2.0 * np.sqrt(distances / preset.acceleration)
    return np.where(distances >= preset.speed * ramp, distances / preset.speed + ramp, short)


# ``modern``: a collaborative arm. ``puma``: an arm of the 1990s. Both are assumptions.
ROBOT_PRESETS: Mapping[str, RobotPreset] = {
    "modern": RobotPreset(
        speed=0.1,
        acceleration=1.0,
        turning=math.radians(60),
        approach=0.01,
        retract=0.05,
        dwell=0.1,
        overhead=0.05,
    ),
    "puma": RobotPreset(
        speed=0.05,
        acceleration=0.5,
        turning=math.radians(30),
        approach=0.005,
        retract=0.02,
        dwell=0.5,
        overhead=0.25,
    ),
}
# The modern arm, following the surface at 10 mm/s; an assumption like the others.
SLIDING = SlidingPreset(arm=ROBOT_PRESETS["modern"], speed=0.01, frame=0.02)
# Presets by name.
ROBOTS: Mapping[str, RobotPreset | SlidingPreset] = {**ROBOT_PRESETS, "sliding": SLIDING}
