"""The side surface as a spline, fitted to every felt taxel at once.

The squared distance q from the axis is a tensor product of a clamped spline along the height
and a periodic one around: squared, because q of an ellipsoid is a parabola with finite slope
at the poles, where the distance itself rises with an infinite one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.linalg.lapack import dpocon
from scipy.sparse import csr_array, diags_array, kron

from palpate.core.arrays import Floats
from palpate.core.rebuild.felt.felt_points import FeltPoints
from palpate.core.rebuild.felt.spine import Spine
from palpate.core.splines.basis import PeriodicBasis, clamped_basis

ALONG, AROUND = 32, 48
"""Coefficients along the height and around."""
STIFFNESS_ALONG, STIFFNESS_AROUND = 1e-5, 1e-5
"""Weight of squared second differences, relative to the data's mean weight."""
RIDGE = 1e-10
"""Bounds the condition of the system."""
LEAST_DISTANCE = 0.05
"""Least distance from the axis in a point's weight, as a share of the median."""
LEAST_FACING = 0.05
"""Least radial part of a normal: a point on a level face says nothing of the distance."""


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """A fitted side surface."""

    spine: Spine
    """Axis from which distances are taken."""
    low: float
    """Height at which the spline begins, m."""
    high: float
    """Height at which it ends, m."""
    coefficients: Floats
    """(along, around), m^2."""
    least: float
    """Smallest squared distance ever given, m^2."""
    rms: float
    """Root mean square normal distance of the points, m."""
    condition: float
    """Estimate of the system's condition number, to 2 digits."""
    factor: Floats
    """Cholesky factor of the system in the lower triangle; the upper one is of no meaning."""

    def squared(self, heights: Floats, turns: Floats) -> Floats:
        """Squared distance from the axis on a grid, (heights, turns), m^2."""
        along = clamped_basis(ALONG).matrix(self._local(heights))
        around = PeriodicBasis(AROUND).matrix(turns)
        squared: Floats = np.maximum((around @ (along @ self.coefficients).T).T, self.least)
        return squared

    def slope(self, height: float, turns: Floats) -> Floats:
        """Derivative of the squared distance by the height, (turns,), m."""
        along = clamped_basis(ALONG).matrix(self._local(np.array([height])), 1) @ self.coefficients
        result: Floats = PeriodicBasis(AROUND).matrix(turns) @ along[0] / (self.high - self.low)
        return result

    def deviation(self, heights: Floats, turns: Floats) -> Floats:
        """Root mean square over `turns` of the surface's standard deviation, (heights,), m.

        The posterior of the penalised fit (Wahba, *Bayesian confidence intervals*, 1983):
        noise and what the penalty lets move, not features narrower than the knots.
        """
        along = clamped_basis(ALONG).matrix(self._local(heights))
        rows = kron(along, PeriodicBasis(AROUND).matrix(turns)).toarray()
        spread = np.linalg.norm(solve_triangular(self.factor, rows.T, lower=True), axis=0)
        distance = np.sqrt(self.squared(heights, turns)).ravel()
        deviation = (self.rms * spread / (2.0 * distance)).reshape(len(heights), len(turns))
        pooled: Floats = np.sqrt(np.mean(deviation**2, axis=1))
        return pooled

    def _local(self, heights: Floats) -> Floats:
        local: Floats = np.clip((heights - self.low) / (self.high - self.low), 0.0, 1.0)
        return local


def fit_skin(felt: FeltPoints, spine: Spine, low: float, high: float) -> Skin:
    """Fit the side surface between two heights to felt points.

    Each point counts by its distance along its own normal: to first order that is the misfit
    of q, times the radial part of the normal, over twice the distance from the axis.

    Parameters
    ----------
    felt : FeltPoints
        Points and normals; those outside the heights, or on level faces, are left out.
    spine : Spine
        The axis.
    low, high : float
        Heights, m.

    Raises
    ------
    ValueError
        If no point is left.
    """
    away = felt.points[:, :2] - spine.at(felt.points[:, 2])
    distance = np.linalg.norm(away, axis=1)
    facing = np.einsum("ni,ni->n", felt.normals[:, :2], away) / np.maximum(distance, 1e-12)
    within = (felt.points[:, 2] >= low) & (felt.points[:, 2] <= high) & (facing > LEAST_FACING)
    if not within.any():
        raise ValueError(f"no felt point lies on the side between {low:g} and {high:g} m")
    away, distance, facing = away[within], distance[within], facing[within]
    turns = np.arctan2(away[:, 1], away[:, 0]) / (2.0 * np.pi)
    local = (felt.points[within, 2] - low) / (high - low)
    # Next to the axis the first order is worth nothing: no point counts more than those there.
    weights = facing / (2.0 * np.maximum(distance, LEAST_DISTANCE * np.median(distance)))
    basis = _tensor_rows(clamped_basis(ALONG).matrix(local), PeriodicBasis(AROUND).matrix(turns))
    rows = csr_array(diags_array(weights) @ basis)
    target = weights * distance**2
    system = _penalised(rows)
    factor, _ = cho_factor(system, lower=True)
    solution = cho_solve((factor, True), rows.T @ target)
    misfit = target - rows @ solution
    reciprocal, _ = dpocon(factor, np.abs(system).sum(axis=0).max(), uplo="L")
    return Skin(
        spine=spine,
        low=low,
        high=high,
        coefficients=solution.reshape(ALONG, AROUND),
        least=1e-6 * float(np.median(distance)) ** 2,
        rms=float(np.sqrt(np.mean(misfit**2))),
        # The last digits of the estimate differ from call to call; bodies must not.
        condition=float(f"{1.0 / max(float(reciprocal), np.finfo(float).tiny):.2g}"),
        factor=factor,
    )


def _penalised(rows: csr_array) -> Floats:
    """Normal matrix with the penalty: positive definite, its condition bounded by the ridge."""
    normal: Floats = (rows.T @ rows).toarray()
    scale = float(np.trace(normal)) / len(normal)
    return normal + scale * _penalty()


@cache
def _penalty() -> Floats:
    """Squared second differences along and around, and the ridge."""
    bend_along = np.diff(np.eye(ALONG), 2, axis=0)
    unit = np.eye(AROUND)
    bend_around = np.roll(unit, 1, axis=1) - 2.0 * unit + np.roll(unit, -1, axis=1)
    along = STIFFNESS_ALONG * np.kron(bend_along.T @ bend_along, unit)
    around = STIFFNESS_AROUND * np.kron(np.eye(ALONG), bend_around.T @ bend_around)
    penalty: Floats = along + around + RIDGE * np.eye(ALONG * AROUND)
    penalty.setflags(write=False)
    return penalty


def _tensor_rows(first: csr_array, second: csr_array) -> csr_array:
    """Row by row product of two sparse bases, (n, first columns * second columns)."""
    counts = np.diff(first.indptr)[0], np.diff(second.indptr)[0]
    n = first.shape[0]
    values = first.data.reshape(n, counts[0], 1) * second.data.reshape(n, 1, counts[1])
    columns = first.indices.reshape(n, counts[0], 1) * second.shape[1] + second.indices.reshape(
        n, 1, counts[1]
    )
    pointers = np.arange(0, n * counts[0] * counts[1] + 1, counts[0] * counts[1])
    shape = (n, first.shape[1] * second.shape[1])
    return csr_array((values.ravel(), columns.ravel(), pointers), shape=shape)
