"""How far points are from the closed curve of their slice."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from palpate.core.arrays import Floats

APART = 10.0
"""Slices are set apart by so many times the width of everything, so that no place is nearest
to a point of another slice."""


def slice_distance(curves: Floats, points: Floats) -> Floats:
    """Distances (c, M, k) of points from their slices' curves, m.

    To the tangent at the nearest of the curve's places, as far as that place stands for it:
    one search for all.

    Parameters
    ----------
    curves : (M, n, 2) array
        Each curve at even steps of its turn, m.
    points : (c, M, k, 2) array
        c sets of k points for each slice, m.
    """
    # About each slice's own middle: width must not grow by where an object leans to.
    middles = curves.mean(axis=1)
    curves = curves - middles[:, None]
    points = points - middles[:, None]
    far = APART * max(float(np.abs(curves).max()), float(np.abs(points).max()))
    level = far * np.arange(len(curves), dtype=np.float64)
    tree = cKDTree(_raised(curves, level[:, None]), balanced_tree=False, compact_nodes=False)
    nearest = tree.query(_raised(points, level[:, None]))[1].reshape(points.shape[:-1])
    ahead = 0.5 * (np.roll(curves, -1, axis=1) - np.roll(curves, 1, axis=1))
    step = np.linalg.norm(ahead, axis=2)
    along = ahead / np.where(step > 0.0, step, 1.0)[..., None]
    off = points - curves.reshape(-1, 2)[nearest]
    tangent = along.reshape(-1, 2)[nearest]
    across = off[..., 0] * tangent[..., 1] - off[..., 1] * tangent[..., 0]
    aside = np.sqrt(np.maximum((off**2).sum(axis=-1) - across**2, 0.0))
    beyond = aside - 0.5 * step.ravel()[nearest]
    distance: Floats = np.hypot(across, np.maximum(beyond, 0.0))
    return distance


def _raised(plane: Floats, level: Floats) -> Floats:
    """Places (n, 3) of points (..., 2), each slice at its own level."""
    levels = np.broadcast_to(level, plane.shape[:-1])
    return np.concatenate([plane, levels[..., None]], axis=-1).reshape(-1, 3)
