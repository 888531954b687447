"""The slicing axis that a touch of the upper end tells: square to the surface there.

One touch does not know whether it met a face. But where the surface is level, sections are best
taken level; and where all sides run straight along its normal, it is the face that closes them.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp.straight import straight_axis

LEVEL = math.radians(3.0)
"""A surface that leans less lies level: the object stands on a platform and ends level, however its
middles lean."""
SQUARE = math.radians(3.0)
"""The sides run straight along the face's normal if their own axis differs by no more."""
SAME = math.radians(1.0)
"""An axis that differs by less is no other."""


def face_axis(axis: Floats, face: Floats, normals: Floats) -> Floats | None:
    """A better axis than the one along which an end was touched; None if that does.

    Parameters
    ----------
    axis : (3,) array
        The slicing axis so far, a unit vector that points to the end.
    face : (3,) array
        Outward unit normal where the end was touched.
    normals : (n, 3) array
        Outward unit normals of all contacts.
    """
    vertical = np.array([0.0, 0.0, 1.0])
    if _apart(face, axis) < SAME:
        return None
    if _apart(face, vertical) < LEVEL:
        return None if np.array_equal(axis, vertical) else vertical
    straight = straight_axis(normals, face)
    if straight is None or _apart(straight, face) > SQUARE:
        return None
    return face


def _apart(one: Floats, other: Floats) -> float:
    """Angle between unit vectors, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))
