"""Jets, local polynomials, fitted to the touched taxels: least squares by QR, with errors.

Cazals and Pouget, *Estimating differential quantities using polynomial fitting*, 2005. The
monomials are ordered by degree, so that one factorisation holds those of all lower degrees as its
leading blocks. It depends only on which taxels are touched: a full pad's is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats, Ints, scaled_mad
from palpate.core.touch.pad import Pad
from palpate.reprs import readable

TUKEY = 4.685  # Deviations beyond which a taxel has no weight: 95 % efficient for normal noise
MOST_ROUNDS = 8  # Of reweighting; weights that move by less than `SETTLED` end it before
SETTLED = 1e-3
LEAST_TAXELS = 8  # Below this there is no telling a slope from a corner
# Least number of taxels for each degree: about three for each coefficient.
DEGREES = ((45, 4), (30, 3), (12, 2), (LEAST_TAXELS, 1))
# A monomial of which the lower ones leave less than this root mean square, over the touched taxels,
# is not seen: rounding leaves 1e-16, the smallest contact that is fitted 1e-3.
DEPENDENT = 1e-9
KEPT_DESIGNS = 32  # Factorisations that are remembered, 70 kB each
COUNTS = (1, 3, 6, 10, 15)  # Coefficients of a polynomial of each degree
# How often z, z_x, z_y, z_xx, z_xy, z_yy are differentiated by x and y.
UP_TO_SECOND = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class JetFit(NamedTuple):
    """A jet, its derivatives at the middle of the contact, and how sure they are."""

    jet: Jet  # The polynomial
    middle: tuple[float, float, float]  # Mean x, y of touched taxels, the jet's height there, m
    derivatives: Floats  # z_x, z_y, z_xx, z_xy, z_yy at the middle, (5,); second derivatives in 1/m
    # Square root of the derivatives' covariance for unit noise, (5, m): the covariance is
    # ``deviation**2 * factor @ factor.T``.
    derivative_factor: Floats
    factor: Floats  # Likewise of the coefficients, (m, m)
    misfit: Floats  # Height less jet at the touched taxels, in the order of the mask, (n,), m
    residual: float  # Root mean square misfit of the taxels that count, m
    # Noise of a taxel of weight 1 as the misfit shows it, m: what the coefficients took up is given
    # back.
    deviation: float
    weights: Floats | None  # From 0 to 1 for each touched taxel, (n,); None if all count alike


def fit_jet(pad: Pad, height: Floats, touched: Bools, noise: float | None = None) -> JetFit | None:
    """Jet of the touched taxels.

    `height` (rows, cols): surface over the plane of the pad's face, m. `touched` (rows, cols) of
    bool: which taxels count. `noise`: standard deviation of one taxel, m, or less. If given, the
    cubic and the quartic part are shrunk by as much as noise explains them. None if fewer than 8
    taxels count, or they lie on a line. The degree follows the number of taxels, and
    falls where they cannot tell the powers of one degree apart, as on two rows. A quartic follows a
    tight curve and a quadric is steadier on a flat one; shrinking by James and Stein, *Estimation
    with quadratic loss*, 1961, goes between the two whichever the surface is, and over all
    coefficients it is on average nowhere worse than the quartic.
    """
    design = jet_design(pad.rows, pad.cols, pad.pitch, touched.tobytes())
    if design is None:
        return None
    z = height.ravel()
    if design.places.size < z.size:
        z = z[design.places]
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

    `least_deviation`: the noise is not taken to be smaller than this, m: otherwise a noise-free
    frame would throw out all taxels that a polynomial misses. `start` (rows, cols): weights to
    begin with; without them, all alike. None if fewer than 8 taxels are touched, or they lie on a
    line. Tukey's biweight, the scale by the median absolute misfit, at most 8 rounds; Beaton and
    Tukey, *The fitting of power series*, 1974.
    """
    design = jet_design(pad.rows, pad.cols, pad.pitch, touched.tobytes())
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
        spread = max(scaled_mad(fit.misfit[before > 0.0]), least_deviation)
        weights = before
        if spread > 0.0:  # Tukey's biweight
            share = np.maximum(1.0 - (fit.misfit / spread / TUKEY) ** 2, 0.0)
            weights = share * share
        fit = _weighted(design, z, weights) or fit
        if np.abs(weights - before).max() < SETTLED:
            break
        before = weights
    return fit


