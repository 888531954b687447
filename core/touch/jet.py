"""Jets, local polynomials, fitted to the touched taxels: least squares by QR, with errors.

Cazals and Pouget, *Estimating differential quantities using polynomial fitting*, 2005. The
monomials are ordered by degree, so that one factorisation contains those of all lower degrees as
its leading blocks. It depends only on which taxels are touched: the latest ones are cached.
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

N_COEFFICIENTS = (1, 3, 6, 10, 15)  # of a polynomial of each degree
# Orders of differentiation by x and y of z, z_x, z_y, z_xx, z_xy, z_yy.
DERIVATIVE_ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class JetSettings:
    """Degree of a jet for a number of taxels: about three for each coefficient.

    Below 8 taxels a slope cannot be distinguished from a corner.
    """

    min_taxels: tuple[int, ...] = (8, 12, 30, 45)  # for degrees 1, 2, ...
    # Least root mean square, over the touched taxels, of a monomial's part that is independent of
    # the lower ones. Dependent ones leave 1e-16 by rounding, the smallest contact leaves 1e-3.
    min_independent: float = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustJetSettings:
    """Iteration of a robust jet with Tukey's weights."""

    max_sigmas: float = 4.685  # of a taxel with weight; 95 % efficient for normal noise
    max_rounds: int = 8  # of reweighting
    weight_tolerance: float = 1e-3  # smaller changes of all weights end the rounds


DEFAULT_JET = JetSettings()


class JetFit(NamedTuple):
    """A jet, its derivatives at the middle of the contact, and their errors."""

    jet: Jet
    middle: tuple[float, float, float]  # [m] mean x, y of touched taxels, the jet's height there
    derivatives: Floats  # z_x, z_y [1], z_xx, z_xy, z_yy [1/m] at the middle, (5,)
    # Square root of the derivatives' covariance for unit noise, (5, m): the covariance is
    # ``deviation**2 * factor @ factor.T``.
    derivative_factor: Floats
    factor: Floats  # the same for the coefficients, (m, m)
    misfit: Floats  # height less jet at the touched taxels, in the order of the mask, (n,) [m]
    residual: float  # [m] root mean square misfit of the taxels with weight
    deviation: float  # [m] noise of a taxel of weight 1, from the misfit and degrees of freedom
    weights: Floats | None  # from 0 to 1 for each touched taxel, (n,); None if all are equal


def fit_jet(
    pad: Pad,
    height: Floats,
    touched: Bools,
    noise: float | None = None,
    settings: JetSettings = DEFAULT_JET,
) -> JetFit | None:
    """Jet of the touched taxels.

    `height` (rows, cols): surface over the plane of the pad's face [m]. `touched` (rows, cols) of
    bool: taxels to fit. `noise`: standard deviation of one taxel [m], or less; with it the cubic
    and the quartic part are shrunk by the share that noise explains. None if fewer than 8 taxels
    are touched, or they lie on a line. The degree follows the number of taxels, and is lowered
    where the powers of one degree are dependent on them, as on two rows. A quartic follows a tight
    curve and a quadric is steadier on a flat one; shrinking by James and Stein, *Estimation with
    quadratic loss*, 1961, is between the two on any surface, and over all coefficients on average
    nowhere worse than the quartic.
    """
    design = jet_design(pad.rows, pad.cols, pad.pitch, touched.tobytes(), settings)
    if design is None:
        return None
    z = height.ravel()
    if design.places.size < z.size:
        z = z[design.places]
    inner = z @ design.basis
    misfit = z - design.basis @ inner
    squares, count, m = float(misfit @ misfit), len(z), len(inner)
    deviation, outer = math.sqrt(squares / max(count - m, 1)), design.outer
    if noise is not None and m > N_COEFFICIENTS[2]:
        shares = _shares(inner, max(noise, deviation))
        inner, outer = inner * shares, outer * np.sqrt(shares)
        misfit = z - design.basis @ inner
        squares = float(misfit @ misfit)
    result = design.outer @ inner
    return JetFit(
        jet=Jet(result[:m], design.scale),
        middle=(*design.middle, float(result[m])),
        derivatives=result[m + 1 :],
        derivative_factor=outer[m + 1 :],
        factor=outer[:m],
        misfit=misfit,
        residual=math.sqrt(squares / count),
        deviation=deviation,
        weights=None,
    )


