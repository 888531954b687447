"""Which closed polygons are seen whole from the origin."""

from __future__ import annotations

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.plane.angle_between import turn_between

BACK = 0.1
"""Angle by which a polygon may go back around the origin, rad: noise does."""


def are_star_shaped(away: Floats) -> Bools:
    """Whether polygons (M, n, 2) are seen from the origin in one turn, always onwards."""
    rises = turn_between(away, np.roll(away, -1, axis=1))
    once = np.abs(rises.sum(axis=1) - 2.0 * np.pi) < 1.0
    star: Bools = once & (rises > 0.0).all(axis=1)
    return star


def are_nearly_star_shaped(away: Floats) -> Bools:
    """Whether they go around the origin once and hardly ever back."""
    twice = np.concatenate([away, away], axis=1)
    rises = turn_between(twice, np.roll(twice, -1, axis=1))
    turned = np.cumsum(rises[:, :-1], axis=1)
    back = (np.maximum.accumulate(turned, axis=1) - turned).max(axis=1)
    nearly: Bools = (turned[:, -1] > 3.0 * np.pi) & (back <= BACK)
    return nearly
