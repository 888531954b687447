"""How single touches of a solid can be made: free approaches to its worst places.

Places with the largest expected error are approached along their normals and along directions about
them; rays from the face of the pad tell what a touch would meet there, and whether the finger, a
prism behind the pad, is free on its way.
"""

from __future__ import annotations

import math
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

TRIED = 32  # Places to which touches are tried: the worst, not too close together
APART = 0.75  # Widths of the pad between two of these
RAYS = 6  # Along each side of the pad's face
NEAR = 0.33  # Of the pad's width: what lies so near to a contact is known afterwards
BODY = 10.0e-3  # Length of the finger behind the pad's face that must be free, m
LEAST_START, MOST_START = 4.0e-3, 20.0e-3  # Of the face over the place where it is expected, m
DEVIATIONS = 3.0  # Expected errors that a start lies farther off
# Way beyond the expected contact before a touch is given up, m: the distance from touch, within
# these, for so deep may be what nothing was touched of.
BEYOND, MOST_BEYOND = 8.0e-3, 50.0e-3
CLEARANCE = 1.0e-3  # Of the finger from the pedestal, m
SAME = 1e-9  # Targets that differ by less are one, m
FAR = 1.0  # Rays that meet nothing end here, m


class TouchOffer(NamedTuple):
    """A touch that can be made."""

    pose: Pose  # From which the pad moves along its z axis, world frame
    reach: float  # Longest way, m
    target: Floats  # Where the surface is expected, (3,), m
    places: Ints  # Numbers of the places that are known afterwards


def touch_offers(surface: ObservedSurface) -> list[TouchOffer]:
    """Touches that can be made where errors are largest, the largest first."""
    places, width = surface.places, pad_width(surface.pad)
    tree = point_tree(places.points)
    found: list[TouchOffer] = []
    for number in _worst(surface, tree, width):
        normal = places.normals[tree.query_ball_point(places.points[number], 0.2 * width)].mean(
            axis=0
        )
        offer = _best_approach(surface, tree, number, normal)
        if offer is not None:
            found.append(offer)
    return found


def _worst(surface: ObservedSurface, tree: cKDTree, width: float) -> list[int]:
    """Places at which the squared errors about them are largest, from the largest on."""
    places, worth = surface.places, surface.squares
    one, other = tree.query_pairs(NEAR * width, output_type="ndarray").T
    sums = (
        worth
        + np.bincount(one, worth[other], len(worth))
        + np.bincount(other, worth[one], len(worth))
    )
    sums[worth == 0.0] = 0.0
    chosen: list[int] = []
    while len(chosen) < TRIED and sums.max(initial=0.0) > 0.0:
        chosen.append(int(sums.argmax()))
        sums[tree.query_ball_point(places.points[chosen[-1]], APART * width)] = 0.0
    return chosen


def _best_approach(
    surface: ObservedSurface, tree: cKDTree, number: int, normal: Floats
) -> TouchOffer | None:
    """The approach of a place by which most of the squared errors are met; None if none is free."""
    left = surface.squares
    best, most = None, 0.0
    length = float(np.linalg.norm(normal))
    if not length > 0.0:
        return None
    for tilt, outward in approach_directions(normal / length):
        offer = _approach(surface, tree, number, outward)
        if offer is None:
            continue
        worth = float(left[offer.places].sum())
        if worth > most:
            best, most = offer, worth
        if tilt == 0.0 and best is not None and number in best.places:
            break  # straight on is best where it is free
    return best


def _approach(
    surface: ObservedSurface, tree: cKDTree, number: int, outward: Floats
) -> TouchOffer | None:
    """A touch of a place out of a direction; None where finger or start are not free."""
    places, pad = surface.places, surface.pad
    axes = pad_axes(-outward)
    target = places.points[number]
    start = min(
        max(LEAST_START, DEVIATIONS * float(places.errors[number]) + LEAST_START), MOST_START
    )
    face = _face(pad) @ axes.T
    away = start + 2.0 * LEAST_START + BODY
    ranges = surface.shape.cast(target + away * outward + face, -outward, FAR)
    nearest = float(ranges.min())
    if nearest < start + BODY:  # the finger would meet something, or begin inside
        return None
    if nearest > away + BEYOND:
        return None
    beyond = float(np.clip(places.distances[number], BEYOND, MOST_BEYOND))
    met = ranges <= nearest + 1.0e-3
    points = target + away * outward + face[met] - ranges[met, None] * outward
    known = np.unique(np.concatenate(tree.query_ball_point(points, NEAR * pad_width(pad))))
    contact = target + (away - nearest) * outward
    begin = contact + start * outward
    if math.hypot(*begin[:2]) > surface.reach:
        return None
    if _meets_pedestal(surface.pedestal, contact, axes, pad, start + BODY):
        return None
    return TouchOffer(
        Pose(begin, axes), start + beyond, points.mean(axis=0), known.astype(np.int32)
    )


def _meets_pedestal(
    standing: Floats, contact: Floats, axes: Floats, pad: Pad, length: float
) -> bool:
    """Whether a finger at a contact meets what lies straight below places (n, 3).

    `axes` (3, 3): of its pad, as columns. `length`: of the finger behind the pad's face, m.
    """
    half = 0.5 * pad_width(pad) + CLEARANCE
    limits = np.array([[-half, half], [-half, half], [-length, -CLEARANCE]])
    down = -axes[2]
    down = np.where(np.abs(down) < SAME, SAME, down)
    crossed = (limits - ((standing - contact) @ axes)[..., None]) / down[:, None]  # m downwards
    begin, end = crossed.min(axis=2).max(axis=1), crossed.max(axis=2).min(axis=1)
    return bool((np.maximum(begin, 0.0) < end).any())


def pad_axes(inward: Floats) -> Floats:
    """Axes (3, 3) of a pad that moves along a direction, its x axis level."""
    x, y, z = inward.tolist()  # Written out: numpy's cross product is slow for one vector
    level = (-y, x, 0.0) if math.hypot(x, y) >= 0.05 else (z, 0.0, -x)
    length = math.hypot(*level)
    a, b, c = (part / length for part in level)
    return np.array([[a, y * c - z * b, x], [b, z * a - x * c, y], [c, x * b - y * a, z]])


@lru_cache(maxsize=8)
def _face(pad: Pad) -> Floats:
    """Places (n, 3) of the pad's face, in its own frame, m."""
    half = 0.5 * pad_width(pad)
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-half, half, RAYS)] * 2))
    sag = 0.5 * pad.dome * (x**2 + y**2)
    face = np.column_stack([x, y, -sag])
    face.setflags(write=False)
    return face
