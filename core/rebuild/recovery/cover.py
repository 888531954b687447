"""How much of a fitted surface has no points near it."""

from __future__ import annotations

import math

import numpy as np

from palpate.core.arrays import Floats

SAMPLES = 400
SPACING = 1.0
"""Of the root of the area for each point. With points strewn evenly, one place in 23 is farther
than that from all of them: the probability is exp(-pi)."""
FAR = 3.0
"""Standard deviations by which points may stand off."""


def uncovered(surface: Floats, area: float, points: Floats, noise: float) -> float:
    """Share of places spread evenly over a surface that are far from all points.

    Parameters
    ----------
    surface : (k, 3) array
        The places.
    area : float
        Of the surface.
    points : (n, 3) array
        What the surface was fitted to.
    noise : float
        Standard deviation of the points.
    """
    squares = np.einsum("ki,ki->k", surface, surface)[:, None] + np.einsum(
        "ni,ni->n", points, points
    )
    squares -= 2.0 * surface @ points.T
    near = SPACING * math.sqrt(area / len(points)) + FAR * noise
    return float((squares.min(axis=1) > near * near).mean())
