"""Triangles between stacked rings of points, closed by a pole at each end, as a mesh of genus 0.

A ring may have as many points as the one before, or half or twice as many.
"""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints


def close_rings(bottom: Floats, rings: Floats, top: Floats) -> tuple[Floats, Ints]:
    """Watertight mesh of genus 0 from two poles and the rings between them.

    `bottom` and `top` (3,): the poles, m. `rings` (m, n, 3): from the bottom to the top; each
    counter-clockwise seen from above. Returns `vertices` (m n + 2, 3): m. `faces` (2 m n, 3):
    counter-clockwise seen from outside.
    """
    count, size = rings.shape[:2]
    vertices = np.concatenate([bottom[None], rings.reshape(-1, 3), top[None]])
    here = 1 + np.arange(size)
    following = 1 + (np.arange(size) + 1) % size
    lower = (size * np.arange(count - 1))[:, None]
    a, b = lower + here, lower + following
    c, d = a + size, b + size
    side = np.stack([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)], axis=2)
    last = size * (count - 1)
    below = np.column_stack([np.zeros(size, int), following, here])
    above = np.column_stack([np.full(size, len(vertices) - 1), last + here, last + following])
    faces = np.concatenate([below, side.reshape(-1, 3), above])
    return vertices, faces.astype(np.int32)


def join_rings(sizes: Ints) -> Ints:
    """Faces of a closed surface from two poles and the rings between them.

    `sizes` (m,): points of each ring, from the bottom to the top. They begin at the same turn and
    run counter-clockwise seen from above; neighbours have as many, half or twice as many. Returns
    (f, 3), counter-clockwise seen from outside. Vertex 0 is the lower pole, then come the rings in
    order, then the upper pole. Raises ValueError if there is no ring, one has fewer than 3 points,
    or neighbours have other sizes.
    """
    counts = [int(size) for size in sizes]
    if min(counts, default=0) < 3:
        raise ValueError(f"sizes must be at least one ring of 3 points, got {counts}")
    firsts = [1, *(1 + np.cumsum(counts)).tolist()]
    here, following = _ring(firsts[0], counts[0])
    strips = [np.column_stack([np.zeros_like(here), following, here])]
    for ring in range(len(counts) - 1):
        strips.append(_strip(firsts[ring], counts[ring], firsts[ring + 1], counts[ring + 1]))
    here, following = _ring(firsts[-2], counts[-1])
    strips.append(np.column_stack([np.full_like(here, firsts[-1]), here, following]))
    return np.concatenate(strips).astype(np.int32)


def _strip(low: int, below: int, high: int, above: int) -> Ints:
    """Faces between the ring that begins at `low` and the one over it."""
    if below == above:
        (a, b), (d, c) = _ring(low, below), _ring(high, above)
        halves = [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
    elif below == 2 * above:
        halves = _halved(low, high, above)
    elif above == 2 * below:
        halves = [strip[:, ::-1] for strip in _halved(high, low, below)]
    else:
        raise ValueError(
            f"sizes of neighbours must be equal, half or twice, got {below} and {above}"
        )
    return np.stack(halves, axis=1).reshape(-1, 3)


def _halved(fine: int, coarse: int, count: int) -> list[Ints]:
    """Three faces to each point of the coarse ring, which lies over the fine one."""
    first, middle = _ring(fine, 2 * count)
    a, b, c = first[::2], middle[::2], middle[1::2]
    d, e = _ring(coarse, count)
    return [np.column_stack([a, b, d]), np.column_stack([b, e, d]), np.column_stack([b, c, e])]


def _ring(first: int, size: int) -> tuple[Ints, Ints]:
    """Numbers of a ring's points, and of those that follow them."""
    here = np.arange(size, dtype=np.int32)
    return first + here, first + (here + 1) % size
