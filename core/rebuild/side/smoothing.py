"""Smoothing of values on a grid, and the error of a surface between its lines.

The smoother is the product of one along and one around; in the bases in which each is diagonal
(see `demmler_reinsch`), every pair of strengths is scored by sums alone. Each penalty is given by a
root, a matrix whose product with the coefficients has the penalty as its sum of squares. A smoother
estimates the noise, but not the error of the surface between contours: for that, each contour is
predicted from its neighbours, and the error of the prediction, less the noise, is the surface's
error at about twice the spacing. The growth of the error with the spacing shows what part of it is
left at the spacing itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.contours import neighbour_weights
from palpate.core.splines import Modes, demmler_reinsch


@dataclass(frozen=True, slots=True, kw_only=True)
class SmoothingSettings:
    """Which strengths of smoothing are tried."""

    n_strengths: int = 61  # strengths that are tried on each axis, from least to largest
    # Strengths from one over the stiffest mode's stiffness, which leaves values unchanged, to one
    # over the most compliant mode's, which leaves nothing that bends.
    min_strength: float = 1e-6
    max_strength: float = 1e4
    flat_tolerance: float = 1e-12  # stiffness over the mean, up to which a mode does not bend
    min_spare: float = 1e-9  # fraction of the freedom left, if caution leaves less: a finite score


DEFAULT_SMOOTHING = SmoothingSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class BetweenSettings:
    """How the error between contours is estimated.

    The reduction by many contours was set on shapes of several kinds, such that 95 of 100 points
    lie in the band of 95 %.
    """

    azimuth_width: float = 0.2  # [rad] standard deviation of the average around a contour
    min_decay_contours: int = 9  # from which on the decay with the spacing is measured
    default_decay: float = 0.4  # error at half a spacing over that at it, with fewer contours
    min_decay: float = 0.1  # limits of a measured decay
    max_decay: float = 0.7
    worst_fraction: float = 0.25  # of the contours, with the largest errors, that measure it
    # With more contours the error is reduced by the factor `max_full_contours` over their number:
    # the surface then follows features over more than two spacings.
    max_full_contours: int = 9
    min_reduction: float = 1 / 3  # least factor


DEFAULT_BETWEEN = BetweenSettings()


@dataclass(frozen=True, slots=True, eq=False)
class SmoothingAxis:
    """One axis of a grid, prepared for any values."""

    modes: Modes
    weight: Floats  # quadratic form of the fit, over its mean diagonal, (n, n)
    bending: Floats  # quadratic form of the penalty, over its mean diagonal, (n, n)
    strengths: Floats  # strengths that are tried, (s,), rising

    def condition(self, strength: float) -> float:
        """Condition number of the matrix from coefficients to values and bending."""
        seen = np.linalg.eigvalsh(self.weight + strength * self.bending)
        return float(np.sqrt(seen[-1] / max(seen[0], np.finfo(float).eps * seen[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Values on a grid, smoothed."""

    along: SmoothingAxis  # first axis
    around: SmoothingAxis  # second axis
    parts: Floats  # components of the values in the modes, (d, r, q)
    kept: Floats  # fraction of each component that smoothing keeps, (r, q)
    strengths: tuple[float, float]  # along and around, over the mean weight of the values
    spare: float  # number of values less the degrees of freedom spent, of each component
    freedom: float  # degrees of freedom spent on each component
    sigma: float  # estimated standard deviation of one component
    score: float  # by which the strengths were chosen; the least is best for the same values

    @property
    def coefficients(self) -> Floats:
        """(n, k, d), for the bases along and around."""
        control = self.along.modes.control @ (self.kept * self.parts)
        return np.ascontiguousarray((control @ self.around.modes.control.T).transpose(1, 2, 0))

    @property
    def fitted(self) -> Floats:
        """The smoothed values, (m, l, d)."""
        values = self.along.modes.shapes @ (self.kept * self.parts) @ self.around.modes.shapes.T
        return np.ascontiguousarray(values.transpose(1, 2, 0))

    @property
    def condition(self) -> float:
        """Condition number of the whole system: the product of those along and around."""
        along, around = self.strengths
        return self.along.condition(along) * self.around.condition(around)

    @property
    def missed(self) -> Floats:
        """Error (m,) of each line along, predicted from the others (leave-one-out)."""
        (lost,) = self.along.modes.lost(np.array(self.strengths[:1]))
        (held,) = self.around.modes.kept(np.array(self.strengths[1:]))
        shapes = self.along.modes.shapes
        residual = shapes @ (lost[:, None] * self.parts * held)
        free = np.square(shapes) @ lost
        size = np.sqrt(np.square(residual).sum(axis=(0, 2)))
        return np.asarray(size / np.maximum(free, np.finfo(float).tiny))

    def variance(self, along: scipy.sparse.csr_array, around: scipy.sparse.csr_array) -> Floats:
        """Posterior variance of a component over that of the noise, (a, b).

        At places given by their bases along (a, n) and around (b, k). Wahba, *Bayesian confidence
        intervals for the cross-validated smoothing spline*, 1983.
        """
        rows = np.square(along @ self.along.modes.control)
        columns = np.square(around @ self.around.modes.control)
        return np.asarray(rows @ self.kept @ columns.T)


