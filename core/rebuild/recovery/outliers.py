"""Which points stand apart from the others, before anything is fitted to them."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats

MEDIAN_STEPS = 30
WEIGHT_STEPS = 10
FULL_WEIGHT = 1.45
"""Of the median distance: what is nearer counts fully."""
LEAST_SPREAD = 1e-9
"""Of the variance, added in every direction, so that flat points have distances too."""


def outlyingness(points: Floats) -> Floats:
    """How far each of points (n, 3) is from the middle of most, in their spread, (n,).

    Notes
    -----
    Mahalanobis distance over a reweighted covariance, about the point with the least sum of
    distances: unlike the median of each coordinate, that one turns with the points. Weiszfeld,
    1937.
    """
    centre = points.mean(axis=0)
    for _ in range(MEDIAN_STEPS):
        distance = _lengths(points - centre)
        weight = 1.0 / np.maximum(distance, LEAST_SPREAD * float(distance.max()) + 1e-300)
        centre = weight @ points / weight.sum()
    weight, distance = np.ones(len(points)), np.ones(len(points))
    for _ in range(WEIGHT_STEPS):
        away = points - centre
        spread = (weight[:, None] * away).T @ away / weight.sum()
        least = LEAST_SPREAD * float(np.einsum("ij,ij->", away, away)) / len(points)
        spread += (least + 1e-300) * np.eye(3)
        distance = np.sqrt(np.einsum("ij,ij->i", away, np.linalg.solve(spread, away.T).T))
        limit = FULL_WEIGHT * float(np.median(distance))
        weight = np.minimum(1.0, limit / np.maximum(distance, limit + 1e-300)) ** 4
        weight[distance <= limit] = 1.0
        centre = weight @ points / weight.sum()
    return distance


def core_of(points: Floats, share: float) -> Bools:
    """Which of points (n, 3) are left when the share that is most outlying is taken away."""
    apart = outlyingness(points)
    result: Bools = apart <= np.quantile(apart, 1.0 - share)
    return result


def _lengths(vectors: Floats) -> Floats:
    result: Floats = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return result