def _weighted(design: JetDesign, z: Floats, weights: Floats) -> JetFit | None:
    """By a factorisation of the weighted rows; the degree falls if the weights leave too few."""
    count = int(np.count_nonzero(weights))
    root = np.sqrt(weights)
    basis, triangle = qr_factors(design.monomials * root[:, None])
    most = min(supported_degree(count), COUNTS.index(len(triangle)))
    degree = identifiable_degree(triangle, most, count)
    if degree == 0:
        return None
    m = COUNTS[degree]
    inverse = np.asarray(np.linalg.inv(triangle[:m, :m]), np.float64)
    inner: Floats = basis[:, :m].T @ (z * root)
    monomial = design.monomials[:, :m]
    misfit = z - monomial @ (inverse @ inner)
    squares = float(weights @ (misfit * misfit))
    coefficients = inverse @ inner
    there = design.rows[:, :m] @ coefficients
    return JetFit(
        jet=Jet(coefficients, design.scale),
        middle=(*design.middle, float(there[0])),
        derivatives=there[1:],
        derivative_factor=design.rows[1:, :m] @ inverse,
        factor=inverse,
        misfit=misfit,
        residual=math.sqrt(squares / float(weights.sum())),
        deviation=math.sqrt(squares / max(count - m, 1)),
        weights=weights,
    )


def _shares(inner: Floats, noise: float) -> Floats:
    """Share of each coefficient over Q that is kept: James and Stein for each degree's own.

    Those of one degree count together, so that the pad may be turned. Seen as Bayes's rule with a
    prior that is learnt from them, the share is also that of their variance.
    """
    shares = np.ones(len(inner))
    for lower, upper in pairwise(COUNTS[2:]):
        part = inner[lower:upper]
        if len(part):
            size = float(part @ part)
            loss = (len(part) - 2) * noise * noise
            shares[lower:upper] = max(1.0 - loss / size, 0.0) if size > 0.0 else 0.0
    return shares


class JetDesign(NamedTuple):
    """Factorised monomials over the touched taxels."""

    places: Ints  # Indices of the touched taxels in the flattened array, (n,)
    middle: tuple[float, float]  # Their mean place, m
    scale: float  # Half the width of the pad, m
    monomials: Floats  # (n, m)
    basis: Floats  # Orthonormal columns Q of the factorisation Q R, (n, m)
    rows: Floats  # What gives height and derivatives at the middle from the coefficients, (6, m)
    outer: Floats  # What gives coefficients, height and derivatives from those over Q, (m + 6, m)


@lru_cache(maxsize=KEPT_DESIGNS)
def jet_design(rows: int, cols: int, pitch: float, touched: bytes) -> JetDesign | None:
    """The design of touched taxels, by their mask's bytes; None if fewer than 8, or on a line."""
    places = np.flatnonzero(np.frombuffer(touched, np.bool_)).astype(np.int32)
    degree = supported_degree(len(places))
    if degree == 0:
        return None
    x, y, all_over = _whole_pad(rows, cols)
    there = all_over[places, : COUNTS[degree]]
    basis, triangle = qr_factors(there)
    degree = identifiable_degree(triangle, degree, len(places))
    if degree == 0:
        return None
    m, scale = COUNTS[degree], 0.5 * pitch * cols
    if m < len(triangle):
        there, basis = there[:, :m].copy(), basis[:, :m].copy()
    at_x, at_y = float(x[places].mean()), float(y[places].mean())
    derive = derivative_rows(at_x, at_y, degree) * _units(scale)
    inverse = np.linalg.inv(triangle[:m, :m])
    outer = np.concatenate([inverse, derive @ inverse])
    return JetDesign(places, (at_x * scale, at_y * scale), scale, there, basis, derive, outer)


def supported_degree(count: float) -> int:
    """The degree that so many taxels can bear; 0 if not even a plane."""
    return next((degree for least, degree in DEGREES if count >= least), 0)


@cache
def _whole_pad(rows: int, cols: int) -> tuple[Floats, Floats, Floats]:
    """Places (n,) of all taxels, in halves of the pad's width, and their monomials."""
    row, col = np.divmod(np.arange(rows * cols), cols)
    x, y = (2.0 * col - (cols - 1)) / cols, (2.0 * row - (rows - 1)) / cols
    return x, y, monomials(x, y, len(COUNTS) - 1)


def qr_factors(matrix: Floats) -> tuple[Floats, Floats]:
    """Q and R; LAPACK is twice as fast on columns that lie together."""
    basis, triangle = np.linalg.qr(np.asfortranarray(matrix))
    return basis, triangle


def identifiable_degree(triangle: Floats, degree: int, count: float) -> int:
    """The highest degree all of whose monomials the taxels tell apart; 0 if not even a plane."""
    seen = np.abs(triangle.diagonal()) > DEPENDENT * math.sqrt(count)
    while degree and not seen[: COUNTS[degree]].all():
        degree -= 1
    return degree