def fit_robust_jet(
    pad: Pad,
    height: Floats,
    touched: Bools,
    min_deviation: float,
    start: Floats | None = None,
    robust: RobustJetSettings = RobustJetSettings(),
    settings: JetSettings = DEFAULT_JET,
) -> JetFit | None:
    """Jet of the touched taxels that gives no weight to outliers.

    `min_deviation`: lower bound of the noise [m]; with 0, a noise-free frame would lose all taxels
    that a polynomial misses. `start` (rows, cols): initial weights; None for equal ones. None if
    fewer than 8 taxels are touched, or they lie on a line. Tukey's biweight, with the scale from
    the median absolute misfit; Beaton and Tukey, *The fitting of power series*, 1974.
    """
    design = jet_design(pad.rows, pad.cols, pad.pitch, touched.tobytes(), settings)
    if design is None:
        return None
    z = height.ravel()[design.places]
    before = np.ones(len(z)) if start is None else start.ravel()[design.places]
    fit = _weighted(design, z, before, settings)
    if fit is None:  # the initial weights leave too few taxels
        before = np.ones(len(z))
        fit = fit_jet(pad, height, touched, None, settings)
    for _ in range(robust.max_rounds):
        if fit is None:
            break
        spread = max(scaled_mad(fit.misfit[before > 0.0]), min_deviation)
        weights = before
        if spread > 0.0:  # Tukey's biweight
            share = np.maximum(1.0 - (fit.misfit / spread / robust.max_sigmas) ** 2, 0.0)
            weights = share * share
        fit = _weighted(design, z, weights, settings) or fit
        if np.abs(weights - before).max() < robust.weight_tolerance:
            break
        before = weights
    return fit


def _weighted(
    design: JetDesign, z: Floats, weights: Floats, settings: JetSettings
) -> JetFit | None:
    """Weighted jet; its degree is lowered if the weights leave too few taxels."""
    count = int(np.count_nonzero(weights))
    root = np.sqrt(weights)
    basis, triangle = qr_factors(design.monomials * root[:, None])
    degree = min(supported_degree(count, settings), N_COEFFICIENTS.index(len(triangle)))
    degree = identifiable_degree(triangle, degree, count, settings)
    if degree == 0:
        return None
    m = N_COEFFICIENTS[degree]
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
    """Fraction of each coefficient over Q that is kept: James and Stein, degree by degree.

    Coefficients of one degree are shrunk together, so that the result does not depend on how the
    pad is turned. By Bayes's rule with a prior from the coefficients themselves, their variance
    shrinks by the same fraction.
    """
    shares = np.ones(len(inner))
    for lower, upper in pairwise(N_COEFFICIENTS[2:]):
        part = inner[lower:upper]
        if len(part):
            size = float(part @ part)
            loss = (len(part) - 2) * noise * noise
            shares[lower:upper] = max(1.0 - loss / size, 0.0) if size > 0.0 else 0.0
    return shares


class JetDesign(NamedTuple):
    """Factorised monomials over the touched taxels."""

    places: Ints  # indices of the touched taxels in the flattened array, (n,)
    middle: tuple[float, float]  # [m] their mean place
    scale: float  # [m] half the width of the pad
    monomials: Floats  # (n, m)
    basis: Floats  # orthonormal columns Q of the factorisation Q R, (n, m)
    rows: Floats  # matrix (6, m) from coefficients to height and derivatives at the middle
    outer: Floats  # matrix (m + 6, m) from coefficients over Q to those of a jet, then to `rows`


