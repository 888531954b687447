"""Whether a closed polygon meets itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Bools, Floats
from palpate.core.plane.closed_polygon import closed_polygon

Numbers = NDArray[np.intp]
Boxes = Floats
"""Left, lower, right and upper sides, (4, k)."""

FIRST_BOXES = 32
"""At most so many boxes are compared each with each."""
AT_ONCE = 1 << 15
"""Pairs of boxes that are looked at together, so that memory stays small."""


def crosses_itself(polygon: Floats) -> bool:
    """Whether two edges of a closed polygon (n, 2) cross or touch that are not neighbours.

    Vertices that come twice in a row, as where the first is given again at the end, are one.

    Raises
    ------
    ValueError
        If the polygon is not finite (n, 2).

    Notes
    -----
    Edges that follow each other lie together in ever larger boxes; only where two boxes
    overlap are their halves looked at.
    """
    polygon = closed_polygon(polygon, least=0)
    polygon = polygon[(polygon != np.roll(polygon, 1, axis=0)).any(axis=1)]
    if len(polygon) < 4:
        return False
    # In its own size, so that no product of two lengths vanishes or leaves the range.
    polygon = (polygon - polygon[0]) / np.ptp(polygon, axis=0).max()
    following = np.roll(polygon, -1, axis=0)
    count = len(polygon)
    for first, second in _near_pairs(polygon, following):
        apart = second - first
        distinct = (apart > 1) & (apart < count - 1)
        a, b = first[distinct], second[distinct]
        if _meet(polygon[a], following[a], polygon[b], following[b]).any():
            return True
    return False


def _near_pairs(starts: Floats, ends: Floats) -> Iterator[tuple[Numbers, Numbers]]:
    """Pairs of edges (k,), (k,) whose boxes overlap, the first never after the second."""
    levels = _boxes(np.vstack([np.minimum(starts, ends).T, np.maximum(starts, ends).T]))
    first, second = np.triu_indices(levels[-1].shape[1])
    waiting = [(len(levels) - 1, first, second)]
    while waiting:
        level, first, second = waiting.pop()
        left, low, right, high = levels[level]
        overlap = (left[first] <= right[second]) & (left[second] <= right[first])
        overlap &= (low[first] <= high[second]) & (low[second] <= high[first])
        first, second = first[overlap], second[overlap]
        if level == 0:
            yield first, second
            continue
        first = 2 * np.repeat(first, 4) + np.tile([0, 0, 1, 1], len(first))
        second = 2 * np.repeat(second, 4) + np.tile([0, 1, 0, 1], len(second))
        there = (first <= second) & (second < levels[level - 1].shape[1])
        first, second = first[there], second[there]
        for begin in range(0, len(first), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            waiting.append((level - 1, first[part], second[part]))


def _boxes(edges: Boxes) -> list[Boxes]:
    """Boxes around each edge, around each two of them, each four, and so on."""
    levels = [edges]
    while levels[-1].shape[1] > FIRST_BOXES:
        below = levels[-1]
        if below.shape[1] % 2:  # the last one stands alone
            below = np.hstack([below, below[:, -1:]])
        one, other = below[:, ::2], below[:, 1::2]
        both = np.vstack([np.minimum(one[:2], other[:2]), np.maximum(one[2:], other[2:])])
        levels.append(both)
    return levels


def _meet(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Whether segments ab and cd, (k, 2) each, whose boxes overlap, have a point in common."""
    on_ab = _side(a, b, c) * _side(a, b, d)
    on_cd = _side(c, d, a) * _side(c, d, b)
    met: Bools = (on_ab <= 0.0) & (on_cd <= 0.0)
    return met


def _side(a: Floats, b: Floats, point: Floats) -> Floats:
    """1, 0 or -1 (k,): left of, on or right of the line from a to b."""
    along, away = b - a, point - a
    side: Floats = np.sign(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
    return side
