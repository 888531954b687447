"""Fit of a jet to the touched taxels, and how sure it is: least squares by QR."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.filters import MAD_TO_SIGMA
from palpate.core.touch.jet import COUNTS, Jet
from palpate.core.touch.jet_design import (
    Design,
    design_of,
    factorised,
    largest_degree,
    seen_degree,
)
from palpate.core.touch.pad import Pad

TUKEY = 4.685
"""Deviations beyond which a taxel has no weight: 95 % efficient for normal noise."""
MOST_ROUNDS = 8
"""Of reweighting; weights that move by less than `SETTLED` end it before."""
SETTLED = 1e-3


class JetFit(NamedTuple):
    """A jet, its derivatives at the middle of the contact, and how sure they are."""

    jet: Jet
    """The polynomial."""
    middle: tuple[float, float, float]
    """Mean x and y of the touched taxels, and the jet's height there, m."""
    derivatives: Floats
    """z_x, z_y, z_xx, z_xy, z_yy at the middle, (5,); second derivatives in 1/m."""
    derivative_factor: Floats
    """Square root of the derivatives' covariance for unit noise, (5, m): the covariance is
    ``deviation**2 * factor @ factor.T``."""
    factor: Floats
    """Likewise of the coefficients, (m, m)."""
    misfit: Floats
    """Height less jet at the touched taxels, in the order of the mask, (n,), m."""
    residual: float
    """Root mean square misfit of the taxels that count, m."""
    deviation: float
    """Noise of a taxel of weight 1 as the misfit shows it, m: what the coefficients took up
    is given back."""
    weights: Floats | None
    """From 0 to 1 for each touched taxel, (n,); None if all count alike."""


def fit_jet(
    pad: Pad,
    height: Floats,
    touched: Bools,
    weights: Floats | None = None,
    noise: float | None = None,
) -> JetFit | None:
    """Jet of the touched taxels.

    Parameters
    ----------
    pad : Pad
        The array.
    height : (rows, cols) array
        Surface over the plane of the pad's face, m.
    touched : (rows, cols) array of bool
        Which taxels count.
    weights : (rows, cols) array, optional
        How much each of them does, from 0 to 1: inverse variances, up to a factor.
    noise : float, optional
        Standard deviation of one taxel, m, or less. If given, the cubic and the quartic part
        are shrunk by as much as noise explains them.

    Returns
    -------
    None if fewer than 8 taxels count, or they lie on a line.

    Notes
    -----
    The degree follows the number of taxels, and falls where they cannot tell the powers of
    one degree apart, as on two rows.

    A quartic follows a tight curve and a quadric is steadier on a flat one; shrinking by
    James and Stein, *Estimation with quadratic loss*, 1961, goes between the two whichever the
    surface is, and over all coefficients it is on average nowhere worse than the quartic.
    """
    if weights is not None:
        touched = touched & (weights > 0.0)
    design = design_of(pad.rows, pad.cols, pad.pitch, touched.tobytes())
    if design is None:
        return None
    z = height.ravel()
    if design.places.size < z.size:
        z = z[design.places]
    if weights is not None:
        return _weighted(design, z, weights.ravel()[design.places], noise)
    inner = z @ design.basis
    misfit = z - design.basis @ inner
    squares, count, m = float(misfit @ misfit), len(z), len(inner)
    deviation, outer = math.sqrt(squares / max(count - m, 1)), design.outer
    if noise is not None and m > COUNTS[2]:
        shares = _shares(inner, max(noise, deviation))
        inner, outer = inner * shares, outer * np.sqrt(shares)
        misfit = z - design.basis @ inner
        squares = float(misfit @ misfit)
    found = design.outer @ inner
    return JetFit(
        jet=Jet(found[:m], design.scale),
        middle=(*design.middle, float(found[m])),
        derivatives=found[m + 1 :],
        derivative_factor=outer[m + 1 :],
        factor=outer[:m],
        misfit=misfit,
        residual=math.sqrt(squares / count),
        deviation=deviation,
        weights=None,
    )


