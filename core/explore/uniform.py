"""The uniform plan: slices at even heights, from the middle up and then from it down."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.aim import PRESS
from palpate.core.frames import DOWN, pose_of
from palpate.core.plane.area_centroid import area_centroid

END_SHARE = 0.03
"""The first and the last slice lie this share of the height inside the ends."""
CAP_SHARE = 0.6
"""Touches from above lie at this share of the way from the middle to the top contour."""
CAP_TOUCHES = 4
"""Touches from above around the first one."""
CAP_TURNS = 12
"""Ways in which they are turned, of which the one is taken that reaches farthest."""
RETRY_SHIFT = 0.25
"""A slice that cannot be traced is tried once more this share of the spacing nearer to the
middle."""
APPROACH = 30.0e-3
"""The pad approaches a slice from this far outside the widest contour so far, m."""
ROUNDING = 1e-9
"""Of the height: stretches that are wider by less are not."""
CLEARANCE = 5e-3
"""Start of a touch from above over the highest point known, m."""


def slice_heights(bottom: float, top: float, count: int) -> list[float]:
    """Heights of evenly spaced slices: the middle one, those above it, those below it.

    Parameters
    ----------
    bottom, top : float
        Heights of the object's ends, m.
    count : int
        Number of slices.

    Raises
    ------
    ValueError
        If the top is not above the bottom, or there is no slice.
    """
    if not top > bottom:
        raise ValueError(f"the top must be above the bottom {bottom} m, got {top} m")
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    if count == 1:
        return [0.5 * (bottom + top)]
    share = np.linspace(END_SHARE, 1.0 - END_SHARE, count)
    heights: list[float] = (bottom + share * (top - bottom)).tolist()
    middle = count // 2
    return heights[middle:] + heights[:middle][::-1]


def retry_height(height: float, bottom: float, top: float, count: int) -> float:
    """Height at which to try again where a slice could not be traced, m."""
    spacing = (top - bottom) * (1.0 - 2.0 * END_SHARE) / max(count - 1, 1)
    towards = math.copysign(RETRY_SHIFT * spacing, 0.5 * (bottom + top) - height)
    return height + towards


def search_places(reach: float, pad_width: float) -> list[Floats]:
    """Places (2,) at which to look for the object from above, m: the axis, then rings around it.

    Neighbouring places are a pad's width apart, so that nothing wider is missed within reach.
    """
    places = [np.zeros(2)]
    for ring in range(1, int(reach / pad_width) + 1):
        azimuths = 2 * math.pi * np.arange(6 * ring) / (6 * ring)
        away = ring * pad_width
        places += [away * np.array([math.cos(a), math.sin(a)]) for a in azimuths]
    return places


def cap_places(contour: Floats, pad_width: float) -> list[Floats]:
    """Places (2,) for touches from above inside the top contour (n, 3), m.

    None where the contour is so small that the first touch has felt all of it.
    """
    middle = area_centroid(contour)
    away = contour[:, :2] - middle
    radius = np.linalg.norm(away, axis=1)
    if radius.mean() < 0.5 * pad_width:
        return []
    azimuth = np.arctan2(away[:, 1], away[:, 0])
    order = np.argsort(azimuth)
    around = 2 * math.pi * np.arange(CAP_TOUCHES) / CAP_TOUCHES
    turns = 2 * math.pi / CAP_TOUCHES * np.arange(CAP_TURNS)[:, None] / CAP_TURNS + around
    widths = np.interp(turns, azimuth[order], radius[order], period=2 * math.pi)
    best = int(widths.sum(axis=1).argmax())  # towards the corners, if there are any
    rim = np.column_stack([np.cos(turns[best]), np.sin(turns[best])]) * widths[best][:, None]
    return list(middle + CAP_SHARE * rim)


def from_above(place: Floats, height: float) -> Floats:
    """Pose (7,) of a pad over a place, looking down from a height."""
    return pose_of(np.array([place[0], place[1], height + CLEARANCE + PRESS]), DOWN)


def approach(
    height: float, heights: Sequence[float], contours: Sequence[Floats]
) -> tuple[Floats, float]:
    """Where the middle of a slice is expected, (2,), and from how far it is approached, m.

    Parameters
    ----------
    height : float
        Height of the slice, m.
    heights : sequence of float
        Heights of the contours traced so far, at least one, m.
    contours : sequence of (n, 3) arrays
        The contours, m.
    """
    nearest = int(np.argmin([abs(one - height) for one in heights]))
    middle = area_centroid(contours[nearest])
    widest = max(float(np.linalg.norm(points[:, :2] - middle, axis=1).max()) for points in contours)
    return middle, widest + APPROACH


def uncovered_height(bottom: float, top: float, count: int, traced: Sequence[float]) -> float:
    """Height in stretches without a contour, beyond the widest that was planned, m.

    Parameters
    ----------
    bottom, top : float
        Heights of the object's ends, m.
    count : int
        Number of slices that were planned.
    traced : sequence of float
        Heights of the contours that closed, m.
    """
    if not top > bottom:
        return 0.0
    widest = max(np.diff(sorted([bottom, top, *slice_heights(bottom, top, count)])))
    gaps = np.diff(sorted([bottom, top, *traced]))
    beyond = gaps - widest
    # Heights are measured: a stretch that differs in its last digit is as wide as was planned.
    return float(beyond[beyond > ROUNDING * (top - bottom)].sum())
