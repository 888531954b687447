"""Whether a closed polygon meets itself."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints


def crosses_itself(polygon: Floats) -> bool:
    """Whether two edges of a closed polygon (n, 2) cross or touch that are not neighbours.

    Only pairs whose ranges along the polygon's longer side overlap are looked at.
    """
    if len(polygon) < 4:
        return False
    following = np.roll(polygon, -1, axis=0)
    first, second = _near_pairs(polygon, following)
    count = len(polygon)
    apart = (second - first) % count
    distinct = (apart > 1) & (apart < count - 1)
    first, second = first[distinct], second[distinct]
    met = _meet(polygon[first], following[first], polygon[second], following[second])
    return bool(met.any())


def _near_pairs(starts: Floats, ends: Floats) -> tuple[Ints, Ints]:
    """Pairs of edges (k,), (k,) that overlap in both coordinates: by sorting, not by trying all."""
    axis = int(np.argmax(np.ptp(starts, axis=0)))
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    order = np.argsort(low[:, axis], kind="stable")
    sorted_low = low[order, axis]
    last = np.searchsorted(sorted_low, high[order, axis], side="right")
    others = np.maximum(last - 1 - np.arange(len(order)), 0)
    begin = np.cumsum(others) - others
    first = np.repeat(np.arange(len(order)), others)
    second = first + 1 + np.arange(len(first)) - np.repeat(begin, others)
    first, second = order[first], order[second]
    across = 1 - axis
    overlap = low[first, across] <= high[second, across]
    overlap &= low[second, across] <= high[first, across]
    return first[overlap].astype(np.int32), second[overlap].astype(np.int32)


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
