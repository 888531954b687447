"""What moves cost a robot: the time of one guarded move, and that of recorded moves for any robot.

A recording keeps, with each touch, the ways and turns of which its time was made. So the accuracy
of one run can be drawn against the time of every robot. The presets are assumptions.
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

COLUMNS = 5
DEEPEST = 5e-3  # Beyond its reach no touch goes farther, m
LIFTED = -1.0  # Length of the way along the surface where there was none


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPreset:
    """How fast an arm is.

    Raises ValueError if a speed or the acceleration is not positive, or a duration is negative.
    """

    speed: float  # Of free travel, m/s
    acceleration: float  # Of free travel, m/s2
    turning: float  # Speed of reorientation, rad/s
    approach: float  # Speed towards the surface, m/s
    retract: float  # Speed away from it, m/s
    dwell: float  # Rest in contact, s
    overhead: float  # Of each of the two commands of a touch, s

    def __post_init__(self) -> None:
        units = {"acceleration": "m/s2", "turning": "rad/s", "dwell": "s", "overhead": "s"}
        for field in fields(self):
            value, unit = getattr(self, field.name), units.get(field.name, "m/s")
            (not_negative if unit == "s" else positive)(field.name, value, unit)

    @property
    def array(self) -> Floats:
        """The figures in their order, (7,), as messages carry them."""
        return np.array([getattr(self, field.name) for field in fields(self)])

    @classmethod
    def of_array(cls, values: Floats) -> RobotPreset:
        """The preset with these figures, (7,)."""
        return cls(**dict(zip((field.name for field in fields(cls)), values.tolist(), strict=True)))


def move_between(before: Pose | None, pose: Pose) -> tuple[float, float]:
    """Way and turn from one pose to another, m and rad; none if there was none before."""
    if before is None:
        return 0.0, 0.0
    travel = float(np.linalg.norm(pose.position - before.position))
    return travel, rotation_angle(before.axes, pose.axes)


def longest_seconds(preset: RobotPreset, travel: float, turn: float, reach: float) -> float:
    """Robot time, s, of a touch at the end of its reach and `DEEPEST` beyond; lengths in m, rad."""
    return free_seconds(preset, travel, turn) + contact_seconds(preset, reach + DEEPEST)


def free_seconds(preset: RobotPreset, travel: float, turn: float) -> float:
    """Robot time from one start pose to the next, travelling and turning together.

    `travel`: way from the last start pose to this one, m. `turn`: angle between the two, rad.
    Raises ValueError if the way or the angle is negative or not finite.
    """
    way = not_negative("travel", travel, "m")
    turning = not_negative("turn", turn, "rad") / preset.turning
    return max(float(_travel_durations(preset, np.array(way))), turning)


def contact_seconds(preset: RobotPreset, approach: float) -> float:
    """Robot time of a move to the surface and back: approach, rest, retreat, two commands.

    `approach`: way from the start pose to the end of the touch, m; the finger goes back as far.
    Raises ValueError if the way is negative or not finite.
    """
    not_negative("approach", approach, "m")
    there_and_back = approach / preset.approach + approach / preset.retract
    return there_and_back + preset.dwell + 2.0 * preset.overhead


class MoveGeometry(NamedTuple):
    """Geometry of moves in the order in which they were made."""

    wait: Floats  # Time in which the arm did not move, waiting for a decision or a message, (n,), s
    travel: Floats  # From the last start pose to this one, (n,), m
    turn: Floats  # Angle between the two, (n,), rad
    approach: Floats  # From start pose to end of the move, (n,), m; the finger goes back as far
    # From the last contact to this one, where the finger could have slid, (n,), m; `LIFTED` where
    # one of the two was none, or they belong to different goals.
    along: Floats

    @classmethod
    def of_rows(cls, rows: ArrayLike) -> MoveGeometry:
        """Moves from rows of (wait, travel, turn, approach, along), as messages carry them.

        Raises ValueError if they are no finite (n, 5) array, or a length, angle or time is
        negative.
        """
        table = finite_array("moves", rows, (None, COLUMNS))
        if (table[:, :4] < 0.0).any():
            worst = float(table[:, :4].min())
            raise ValueError(f"moves must not be negative but for `along`, got {worst:g}")
        return cls(*table.T)


class MoveDurations(NamedTuple):
    """Where the time of each move goes, (n,) each, s."""

    wait: Floats  # Not moving
    travel: Floats  # To the start pose, or along the surface
    approach: Floats  # To the surface
    dwell: Floats  # Rest in contact, and the commands
    retract: Floats  # Away from it

    def total(self) -> Floats:
        """Time of each move, (n,), s."""
        return np.asarray(sum(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class SlidingPreset:
    """An arm that stays on the surface between two touches of one goal.

    Raises ValueError if a speed or the time of a frame is not positive.
    """

    arm: RobotPreset  # How it moves otherwise
    speed: float  # Along the surface, m/s
    frame: float  # Of each frame that is taken on the way, s

    def __post_init__(self) -> None:
        positive("speed", self.speed, "m/s")
        positive("frame", self.frame, "s")


def move_durations(moves: MoveGeometry, robot: RobotPreset | SlidingPreset) -> MoveDurations:
    """Durations of moves by a robot; of the preset of a recording they sum to its robot times."""
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
    """Between touches that the surface joins there is neither retreat nor approach nor rest."""
    lifted, slid = move_durations(moves, robot.arm), moves.along >= 0.0
    way = moves.along / robot.speed
    followed = np.append(slid[1:], False)
    # The surface is left as from the contact where sliding began.
    began = np.maximum.accumulate(np.where(slid, 0, np.arange(len(slid))))
    return MoveDurations(
        lifted.wait,
        np.where(slid, np.maximum(way, moves.turn / robot.arm.turning), lifted.travel),
        np.where(slid, 0.0, lifted.approach),
        np.where(slid, robot.frame, lifted.dwell),
        np.where(followed, 0.0, lifted.retract[began]),
    )


def _travel_durations(preset: RobotPreset, ways: Floats) -> Floats:
    """From rest to rest, with a trapezoid of speed, or a triangle where it is short, (n,)."""
    ramp = preset.speed / preset.acceleration
    short = 2.0 * np.sqrt(ways / preset.acceleration)
    return np.where(ways >= preset.speed * ramp, ways / preset.speed + ramp, short)


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
