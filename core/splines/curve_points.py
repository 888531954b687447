"""Points of a closed curve, in an order and a scale that do not depend on how they were given."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats, Ints

SAME = 1e-12
"""Points nearer to each other, as a share of the curve's size, are one."""
ROUNDING = 64 * float(np.finfo(float).eps)
"""Of the coordinates: points that spread no farther are one, told apart by rounding."""
LARGEST = float(np.finfo(float).max)


class Ring(NamedTuple):
    """Points around a closed curve, each different from the next."""

    points: Floats
    """(m, d), about the middle and over the size, so that all lie within 1/2 of 0."""
    rows: Ints
    """(m,): which of the given points they are."""
    middle: Floats
    """(d,), m."""
    size: float
    """Longest side of the box around the points, m; 0 where they are one point."""
    dropped: int
    """Rows that were not finite."""


def order_points(points: Floats) -> Ring:
    """Drop what is not finite or comes twice, centre, scale, and put in order.

    Parameters
    ----------
    points : (m, d) array
        In 2 or 3 dimensions, m. The first may come again at the end.

    Returns
    -------
    Ring
        From the point that comes last in alphabetical order, counter-clockwise (seen along
        that axis from which the curve is broadest). The same points, begun anywhere and
        listed in either direction, give the same ring to the last bit.

    Raises
    ------
    ValueError
        If no row is finite, or they spread farther than a number can say.
    """
    rows = np.flatnonzero(np.isfinite(points).all(axis=1)).astype(np.int32)
    dropped = len(points) - len(rows)
    if not len(rows):
        raise ValueError(f"points must have at least one finite row, got {len(points)} rows")
    found = points[rows]
    low, high = found.min(axis=0), found.max(axis=0)
    # The middle of the box: a mean would round differently in another order.
    middle = 0.5 * low + 0.5 * high
    size = 2.0 * float(np.max(0.5 * high - 0.5 * low))
    if size == np.inf:
        raise ValueError(f"points must spread less than {LARGEST:g} m, got {low} to {high} m")
    if size <= ROUNDING * float(np.abs(found).max()):
        return Ring(np.zeros((1, points.shape[1])), rows[:1], middle, 0.0, dropped)
    scaled = (found - middle) / size
    order = np.flatnonzero((scaled != np.roll(scaled, 1, axis=0)).any(axis=1))
    order = order[_canonical(scaled[order])]
    ahead = np.linalg.norm(scaled[order] - np.roll(scaled[order], -1, axis=0), axis=1)
    order = order[ahead > SAME]
    return Ring(scaled[order], rows[order], middle, size, dropped)


def area_vector(points: Floats) -> Floats:
    """Normal of a closed polygon (m, d) as long as its area: (1,) in 2 dimensions, (3,) in 3."""
    following = np.roll(points, -1, axis=0)
    if points.shape[1] == 2:
        twice = points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]
        return np.array([0.5 * twice.sum()])
    vector: Floats = 0.5 * np.cross(points, following).sum(axis=0)
    return vector


def _canonical(points: Floats) -> Ints:
    """Order (m,) that is the same however the points were begun and whichever way they run."""
    count = len(points)
    around = np.arange(count)
    order = np.lexsort(points.T[::-1])
    other = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    rank = np.zeros(count, np.int64)
    rank[order[1:]] = np.cumsum(other)
    onwards = (_begin(rank) + around) % count
    backwards = (count - 1 - _begin(rank[::-1]) - around) % count
    best = max(onwards, backwards, key=lambda way: rank[way].tolist())
    normal = area_vector(points[best])
    if normal[np.argmax(np.abs(normal))] < 0.0:
        best = best[-around]
    return best.astype(np.int32)


def _begin(rank: NDArray[np.int64]) -> int:
    """Where to begin so that the ranks (m,), read around, come last in alphabetical order.

    Where several places may do, they are told apart by what follows, and by twice as much of
    it each time.
    """
    reach = 1
    while reach < len(rank) and np.count_nonzero(rank == rank.max()) > 1:
        rank = rank * len(rank) + np.roll(rank, -reach)
        rank = np.unique(rank, return_inverse=True)[1]
        reach *= 2
    return int(rank.argmax())
