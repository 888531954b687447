"""Order around a section of points that were given in no order.

The order is by azimuth, or a short tour: nearest neighbours, improved by reversing parts (2-opt:
Croes, *A method for solving traveling-salesman problems*, 1958). An order is certain if it crosses
itself nowhere and turns no more than a section of as many points does: a tour through a cloud of
points turns at every point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.geometry import is_simple_ring, self_intersects, turn_between


@dataclass(frozen=True, slots=True)
class OrderingSettings:
    """How points of a section are put in order; tuned on shuffled sections of 4 to 600 points."""

    # Length in the order by azimuth over that of the tour; beyond it the tour is used.
    max_azimuth_ratio: float = 1.02
    max_tour_points: int = 1500  # beyond it the tour is not shortened; cost grows with the square
    max_sweeps: int = 30  # rounds of shortening
    min_gain: float = 1e-9  # fraction of the tour's length that a reversal must save
    max_length_ratio: float = 1.15  # given order over new order: beyond it points are in no order
    max_turning: float = 1.25  # [turns] in all, of an order of few points that is certain
    max_turn_per_point: float = np.radians(30.0)  # [rad], mean, of a certain order of many points
    # Points have an order if means of consecutive ones lie almost as far apart as they do. On a
    # circle means keep 0.95 of its width, with noise as without it.
    mean_share: float = 1.0 / 6.0  # of all points, in one mean
    min_mean_points: int = 3  # in one mean
    min_width: float = 0.6  # of the means, fraction of the section's width


DEFAULT_ORDERING = OrderingSettings()


class PointOrder(NamedTuple):
    """A closed polygon through points."""

    rows: Ints  # (n,): numbers of the points in their order
    by_azimuth: bool  # whether it is the order by azimuth; else it is a short tour


def order_points(points: Floats, settings: OrderingSettings = DEFAULT_ORDERING) -> PointOrder:
    """Order of points (n, 2) around one contour.

    By azimuth about the middle of their box, unless a tour from neighbour to neighbour is clearly
    shorter, as where the section is not star-shaped: then that tour.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = points - middle
    by_azimuth = np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable").astype(np.int32)
    if len(points) < 5:
        return PointOrder(by_azimuth, True)
    tour = _two_opt(points, _nearest_neighbour_tour(points), settings)
    if _length(points[by_azimuth]) <= settings.max_azimuth_ratio * _length(points[tour]):
        return PointOrder(by_azimuth, True)
    return PointOrder(tour, False)


def _two_opt(points: Floats, tour: Ints, settings: OrderingSettings) -> Ints:
    """The tour, shortened by reversing parts of it."""
    if len(tour) > settings.max_tour_points:
        return tour
    tour = tour.copy()
    min_gain = settings.min_gain * _length(points[tour])
    for _ in range(settings.max_sweeps):
        shorter = False
        for first in range(len(tour) - 2):
            shorter |= _reverse_best(points, tour, first, min_gain)
        if not shorter:
            break
    return tour


def _length(loop: Floats) -> float:
    return float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())


def _reverse_best(points: Floats, tour: Ints, first: int, min_gain: float) -> bool:
    """Reverse the part behind a place of the tour that gains most; False if none gains."""
    loop = points[tour]
    here, following = loop[first], loop[first + 1]
    ends, after = loop[first + 2 :], np.roll(loop, -1, axis=0)[first + 2 :]
    saved = np.linalg.norm(following - here) + np.linalg.norm(after - ends, axis=1)
    added = np.linalg.norm(ends - here, axis=1) + np.linalg.norm(after - following, axis=1)
    best = int(np.argmax(saved - added))
    if saved[best] - added[best] <= min_gain:
        return False
    tour[first + 1 : first + 3 + best] = tour[first + 1 : first + 3 + best][::-1].copy()
    return True


def _nearest_neighbour_tour(points: Floats) -> Ints:
    """From each point to the nearest remaining one, beginning at the largest x."""
    is_left = np.ones(len(points), bool)
    tour = np.empty(len(points), np.int32)
    here = int(np.argmax(points[:, 0]))
    for step in range(len(points)):
        tour[step], is_left[here] = here, False
        away = np.where(is_left, np.linalg.norm(points - points[here], axis=1), np.inf)
        here = int(np.argmin(away))
    return tour


class CheckedOrder(NamedTuple):
    """Whether points were given in order, and if not, their new order."""

    rows: Ints | None  # (n,): numbers in the new order; None if the given order is kept
    is_disordered: bool  # whether the given order is none, and no other one is certain


def checked_order(points: Floats, settings: OrderingSettings = DEFAULT_ORDERING) -> CheckedOrder:
    """Judge the order of points (n, 2) around a section, and put them in order if they have none.

    They have none if the polygon through them is clearly longer than the shortest tour, and not by
    noise alone.
    """
    first = np.sort(np.unique(points, axis=0, return_index=True)[1]).astype(np.int32)
    places = points[first]
    rows = order_points(places, settings).rows
    ordered = places[rows]
    if _length(points) <= settings.max_length_ratio * _length(ordered):
        return CheckedOrder(None, False)
    if _is_certain(ordered, settings):
        return CheckedOrder(first[rows], False)
    if not _goes_around(places, settings):
        return CheckedOrder(None, True)
    repeats = _length(points) > settings.max_length_ratio * _length(places)
    return CheckedOrder(first if repeats else None, False)


def _is_certain(loop: Floats, settings: OrderingSettings) -> bool:
    """Whether a closed polygon (n, 2) is simple, and turns no more than a section does."""
    ahead = np.roll(loop, -1, axis=0) - loop
    turning = float(np.abs(turn_between(ahead, np.roll(ahead, -1, axis=0))).sum())
    allowed = max(2.0 * np.pi * settings.max_turning, settings.max_turn_per_point * len(loop))
    return turning <= allowed and not self_intersects(loop)


def _goes_around(loop: Floats, settings: OrderingSettings) -> bool:
    """Whether a closed polygon (n, 2) goes around a section once, apart from noise.

    Means of consecutive points have little noise and stay around the section; means of points in no
    order lie near its middle, or near a line.
    """
    count = max(round(settings.mean_share * len(loop)), settings.min_mean_points)
    means = np.mean([np.roll(loop, by, axis=0) for by in range(count)], axis=0)
    width, kept = (
        np.linalg.svd(ring - ring.mean(axis=0), compute_uv=False) for ring in (loop, means)
    )
    return bool((kept >= settings.min_width * width).all()) and is_simple_ring(means)
