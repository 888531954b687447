"""How a contour that should be level rises and falls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats


class Sway(NamedTuple):
    """Departures of a contour's z from its mean, root mean square."""

    shape: float
    """What a smooth surface explains: the contour is tilted or bent, m."""
    noise: float
    """What it does not, m."""


def height_sway(points: Floats) -> Sway:
    """How z of points (n, 3) departs from its mean.

    z is compared with a quadric over the plane, and the share that noise alone would have
    in the fit is taken out of it; of 6 points and fewer all is taken for shape.
    """
    z = points[:, 2] - points[0, 2]
    z = z - z.mean()
    size = float(np.abs(z).max())
    if size == 0.0:
        return Sway(0.0, 0.0)
    near = points[:, :2] - points[:, :2].mean(axis=0)
    x, y = (near / np.abs(near).max()).T
    quadric = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    # A circle cannot tell the bowl from the constant: the shortest of all solutions will do.
    solution, _, rank, _ = np.linalg.lstsq(quadric, z / size, rcond=None)
    explained = quadric @ solution
    spare = len(z) - int(rank)
    left = float(((z / size - explained) ** 2).sum())
    noise = np.sqrt(left / spare) if spare > 0 else 0.0
    shape = np.sqrt(max(float((explained**2).mean()) - noise**2 * (rank - 1) / len(z), 0.0))
    return Sway(size * float(shape), size * float(noise))
