"""Contours seen from a point.

Matched by azimuth, angles between directions, where one is seen whole.

`radial_match` is the match of Fung, 1999, 4.2, step 5, kept for comparison; `azimuth_match`
gives one where a ray meets the contour several times or not at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from palpate.core.arrays import Floats, Ints, finite_array
from palpate.core.geometry.polygons import closed_polygon

# How much of the length's even pace is mixed in where the azimuth does not always rise.
LENGTH_SHARE = 0.1
# Of the polygon's size: a place that sees it whole lies at least so far behind each edge.
DEEP = 1e-3


class AzimuthMatch(NamedTuple):
    """Which places on a contour belong to azimuths."""

    points: Floats  # (k, 2), m
    # (k,): the share of the contour's length from its first vertex on, from 0 to 1. Azimuths that
    # rise by less than a turn give turns that do as well, but for the seam.
    turns: Floats
    # Each ray from the middle meets the contour once: the match is exactly the radial one.
    one_to_one: bool
    # The contour goes once round the middle, counter-clockwise. If not, the azimuth says nothing,
    # and the match is by length alone.
    inside: bool


def azimuth_match(polygon: Floats, middle: Floats, azimuths: Floats) -> AzimuthMatch:
    """Match a contour to azimuths about a middle.

    `polygon` (n, 2): closed, fine, counter-clockwise, m. `middle` (2,): from where azimuths are
    taken, m. `azimuths` (k,), rad. Raises ValueError if the polygon has fewer than 3 vertices, or
    anything is not finite.

    Along a concave contour the azimuth rises, falls back, and rises again; a ray then meets
    it several times. Here the azimuth is replaced by the middle between the largest one so
    far and the least one still to come, which never falls.
    """
    polygon = closed_polygon(polygon, least=3)
    middle = finite_array("middle", middle, (2,))
    azimuths = finite_array("azimuths", azimuths, (None,))
    around = np.vstack([polygon, polygon[:1]])
    lengths = np.linalg.norm(np.diff(around, axis=0), axis=1)
    turns = np.concatenate([[0.0], np.cumsum(lengths)])
    turns /= turns[-1] if turns[-1] > 0.0 else 1.0
    away = around - middle
    rises = turn_between(away[:-1], away[1:])
    azimuth = np.arctan2(away[0, 1], away[0, 0]) + np.concatenate([[0.0], np.cumsum(rises)])
    inside = bool(abs(float(rises.sum()) - 2.0 * np.pi) < 1.0)
    one_to_one = inside and bool((rises > 0.0).all())
    pace = _rising(azimuth) if inside else azimuth
    even = 2.0 * np.pi * turns
    # The even pace is begun where it is nearest to the azimuth all around.
    ahead = pace[:-1] - even[:-1]
    even += np.arctan2((lengths * np.sin(ahead)).sum(), (lengths * np.cos(ahead)).sum())
    if not inside:
        pace = even
    elif not one_to_one:
        even += 2.0 * np.pi * np.round((pace - even).mean() / (2.0 * np.pi))
        pace = (1.0 - LENGTH_SHARE) * pace + LENGTH_SHARE * even
    places = np.interp(pace[0] + np.mod(azimuths - pace[0], 2.0 * np.pi), pace, turns)
    points = np.column_stack([np.interp(places, turns, around[:, axis]) for axis in (0, 1)])
    return AzimuthMatch(points, places, one_to_one, inside)


def _rising(azimuth: Floats) -> Floats:
    """The middle of the largest azimuth so far and the least to come, around the seam as well."""
    turn = azimuth[:-1]
    wound = np.concatenate([turn - 2.0 * np.pi, turn, turn + 2.0 * np.pi, azimuth[-1:] + 2 * np.pi])
    so_far = np.maximum.accumulate(wound)
    to_come = np.minimum.accumulate(wound[::-1])[::-1]
    return 0.5 * (so_far + to_come)[len(turn) : 2 * len(turn) + 1]


class RadialMatch(NamedTuple):
    """Where rays meet a contour."""

    points: Floats  # (k, 2): the farthest meeting of each ray, m; the middle where there is none
    meetings: Ints  # (k,): how many there are. Only where all are 1 is the match one to one.


def radial_match(polygon: Floats, middle: Floats, azimuths: Floats) -> RadialMatch:
    """Points of a closed polygon (n, 2) on rays from a middle (2,), m, at azimuths (k,), rad.

    Kept for comparison; `azimuth_match` gives a match where a ray meets the contour several
    times or not at all.

    Raises ValueError if the polygon has no vertex, or something is not finite or of another shape.
    """
    polygon, middle = closed_polygon(polygon), finite_array("middle", middle, (2,))
    azimuths = finite_array("azimuths", azimuths, (None,))
    starts = polygon - middle
    ends = np.roll(starts, -1, axis=0)
    rays = np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    # Left of the ray (or on it) to right of it and back: each meeting counts once.
    first = rays[:, :1] * starts[:, 1] - rays[:, 1:] * starts[:, 0]
    second = rays[:, :1] * ends[:, 1] - rays[:, 1:] * ends[:, 0]
    crossing = (first >= 0.0) != (second >= 0.0)
    share = np.divide(first, first - second, out=np.zeros_like(first), where=crossing)
    along = rays @ starts.T + share * (rays @ (ends - starts).T)
    met = crossing & (along > 0.0)
    farthest = np.where(met, along, 0.0).max(axis=1)
    return RadialMatch(middle + farthest[:, None] * rays, met.sum(axis=1).astype(np.int32))


def kernel_point(polygon: Floats) -> Floats | None:
    """The place (2,) deepest behind all edges of a polygon, m; None if none sees it whole.

    `polygon` (n, 2): counter-clockwise, finite, m.

    The edges' half planes have the kernel in common (Lee and Preparata, *An optimal algorithm for
    finding the kernel of a polygon*, 1979); here a linear programme finds the middle of the
    largest disc in it.
    """
    from scipy.optimize import linprog

    middle = polygon.mean(axis=0)
    size = float(np.abs(polygon - middle).max())
    if not size > 0.0:
        return None
    corners = (polygon - middle) / size
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    corners, edges = corners[lengths > 0.0], edges[lengths > 0.0]
    outward = np.column_stack([edges[:, 1], -edges[:, 0]]) / lengths[lengths > 0.0, None]
    behind = np.einsum("ni,ni->n", outward, corners)
    rows = np.column_stack([outward, np.ones(len(outward))])
    bounds = [(-1.0, 1.0), (-1.0, 1.0), (DEEP, 2.0)]
    found = linprog([0.0, 0.0, -1.0], A_ub=rows, b_ub=behind, bounds=bounds)
    if found.x is None:
        return None
    place: Floats = middle + size * found.x[:2]
    return place


def angle_between(first: Floats, second: Floats) -> Floats:
    """Angle (...) from 0 to pi between directions (..., 2) or (..., 3), rad.

    By the arc tangent of cross and scalar product: an arc cosine knows nothing of angles
    below 1e-8. A direction of length 0 is taken to lie along any other.

    Raises ValueError if a direction is not finite (..., 2) or (..., 3).
    """
    first, second = _scaled("first", first, (2, 3)), _scaled("second", second, (2, 3))
    along = np.einsum("...d,...d->...", first, second)
    if first.shape[-1] == 2:
        across = np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    else:
        across = np.linalg.norm(np.cross(first, second), axis=-1)
    angle: Floats = np.arctan2(across, along)
    return angle


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle (...) above -pi and up to pi from one plane direction (..., 2) to another, rad.

    Positive counter-clockwise; made as `angle_between` makes its.

    Raises ValueError if a direction is not finite (..., 2).
    """
    first, second = _scaled("first", first, (2,)), _scaled("second", second, (2,))
    along = np.einsum("...d,...d->...", first, second)
    across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    turn: Floats = np.arctan2(across + 0.0, along)  # of -0 it would be -pi
    return turn


def _scaled(name: str, direction: ArrayLike, sizes: tuple[int, ...]) -> Floats:
    """The direction with a largest coordinate of 1, so that no product leaves the range."""
    direction = np.asarray(direction, np.float64)
    if not direction.ndim or direction.shape[-1] not in sizes:
        wanted = " or ".join(f"(..., {size})" for size in sizes)
        raise ValueError(f"{name} must have shape {wanted}, got {direction.shape}")
    if not np.isfinite(direction).all():
        raise ValueError(f"{name} must be finite")
    largest = np.abs(direction).max(axis=-1, keepdims=True)
    return direction / np.where(largest > 0.0, largest, 1.0)
