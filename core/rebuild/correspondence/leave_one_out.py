"""What each contour should look like if only its neighbours had been traced."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from palpate.core.arrays import Floats

EACH_SIDE = 2
"""Neighbours below and above that tell of a contour."""


def neighbour_weights(heights: Floats) -> Floats:
    """Weights (M, M) that predict each contour from its neighbours: ``weights @ rows``.

    Parameters
    ----------
    heights : (M,) array
        Rising, m.

    Returns
    -------
    (M, M) array
        Lagrange's weights of the polynomial through the two nearest contours below and the two
        above, or as many as there are; at either end through the three nearest ones. Rows sum
        to 1; they are 0 where there are fewer than 2 others.
    """
    return _weights(tuple(heights.tolist()))


@lru_cache(maxsize=64)
def _weights(levels: tuple[float, ...]) -> Floats:
    """The same, once for each stack; not to be written to."""
    heights, count = np.array(levels), len(levels)
    every = np.arange(count)
    weights = np.zeros((count, count))
    for row in range(count):
        below, above = every[:row], every[row + 1 :]
        if not len(below) or not len(above):
            near = np.concatenate([below[-EACH_SIDE - 1 :], above[: EACH_SIDE + 1]])
        else:
            near = np.concatenate([below[-EACH_SIDE:], above[:EACH_SIDE]])
        if len(near) >= 2:
            weights[row, near] = _lagrange(heights[near], levels[row])
    weights.setflags(write=False)
    return weights


def _lagrange(nodes: Floats, place: float) -> Floats:
    """Weights (k,) of values at the nodes (k,) in the polynomial's value at a place."""
    apart = nodes[:, None] - nodes
    others = ~np.eye(len(nodes), dtype=bool)
    shares = np.divide(place - nodes, apart, out=np.ones_like(apart), where=others)
    weights: Floats = shares.prod(axis=1)
    return weights
