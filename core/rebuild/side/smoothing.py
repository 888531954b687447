"""Smoothing of values on a grid, and what may be wrong between its lines.

The smoother is the product of one along and one around; in the bases in which each is diagonal
(see `demmler_reinsch`), every pair of strengths is judged by sums alone. Each penalty is given
by a root, a matrix whose product with the coefficients has the penalty as its sum of squares. A
smoother knows its noise, not what happens where nobody touched: each contour is predicted from
its neighbours, and by how much it misses, less the noise, is what a surface may miss at about
twice the spacing; how that grows with the spacing tells how much of it is left at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from palpate.core.arrays import Floats, finite_array
from palpate.core.rebuild.contours import neighbour_weights
from palpate.core.splines import Modes, demmler_reinsch

STRENGTHS = 61  # Strengths that are tried along each axis
# Times the stiffness of the stiffest mode, and of the most yielding one: from leaving values as
# they are to leaving nothing that bends.
WEAKEST, STRONGEST = 1e-6, 1e4
LEAST_SPARE = 1e-9  # Share of freedom left where caution allows none: never the best score
FLAT = 1e-12  # Stiffness, over the mean, of what does not bend
NEAR = 0.2  # Width around a contour over which its misses are averaged, rad
DECAYING = 9  # Contours from which on the decay with the spacing is measured
DECAY, LEAST_DECAY, MOST_DECAY = 0.4, 0.1, 0.7  # Of a miss at half the spacing: by default, limits
WORST = 0.25  # Share of the contours, those missed most, by which the decay is measured
# Of more contours than so many it counts less, in proportion, for the surface agrees with them over
# more than two spacings; and how much at least. Set on shapes of several kinds, such that 95 of 100
# points lie in the band of 95 %.
FEW, LEAST_TRUST = 9, 1 / 3


@dataclass(frozen=True, slots=True, eq=False)
class SmoothingAxis:
    """One way along a grid, prepared for any values."""

    modes: Modes  # Its modes
    weight: Floats  # Quadratic form of the fit, over its mean diagonal, (n, n)
    bending: Floats  # Quadratic form of the penalty, in the same measure, (n, n)
    strengths: Floats  # Those that are tried, (s,), rising

    def condition(self, strength: float) -> float:
        """Condition number of the matrix from coefficients to values and bending."""
        seen = np.linalg.eigvalsh(self.weight + strength * self.bending)
        return float(np.sqrt(seen[-1] / max(seen[0], np.finfo(float).eps * seen[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Values on a grid, smoothed."""

    along: SmoothingAxis  # The first axis
    around: SmoothingAxis  # The second one
    parts: Floats  # What the modes hold of the values, (d, r, q)
    kept: Floats  # Share of each that was kept, (r, q)
    strengths: tuple[float, float]  # Along and around, against the mean weight of the values
    spare: float  # Values less degrees of freedom, of each component
    freedom: float  # Degrees of freedom spent on each component
    sigma: float  # Estimate of the noise: standard deviation of one component
    score: float  # By which the strengths were chosen; the least is best for the same values

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
        """By how much each line along is predicted wrongly by the others, (m,)."""
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


def smoothing_axis(basis: Floats, root: Floats) -> SmoothingAxis:
    """Prepare one axis of a grid.

    By basis functions (m, n) at its lines, and the root (r, n) of the penalty.
    """
    weight, bending = _measured(basis), _measured(root)
    modes = demmler_reinsch(weight, bending, basis)
    stiff = modes.stiffness[modes.stiffness > FLAT]
    weakest, strongest = (WEAKEST / stiff.max(), STRONGEST / stiff.min()) if len(stiff) else (1, 1)
    return SmoothingAxis(modes, weight, bending, np.geomspace(weakest, strongest, STRENGTHS))