def derivative_rows(x: float, y: float, degree: int) -> Floats:
    """What gives z, z_x, z_y, z_xx, z_xy, z_yy at a place, (6, m), in the jet's scale."""
    of_x, of_y, factor = _up_to_second(degree)
    in_x = np.array([x**power for power in range(degree + 1)])
    in_y = np.array([y**power for power in range(degree + 1)])
    rows: Floats = in_x[of_x] * in_y[of_y] * factor
    return rows


@cache
def _up_to_second(degree: int) -> tuple[Ints, Ints, Floats]:
    """Exponents and factors of the height and its five derivatives, (6, m) each."""
    six = [_exponents(degree, *order) for order in UP_TO_SECOND]
    of_x, of_y, factor = zip(*six, strict=True)
    return np.stack(of_x), np.stack(of_y), np.stack(factor)


@cache
def _units(scale: float) -> Floats:
    """Units of the height and the five derivatives, (6, 1)."""
    return np.array([[scale**-power] for power in (0, 1, 1, 2, 2, 2)])


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Jet:
    """z(x, y) as a polynomial about the pad's middle.

    Cazals and Pouget, *Estimating differential quantities using polynomial fitting*, 2005.
    """

    coefficients: Floats  # By total degree, then by the power of y: 1, x, y, x^2, xy, y^2, ...; m
    scale: float  # Length by which x and y are divided, m

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height at places x, y (n,), m."""
        return self._derivatives(x, y, (0, 0))[0]

    def slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Slopes dz/dx and dz/dy at places x, y (n,)."""
        by_x, by_y = self._derivatives(x, y, (1, 0), (0, 1))
        return by_x, by_y

    def second_derivatives(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives z_xx, z_xy and z_yy at places x, y (n,), 1/m."""
        by_xx, by_xy, by_yy = self._derivatives(x, y, (2, 0), (1, 1), (0, 2))
        return by_xx, by_xy, by_yy

    @property
    def degree(self) -> int:
        """Total degree of the polynomial."""
        return COUNTS.index(len(self.coefficients))

    def _derivatives(self, x: Floats, y: Floats, *orders: tuple[int, int]) -> list[Floats]:
        degree, scale = self.degree, self.scale
        in_x, in_y = _powers(x / scale, degree), _powers(y / scale, degree)
        return [
            _monomials(in_x, in_y, degree, order) @ self.coefficients / scale ** sum(order)
            for order in orders
        ]


def monomials(x: Floats, y: Floats, degree: int) -> Floats:
    """Monomials at places x, y (n,) in units of the jet's scale: (n, m), as in a jet."""
    return _monomials(_powers(x, degree), _powers(y, degree), degree, (0, 0))


def _monomials(in_x: Floats, in_y: Floats, degree: int, order: tuple[int, int]) -> Floats:
    """Monomials, differentiated so often by x and y: (n, m)."""
    of_x, of_y, factor = _exponents(degree, *order)
    product: Floats = in_x[:, of_x] * in_y[:, of_y]
    return product if order == (0, 0) else product * factor


@cache
def _exponents(degree: int, by_x: int, by_y: int) -> tuple[Ints, Ints, Floats]:
    """Exponents of x and y in each differentiated monomial, and its factor."""
    pairs = [(total - power, power) for total in range(degree + 1) for power in range(total + 1)]
    of_x, of_y = np.array(pairs).T
    factor = [float(math.perm(i, by_x) * math.perm(j, by_y)) for i, j in pairs]
    return np.maximum(of_x - by_x, 0), np.maximum(of_y - by_y, 0), np.array(factor)


def _powers(x: Floats, degree: int) -> Floats:
    """Powers of x (n,) from 0 to `degree`, (n, degree + 1); by multiplication, not by pow."""
    powers: Floats = np.ones((len(x), degree + 1))
    powers[:, 1:] = x[:, None]
    np.cumprod(powers, axis=1, out=powers)
    return powers


def taylor_coefficients(x: float, y: float, scale: float) -> Floats:
    """Matrix (6, 6) from value and derivatives at a place [m] to coefficients of a quadric.

    Derivatives are z_x, z_y, z_xx, z_xy, z_yy; coefficients as of a `Jet` with this `scale` [m].
    """
    shifted: Floats = np.array(
        [
            [1.0, -x, -y, 0.5 * x * x, x * y, 0.5 * y * y],
            [0.0, 1.0, 0.0, -x, -y, 0.0],
            [0.0, 0.0, 1.0, 0.0, -x, -y],
            [0.0, 0.0, 0.0, 0.5, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.5],
        ]
    )
    units: Floats = np.array([1.0, scale, scale, scale**2, scale**2, scale**2])
    return shifted * units[:, None]