def fit_robust_jet(
    pad: Pad, height: Floats, touched: Bools, least_deviation: float, start: Floats | None = None
) -> JetFit | None:
    """Jet of the touched taxels that gives no weight to those that stand far off.

    Parameters
    ----------
    pad, height, touched
        As for `fit_jet`.
    least_deviation : float
        The noise is not taken to be smaller than this, m: otherwise a noise-free frame would
        throw out all taxels that a polynomial misses.
    start : (rows, cols) array, optional
        Weights to begin with; without them, all alike.

    Returns
    -------
    None if fewer than 8 taxels are touched, or they lie on a line.

    Notes
    -----
    Tukey's biweight, the scale by the median absolute misfit, at most 8 rounds; Beaton and
    Tukey, *The fitting of power series*, 1974.
    """
    design = design_of(pad.rows, pad.cols, pad.pitch, touched.tobytes())
    if design is None:
        return None
    z = height.ravel()[design.places]
    before = np.ones(len(z)) if start is None else start.ravel()[design.places]
    fit = _weighted(design, z, before)
    if fit is None:  # the start leaves too few
        before = np.ones(len(z))
        fit = fit_jet(pad, height, touched)
    for _ in range(MOST_ROUNDS):
        if fit is None:
            break
        counted = np.abs(fit.misfit[before > 0.0])
        spread = max(MAD_TO_SIGMA * float(np.median(counted)), least_deviation)
        weights = _tukey(fit.misfit / spread) if spread > 0.0 else before
        fit = _weighted(design, z, weights) or fit
        if np.abs(weights - before).max() < SETTLED:
            break
        before = weights
    return fit


def _shares(inner: Floats, noise: float) -> Floats:
    """Share of each coefficient over Q that is kept: James and Stein for each degree's own.

    Those of one degree count together, so that the pad may be turned. Seen as Bayes's rule
    with a prior that is learnt from them, the share is also that of their variance.
    """
    shares = np.ones(len(inner))
    for lower, upper in pairwise(COUNTS[2:]):
        part = inner[lower:upper]
        if len(part):
            size = float(part @ part)
            loss = (len(part) - 2) * noise * noise
            shares[lower:upper] = max(1.0 - loss / size, 0.0) if size > 0.0 else 0.0
    return shares


def _weighted(
    design: Design, z: Floats, weights: Floats, noise: float | None = None
) -> JetFit | None:
    """By a factorisation of the weighted rows; the degree falls if the weights leave too few."""
    count = int(np.count_nonzero(weights))
    root = np.sqrt(weights)
    basis, triangle = factorised(design.monomials * root[:, None])
    degree = seen_degree(triangle, min(largest_degree(count), COUNTS.index(len(triangle))), count)
    if degree == 0:
        return None
    m = COUNTS[degree]
    inverse = np.asarray(np.linalg.inv(triangle[:m, :m]), np.float64)
    inner: Floats = basis[:, :m].T @ (z * root)
    monomial = design.monomials[:, :m]
    misfit = z - monomial @ (inverse @ inner)
    squares = float(weights @ (misfit * misfit))
    deviation = math.sqrt(squares / max(count - m, 1))
    factor: Floats = inverse
    if noise is not None and m > COUNTS[2]:
        shares = _shares(inner, max(noise, deviation))
        inner, factor = inner * shares, inverse * np.sqrt(shares)
        misfit = z - monomial @ (inverse @ inner)
        squares = float(weights @ (misfit * misfit))
    coefficients = inverse @ inner
    there = design.rows[:, :m] @ coefficients
    return JetFit(
        jet=Jet(coefficients, design.scale),
        middle=(*design.middle, float(there[0])),
        derivatives=there[1:],
        derivative_factor=design.rows[1:, :m] @ factor,
        factor=factor,
        misfit=misfit,
        residual=math.sqrt(squares / float(weights.sum())),
        deviation=deviation,
        weights=weights,
    )


def _tukey(off: Floats) -> Floats:
    """Tukey's biweight of misfits in deviations."""
    share: Floats = np.maximum(1.0 - (off / TUKEY) ** 2, 0.0)
    return share * share