def _measured(root: Floats) -> Floats:
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
) -> Smoothed:
    """Smooth values (m, l, d) on a grid: d components at each crossing of m and l lines.

    `noise` is the standard deviation of a component, if it is known: the strengths are then those
    of the least expected error, otherwise those of generalised cross-validation (Craven and Wahba,
    *Smoothing noisy data with spline functions*, 1979, for both at once). There, `caution` is how
    much a degree of freedom counts, at least 1: more guards against following noise that neighbours
    share, at the price that values cannot be passed; of 1.2, up to five sixths of them are spent
    (Kim and Gu, *Smoothing spline Gaussian regression*, 2004). Nothing is subtracted from almost
    the same, so that the score has its limit (of leaving one out) where as many degrees of freedom
    are spent as there are values. Raises ValueError if the shape does not fit the axes, a value is
    not finite, the noise is negative or not finite, or the caution is below 1.
    """
    lines = len(along.modes.shapes), len(around.modes.shapes)
    values = finite_array("values", values, (*lines, None))
    if noise is not None and not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must be 0 or more and finite, got {noise}")
    if not 1.0 <= caution < np.inf:
        raise ValueError(f"caution must be at least 1 and finite, got {caution}")
    grids = values.transpose(2, 0, 1)
    parts = along.modes.shapes.T @ grids @ around.modes.shapes
    beyond = grids - along.modes.shapes @ parts @ around.modes.shapes.T
    squares, spare = _trials(along, around, np.square(parts).sum(axis=0))
    squares += np.square(beyond).sum()
    spare += lines[0] * lines[1] - parts[0].size
    if noise is None:
        sparing = spare - (caution - 1.0) * (lines[0] * lines[1] - spare)
        scores = squares / np.square(np.maximum(sparing, LEAST_SPARE * spare))
    else:
        scores = squares / len(parts) - 2.0 * noise**2 * spare
    first, second = np.unravel_index(np.argmin(scores), scores.shape)
    strengths = float(along.strengths[first]), float(around.strengths[second])
    kept = along.modes.kept(np.array(strengths[:1])).T * around.modes.kept(np.array(strengths[1:]))
    left = float(spare[first, second])
    return Smoothed(
        along=along,
        around=around,
        parts=parts,
        kept=kept,
        strengths=strengths,
        spare=left,
        freedom=lines[0] * lines[1] - left,
        sigma=float(np.sqrt(squares[first, second] / (len(parts) * left))),
        score=float(scores[first, second]),
    )


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
    """Squares of what a surface may miss between contours."""

    sites: Floats  # Parameters of the contours along the axis, rising, (m,)
    squares: Floats  # Squared misses of each contour, noise taken off, at even turns, (m, k)
    share: float  # Of a miss that is to be expected midway between contours

    def variance(self, places: Floats, turns: Floats) -> Floats:
        """On a grid (a, b) of parameters and turns: 0 at contours, most midway."""
        count = len(self.sites)
        if count < 2:
            return np.zeros((len(places), len(turns)))
        squares = self.squares @ _nearby(turns, self.squares.shape[1]).T
        first = np.clip(np.searchsorted(self.sites, places) - 1, 0, count - 2)
        share = (places - self.sites[first]) / np.diff(self.sites)[first]
        inside = self.share**2 * np.clip(4.0 * share * (1.0 - share), 0.0, None)
        beyond = np.square(np.maximum(np.maximum(-share, share - 1.0), 0.0))
        worse = np.maximum(squares[first], squares[first + 1])
        outer = np.where((share > 1.0)[:, None], squares[first + 1], squares[first])
        return np.asarray(inside[:, None] * worse + beyond[:, None] * outer)


def between_contours(
    sites: Floats, contours: Floats, across: Floats, sigma: float
) -> BetweenContours:
    """Judge how far a surface through contours (m, k, 2), at even turns, can be trusted.

    At rising parameters `sites` (m,) along the axis; `across` (m, k, 2) are unit vectors across the
    contours, 0 where one is a point, and `sigma` is the standard deviation of the noise across.
    """
    one = _misses(sites, contours, across)
    width = contours.shape[1]
    nearby = _nearby(np.arange(width) / width, width)
    squares = np.maximum(one[0] @ nearby.T - one[1][:, None] * sigma**2, 0.0)
    trust = float(np.clip(FEW / len(sites), LEAST_TRUST, 1.0))
    decay = DECAY
    if len(sites) >= DECAYING:
        # The same from every other contour, at twice the spacing.
        twice = np.empty(contours.shape[:2]), np.empty(len(sites))
        for part in (slice(0, None, 2), slice(1, None, 2)):
            twice[0][part], twice[1][part] = _misses(sites[part], contours[part], across[part])
        decay = _decay(one, twice, sigma)
    return BetweenContours(sites, squares, trust * decay)


def _nearby(turns: Floats, count: int) -> Floats:
    """Weights (b, k) of even turns in an average about turns (b,)."""
    away = turns[:, None] - np.arange(count) / count
    angle = 2.0 * np.pi * (away - np.round(away))
    weights = np.exp(-0.5 * np.square(angle / NEAR))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _decay(one: tuple[Floats, Floats], two: tuple[Floats, Floats], sigma: float) -> float:
    """Miss at half the spacing over that at the whole, where they are largest."""
    inner = slice(2, -2)
    near, far = (
        np.maximum(squares[inner].mean(axis=1) - gain[inner] * sigma**2, 0.0)
        for squares, gain in (one, two)
    )
    worst = np.argsort(-near)[: max(3, int(WORST * len(near)))]
    if not far[worst].sum() > 0.0:
        return DECAY
    ratio = float(np.sqrt(near[worst].sum() / far[worst].sum()))
    return float(np.clip(ratio, LEAST_DECAY, MOST_DECAY))


def _misses(sites: Floats, contours: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Squared misses (m, k) of contours, predicted from neighbours, and their gain of noise."""
    weights = np.eye(2)[::-1] if len(sites) == 2 else neighbour_weights(sites)
    known = (weights != 0.0).any(axis=1)
    missed = np.tensordot(weights, contours, 1) - contours
    squares = np.square(np.einsum("mkd,mkd->mk", missed, across))
    return np.where(known[:, None], squares, 0.0), 1.0 + np.square(weights).sum(axis=1)
