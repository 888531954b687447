"""How wrong a surface may be between its contours: what leaving one out would have cost.

A smoother knows its noise, not what happens where nobody felt. Each contour is predicted from
its neighbours; by how much it misses, less the noise, is what a surface may miss at about twice
the spacing, and how that grows with the spacing says how much of it is left at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.rebuild.correspondence.leave_one_out import neighbour_weights

NEAR = 0.2
"""Width around a contour over which its misses are averaged, rad."""
DECAYING = 9
"""Contours from which on the decay with the spacing is measured."""
DECAY, LEAST_DECAY, MOST_DECAY = 0.4, 0.1, 0.7
"""Of a miss when the spacing is halved: where it cannot be measured, and its limits."""
WORST = 0.25
"""Share of the contours, those missed most, by which the decay is measured."""
FEW, LEAST_TRUST = 9, 1 / 3
"""Of more contours than so many it counts less, in proportion, for the surface agrees with them
over more than two spacings; and how much at least. Set on shapes of several kinds, such that 95
of 100 points lie in the band of 95 %."""


class Misses(NamedTuple):
    """Contours predicted from their neighbours."""

    squares: Floats
    """Squared misses across the contours, (m, k)."""
    gain: Floats
    """Variance of a miss over that of the noise, (m,); 1 where there are no neighbours."""


@dataclass(frozen=True, slots=True, eq=False)
class BetweenContours:
    """Squares of what a surface may miss between contours."""

    sites: Floats
    """Parameters of the contours along the axis, rising, (m,)."""
    squares: Floats
    """Squared misses of each contour, noise taken off, at even turns, (m, k)."""
    share: float
    """Of a miss that is to be expected midway between contours."""

    def variance(self, places: Floats, turns: Floats) -> Floats:
        """On a grid of parameters (a,) and turns (b,): (a, b).

        Nothing at the contours, most midway between them; beyond the outermost ones it grows
        with the squared distance.
        """
        count = len(self.sites)
        if count < 2:
            return np.zeros((len(places), len(turns)))
        squares = self.squares @ _nearby(turns, self.squares.shape[1]).T
        first = np.clip(np.searchsorted(self.sites, places) - 1, 0, count - 2)
        gap = np.diff(self.sites)[first]
        share = (places - self.sites[first]) / gap
        inside = self.share**2 * np.clip(4.0 * share * (1.0 - share), 0.0, None)
        beyond = np.square(np.maximum(np.maximum(-share, share - 1.0), 0.0))
        worse = np.maximum(squares[first], squares[first + 1])
        outer = np.where((share > 1.0)[:, None], squares[first + 1], squares[first])
        variance: Floats = inside[:, None] * worse + beyond[:, None] * outer
        return variance


def between_contours(
    sites: Floats, contours: Floats, across: Floats, sigma: float
) -> BetweenContours:
    """Judge how far a surface through contours can be trusted between them.

    Parameters
    ----------
    sites : (m,) array
        Parameters of the contours along the axis, rising.
    contours : (m, k, 2) array
        Their points at even turns.
    across : (m, k, 2) array
        Unit vectors across the contours; zero where a contour is a point.
    sigma : float
        Standard deviation of the noise across.
    """
    one = _misses(sites, contours, across)
    width = contours.shape[1]
    nearby = _nearby(np.arange(width) / width, width)
    squares = np.maximum(one.squares @ nearby.T - one.gain[:, None] * sigma**2, 0.0)
    trust = float(np.clip(FEW / len(sites), LEAST_TRUST, 1.0))
    decay = DECAY
    if len(sites) >= DECAYING:
        decay = _decay(one, _every_other(sites, contours, across), sigma)
    return BetweenContours(sites, squares, trust * decay)


def _misses(sites: Floats, contours: Floats, across: Floats) -> Misses:
    """Predict each contour from its neighbours."""
    weights = np.eye(2)[::-1] if len(sites) == 2 else neighbour_weights(sites)
    known = (weights != 0.0).any(axis=1)
    missed = np.tensordot(weights, contours, 1) - contours
    squares = np.square(np.einsum("mkd,mkd->mk", missed, across))
    return Misses(np.where(known[:, None], squares, 0.0), 1.0 + np.square(weights).sum(axis=1))


def _every_other(sites: Floats, contours: Floats, across: Floats) -> Misses:
    """The same from every other contour, at twice the spacing."""
    squares, gain = np.empty(contours.shape[:2]), np.empty(len(sites))
    for start in (0, 1):
        part = slice(start, None, 2)
        squares[part], gain[part] = _misses(sites[part], contours[part], across[part])
    return Misses(squares, gain)


def _decay(one: Misses, two: Misses, sigma: float) -> float:
    """Miss at half the spacing over that at the whole, where they are largest."""
    inner = slice(2, -2)
    near, far = (
        np.maximum(misses.squares[inner].mean(axis=1) - misses.gain[inner] * sigma**2, 0.0)
        for misses in (one, two)
    )
    worst = np.argsort(-near)[: max(3, int(WORST * len(near)))]
    if not far[worst].sum() > 0.0:
        return DECAY
    ratio = float(np.sqrt(near[worst].sum() / far[worst].sum()))
    return float(np.clip(ratio, LEAST_DECAY, MOST_DECAY))


def _nearby(turns: Floats, count: int) -> Floats:
    """Weights (b, k) of even turns in an average about turns (b,)."""
    away = turns[:, None] - np.arange(count) / count
    angle = 2.0 * np.pi * (away - np.round(away))
    weights = np.exp(-0.5 * np.square(angle / NEAR))
    averages: Floats = weights / weights.sum(axis=1, keepdims=True)
    return averages
