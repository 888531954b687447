"""Where curves cross the ray from their middle along x."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats


def start_ray(shapes: Floats) -> Floats:
    """Turns (M,) from 0 to 1 at which curves come up through the ray along x, the farthest out.

    Parameters
    ----------
    shapes : (M, n, 2) array
        Closed counter-clockwise curves, each about its own middle, at even steps of the turn, m.
        One that does not cross the ray, as its middle lies outside, begins where it is
        farthest along x.
    """
    count = shapes.shape[1]
    following = np.roll(shapes, -1, axis=1)
    x, y = shapes[..., 0], shapes[..., 1]
    up = (y <= 0.0) & (following[..., 1] > 0.0)
    share = np.divide(-y, following[..., 1] - y, out=np.zeros_like(y), where=up)
    meets = x + share * (following[..., 0] - x)
    meets = np.where(up & (meets > 0.0), meets, -np.inf)
    rows, place = np.arange(len(shapes)), meets.argmax(axis=1)
    turns = np.mod((place + share[rows, place]) / count, 1.0)
    crossed = np.isfinite(meets[rows, place])
    begins: Floats = np.where(crossed, turns, x.argmax(axis=1) / count)
    return begins
