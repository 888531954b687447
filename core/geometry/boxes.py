"""Bounding boxes: an order along a space-filling curve, and the pairs that overlap."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from palpate.core.arrays import Floats

Indices = NDArray[np.intp]
MORTON_BITS = 16  # of each coordinate


def morton_order(points: Floats) -> Indices:
    """The order (n,) of points (n, 3) along the curve that interleaves their coordinates' bits."""
    low = points.min(axis=0)
    size = float(np.ptp(points, axis=0).max()) or 1.0
    cells = ((points - low) * ((1 << MORTON_BITS) - 1) / size).astype(np.uint64)
    for shift, mask in (  # each step moves half of the bits, until two zeros follow each bit
        (16, 0x0000FF0000FF),
        (8, 0x00F00F00F00F),
        (4, 0x0C30C30C30C3),
        (2, 0x249249249249),
    ):
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    code = cells[:, 0] | cells[:, 1] << np.uint64(1) | cells[:, 2] << np.uint64(2)
    return np.argsort(code, kind="stable")


def overlapping_pairs(
    low: Floats, high: Floats, *, max_root_boxes: int = 32, block: int = 1 << 15
) -> Iterator[tuple[Indices, Indices]]:
    """Pairs (p,), (p,) of boxes that overlap or touch, the first never after the second.

    `low` and `high` (n, k): the smallest and largest coordinates of each box. Consecutive boxes
    should be close to each other, as along a polygon or in `morton_order`: they are joined to ever
    larger boxes, and only where two of those overlap are their halves tested. `max_root_boxes`:
    joining ends there, and all pairs are tested. `block`: pairs at once, to fit the cache.
    """
    levels = _levels(low, high, max_root_boxes)
    first, second = np.triu_indices(levels[-1][0].shape[1])
    waiting = [(len(levels) - 1, first, second)]
    while waiting:
        level, first, second = waiting.pop()
        for below, above in zip(*levels[level], strict=True):
            overlap = (below[first] <= above[second]) & (below[second] <= above[first])
            first, second = first[overlap], second[overlap]
        if level == 0:
            yield first, second
            continue
        first = 2 * np.repeat(first, 4) + np.tile([0, 0, 1, 1], len(first))
        second = 2 * np.repeat(second, 4) + np.tile([0, 1, 0, 1], len(second))
        is_pair = (first <= second) & (second < levels[level - 1][0].shape[1])
        first, second = first[is_pair], second[is_pair]
        for begin in range(0, len(first), block):
            part = slice(begin, begin + block)
            waiting.append((level - 1, first[part], second[part]))


def _levels(low: Floats, high: Floats, max_root_boxes: int) -> list[tuple[Floats, Floats]]:
    """Coordinates (k, m) of the boxes, of boxes around pairs of them, and so on."""
    levels = [(low.T.copy(), high.T.copy())]
    while levels[-1][0].shape[1] > max_root_boxes:
        below, above = levels[-1]
        first = np.arange(0, below.shape[1], 2)
        levels.append(
            (np.minimum.reduceat(below, first, axis=1), np.maximum.reduceat(above, first, axis=1))
        )
    return levels
