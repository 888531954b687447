"""What moves would have cost another robot: their geometry is kept, and any preset applied to it.

A recording keeps, with each touch, the ways and turns of which its time was made. So the accuracy
of one run can be drawn against the time of every robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Bools, Floats, finite_array, positive
from palpate.core.measure.robot_time import PRESETS, Preset

COLUMNS = 5
LIFTED = -1.0
"""Length of the way along the surface where there was none."""


class Moves(NamedTuple):
    """Geometry of moves in the order in which they were made."""

    wait: Floats
    """Time in which the arm did not move, waiting for a decision or a message, (n,), s."""
    travel: Floats
    """From the last start pose to this one, (n,), m."""
    turn: Floats
    """Angle between the two, (n,), rad."""
    approach: Floats
    """From the start pose to the end of the move, (n,), m; the finger goes back as far."""
    along: Floats
    """From the last contact to this one, where the finger could have slid, (n,), m; `LIFTED` where
    one of the two was none, or they belong to different goals."""

    @classmethod
    def of_rows(cls, rows: ArrayLike) -> Moves:
        """Moves from rows of (wait, travel, turn, approach, along), as messages carry them.

        Raises
        ------
        ValueError
            If they are no finite (n, 5) array, or a length, angle or time is negative.
        """
        table = finite_array("moves", rows, (None, COLUMNS))
        if (table[:, :4] < 0.0).any():
            worst = float(table[:, :4].min())
            raise ValueError(f"moves must not be negative but for `along`, got {worst:g}")
        return cls(*table.T)


class Durations(NamedTuple):
    """Where the time of each move goes, (n,) each, s."""

    wait: Floats
    """Not moving."""
    travel: Floats
    """To the start pose, or along the surface."""
    approach: Floats
    """To the surface."""
    dwell: Floats
    """Rest in contact, and the commands."""
    retract: Floats
    """Away from it."""

    def total(self) -> Floats:
        """Time of each move, (n,), s."""
        return np.asarray(sum(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sliding:
    """An arm that stays on the surface between two touches of one goal.

    Raises
    ------
    ValueError
        If a speed or the time of a frame is not positive.
    """

    arm: Preset
    """How it moves otherwise."""
    speed: float
    """Along the surface, m/s."""
    frame: float
    """Of each frame that is taken on the way, s."""

    def __post_init__(self) -> None:
        positive("speed", self.speed, "m/s")
        positive("frame", self.frame, "s")


SLIDING = Sliding(arm=PRESETS["modern"], speed=0.01, frame=0.02)
"""The modern arm, following the surface at 10 mm/s; an assumption like the others."""
ROBOTS: Mapping[str, Preset | Sliding] = {**PRESETS, "sliding": SLIDING}
"""Presets by name."""


def durations(moves: Moves, robot: Preset | Sliding) -> Durations:
    """Durations of moves, as this robot would make them.

    Parameters
    ----------
    moves : Moves
        Their geometry.
    robot : Preset or Sliding
        Who makes them.

    Notes
    -----
    With the preset of which a recording was made they add up to its robot times: see `seconds`.
    """
    if isinstance(robot, Sliding):
        return _slid(moves, robot)
    return Durations(
        moves.wait,
        np.maximum(_travel(robot, moves.travel), moves.turn / robot.turning),
        moves.approach / robot.approach,
        np.full(len(moves.wait), robot.dwell + 2.0 * robot.overhead),
        moves.approach / robot.retract,
    )


def seconds(moves: Moves, robot: Preset | Sliding) -> Floats:
    """Robot time at the end of each move, (n,), s: the sum of all durations so far."""
    return np.cumsum(durations(moves, robot).total())


def _slid(moves: Moves, robot: Sliding) -> Durations:
    """Between touches that the surface joins there is neither retreat nor approach nor rest."""
    lifted, slid = durations(moves, robot.arm), moves.along >= 0.0
    way = np.where(slid, moves.along, 0.0) / robot.speed
    return Durations(
        lifted.wait,
        np.where(slid, np.maximum(way, moves.turn / robot.arm.turning), lifted.travel),
        np.where(slid, 0.0, lifted.approach),
        np.where(slid, robot.frame, lifted.dwell),
        np.where(_followed(slid), 0.0, _retreat(slid, lifted.retract)),
    )


def _followed(slid: Bools) -> Bools:
    """Which moves are followed by one along the surface."""
    return np.append(slid[1:], False)


def _retreat(slid: Bools, retract: Floats) -> Floats:
    """Time to leave the surface after each move: as from the contact where sliding began."""
    began = np.maximum.accumulate(np.where(slid, 0, np.arange(len(slid))))
    return retract[began]


def _travel(preset: Preset, ways: Floats) -> Floats:
    """From rest to rest, with a trapezoid of speed, or a triangle where it is short, (n,)."""
    ramp = preset.speed / preset.acceleration
    short = 2.0 * np.sqrt(ways / preset.acceleration)
    return np.where(ways >= preset.speed * ramp, ways / preset.speed + ramp, short)
