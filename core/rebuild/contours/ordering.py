"""The way around a section through points that were given in no order.

By azimuth, or by a short tour: nearest neighbours, improved by reversing parts (Croes, *A method
for solving traveling-salesman problems*, 1958). An order is safe if it crosses itself nowhere and
turns no more than a section of so many points does: a tour through a cloud turns at every point.
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

    azimuth_tolerance: float = 1.02  # fraction of the tour: a longer way by azimuth is not taken
    max_tour_points: int = 1500  # beyond it the tour is not shortened; cost grows with the square
    max_sweeps: int = 30  # rounds of shortening
    min_gain: float = 1e-9  # fraction of the tour's length
    max_length_ratio: float = 1.15  # of the given order over the tour: beyond it there is no order
    max_turning: float = 1.25  # turns of a short section that is safe, of any number of points
    max_turn_per_point: float = np.radians(30.0)  # [rad], mean, of a safe order of many points
    mean_share: float = 1.0 / 6.0  # of the points, in a row, whose means tell noise from disorder
    min_mean_points: int = 3  # as many at least
    min_width: float = 0.6  # of the section's own, that their means keep: a circle's keep 0.95


DEFAULT_ORDERING = OrderingSettings()


class PointOrder(NamedTuple):
    """A closed way through points."""

    rows: Ints  # (n,): the points in their order
    by_azimuth: bool  # Whether it goes by azimuth about the middle; else it is a short tour


def order_points(points: Floats, settings: OrderingSettings = DEFAULT_ORDERING) -> PointOrder:
    """The way around points (n, 2) of one contour.

    By azimuth about their middle where the section is star-shaped from there; else, or where a tour
    from neighbour to neighbour is clearly shorter, that tour.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = points - middle
    by_azimuth = np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable").astype(np.int32)
    if len(points) < 5:
        return PointOrder(by_azimuth, True)
    tour = _two_opt(points, _nearest_neighbour_tour(points), settings)
    if _length(points[by_azimuth]) <= settings.azimuth_tolerance * _length(points[tour]):
        return PointOrder(by_azimuth, True)
    return PointOrder(tour, False)


def _two_opt(points: Floats, tour: Ints, settings: OrderingSettings) -> Ints:
    """The tour with parts reversed as long as that shortens it."""
    if len(tour) > settings.max_tour_points:
        return tour
    tour = tour.copy()
    least = settings.min_gain * _length(points[tour])
    for _ in range(settings.max_sweeps):
        shorter = False
        for first in range(len(tour) - 2):
            shorter |= _reverse_best(points, tour, first, least)
        if not shorter:
            break
    return tour


def _length(loop: Floats) -> float:
    return float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())


def _reverse_best(points: Floats, tour: Ints, first: int, least: float) -> bool:
    """Cut behind a place of the tour and where it gains most, and reverse what lies between."""
    loop = points[tour]
    here, following = loop[first], loop[first + 1]
    ends, after = loop[first + 2 :], np.roll(loop, -1, axis=0)[first + 2 :]
    saved = np.linalg.norm(following - here) + np.linalg.norm(after - ends, axis=1)
    spent = np.linalg.norm(ends - here, axis=1) + np.linalg.norm(after - following, axis=1)
    best = int(np.argmax(saved - spent))
    if saved[best] - spent[best] <= least:
        return False
    tour[first + 1 : first + 3 + best] = tour[first + 1 : first + 3 + best][::-1].copy()
    return True


def _nearest_neighbour_tour(points: Floats) -> Ints:
    """From each point to the nearest that is left, beginning at the one farthest right."""
    left = np.ones(len(points), bool)
    tour = np.empty(len(points), np.int32)
    here = int(np.argmax(points[:, 0]))
    for step in range(len(points)):
        tour[step], left[here] = here, False
        away = np.where(left, np.linalg.norm(points - points[here], axis=1), np.inf)
        here = int(np.argmin(away))
    return tour


class FoundOrder(NamedTuple):
    """Whether points were given in order, and else in which order they are used."""

    rows: Ints | None  # (n,): their order; None if they were given in one, or none is safe
    disordered: bool  # They were given in no order, and none is safe


def found_order(points: Floats, settings: OrderingSettings = DEFAULT_ORDERING) -> FoundOrder:
    """Judge the order of points (n, 2) around a section, and put them in order if they have none.

    They have none if the way through them is clearly longer than the shortest that is found, and
    not for noise alone.
    """
    first = np.sort(np.unique(points, axis=0, return_index=True)[1]).astype(np.int32)
    places = points[first]
    rows = order_points(places, settings).rows
    ordered = places[rows]
    if _length(points) <= settings.max_length_ratio * _length(ordered):
        return FoundOrder(None, False)
    if _is_safe(ordered, settings):
        return FoundOrder(first[rows], False)
    if not _goes_around(places, settings):
        return FoundOrder(None, True)
    repeats = _length(points) > settings.max_length_ratio * _length(places)
    return FoundOrder(first if repeats else None, False)


def _is_safe(loop: Floats, settings: OrderingSettings) -> bool:
    """Whether a closed polygon (n, 2) is simple, and turns as a section does."""
    ahead = np.roll(loop, -1, axis=0) - loop
    turning = float(np.abs(turn_between(ahead, np.roll(ahead, -1, axis=0))).sum())
    allowed = max(2.0 * np.pi * settings.max_turning, settings.max_turn_per_point * len(loop))
    return turning <= allowed and not self_intersects(loop)


def _goes_around(loop: Floats, settings: OrderingSettings) -> bool:
    """Whether a closed polygon (n, 2) goes around a section once, noise apart.

    Means of points in a row lose the noise and stay around the section, where points in no order
    have means near its middle, or near a line.
    """
    count = max(round(settings.mean_share * len(loop)), settings.min_mean_points)
    means = np.mean([np.roll(loop, by, axis=0) for by in range(count)], axis=0)
    wide, kept = (np.linalg.svd(one - one.mean(axis=0), compute_uv=False) for one in (loop, means))
    return bool((kept >= settings.min_width * wide).all()) and is_simple_ring(means)
