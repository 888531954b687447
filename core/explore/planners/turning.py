"""On which side an object is set down next: the one that lets a finger touch most of what is open.

The solid as known may rest on several sides. Each is judged by the places that no finger reaches
as it lies now and that would face up, or sideways well above the platform, by what errors they may
hide: squared, as planners of touches weigh them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Bools
from palpate.core.explore.planners.surface import HIDDEN, ObservedSurface
from palpate.core.geometry import Rest, RestingSolid, rotation_between
from palpate.core.poses import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningSettings:
    """When an object is turned over, and on which side it is set down."""

    min_upward: float = -0.3  # upward part of the normals of what a finger reaches
    min_height: float = 8.0e-3  # [m] over the platform of what it reaches, unless it faces up
    facing_up: float = 0.7  # upward part of normals that face up
    min_gain: float = 0.1  # fraction of all squared errors that it must bring within reach
    near_best: float = 0.95  # of the largest gain: of such sides the most stable is taken
    min_thickness: float = (
        10.0e-3  # [m] upwards, as it will lie: a hand cannot feel thinner objects
    )
    max_rests: int = 200  # sides that are looked at, the most stable
    # Leaning by this when it is set down the object must still come to rest on that side [rad].
    lean: float = math.radians(6.0)


TURNING = TurningSettings()


def choose_turn(
    surface: ObservedSurface,
    tolerance: float,
    *,
    underside: bool,
    settings: TurningSettings = TURNING,
) -> Pose | None:
    """The motion that sets the object down on its best other side; None if none brings enough.

    `tolerance`: error that is asked for [m]. `underside`: whether what it has always stood on must
    be known, however small; else that counts for nothing. The motion is that of the object as it
    lies now.
    """
    if surface.platform is None or not len(surface.mesh.faces):
        return None
    places = surface.places
    hidden = np.square(np.maximum(places.bounds, HIDDEN.unknown_slope * places.distances))
    total = float(np.maximum(hidden, tolerance**2).sum())
    hidden[surface.reached | (hidden < tolerance**2)] = 0.0
    least = settings.min_gain * total
    if underside and places.flat.any():
        # It comes first: each place of it counts more than all others together.
        least, hidden = 1.0, np.where(places.flat, 2.0, hidden / total)
    elif not underside:
        hidden[places.flat] = 0.0
    resting = RestingSolid(surface.mesh.vertices, surface.mesh.faces)
    upright = [one for one in resting.rests if _thickness(resting, one) > settings.min_thickness]
    rests = upright[: settings.max_rests]
    gains = np.array(
        [hidden[_within_reach(surface, resting, one, settings)].sum() for one in rests]
    )
    while len(rests) and gains.max() > least:
        near_best = np.flatnonzero(gains >= settings.near_best * gains.max())
        best = rests[int(near_best[0])]  # the most stable
        if resting.is_firm(best, settings.lean):
            return _set_down(resting, best, surface.platform)
        gains[near_best[0]] = 0.0
    return None


def _thickness(resting: RestingSolid, rest: Rest) -> float:
    return float(np.ptp(resting.hull @ rest.down))


def _within_reach(
    surface: ObservedSurface, resting: RestingSolid, rest: Rest, settings: TurningSettings
) -> Bools:
    """Which places (n,) a finger is expected to reach when the object lies on a side."""
    places = surface.places
    upward = -places.normals @ rest.down
    height = float((resting.hull @ rest.down).max()) - places.points @ rest.down
    high = (height > settings.min_height) | (upward > settings.facing_up)
    return np.asarray((upward > settings.min_upward) & high)


def _set_down(resting: RestingSolid, rest: Rest, platform: float) -> Pose:
    """The motion onto a side by the smallest angle, with the centre of mass on the upright axis."""
    axes = rotation_between(rest.down, np.array([0.0, 0.0, -1.0]))
    x, y, _ = axes @ resting.centre
    lowest = float((resting.hull @ axes[2]).min())
    return Pose(np.array([-x, -y, platform - lowest]), axes)
