"""Inversion of a spline of one variable that rises."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, finite_array
from palpate.core.splines.basis import Basis

MOST_STEPS = 60
ENOUGH = 4 * float(np.finfo(float).eps)
"""Of the spline's range: what evaluating it leaves uncertain."""


class Roots(NamedTuple):
    """Where a spline takes given values."""

    parameters: Floats
    """(n,)."""
    residual: Floats
    """What is left there, (n,)."""
    steps: Ints
    """Steps, (n,)."""


def invert_rising(basis: Basis, coefficients: Floats, values: Floats) -> Roots:
    """Parameters at which a spline takes values.

    Parameters
    ----------
    basis : Basis
        Its basis.
    coefficients : (count,) array
        Rising: the spline rises with them, for its derivative is a spline of their differences.
    values : (n,) array
        Those beyond the spline's ends are answered with its ends.

    Raises
    ------
    ValueError
        If the coefficients are not `count` finite numbers that rise, or a value is NaN.

    Notes
    -----
    The spline rises, so that its values at the knots tell between which two a root lies. There
    it is one polynomial, of which Newton's method finds the root, by halves where a step would
    leave the bracket. A root that is found stays: the bracket's end is on it, and halving would
    drive it away again.
    """
    coefficients = finite_array("coefficients", coefficients, (basis.count,))
    values = np.asarray(values, np.float64)
    if np.isnan(values).any():
        raise ValueError(f"values must be numbers, got {np.count_nonzero(np.isnan(values))} nan")
    if not (np.diff(coefficients) > 0.0).all():
        raise ValueError("coefficients must rise")
    breaks = np.unique(np.clip(basis.knots, *basis.domain))
    taylor = _taylor(basis, coefficients, breaks)
    heights = taylor[0]
    span = np.clip(np.searchsorted(heights, values, side="right") - 1, 0, len(breaks) - 2)
    width = np.diff(breaks)[span]
    pieces = taylor[:, span] * width ** np.arange(len(taylor))[:, None]
    rise = heights[span + 1] - heights[span]
    least = ENOUGH * float(heights[-1] - heights[0])
    place = np.clip((values - heights[span]) / rise, 0.0, 1.0)
    low, high = np.zeros(len(values)), np.ones(len(values))
    steps = np.zeros(len(values), np.int32)
    for _ in range(MOST_STEPS):
        value, slope = _horner(pieces, place)
        left = value - values
        going = np.abs(left) > least
        low, high = np.where(left < 0.0, place, low), np.where(left > 0.0, place, high)
        going &= high > low
        if not going.any():
            break
        with np.errstate(divide="ignore", invalid="ignore"):  # then by halves
            ahead = place - left / slope
        inside = (ahead > low) & (ahead < high)
        ahead = np.where(inside, ahead, np.where(_at_end(place, left), place, 0.5 * (low + high)))
        going &= ahead != place
        place = np.where(going, ahead, place)
        steps += going
        if not going.any():
            break
    residual = np.abs(_horner(pieces, place)[0] - values)
    return Roots(breaks[span] + width * place, residual, steps)


def _at_end(place: Floats, left: Floats) -> Bools:
    """Where the root lies beyond the piece's end, by rounding or because the value does."""
    beyond: Bools = ((place == 0.0) & (left > 0.0)) | ((place == 1.0) & (left < 0.0))
    return beyond


def _taylor(basis: Basis, coefficients: Floats, breaks: Floats) -> Floats:
    """Derivatives over factorials at the breaks, (degree + 1, len(breaks))."""
    local = basis.nonzero(breaks, basis.degree)
    values = np.einsum("dnk,nk->dn", local.values, coefficients[local.columns()])
    factorials = np.concatenate([[1.0], np.cumprod(np.arange(1.0, basis.degree + 1))])
    taylor: Floats = values / factorials[:, None]
    return taylor


def _horner(pieces: Floats, place: Floats) -> tuple[Floats, Floats]:
    """Values and slopes of polynomials, a column each, lowest power first."""
    value, slope = pieces[-1].copy(), np.zeros_like(place)
    for power in pieces[-2::-1]:
        slope = slope * place + value
        value = value * place + power
    return value, slope
