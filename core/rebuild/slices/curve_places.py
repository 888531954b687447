"""Points of many closed curves at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.slices.even_steps import same_steps
from palpate.core.splines.closed_curve import ClosedCurve


def chord_places(fine: Floats, turns: Floats) -> Floats:
    """Points (..., M, k, 2) of curves (M, n, 2) at turns (..., M, k), on chords of the curves."""
    count = fine.shape[1]
    place = np.mod(turns, 1.0) * count
    first = place.astype(np.intp)
    share = (place - first)[..., None]
    row = np.arange(len(fine))[:, None]
    begin, end = fine[row, first % count], fine[row, (first + 1) % count]
    points: Floats = begin + share * (end - begin)
    return points


def curve_places(curves: Sequence[ClosedCurve], turns: Floats) -> Floats:
    """Points (M, k, 2) of M curves at turns (M, k).

    Those with knots at even steps, as most have, are evaluated together.
    """
    even = [curve.smoothing == 0.0 and same_steps(curve.parameters) for curve in curves]
    found = np.empty((*turns.shape, 2))
    if any(even):
        together = [curve for curve, one in zip(curves, even, strict=True) if one]
        found[even] = _even_places(together, turns[even])
    for row, (curve, one) in enumerate(zip(curves, even, strict=True)):
        if not one:
            found[row] = curve.at(turns[row])
    return found


def _even_places(curves: Sequence[ClosedCurve], turns: Floats) -> Floats:
    counts = np.array([len(curve.control) for curve in curves])
    begin = (np.cumsum(counts) - counts)[:, None]
    control = np.concatenate([curve.control for curve in curves])
    place = np.mod(turns, 1.0) * counts[:, None]
    first = np.floor(place)
    x = place - first
    span = first.astype(np.intp)
    weights = (
        (1.0 - x) ** 3 / 6.0,
        (3.0 * x**3 - 6.0 * x**2 + 4.0) / 6.0,
        (-3.0 * x**3 + 3.0 * x**2 + 3.0 * x + 1.0) / 6.0,
        x**3 / 6.0,
    )
    points = np.zeros((*turns.shape, 2))
    for by, weight in enumerate(weights):
        points += weight[..., None] * control[begin + (span + by) % counts[:, None]]
    return points
