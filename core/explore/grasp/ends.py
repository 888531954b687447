"""Where an object begins and ends along its axis, and how wide it is.

An end that was touched is where its contacts say; one that was not is where the fitted solid has
it, if that fits, or where the platform cuts it off.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.grasp.fit import Fit
from palpate.core.explore.grasp.misfit import Corrected
from palpate.core.frames import inverse, split_pose, transform

FACING = 0.9
"""Cosine to the axis from which on a contact's normal says where the end is."""
LEANING = 0.5
"""The same, where the fitted solid is no help."""
NEAR = 0.06
"""Of the extent: contacts as near as this to the outermost one belong to the end."""
BOUNDED = 0.3
"""Share of this that is allowed to a fit that came to a bound."""
QUARTER = 0.25
"""Of the extent: the widest contact so near to the lower end tells how wide that is."""
FITS = 0.015
"""Of the diameter: a solid that misses its contacts by more says nothing of what is beyond."""
LEAST_COSINE = 0.5
"""The platform cuts off an axis that is steeper than this."""


class Touched(NamedTuple):
    """Contacts."""

    points: Floats
    """(n, 3), m."""
    normals: Floats
    """Outward unit normals, (n, 3)."""


class Known(NamedTuple):
    """A solid that fits."""

    vertices: Floats
    """(n, 3), m."""
    deviation: Floats
    """Standard deviation of each, (n,), m."""
    poor: float
    """From 0 to 1: how much of what it may miss it misses."""


class Ends(NamedTuple):
    """Extent along an axis."""

    low: float
    """m."""
    high: float
    """m."""
    radius: float
    """Largest distance from the axis, m."""
    error: float
    """Standard deviation of the two ends, the larger one, m."""


def ends_along(
    pose: Floats, solid: Corrected, found: Fit, touched: Touched, platform: float
) -> Ends:
    """Extent along the z axis of a frame.

    Parameters
    ----------
    pose : (7,) array
        The frame, its origin anywhere on the axis.
    solid : Corrected
        The fitted solid, moved on to its contacts.
    found : Recovery
        How well it fits.
    touched : Touched
        The contacts in the world, at least one.
    platform : float
        Height of the platform in the world, m.
    """
    axes = split_pose(pose)[1]
    here = Touched(transform(inverse(pose), touched.points), touched.normals @ axes)
    vertices = transform(inverse(pose), solid.vertices)
    allowed = FITS * float(np.ptp(vertices, axis=0).max())
    over = solid.vertices[:, 2] >= platform - allowed
    known = None
    if found.rms < (BOUNDED if "at a bound" in found.doubts else 1.0) * allowed:
        known = Known(vertices[over], solid.deviation[over], found.rms / allowed)
    down = np.array([1.0, 1.0, -1.0])
    foot = _foot(pose, axes, here, platform)
    high, above = _end(here, known, None)
    turned = Touched(here.points * down, here.normals * down)
    low, below = _end(turned, known and known._replace(vertices=known.vertices * down), foot)
    wide = here.points if known is None else np.vstack([here.points, known.vertices])
    return Ends(-low, high, float(np.hypot(wide[:, 0], wide[:, 1]).max()), max(above, below))


def _end(here: Touched, known: Known | None, foot: float | None) -> tuple[float, float]:
    """Where the upper end is, and its standard deviation, m."""
    along = here.points[:, 2]
    outermost = float(along.max())
    near = along >= outermost - NEAR * (outermost - float(along.min()))
    felt = _felt_end(here, near & (here.normals[:, 2] > FACING), 0.5)
    if felt is not None:
        return felt
    if known is not None:
        vertex = int(known.vertices[:, 2].argmax())
        end = max(outermost, float(known.vertices[vertex, 2]))
        return end, float(known.deviation[vertex]) + known.poor * (end - outermost)
    radius = float(np.hypot(here.points[:, 0], here.points[:, 1]).max())
    level = outermost if foot is None else max(outermost, foot)
    round_end = _felt_end(here, near & (here.normals[:, 2] > LEANING), 0.5)
    if round_end is None:
        return level, (0.5 if foot is None else 0.25) * radius
    # An edge and a round end feel alike: between the two.
    return 0.5 * (level + round_end[0]), 0.5 * abs(round_end[0] - level) + 0.1 * radius


def _felt_end(here: Touched, at_end: Bools, share: float) -> tuple[float, float] | None:
    """Where the top is of the paraboloid about the axis through a contact, across its normal.

    The paraboloid's share is a half.
    """
    if not at_end.any():
        return None
    points, normals = here.points[at_end], here.normals[at_end]
    outwards = (points[:, :2] * normals[:, :2]).sum(axis=1) / normals[:, 2]
    tops = points[:, 2] + share * np.maximum(outwards, 0.0)
    best = int(normals[:, 2].argmax())
    top = max(float(tops[best]), float(here.points[:, 2].max()))
    return top, 0.5 * abs(top - float(points[best, 2])) + float(np.ptp(points[:, 2])) / 4.0


def _foot(pose: Floats, axes: Floats, here: Touched, platform: float) -> float | None:
    """Where a level lower end that stands on the platform by its rim is, downwards, m."""
    cosine = float(axes[2, 2])
    if cosine < LEAST_COSINE:
        return None
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    along = here.points[:, 2]
    lowest = along <= along.min() + QUARTER * np.ptp(along)
    rim = float(np.hypot(here.points[lowest, 0], here.points[lowest, 1]).max())
    return -(platform - float(pose[2]) + rim * sine) / cosine