@lru_cache(maxsize=32)  # 70 kB each
def jet_design(
    rows: int, cols: int, pitch: float, touched: bytes, settings: JetSettings = DEFAULT_JET
) -> JetDesign | None:
    """Design of the touched taxels, by their mask's bytes; None if they bear no plane."""
    places = np.flatnonzero(np.frombuffer(touched, np.bool_)).astype(np.int32)
    degree = supported_degree(len(places), settings)
    if degree == 0:
        return None
    x, y, all_over = _whole_pad(rows, cols)
    there = all_over[places, : N_COEFFICIENTS[degree]]
    basis, triangle = qr_factors(there)
    degree = identifiable_degree(triangle, degree, len(places), settings)
    if degree == 0:
        return None
    m, scale = N_COEFFICIENTS[degree], 0.5 * pitch * cols
    if m < len(triangle):
        there, basis = there[:, :m].copy(), basis[:, :m].copy()
    at_x, at_y = float(x[places].mean()), float(y[places].mean())
    derive = derivative_rows(at_x, at_y, degree) * _units(scale)
    inverse = np.linalg.inv(triangle[:m, :m])
    outer = np.concatenate([inverse, derive @ inverse])
    return JetDesign(places, (at_x * scale, at_y * scale), scale, there, basis, derive, outer)


def supported_degree(count: float, settings: JetSettings = DEFAULT_JET) -> int:
    """Highest degree that a number of taxels bears; 0 if not even a plane."""
    return sum(count >= least for least in settings.min_taxels)


@cache
def _whole_pad(rows: int, cols: int) -> tuple[Floats, Floats, Floats]:
    """Places (n,) of all taxels, in halves of the pad's width, and their monomials."""
    row, col = np.divmod(np.arange(rows * cols), cols)
    x, y = (2.0 * col - (cols - 1)) / cols, (2.0 * row - (rows - 1)) / cols
    return x, y, monomials(x, y, len(N_COEFFICIENTS) - 1)


def qr_factors(matrix: Floats) -> tuple[Floats, Floats]:
    """Q and R; LAPACK is twice as fast on contiguous columns."""
    basis, triangle = np.linalg.qr(np.asfortranarray(matrix))
    return basis, triangle


def identifiable_degree(
    triangle: Floats, degree: int, count: float, settings: JetSettings = DEFAULT_JET
) -> int:
    """Highest degree whose monomials are independent on the taxels; 0 if not even a plane."""
    independent = np.abs(triangle.diagonal()) > settings.min_independent * math.sqrt(count)
    while degree and not independent[: N_COEFFICIENTS[degree]].all():
        degree -= 1
    return degree


def derivative_rows(x: float, y: float, degree: int) -> Floats:
    """Matrix (6, m) from coefficients to z, z_x, z_y, z_xx, z_xy, z_yy, in the jet's scale."""
    of_x, of_y, factor = _up_to_second(degree)
    in_x = np.array([x**power for power in range(degree + 1)])
    in_y = np.array([y**power for power in range(degree + 1)])
    rows: Floats = in_x[of_x] * in_y[of_y] * factor
    return rows


@cache
def _up_to_second(degree: int) -> tuple[Ints, Ints, Floats]:
    """Exponents and factors of the height and its five derivatives, (6, m) each."""
    six = [_exponents(degree, *order) for order in DERIVATIVE_ORDERS]
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

    coefficients: Floats  # [m] by total degree, then power of y: 1, x, y, x^2, xy, y^2, ...
    scale: float  # [m] by which x and y are divided

    def height(self, x: Floats, y: Floats) -> Floats:
        """Height [m] at places x, y (n,)."""
        return self._derivatives(x, y, (0, 0))[0]

    def slopes(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Slopes dz/dx and dz/dy at places x, y (n,)."""
        by_x, by_y = self._derivatives(x, y, (1, 0), (0, 1))
        return by_x, by_y

    def second_derivatives(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Derivatives z_xx, z_xy and z_yy [1/m] at places x, y (n,)."""
        by_xx, by_xy, by_yy = self._derivatives(x, y, (2, 0), (1, 1), (0, 2))
        return by_xx, by_xy, by_yy

    @property
    def degree(self) -> int:
        """Total degree of the polynomial."""
        return N_COEFFICIENTS.index(len(self.coefficients))

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
    """Monomials, differentiated `order` times by x and y: (n, m)."""
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
