"""The planes in which an object ends, and the slant of the space between them.

Each touch of an end tells how that leans there, whatever the error of its place. Touches that are
flat and lean alike make a plane.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.feet import FACING, feet_of
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.slant import Slant

TOGETHER = 0.02
"""Of the extent: how far from its plane they may lie, and anything else may stand out over it."""
OUTER = 0.1
"""Of the extent: so far below the outermost touch others must not lean otherwise, as on a gable."""
FEW, UNSURE = 3, math.radians(0.25)
"""Touches that tell themselves how sure their mean is; of fewer, each may be wrong by this, and
none that is not flat may lie beside them: a dome looks flat somewhere."""
SHORT = 2e-3
"""Of the extent: what was felt so near to a given height was felt of that end."""
SURE = 3.0
"""Standard deviations by which a slope must differ from none."""
LEAST = 1e-4
"""Of the extent: what heights must be moved by to be worth it."""
LEVEL = 0.15
"""Slope up to which an end is nearly level: one of both must be, else it is the axis that leans."""
STEEPEST = 1.0
"""Slope beyond which nothing was understood."""


class EndPlane(NamedTuple):
    """A plane over the slicing frame, z = height + slopes . (x, y)."""

    height: float
    """At the origin, m."""
    slopes: Floats
    """(2,)."""
    error: float
    """Standard deviation of a slope."""

    def at(self, places: Floats) -> Floats:
        """Heights (n,) over places (n, 2), m."""
        heights: Floats = self.height + places @ self.slopes
        return heights


def end_plane(felt: FeltPoints, way: float) -> EndPlane | None:
    """The plane of an end, way 1 or -1; None if it was not felt to be one."""
    feet = feet_of(felt, way)
    flat = [one for one in feet if one.kind == "flat"]
    if not flat:
        return None
    extent = float(np.ptp(felt.points[:, 2]))
    first = max(flat, key=lambda foot: way * float(foot.place[2]))
    near = [one for one in feet if way * float(first.place[2] - one.place[2]) <= OUTER * extent]
    alike = [one for one in flat if first.leans_as(one) and first.misses(one) <= TOGETHER * extent]
    others = [one for one in near if one.kind == "flat" and not first.leans_as(one)]
    beside = [one for one in near if one.kind != "flat" and first.misses(one) <= TOGETHER * extent]
    if len(others) >= len(alike) or (beside and len(alike) < FEW):
        return None
    slopes = np.stack([one.slopes for one in alike])
    mean = slopes.mean(axis=0)
    height = float(np.mean([one.place[2] - one.place[:2] @ mean for one in alike]))
    scatter = np.sqrt(np.mean((slopes - mean) ** 2)) if len(alike) >= FEW else math.tan(UNSURE)
    plane = EndPlane(height, mean, float(scatter / np.sqrt(len(alike))))
    beyond = float((way * (felt.points[:, 2] - plane.at(felt.points[:, :2]))).max())
    return plane if beyond < TOGETHER * extent else None


def slant_between(
    felt: FeltPoints, middle: Floats, ends: tuple[float | None, float | None]
) -> Slant | None:
    """The slant of the space between the ends; None where both are level, or not planes.

    Parameters
    ----------
    felt : FeltPoints
        All taxels, seen from the slicing frame; with normals.
    middle : (2,) array
        Of the object, m.
    ends : pair of float or None
        Heights of its ends, as touched by whatever means, m: where no taxel was, they are level;
        an end of which nothing is known is like the other.
    """
    extent = float(np.ptp(felt.points[:, 2]))
    low, high = end_plane(felt, -1.0), end_plane(felt, 1.0)
    away = felt.points[:, :2] - middle
    reach = float(np.linalg.norm(away, axis=1).max())
    if not any(_slants(plane, reach, extent) for plane in (low, high)):
        return None
    below = low or _like(high, felt, -1.0, ends[0], middle)
    above = high or _like(low, felt, 1.0, ends[1], middle)
    bottom, top = (float(plane.at(middle[None])[0]) for plane in (below, above))
    if not top > bottom:
        return None
    change = (above.slopes - below.slopes) / (top - bottom)
    slant = Slant(middle, below.slopes - bottom * change, change)
    steep = sorted(float(np.linalg.norm(plane.slopes)) for plane in (below, above))
    sound = bool(slant.reaches(felt.points).all()) and steep[0] < LEVEL and steep[1] < STEEPEST
    return slant if sound else None


def _slants(plane: EndPlane | None, reach: float, extent: float) -> bool:
    if plane is None:
        return False
    slope = float(np.linalg.norm(plane.slopes))
    return slope > SURE * plane.error and slope * reach > LEAST * extent


def only_given(felt: FeltPoints, way: float, given: float | None) -> bool:
    """Whether an end is known by a given height alone, as by a platform: no taxel there faces."""
    if given is None:
        return False
    assert felt.normals is not None
    heights = way * felt.points[:, 2]
    there = heights > way * given - SHORT * float(np.ptp(heights))
    return not bool((way * felt.normals[there, 2] > FACING).any())


def _like(
    other: EndPlane | None, felt: FeltPoints, way: float, given: float | None, middle: Floats
) -> EndPlane:
    """What stands for an end that is no plane: level if only given, else as the other one."""
    assert other is not None
    if given is not None and only_given(felt, way, given):
        return EndPlane(given, np.zeros(2), 0.0)
    farthest = way * float((way * felt.points[:, 2]).max())
    return EndPlane(farthest - float(middle @ other.slopes), other.slopes, other.error)
