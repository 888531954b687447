"""Touches of an object that was turned over: a rigid motion of the touches of each placement.

The pose of the object after a turn is known from contacts of the hand, to one or two tenths of a
millimetre. What is left are six unknowns of each placement, a turn and a shift, which are fitted
with the solid and the displacements of single touches. A prior holds them near to the known pose:
at sharp edges, a smooth surface would otherwise turn all touches of a placement together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.poses import Pose, rotation_angle, rotations_from_vectors
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general.fitting import SharedMotions, TouchedPoints, touch_middles


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """Prior standard deviations of a placement's error; larger ones let the fit move it more."""

    shift: float = 0.2e-3  # [m] of the middle of its touches, along each axis
    turn: float = math.radians(0.4)  # [rad] about each axis
    least_pose: float = 2.0e-6  # [m] least pose error of a touch: exact poses have this one

    # A fitted shift or turn that is larger, over its deviation, contradicts the known pose. It was
    # at most 1.4 in 20 explorations of 13 objects, and 4.4 in one whose pose leaned by 3 degrees.
    max_sigmas: float = 3.0


def shared_motions(
    points: TouchedPoints,
    placement: Ints,
    cell: float,
    pose: float,
    settings: MotionSettings = MotionSettings(),
) -> SharedMotions | None:
    """The motions of later placements, shared by their touches; None if all are of the first.

    `points`: in cells of an edge `cell` [m]. `placement` (t,): of each touch. `pose` [m]: standard
    deviation of the displacement of each single touch; not 0.
    """
    if not len(placement) or not placement.any():
        return None
    count = int(points.touch.max()) + 1
    middles, of_touch = touch_middles(points.places, points.touch), np.zeros(count, np.int32)
    known = min(count, len(placement))  # later ones are assumed points, not touches
    of_touch[:known] = placement[:known]
    columns = np.zeros((count, 3, 6 * int(placement.max())))
    for number in range(1, int(placement.max()) + 1):
        own = np.flatnonzero(of_touch == number)
        if not len(own):
            continue
        away = middles[own] - middles[own].mean(axis=0)
        first = 6 * (number - 1)
        for axis in range(3):
            unit = np.eye(3)[axis]
            columns[own, :, first + axis] = settings.turn * np.cross(unit, away)
            columns[own, :, first + 3 + axis] = settings.shift / cell * unit
    return SharedMotions(columns.reshape(3 * count, -1), pose / cell)


def found_motions(
    contacts: ContactPoints,
    placement: Ints,
    unknowns: Floats,
    settings: MotionSettings = MotionSettings(),
) -> tuple[Pose, ...]:
    """The rigid motion of each later placement that moves its touches onto the others.

    `unknowns` (6 p,): the fitted turns and shifts, over their prior standard deviations.
    """
    middles = touch_middles(contacts.points, contacts.touch)
    of_touch = placement[: len(middles)]
    motions = []
    for number, unknown in enumerate(unknowns.reshape(-1, 6), 1):
        own = middles[of_touch == number]
        middle = own.mean(axis=0) if len(own) else np.zeros(3)
        turn = rotations_from_vectors(settings.turn * unknown[None, :3])[0]
        motions.append(Pose(middle + settings.shift * unknown[3:] - turn @ middle, turn))
    return tuple(motions)


def contradicts(
    motion: Pose, contacts: ContactPoints, settings: MotionSettings = MotionSettings()
) -> bool:
    """Whether a fitted motion moves these contacts farther than the known pose allows."""
    middle = contacts.points.mean(axis=0, keepdims=True)
    shift = float(np.abs(motion.to_outer(middle) - middle).max())
    turn = rotation_angle(np.eye(3), motion.axes)
    return max(shift / settings.shift, turn / settings.turn) > settings.max_sigmas
