"""What point inversion answers, and what counts as an answer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints
from palpate.core.splines.determinant import extent, mean_determinant, scaled
from palpate.core.splines.volume import Volume

EPSILON = float(np.finfo(float).eps)
ENOUGH = 1e-12
"""Of the volume's size: no iteration goes on below that residual."""
CONVERGED = 1e-9
"""Of the volume's size: a larger residual is no answer."""
FLAT = 1e-12
"""Of the product of the slopes' largest components: a determinant below that is none."""


class Inversion(NamedTuple):
    """Parameters of some points."""

    parameters: Floats
    """s, t, u (n, 3), each from 0 to 1; those of a nearest point where nothing else was found."""
    residual: Floats
    """Distance (n,) between the point and that of the parameters, m."""
    converged: Bools
    """(n,): the residual is 0 but for rounding. A point outside never converges."""
    folded: Bools
    """(n,): the volume is turned inside out there, or squeezed flat, so that other parameters
    may give the same point."""
    steps: Ints
    """Steps of the iteration, (n,)."""


def enough(volume: Volume) -> float:
    """Residual below which nothing is to be gained, m."""
    return _of_size(volume, ENOUGH, 16)


def tolerance(volume: Volume) -> float:
    """Residual above which there is no answer, m."""
    return _of_size(volume, CONVERGED, 64)


def is_folded(volume: Volume, slopes: Floats) -> Bools:
    """Where slopes (n, 3, 3) of a volume have no determinant of its own sign.

    That is the sign of the mean: a volume may run round a ring and yet fold nowhere.
    """
    own = mean_determinant(scaled(volume, volume.control[0, 0, 0], extent(volume)))
    largest = np.abs(slopes).max(axis=1, keepdims=True)
    s, t, u = (slopes / np.where(largest > 0.0, largest, 1.0)).transpose(2, 0, 1)
    determinant = np.einsum("ni,ni->n", np.cross(s, t), u)
    folded: Bools = (determinant if own >= 0.0 else -determinant) <= FLAT
    return folded


def _of_size(volume: Volume, share: float, roundings: int) -> float:
    points = volume.control.reshape(-1, 3)
    size = float(np.ptp(points, axis=0).max())
    return share * size + roundings * EPSILON * float(np.abs(points).max())
