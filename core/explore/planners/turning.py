"""On which side an object is set down next: where a finger can touch most of what is unknown.

The known solid can rest on several sides. The gain of a side is the sum of the squared errors that
places may hide, as in planners of touches: over the places that no finger reaches as the object
lies now, and that would then face up, or sideways well above the platform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Bools
from palpate.core.explore.planners.surface import ObservedSurface
from palpate.core.geometry import Rest, RestingSolid, rotation_between
from palpate.core.poses import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningSettings:
    """When an object is turned over, and on which side it is set down."""

    min_upward: float = -0.3  # z part of a normal, above which a finger reaches the place
    min_height: float = 8.0e-3  # [m] over the platform, above which a finger reaches the place
    facing_up: float = 0.7  # z part of a normal, above which the place may also lie lower
    min_gain: float = 0.1  # fraction of all squared errors that a turn brings within reach
    near_best: float = 0.95  # fraction of the largest gain; the most stable such side is taken
    # [m] upwards, as it will lie: a hand cannot feel thinner objects.
    min_thickness: float = 10.0e-3
    max_rests: int = 200  # most stable sides whose gain is computed
    # [rad] lean at which the object is set down and must still come to rest on that side.
    lean: float = math.radians(6.0)


def choose_turn(
    surface: ObservedSurface,
    tolerance: float,
    *,
    underside: bool,
    settings: TurningSettings = TurningSettings(),
) -> Pose | None:
    """The motion that sets the object down on its best other side; None if none brings enough.

    `tolerance`: error that is asked for [m]. `underside`: whether the underside of the first pose
    must be touched, however small it is; if not, it adds nothing to a gain. The motion starts from
    the object's present pose.
    """
    if surface.platform is None or not len(surface.mesh.faces):
        return None
    places = surface.places
    hidden = surface.settings.hidden.unknown_slope * places.distances
    hidden = np.square(np.maximum(places.bounds, hidden))
    total = float(np.maximum(hidden, tolerance**2).sum())
    hidden[surface.reached | (hidden < tolerance**2)] = 0.0
    least = settings.min_gain * total
    if underside and places.flat.any():
        # The underside comes first: each place of it counts more than all others together.
        least, hidden = 1.0, np.where(places.flat, 2.0, hidden / total)
    elif not underside:
        hidden[places.flat] = 0.0
    resting = RestingSolid(surface.mesh.vertices, surface.mesh.faces)
    thick = [rest for rest in resting.rests if _thickness(resting, rest) > settings.min_thickness]
    rests = thick[: settings.max_rests]
    gains = np.array(
        [hidden[_within_reach(surface, resting, rest, settings)].sum() for rest in rests]
    )
    while len(rests) and gains.max() > least:
        near_best = np.flatnonzero(gains >= settings.near_best * gains.max())
        best = rests[int(near_best[0])]  # the most stable
        if resting.is_firm(best, settings.lean):
            return _set_down(resting, best, surface.platform)
        gains[near_best[0]] = 0.0
    return None


def _thickness(resting: RestingSolid, rest: Rest) -> float:
    """Height of the object [m] when it lies on a side."""
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
