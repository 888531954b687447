"""How noisy points along a closed curve are, before any curve has been fitted."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Floats

LEAST_POINTS = 25
"""With fewer points noise and shape cannot be told apart: each of a square's corners shows in
five of them."""
MEDIAN = 0.6745
"""Median size of an error of deviation 1. Only one coordinate shows it: the parameters follow
the points along the curve."""
OPPOSED = -0.5
"""Cosine between neighbouring deviations below which they alternate. Noise has -0.8."""


def local_noise(points: Floats, parameters: Floats) -> float:
    """Standard deviation of the noise across the curve, in the points' unit; 0 where there is none.

    Each point is compared with the cubic through its two neighbours on either side. Of a
    smooth curve, the deviations of neighbours agree; of noise they are opposed. The median
    knows nothing of corners, for they are few.

    Parameters
    ----------
    points : (m, d) array
        Around the curve.
    parameters : (m,) array
        Increasing, in turns.
    """
    count = len(points)
    if count < LEAST_POINTS:
        return 0.0
    index = (np.arange(count)[:, None] + np.array([-2, -1, 1, 2])) % count
    away = parameters[index] - parameters[:, None]
    away = away - np.round(away)
    weights = _cubic_weights(away)
    deviations = points - np.einsum("mk,mkd->md", weights, points[index])
    deviations /= np.sqrt(1.0 + (weights**2).sum(axis=1))[:, None]
    lengths = np.linalg.norm(deviations, axis=1)
    following = np.roll(deviations, -1, axis=0)
    along = np.einsum("md,md->m", deviations, following)
    if np.median(along - OPPOSED * lengths * np.roll(lengths, -1)) >= 0.0:
        return 0.0
    return float(np.median(lengths)) / MEDIAN


def _cubic_weights(away: Floats) -> Floats:
    """Lagrange's weights (m, 4) at 0 of values at four other places (m, 4)."""
    between = away[:, None, :] - away[:, :, None]
    np.einsum("mkk->mk", between)[:] = 1.0
    others = np.where(np.eye(4, dtype=bool), 1.0, away[:, None, :])
    weights: Floats = (others / between).prod(axis=2)
    return weights
