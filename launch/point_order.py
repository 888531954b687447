"""An order around a contour for points that have none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints

LONGER = 1.02
"""Times as long as the tour: a way around by azimuth zigzags, so the section is not star-shaped."""
MOST_IMPROVED = 1500
"""Points up to which a tour is shortened; its cost grows with their square."""
SWEEPS = 30
"""Most rounds of shortening."""
LEAST_GAIN = 1e-9
"""Of the tour's length."""


class Order(NamedTuple):
    """A closed way through points."""

    rows: Ints
    """(n,): the points in their order."""
    by_azimuth: bool
    """Whether it goes by azimuth about the middle; else it is a short tour."""


def order_points(points: Floats) -> Order:
    """The way around points (n, 2) of one contour.

    By azimuth about their middle where the section is star-shaped from there; else, or where a
    tour from neighbour to neighbour is clearly shorter, that tour.

    Notes
    -----
    The tour begins with nearest neighbours and is shortened by reversing parts of it: Croes, *A
    method for solving traveling-salesman problems*, 1958.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    away = points - middle
    by_azimuth = np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable").astype(np.int32)
    if len(points) < 5:
        return Order(by_azimuth, True)
    tour = _shortened(points, _neighbours(points))
    if _length(points[by_azimuth]) <= LONGER * _length(points[tour]):
        return Order(by_azimuth, True)
    return Order(tour, False)


def _length(loop: Floats) -> float:
    return float(np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).sum())


def _neighbours(points: Floats) -> Ints:
    """From each point to the nearest that is left, beginning at the one farthest right."""
    left = np.ones(len(points), bool)
    tour = np.empty(len(points), np.int32)
    here = int(np.argmax(points[:, 0]))
    for step in range(len(points)):
        tour[step], left[here] = here, False
        away = np.where(left, np.linalg.norm(points - points[here], axis=1), np.inf)
        here = int(np.argmin(away))
    return tour


def _shortened(points: Floats, tour: Ints) -> Ints:
    """The tour with parts reversed as long as that shortens it."""
    if len(tour) > MOST_IMPROVED:
        return tour
    tour = tour.copy()
    least = LEAST_GAIN * _length(points[tour])
    for _ in range(SWEEPS):
        shorter = False
        for first in range(len(tour) - 2):
            shorter |= _reverse_best(points, tour, first, least)
        if not shorter:
            break
    return tour


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