def smoothing_axis(
    basis: Floats, root: Floats, settings: SmoothingSettings = DEFAULT_SMOOTHING
) -> SmoothingAxis:
    """Prepare one axis of a grid.

    By basis functions (m, n) at its lines, and the root (r, n) of the penalty.
    """
    weight, bending = _normalised_form(basis), _normalised_form(root)
    modes = demmler_reinsch(weight, bending, basis)
    stiff = modes.stiffness[modes.stiffness > settings.flat_tolerance]
    limits = (1.0, 1.0)
    if len(stiff):
        limits = settings.min_strength / stiff.max(), settings.max_strength / stiff.min()
    return SmoothingAxis(modes, weight, bending, np.geomspace(*limits, settings.n_strengths))


def _normalised_form(root: Floats) -> Floats:
    """The quadratic form of a root, over its mean diagonal."""
    form = root.T @ root
    mean = np.trace(form) / len(form)
    return form / mean if mean > 0.0 else form


def smooth(
    values: Floats,
    along: SmoothingAxis,
    around: SmoothingAxis,
    *,
    noise: float | None = None,
    caution: float = 1.0,
    settings: SmoothingSettings = DEFAULT_SMOOTHING,
) -> Smoothed:
    """Smooth values (m, l, d) on a grid: d components at each crossing of m and l lines.

    `noise` is the standard deviation of a component, if it is known: the strengths are then those
    of the least expected error, otherwise those of generalised cross-validation (Craven and Wahba,
    *Smoothing noisy data with spline functions*, 1979, for both at once). There `caution` is the
    weight of a degree of freedom, at least 1: a larger one prevents following noise that neighbours
    share, but values cannot be passed; of 1.2, up to five sixths of them are spent (Kim and Gu,
    *Smoothing spline Gaussian regression*, 2004). Sums avoid cancellation, so that the score has
    its limit, that of leaving one out, where all degrees of freedom are spent. Raises ValueError if
    the shape does not fit the axes, a value is not finite, the noise is negative or not finite, or
    the caution is below 1.
    """
    lines = len(along.modes.shapes), len(around.modes.shapes)
    values = finite_array("values", values, (*lines, None))
    if noise is not None and not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must be 0 or more and finite, got {noise}")
    if not 1.0 <= caution < np.inf:
        raise ValueError(f"caution must be at least 1 and finite, got {caution}")
    grids = values.transpose(2, 0, 1)
    parts = along.modes.shapes.T @ grids @ around.modes.shapes
    rest = grids - along.modes.shapes @ parts @ around.modes.shapes.T
    squares, spare = _trials(along, around, np.square(parts).sum(axis=0))
    squares += np.square(rest).sum()
    count = lines[0] * lines[1]
    spare += count - parts[0].size
    if noise is None:
        scores = squares / np.square(_cautious_spare(spare, count, caution, settings.min_spare))
    else:
        scores = squares / len(parts) - 2.0 * noise**2 * spare
    best = np.unravel_index(np.argmin(scores), scores.shape)
    strengths = float(along.strengths[best[0]]), float(around.strengths[best[1]])
    kept = along.modes.kept(np.array(strengths[:1])).T * around.modes.kept(np.array(strengths[1:]))
    left = float(spare[best])
    return Smoothed(
        along,
        around,
        parts,
        kept,
        strengths,
        spare=left,
        freedom=count - left,
        sigma=float(np.sqrt(squares[best] / (len(parts) * left))),
        score=float(scores[best]),
    )


def _cautious_spare(spare: Floats, count: int, caution: float, min_spare: float) -> Floats:
    """Freedom left of `count` values, if each degree that is spent counts `caution` times."""
    left = spare - (caution - 1.0) * (count - spare)
    return np.asarray(np.maximum(left, min_spare * spare))


def _trials(along: SmoothingAxis, around: SmoothingAxis, squares: Floats) -> tuple[Floats, Floats]:
    """Squared residuals and freedom left for all pairs of strengths: ``1 - a b = p + a q``."""
    a, p = along.modes.kept(along.strengths), along.modes.lost(along.strengths)
    b, q = around.modes.kept(around.strengths), around.modes.lost(around.strengths)
    residual = (p**2 @ squares).sum(axis=1)[:, None] + 2.0 * (p * a) @ squares @ q.T
    residual += a**2 @ squares @ (q**2).T
    spare = p.sum(axis=1)[:, None] * b.shape[1] + a.sum(axis=1)[:, None] * q.sum(axis=1)
    return residual, spare


