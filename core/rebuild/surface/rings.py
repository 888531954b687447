"""A stack of rings, closed with a pole at each end, as a triangle mesh."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints


def close_rings(bottom: Floats, rings: Floats, top: Floats) -> tuple[Floats, Ints]:
    """Watertight mesh of genus 0 from two poles and the rings between them.

    Parameters
    ----------
    bottom, top : (3,) arrays
        The poles, m.
    rings : (m, n, 3) array
        From the bottom to the top; each counter-clockwise seen from above.

    Returns
    -------
    vertices : (m n + 2, 3) array
        m.
    faces : (2 m n, 3) array
        Counter-clockwise seen from outside.
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
