"""Point inversion in a deformed volume: many small least-squares problems side by side."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats, Ints
from palpate.core.least_squares import minimise
from palpate.core.splines.inversion import Inversion, enough, is_folded, tolerance
from palpate.core.splines.placement import affine_fit
from palpate.core.splines.volume import Volume

MOST_STEPS = 40
"""Of one start."""
SAMPLES = 13
"""Along each axis: where to begin again when the first start failed."""
STARTS = 6
"""Nearest samples that are tried."""


def invert_general(volume: Volume, points: Floats) -> Inversion:
    """Parameters of points (n, 3) in any volume, polynomial or rational.

    Notes
    -----
    The distance is minimised by the method of Levenberg and Marquardt within the bounds of the
    parameters, from the affine guess and, where that fails, from the nearest of a grid of
    samples. Newton's method on the derivative of the distance, as in Fung, 1999, (4.12),
    squares the condition number and has roots that are no answers.
    """
    matrix = affine_fit(volume)
    guess = np.clip(points @ matrix[:3] + matrix[3], 0.0, 1.0)
    parameters, residual, steps = _from(volume, points, guess)
    failed = residual > tolerance(volume)
    if failed.any():
        seeds = _near_samples(volume, points[failed])
        for number in range(seeds.shape[1]):
            rows = np.flatnonzero(failed)
            still = residual[rows] > tolerance(volume)
            rows = rows[still]
            if not len(rows):
                break
            other, left, more = _from(volume, points[rows], seeds[still, number])
            steps[rows] += more
            better = left < residual[rows]
            parameters[rows[better]], residual[rows[better]] = other[better], left[better]
    folded = is_folded(volume, volume.first(parameters)[1])
    return Inversion(parameters, residual, residual <= tolerance(volume), folded, steps)


def _from(volume: Volume, points: Floats, starts: Floats) -> tuple[Floats, Floats, Ints]:
    """Where the iteration ends from some starts (n, 3): parameters, residuals, steps."""

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        reached, slopes = volume.first(parameters)
        return reached - points[rows], slopes

    ends = minimise(
        problem, starts, np.zeros(3), np.ones(3), steps=MOST_STEPS, enough=enough(volume)
    )
    return ends.parameters, np.sqrt(2.0 * ends.cost), ends.steps


def _near_samples(volume: Volume, points: Floats) -> Floats:
    """Parameters (n, STARTS, 3) of the samples nearest to points, the nearest first."""
    from scipy.spatial import cKDTree

    axis = np.linspace(0.0, 1.0, SAMPLES)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    tree = cKDTree(volume.grid(axis, axis, axis).reshape(-1, 3))
    near: Floats = grid[tree.query(points, k=STARTS)[1]]
    return near