@dataclass(frozen=True, slots=True, eq=False)
class BetweenContours:
    """Squared error of a surface between contours."""

    sites: Floats  # parameters of the contours along the axis, rising, (m,)
    squares: Floats  # squared prediction errors of each contour, less noise, at even turns, (m, k)
    share: float  # ratio of the error midway between contours to the prediction error

    def variance(
        self, places: Floats, turns: Floats, settings: BetweenSettings = DEFAULT_BETWEEN
    ) -> Floats:
        """On a grid (a, b) of parameters and turns: 0 at contours, largest midway."""
        count = len(self.sites)
        if count < 2:
            return np.zeros((len(places), len(turns)))
        nearby = _nearby(turns, self.squares.shape[1], settings.azimuth_width)
        squares = self.squares @ nearby.T
        first = np.clip(np.searchsorted(self.sites, places) - 1, 0, count - 2)
        fraction = (places - self.sites[first]) / np.diff(self.sites)[first]
        inside = self.share**2 * np.clip(4.0 * fraction * (1.0 - fraction), 0.0, None)
        outside = np.square(np.maximum(np.maximum(-fraction, fraction - 1.0), 0.0))
        worse = np.maximum(squares[first], squares[first + 1])
        outer = np.where((fraction > 1.0)[:, None], squares[first + 1], squares[first])
        return np.asarray(inside[:, None] * worse + outside[:, None] * outer)


def between_contours(
    sites: Floats,
    contours: Floats,
    across: Floats,
    sigma: float,
    settings: BetweenSettings = DEFAULT_BETWEEN,
) -> BetweenContours:
    """Estimate the error between contours (m, k, 2), at even turns, of a surface through them.

    At rising parameters `sites` (m,) along the axis; `across` (m, k, 2) are unit vectors across the
    contours, 0 where one is a point, and `sigma` is the standard deviation of the noise across.
    """
    squares, gains = _prediction_errors(sites, contours, across)
    width = contours.shape[1]
    nearby = _nearby(np.arange(width) / width, width, settings.azimuth_width)
    own = np.maximum(squares @ nearby.T - gains[:, None] * sigma**2, 0.0)
    reduction = settings.max_full_contours / len(sites)
    reduction = float(np.clip(reduction, settings.min_reduction, 1.0))
    decay = settings.default_decay
    if len(sites) >= settings.min_decay_contours:
        # Prediction errors at twice the spacing: from every other contour.
        twice = np.empty(contours.shape[:2]), np.empty(len(sites))
        for part in (slice(0, None, 2), slice(1, None, 2)):
            errors = _prediction_errors(sites[part], contours[part], across[part])
            twice[0][part], twice[1][part] = errors
        decay = _decay((squares, gains), twice, sigma, settings)
    return BetweenContours(sites, own, reduction * decay)


def _nearby(turns: Floats, count: int, width: float) -> Floats:
    """Weights (b, k) of even turns in an average of a width [rad] about turns (b,)."""
    away = turns[:, None] - np.arange(count) / count
    angle = 2.0 * np.pi * (away - np.round(away))
    weights = np.exp(-0.5 * np.square(angle / width))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _decay(
    at_once: tuple[Floats, Floats],
    at_twice: tuple[Floats, Floats],
    sigma: float,
    settings: BetweenSettings,
) -> float:
    """Ratio of the error at the spacing to that at twice the spacing, where it is largest."""
    inner = slice(2, -2)
    near, far = (
        np.maximum(squares[inner].mean(axis=1) - gains[inner] * sigma**2, 0.0)
        for squares, gains in (at_once, at_twice)
    )
    worst = np.argsort(-near)[: max(3, int(settings.worst_fraction * len(near)))]
    if not far[worst].sum() > 0.0:
        return settings.default_decay
    ratio = float(np.sqrt(near[worst].sum() / far[worst].sum()))
    return float(np.clip(ratio, settings.min_decay, settings.max_decay))


def _prediction_errors(sites: Floats, contours: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Squared prediction errors (m, k) of contours, and their noise variance (m,) over sigma^2."""
    weights = np.eye(2)[::-1] if len(sites) == 2 else neighbour_weights(sites)
    known = (weights != 0.0).any(axis=1)
    errors = np.tensordot(weights, contours, 1) - contours
    squares = np.square(np.einsum("mkd,mkd->mk", errors, across))
    return np.where(known[:, None], squares, 0.0), 1.0 + np.square(weights).sum(axis=1)
