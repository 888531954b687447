"""One fingertip's contact: a point of the surface, and its outward normal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.frames import split_pose
from palpate.core.touch.clean import clean
from palpate.core.touch.curvature import feel_patch
from palpate.core.touch.pad import Pad

TOUCHED = 50e-6
"""Least compression that counts as touched, m."""
ACROSS: Floats = np.array([0.0, 1.0, 0.0])
ACROSS.setflags(write=False)


class Contact(NamedTuple):
    """Where a fingertip touches."""

    point: Floats
    """(3,), m."""
    normal: Floats
    """Outward unit normal, (3,)."""


def contact_of(pad: Pad, pose: Floats, compression: Floats, noise: float) -> Contact | None:
    """What a pressed fingertip tells of the surface, in the frame in which its pose is given.

    Parameters
    ----------
    pad : Pad
        The fingertip.
    pose : (7,) array
        Its pose as it is believed to be.
    compression : (rows, cols) array
        As the array reports it, m.
    noise : float
        Standard deviation of one taxel, m.

    Returns
    -------
    Contact or None
        The deepest point, with the normal of the surface about it; None if nothing is touched.
    """
    cleaned = clean(pad, compression, noise, TOUCHED, "auto")
    if not cleaned.touched.any():
        return None
    surface = np.where(cleaned.touched, -(cleaned.compression + pad.sag()), 0.0)
    patch = feel_patch(pad, surface, cleaned.touched, ACROSS, noise)
    position, axes = split_pose(pose)
    if patch.jet is not None and patch.kind == "smooth":
        return Contact(axes @ patch.place + position, axes @ patch.normal)
    x, y = pad.grid()
    row, col = np.unravel_index(
        int(np.where(cleaned.touched, cleaned.compression, -1.0).argmax()), surface.shape
    )
    deepest = np.array([x[row, col], y[row, col], surface[row, col]])
    return Contact(axes @ deepest + position, axes @ patch.normal)
