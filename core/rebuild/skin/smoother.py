"""Smoothing of values on a grid, along and around, each as strongly as the values ask for.

The smoother is the product of one along and one around; in the bases in which each is diagonal
(see `demmler_reinsch`), every pair of strengths is judged by sums alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from palpate.core.arrays import Floats, finite_array
from palpate.core.splines.demmler_reinsch import Modes, demmler_reinsch

STRENGTHS = 61
"""Strengths that are tried along each axis."""
WEAKEST, STRONGEST = 1e-6, 1e4
"""Times the stiffness of the stiffest mode, and of the most yielding one: from leaving values as
they are to leaving nothing that bends."""
LEAST_SPARE = 1e-9
"""Share of the freedom that is taken as left where caution allows none: never the best score."""
FLAT = 1e-12
"""Stiffness, over the mean, of what does not bend."""


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """One way along a grid, prepared for any values."""

    modes: Modes
    """Its modes."""
    roots: Floats
    """Roots of the weights of its lines, (m,)."""
    weight: Floats
    """Quadratic form of the fit, over its mean diagonal, (n, n)."""
    bending: Floats
    """Quadratic form of the penalty, in the same measure, (n, n)."""
    strengths: Floats
    """Those that are tried, (s,), rising."""

    def condition(self, strength: float) -> float:
        """Condition number of the matrix from coefficients to values and bending."""
        seen = np.linalg.eigvalsh(self.weight + strength * self.bending)
        return float(np.sqrt(seen[-1] / max(seen[0], np.finfo(float).eps * seen[-1])))


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """Values on a grid, smoothed."""

    along: Axis
    """The first axis."""
    around: Axis
    """The second one."""
    parts: Floats
    """What the modes hold of the values, (d, r, q)."""
    kept: Floats
    """Share of each that was kept, (r, q)."""
    strengths: tuple[float, float]
    """Along and around, against the mean weight of the values."""
    spare: float
    """Values less degrees of freedom, of each component."""
    freedom: float
    """Degrees of freedom spent on each component."""
    sigma: float
    """Estimate of the noise: standard deviation of one component."""
    score: float
    """By which the strengths were chosen; the least is the best among fits of the same values."""

    @property
    def coefficients(self) -> Floats:
        """(n, k, d), for the bases along and around."""
        control = self.along.modes.control @ (self.kept * self.parts)
        return np.ascontiguousarray((control @ self.around.modes.control.T).transpose(1, 2, 0))

    @property
    def fitted(self) -> Floats:
        """The smoothed values, (m, l, d)."""
        values = self.along.modes.shapes @ (self.kept * self.parts) @ self.around.modes.shapes.T
        roots = self.along.roots[:, None] * self.around.roots
        return np.ascontiguousarray((values / roots).transpose(1, 2, 0))

    @property
    def condition(self) -> float:
        """Condition number of the whole system: the product of those along and around."""
        along, around = self.strengths
        return self.along.condition(along) * self.around.condition(around)

    @property
    def missed(self) -> Floats:
        """By how much each line along, smoothed around, is foretold wrongly by the others, (m,).

        Root of its sum of squares, from the modes alone: all there is where each line has a
        coefficient of its own. The strengths stay what they are.
        """
        (lost,) = self.along.modes.lost(np.array(self.strengths[:1]))
        (held,) = self.around.modes.kept(np.array(self.strengths[1:]))
        shapes = self.along.modes.shapes
        residual = shapes @ (lost[:, None] * self.parts * held)
        free = np.square(shapes) @ lost * self.along.roots
        size = np.sqrt(np.square(residual).sum(axis=(0, 2)))
        missed: Floats = size / np.maximum(free, np.finfo(float).tiny)
        return missed

    def variance(self, along: csr_array, around: csr_array) -> Floats:
        """Posterior variance of a component over that of the noise, (a, b).

        Parameters
        ----------
        along, around : (a, n), (b, k) sparse arrays
            Bases at the places that are asked for.

        Notes
        -----
        Wahba, *Bayesian confidence intervals for the cross-validated smoothing spline*, 1983.
        """
        rows = np.square(along @ self.along.modes.control)
        columns = np.square(around @ self.around.modes.control)
        variance: Floats = rows @ self.kept @ columns.T
        return variance


def smoothing_axis(basis: Floats, root: Floats, weights: Floats | None = None) -> Axis:
    """Prepare one axis of a grid.

    Parameters
    ----------
    basis : (m, n) array
        Basis functions at the grid's m lines.
    root : (r, n) array
        Root of the penalty.
    weights : (m,) array, optional
        Of the lines; 1 if left out.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is not finite, or a weight is not positive.
    """
    basis = finite_array("basis", basis, (None, None))
    count = basis.shape[1]
    root = finite_array("root", root, (None, count))
    weights = np.ones(len(basis)) if weights is None else weights
    weights = finite_array("weights", weights, (len(basis),))
    if not (weights > 0.0).all():
        raise ValueError(f"weights must be positive, got {weights.min():g}")
    roots = np.sqrt(weights)
    weighted = roots[:, None] * basis
    weight, bending = _measured(weighted), _measured(root)
    modes = demmler_reinsch(weight, bending, weighted)
    stiff = modes.stiffness[modes.stiffness > FLAT]
    weakest, strongest = (WEAKEST / stiff.max(), STRONGEST / stiff.min()) if len(stiff) else (1, 1)
    return Axis(modes, roots, weight, bending, np.geomspace(weakest, strongest, STRENGTHS))


def smooth(
    values: Floats, along: Axis, around: Axis, *, noise: float | None = None, caution: float = 1.0
) -> Smoothed:
    """Smooth values on a grid.

    Parameters
    ----------
    values : (m, l, d) array
        d components at each place.
    along, around : Axis
        Prepared for m and l lines.
    noise : float or None
        Standard deviation of a component, if it is known: the strengths are those of the least
        expected error; otherwise those of generalised cross-validation.
    caution : float
        Of cross-validation: how much a degree of freedom counts, at least 1. More than 1 guards
        against following noise that neighbours share, at the price that values cannot be
        passed; of 1.2, up to five sixths of them are spent.

    Raises
    ------
    ValueError
        If the shape does not fit the axes, a value is not finite, the noise is negative or not
        finite, or the caution is below 1.

    Notes
    -----
    Craven and Wahba, *Smoothing noisy data with spline functions*, 1979, for both at once;
    caution: Kim and Gu, *Smoothing spline Gaussian regression*, 2004. Nothing
    is subtracted from almost the same, so that the score has its limit (of leaving one out)
    where as many degrees of freedom are spent as there are values.
    """
    lines = len(along.roots), len(around.roots)
    values = finite_array("values", values, (*lines, None))
    if noise is not None and not 0.0 <= noise < np.inf:
        raise ValueError(f"noise must be 0 or more and finite, got {noise}")
    if not 1.0 <= caution < np.inf:
        raise ValueError(f"caution must be at least 1 and finite, got {caution}")
    weighted = along.roots[:, None] * around.roots * values.transpose(2, 0, 1)
    parts = along.modes.shapes.T @ weighted @ around.modes.shapes
    beyond = weighted - along.modes.shapes @ parts @ around.modes.shapes.T
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


def _trials(along: Axis, around: Axis, squares: Floats) -> tuple[Floats, Floats]:
    """Squared residuals, and freedom not spent, within the modes for all pairs of strengths.

    With a and b kept along and around, p and q lost, ``1 - a b = p + a q``.
    """
    a, p = along.modes.kept(along.strengths), along.modes.lost(along.strengths)
    b, q = around.modes.kept(around.strengths), around.modes.lost(around.strengths)
    residual = (p**2 @ squares).sum(axis=1)[:, None] + 2.0 * (p * a) @ squares @ q.T
    residual += a**2 @ squares @ (q**2).T
    spare = p.sum(axis=1)[:, None] * b.shape[1] + a.sum(axis=1)[:, None] * q.sum(axis=1)
    return residual, spare


def _measured(root: Floats) -> Floats:
    """The quadratic form of a root, over its mean diagonal."""
    form = root.T @ root
    mean = np.trace(form) / len(form)
    measured: Floats = form / mean if mean > 0.0 else form
    return measured
