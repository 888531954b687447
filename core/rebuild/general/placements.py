"""Touches of an object that was turned over: how each placement's touches are moved together.

How the object lies after it was turned is known from a few contacts, to half a millimetre or so.
The rest is six unknowns of a placement, a turn and a shift, which are fitted with the solid and the
displacements of single touches. What was found is then taken out of the touches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from palpate.core.arrays import Ints
from palpate.core.poses import Pose, rotations_from_vectors
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general.fitting import SharedMotions, TouchedPoints, touch_middles
from palpate.core.rebuild.general.solid import GeneralSolid


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """How far a placement may be off before it is fitted: standard deviations."""

    shift: float = 1.0e-3  # [m] along each axis, of the middle of its touches
    turn: float = math.radians(1.0)  # [rad] about each axis
    least_pose: float = 2.0e-6  # [m]: exact poses count as known no better


MOTIONS = MotionSettings()


def shared_motions(
    points: TouchedPoints, placement: Ints, cell: float, pose: float
) -> SharedMotions | None:
    """The motions of the later placements that touches share; None if there is none.

    `points`: in cells of an edge `cell` [m]. `placement` (t,): of each touch. `pose` [m]: standard
    deviation of what each touch is displaced by; not 0.
    """
    if not len(placement) or not placement.any():
        return None
    count = int(points.touch.max()) + 1
    middles, of_touch = touch_middles(points.places, points.touch), placement[:count]
    columns = np.zeros((count, 3, 6 * int(placement.max())))
    for number in range(1, int(placement.max()) + 1):
        own = np.flatnonzero(of_touch == number)
        if not len(own):
            continue
        away = middles[own] - middles[own].mean(axis=0)
        first = 6 * (number - 1)
        for axis in range(3):
            unit = np.eye(3)[axis]
            columns[own, :, first + axis] = MOTIONS.turn * np.cross(unit, away)
            columns[own, :, first + 3 + axis] = MOTIONS.shift / cell * unit
    return SharedMotions(columns.reshape(3 * count, -1), pose / cell)


def replaced(solid: GeneralSolid, placement: Ints, shared: SharedMotions) -> GeneralSolid:
    """The solid with the touches of each later placement moved as the fit found.

    They are not displaced by that any more.
    """
    unknowns = shared.of(solid.fit.displacements).reshape(-1, 6)
    contacts, motions = solid.contacts, []
    points, normals = contacts.points.copy(), np.array(contacts.normals)
    middles = touch_middles(contacts.points, contacts.touch)
    of_touch = placement[: len(middles)]
    of_point = of_touch[contacts.touch]
    for number, unknown in enumerate(unknowns, 1):
        if not (of_touch == number).any():
            motions.append(Pose(np.zeros(3), np.eye(3)))
            continue
        middle = middles[of_touch == number].mean(axis=0)
        turn = rotations_from_vectors(MOTIONS.turn * unknown[None, :3])[0]
        motion = Pose(middle + MOTIONS.shift * unknown[3:] - turn @ middle, turn)
        own = of_point == number
        points[own], normals[own] = motion.to_outer(points[own]), normals[own] @ turn.T
        motions.append(motion)
    fit = replace(solid.fit, displacements=shared.without(solid.fit.displacements))
    moved = ContactPoints(points, normals, contacts.touch)
    return replace(solid, contacts=moved, fit=fit, placement=placement, motions=tuple(motions))
