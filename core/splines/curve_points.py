"""Points of a closed curve, in an order and a scale that do not depend on how they were given."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats, Ints

SAME = 1e-12
"""Points nearer to each other, as a share of the curve's size, are one."""
ROUNDING = 64 * float(np.finfo(float).eps)
"""Of the coordinates: points that spread no farther are one, told apart by rounding."""


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
        If no row is finite.
    """
    rows = np.flatnonzero(np.isfinite(points).all(axis=1)).astype(np.int32)
    dropped = len(points) - len(rows)
    if not len(rows):
        raise ValueError(f"points must have at least one finite row, got {len(points)} rows")
    found = points[rows]
    low, high = found.min(axis=0), found.max(axis=0)
    # The middle of the box: a mean would round differently in another order.
    middle = 0.5 * low + 0.5 * high
    size = float(np.max(high - low))
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
    last = points[np.lexsort(points.T[::-1])[-1]]
    around = np.arange(count)
    ways = [
        (start + sign * around) % count
        for start in np.flatnonzero((points == last).all(axis=1))
        for sign in (1, -1)
    ]
    best = max(ways, key=lambda way: points[way].tolist())
    normal = area_vector(points[best])
    if normal[np.argmax(np.abs(normal))] < 0.0:
        best = best[-around]
    return best.astype(np.int32)
