"""How single touches of a solid can be made: free approaches to its worst places.

Places with the largest expected error are approached along their normals and along directions about
them. Rays from the face of the pad show what a touch would meet there, and whether the finger, a
prism behind the pad, is free on its path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.explore.planners.hollows import approach_directions, pad_width
from palpate.core.geometry import point_tree
from palpate.core.poses import Pose
from palpate.core.touch import Pad

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from palpate.core.explore.planners.surface import ObservedSurface

MAX_RANGE = 1.0  # [m] at which rays end that meet nothing
MAX_ROUNDING = 1e-9  # [1] parts of unit vectors that are smaller are 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachSettings:
    """Which places are approached, from where, and what must be free."""

    n_places: int = 32  # worst places, which are approached
    spacing: float = 0.75  # [widths of the pad] between two of these
    normal_radius: float = 0.2  # [widths of the pad] over which normals are averaged
    known_radius: float = 0.33  # [widths of the pad] around a contact that are known afterwards
    n_rays: int = 6  # along each side of the pad's face
    contact_depth: float = 1.0e-3  # [m] behind the first contact, up to which the pad touches too
    finger_length: float = 10.0e-3  # [m] behind the pad's face that must be free
    min_start: float = 4.0e-3  # [m] of the pad's face over the expected contact
    max_start: float = 20.0e-3  # [m] the same, at most
    n_deviations: float = 3.0  # [expected error of the place] that is added to `min_start`
    # [m] beyond the expected contact, before a touch is given up. Between these limits it is the
    # distance of the place from the nearest touch: an untouched hollow may be as deep.
    min_overshoot: float = 8.0e-3
    max_overshoot: float = 50.0e-3
    clearance: float = 1.0e-3  # [m] of the finger from the pedestal


class TouchOffer(NamedTuple):
    """A touch that can be made."""

    pose: Pose  # from which the pad moves along its z axis, world frame
    reach: float  # [m] longest distance that it moves
    target: Floats  # (3,) [m] where the surface is expected
    places: Ints  # (k,) numbers of the places that are known afterwards


def touch_offers(surface: ObservedSurface) -> list[TouchOffer]:
    """Touches that can be made where errors are largest, the largest first."""
    places, width, settings = surface.places, pad_width(surface.pad), surface.settings.approaches
    tree = point_tree(places.points)
    offers: list[TouchOffer] = []
    for number in _worst(surface, tree, width, settings):
        about = tree.query_ball_point(places.points[number], settings.normal_radius * width)
        normal = places.normals[about].mean(axis=0)
        offer = _best_approach(surface, tree, number, normal)
        if offer is not None:
            offers.append(offer)
    return offers


def _worst(
    surface: ObservedSurface, tree: cKDTree, width: float, settings: ApproachSettings
) -> list[int]:
    """Places at which the squared errors about them are largest, from the largest on."""
    places, squares = surface.places, surface.squares
    first, second = tree.query_pairs(settings.known_radius * width, output_type="ndarray").T
    sums = (
        squares
        + np.bincount(first, squares[second], len(squares))
        + np.bincount(second, squares[first], len(squares))
    )
    sums[squares == 0.0] = 0.0
    chosen: list[int] = []
    while len(chosen) < settings.n_places and sums.max(initial=0.0) > 0.0:
        chosen.append(int(sums.argmax()))
        sums[tree.query_ball_point(places.points[chosen[-1]], settings.spacing * width)] = 0.0
    return chosen


def _best_approach(
    surface: ObservedSurface,
    tree: cKDTree,
    number: int,
    normal: Floats,
) -> TouchOffer | None:
    """The approach of a place by which most of the squared errors are met; None if none is free."""
    best, best_gain = None, 0.0
    length = float(np.linalg.norm(normal))
    if not length > 0.0:
        return None
    for tilt, outward in approach_directions(normal / length, surface.settings.hollows):
        offer = _approach(surface, tree, number, outward, surface.settings.approaches)
        if offer is None:
            continue
        gain = float(surface.squares[offer.places].sum())
        if gain > best_gain:
            best, best_gain = offer, gain
        if tilt == 0.0 and best is not None and number in best.places:
            break  # straight on is best where it is free
    return best


def _approach(
    surface: ObservedSurface,
    tree: cKDTree,
    number: int,
    outward: Floats,
    settings: ApproachSettings,
) -> TouchOffer | None:
    """A touch of a place out of a direction; None where finger or start are not free."""
    places, pad = surface.places, surface.pad
    axes = pad_axes(-outward)
    target = places.points[number]
    error = settings.n_deviations * float(places.errors[number])
    start = min(max(settings.min_start, error + settings.min_start), settings.max_start)
    face = _face(pad, settings.n_rays) @ axes.T
    origin = start + 2.0 * settings.min_start + settings.finger_length
    ranges = surface.shape.cast(target + origin * outward + face, -outward, MAX_RANGE)
    nearest = float(ranges.min())
    if nearest < start + settings.finger_length:  # it would meet something, or begin inside
        return None
    if nearest > origin + settings.min_overshoot:
        return None
    distance = places.distances[number]
    overshoot = float(np.clip(distance, settings.min_overshoot, settings.max_overshoot))
    is_met = ranges <= nearest + settings.contact_depth
    points = target + origin * outward + face[is_met] - ranges[is_met, None] * outward
    near = tree.query_ball_point(points, settings.known_radius * pad_width(pad))
    known = np.unique(np.concatenate(near))
    contact = target + (origin - nearest) * outward
    begin = contact + start * outward
    if math.hypot(*begin[:2]) > surface.reach:
        return None
    length = start + settings.finger_length
    if _meets_pedestal(surface.pedestal, contact, axes, pad, length, settings.clearance):
        return None
    return TouchOffer(
        Pose(begin, axes), start + overshoot, points.mean(axis=0), known.astype(np.int32)
    )


def _meets_pedestal(
    standing: Floats, contact: Floats, axes: Floats, pad: Pad, length: float, clearance: float
) -> bool:
    """Whether a finger at a contact meets what lies straight below places (n, 3).

    `axes` (3, 3): of its pad, as columns. `length`: of the finger behind the pad's face [m].
    `clearance`: of the finger from the pedestal [m].
    """
    half = 0.5 * pad_width(pad) + clearance
    limits = np.array([[-half, half], [-half, half], [-length, -clearance]])
    down = -axes[2]
    down = np.where(np.abs(down) < MAX_ROUNDING, MAX_ROUNDING, down)
    crossed = (limits - ((standing - contact) @ axes)[..., None]) / down[:, None]  # m downwards
    begin, end = crossed.min(axis=2).max(axis=1), crossed.max(axis=2).min(axis=1)
    return bool((np.maximum(begin, 0.0) < end).any())


def pad_axes(inward: Floats, min_level: float = 0.05) -> Floats:
    """Axes (3, 3) of a pad that moves along a unit direction (3,), its x axis level.

    Where the direction's level part is shorter than `min_level`, the y axis is level instead.
    """
    x, y, z = inward.tolist()  # written out: numpy's cross product is slow for one vector
    level = (-y, x, 0.0) if math.hypot(x, y) >= min_level else (z, 0.0, -x)
    length = math.hypot(*level)
    a, b, c = (part / length for part in level)
    return np.array([[a, y * c - z * b, x], [b, z * a - x * c, y], [c, x * b - y * a, z]])


@lru_cache(maxsize=8)
def _face(pad: Pad, n_rays: int) -> Floats:
    """Places (n_rays**2, 3) of the pad's face, in its own frame [m]."""
    half = 0.5 * pad_width(pad)
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-half, half, n_rays)] * 2))
    sag = 0.5 * pad.dome * (x**2 + y**2)
    face = np.column_stack([x, y, -sag])
    face.setflags(write=False)
    return face
